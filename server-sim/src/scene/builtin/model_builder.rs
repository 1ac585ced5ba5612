//! Builds the models of the built-in scenes: places shapes, animates nodes, and makes closed paths.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Vec3};

use super::DURATION_S;
use super::solid::Solid;
use crate::scene::animation::{Curve, Interpolation, Property};
use crate::scene::camera::{CameraKey, CameraPath};
use crate::scene::material::Material;
use crate::scene::model::{AnimationClip, Channel, LocalTransform, Model};

/// A model under construction.
pub(super) struct ModelBuilder {
    pub(super) model: Model,
    /// An opaque, single-sided material.
    pub(super) plain: usize,
    /// An opaque, double-sided material.
    pub(super) thin: usize,
    clip: usize,
}

impl ModelBuilder {
    pub(super) fn new() -> Self {
        let mut model = Model::default();
        let named = |name: &str, double_sided| Material {
            name: name.to_owned(),
            double_sided,
            ..Material::default()
        };
        let (plain, thin) =
            (model.add_material(named("plain", false)), model.add_material(named("thin", true)));
        model.clips.push(AnimationClip { length_s: DURATION_S, speed: 1.0, phase_s: 0.0 });
        Self { model, plain, thin, clip: 0 }
    }

    /// Adds the mesh of a shape. Returns `None` if it has no surface.
    pub(super) fn add_mesh(&mut self, name: &str, solid: Solid, material: usize) -> Option<usize> {
        self.model.add_mesh(solid.raw(name), material)
    }

    /// Adds a translated node.
    pub(super) fn add_node(&mut self, parent: Option<usize>, x: f64, y: f64, z: f64) -> usize {
        self.model.add_node(parent, LocalTransform::at(DVec3::new(x, y, z)))
    }

    /// Adds a rotated and translated node.
    pub(super) fn add_turned_node(
        &mut self,
        parent: Option<usize>,
        turned: DMat3,
        x: f64,
        y: f64,
        z: f64,
    ) -> usize {
        self.model.add_node(parent, LocalTransform::rigid(DVec3::new(x, y, z), DQuat::from_mat3(&turned)))
    }

    /// Places a mesh at a node.
    pub(super) fn place_mesh(&mut self, name: &str, node: usize, mesh: Option<usize>) {
        if let Some(mesh) = mesh {
            self.model.add_mesh_node(name, node, mesh);
        }
    }

    /// Adds a shape that never moves.
    pub(super) fn add_static(&mut self, name: &str, solid: Solid, material: usize) {
        let mesh = self.add_mesh(name, solid, material);
        let node = self.add_node(None, 0.0, 0.0, 0.0);
        self.place_mesh(name, node, mesh);
    }

    /// Animates the rotation of a node over the clip in `keys` intervals of equal length. The ends of a closed loop
    /// must be equal.
    pub(super) fn animate_rotation(&mut self, node: usize, keys: u32, rotation: impl Fn(f64) -> DQuat) {
        let value = |time: f64| rotation(time).to_array().map(|v| v as f32).to_vec();
        self.drive(node, Property::Rotation, 4, keys, value);
    }

    /// Animates the translation of a node over the clip.
    pub(super) fn animate_translation(&mut self, node: usize, keys: u32, place: impl Fn(f64) -> DVec3) {
        self.drive(node, Property::Translation, 3, keys, |time| place(time).as_vec3().to_array().to_vec());
    }

    /// Animates the `width` morph weights of a node over the clip.
    pub(super) fn animate_morph_weights(
        &mut self,
        node: usize,
        width: usize,
        keys: u32,
        weights: impl Fn(f64) -> Vec<f32>,
    ) {
        self.drive(node, Property::Weights, width, keys, weights);
    }

    fn drive(
        &mut self,
        node: usize,
        property: Property,
        width: usize,
        keys: u32,
        value: impl Fn(f64) -> Vec<f32>,
    ) {
        let time = |k: u32| DURATION_S * f64::from(k) / f64::from(keys);
        let curve = Curve {
            interpolation: Interpolation::Linear,
            rotation: property == Property::Rotation,
            width,
            times: (0..=keys).map(|k| time(k) as f32).collect(),
            values: (0..=keys).flat_map(|k| value(time(k))).collect(),
        };
        self.model.channels.push(Channel {
            node,
            property,
            first: 0,
            clip: self.clip,
            curve: Arc::new(curve),
        });
    }
}

/// Returns a sine between -1 and 1 that closes with the clip: `cycles` whole cycles, `phase` in cycles.
pub(super) fn swing(time_s: f64, cycles: f64, phase: f64) -> f64 {
    libm::sin(TAU * (cycles * time_s / DURATION_S + phase))
}

/// Returns the rotation by an angle (radians) about a unit axis.
pub(super) fn about(axis: DVec3, angle: f64) -> DQuat {
    let (s, c) = (libm::sin(angle / 2.0), libm::cos(angle / 2.0));
    DQuat::from_xyzw(axis.x * s, axis.y * s, axis.z * s, c)
}

/// Returns a camera path through keys of time, eye and target.
pub(super) fn camera(fov_y_deg: f32, keys: &[(f64, [f32; 3], [f32; 3])]) -> CameraPath {
    let key = |&(time_s, eye, target): &(f64, [f32; 3], [f32; 3])| CameraKey {
        time_s,
        eye: Vec3::from_array(eye),
        target: Vec3::from_array(target),
        up: Vec3::Y,
    };
    CameraPath::new(fov_y_deg, keys.iter().map(key).collect())
}
