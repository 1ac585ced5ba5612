//! Builds the instances of a model: classifies them by their motion and brings their meshes to metric rest.

use std::sync::{Arc, OnceLock};

use glam::{DAffine3, DMat3, DVec3};

use crate::scene::deform::{self, to_f32};
use crate::scene::error::SceneError;
use crate::scene::hierarchy::NodeHierarchy;
use crate::scene::ids::{MeshId, RestId};
use crate::scene::instance::{Deformation, Deformer, Instance, InstancePose, Motion};
use crate::scene::limits;
use crate::scene::mesh::{Geometry, Mesh, RestMesh, area};
use crate::scene::model::{MeshNode, Model, Skin};
use crate::scene::needs::Needs;
use crate::scene::pose::{frame_of, has_area, place};
use crate::scene::report::SceneReport;
use crate::scene::rigid::{RigidFrame, nearly_equal, rotation_of, snapped};

/// Number of times at which the clip is sampled to classify the motion of an instance.
const TIME_SAMPLES: u32 = 97;
/// Relative difference up to which two stretches count as equal.
const STRETCH_TOLERANCE: f64 = 1e-5;

/// The instances of a model and everything that their poses require.
#[derive(Debug)]
pub(crate) struct SceneInstances {
    pub(crate) hierarchy: NodeHierarchy,
    pub(crate) instances: Vec<Instance>,
    pub(crate) rests: Vec<RestMesh>,
    pub(crate) report: SceneReport,
}

/// Builds the instances of a model.
pub(crate) fn build_instances(
    model: &Model,
    duration_s: f64,
    origin: &str,
) -> Result<SceneInstances, SceneError> {
    let too_many = |what, count, limit| SceneError::TooMany { origin: origin.to_owned(), what, count, limit };
    if model.mesh_nodes.len() > limits::MAX_INSTANCES {
        return Err(too_many("instances", model.mesh_nodes.len(), limits::MAX_INSTANCES));
    }
    if model.nodes.len() > limits::MAX_NODES {
        return Err(too_many("nodes", model.nodes.len(), limits::MAX_NODES));
    }
    let triangles: usize = model.mesh_nodes.iter().map(|p| model.meshes[p.mesh].triangles.len()).sum();
    if triangles > limits::MAX_TRIANGLES {
        return Err(too_many("triangles", triangles, limits::MAX_TRIANGLES));
    }
    let mut report = model.report.clone();
    let hierarchy = NodeHierarchy::new(model, &mut report);
    let times = (0..TIME_SAMPLES).map(|i| duration_s * f64::from(i) / f64::from(TIME_SAMPLES - 1));
    let samples: Vec<Vec<DAffine3>> = times
        .map(|time_s| {
            let mut worlds = Vec::new();
            hierarchy.evaluate(time_s, &mut worlds);
            worlds
        })
        .collect();
    let mut builder =
        InstanceBuilder { model, hierarchy, samples, instances: Vec::new(), rests: Vec::new(), report };
    for mesh_node in &model.mesh_nodes {
        builder.add(mesh_node, origin)?;
    }
    let InstanceBuilder { hierarchy, instances, rests, report, .. } = builder;
    if instances.is_empty() {
        return Err(SceneError::NoTriangles { origin: origin.to_owned() });
    }
    Ok(SceneInstances { hierarchy, instances, rests, report })
}

struct InstanceBuilder<'a> {
    model: &'a Model,
    hierarchy: NodeHierarchy,
    samples: Vec<Vec<DAffine3>>,
    instances: Vec<Instance>,
    rests: Vec<RestMesh>,
    report: SceneReport,
}

impl InstanceBuilder<'_> {
    fn add(&mut self, mesh_node: &MeshNode, origin: &str) -> Result<(), SceneError> {
        let mesh = &self.model.meshes[mesh_node.mesh];
        if self.hierarchy.always_hidden(self.hierarchy.index_of(mesh_node.node)) {
            self.report.hidden_instances += 1;
            return Ok(());
        }
        let mut instance = Instance {
            name: mesh_node.name.clone(),
            mesh: MeshId::at(mesh_node.mesh),
            rest: RestId(0),
            motion: Motion::Static,
            needs: self.material_needs(mesh),
            deformer: Deformer::Rest,
            frame_node: None,
            node: self.hierarchy.index_of(mesh_node.node),
            weights: mesh_node.weights.clone(),
            constant_frame: None,
        };
        let skin = mesh_node.skin.filter(|_| mesh.skin.is_some());
        let rest = match skin {
            Some(skin) => self.classify_skinned(&mut instance, mesh, &self.model.skins[skin]),
            None => self.classify(&mut instance, mesh),
        };
        let Some(rest) = rest else {
            self.report.collapsed_instances += 1;
            return Ok(());
        };
        // What comes and goes is not part of what stands still at all times.
        if instance.motion == Motion::Static && self.hierarchy.visibility_varies(instance.node) {
            instance.motion = Motion::Rigid;
        }
        let far = rest
            .geometry
            .positions
            .iter()
            .any(|p| !p.is_finite() || f64::from(p.length()) > limits::MAX_MAGNITUDE);
        if far || self.leaves_range(&instance) {
            return Err(SceneError::TooFar {
                origin: origin.to_owned(),
                instance: instance.name,
                limit_m: limits::MAX_MAGNITUDE,
            });
        }
        instance.rest = self.intern_rest(rest);
        self.instances.push(instance);
        Ok(())
    }

    /// Returns whether the frame or a joint exceeds the range of numbers at any sampled time.
    fn leaves_range(&self, instance: &Instance) -> bool {
        let near = |v: f32| f64::from(v.abs()) <= limits::MAX_MAGNITUDE;
        self.samples.iter().any(|worlds| {
            let mut pose =
                InstancePose { frame: RigidFrame::IDENTITY, deformation: Deformation::Rest, visible: true };
            place(&self.hierarchy, instance, 0.0, worlds, &mut pose);
            let joints = match &pose.deformation {
                Deformation::Skin { joints, .. } => joints.as_slice(),
                _ => &[],
            };
            !(pose.frame.translation.to_array().into_iter().all(near)
                && joints.iter().all(|joint| joint.0.into_iter().all(near)))
        })
    }

    fn material_needs(&self, mesh: &Mesh) -> Needs {
        let material = &self.model.materials[mesh.material.index()];
        let mut needs = Needs::NONE;
        if material.mask().is_some() && mesh.uvs.is_some() {
            needs |= Needs::MASKED;
        }
        if material.double_sided() {
            needs |= Needs::DOUBLE_SIDED;
        }
        if mesh.normal_uvs.is_some() {
            needs |= Needs::NORMAL_MAP;
        }
        needs
    }

    /// Classifies an instance without joints. Returns its rest, or `None` if it never has an area.
    fn classify(&self, instance: &mut Instance, mesh: &Mesh) -> Option<RestMesh> {
        let node = instance.node;
        let varies = self.hierarchy.varies(node);
        let morphs = !mesh.morphs.is_empty() && self.hierarchy.weights_vary(node);
        instance.frame_node = Some(node);
        if !varies {
            instance.constant_frame = Some(frame_of(&self.samples[0][node]));
        }
        let worlds =
            || self.samples.iter().map(|worlds| &worlds[node]).take(if varies { usize::MAX } else { 1 });
        let stretches: Vec<DMat3> = worlds()
            .map(|world| {
                rotation_of(world.matrix3).map_or(DMat3::ZERO, |turn| turn.transpose() * world.matrix3)
            })
            .collect();
        let largest = stretches.iter().max_by(|a, b| area_scale(**a).total_cmp(&area_scale(**b)));
        let stretch = snapped(*largest?);
        if !has_area(stretch) {
            return None;
        }
        let scales = stretches.iter().any(|s| !nearly_equal(*s, stretch, STRETCH_TOLERANCE * 10.0));
        let mut weights = Vec::new();
        if !mesh.morphs.is_empty() {
            self.hierarchy.weights(node, &instance.weights, 0.0, &mut weights);
        }
        if morphs {
            instance.deformer = Deformer::Morph;
            instance.motion = Motion::Deforming;
            instance.needs |= Needs::MORPH;
            weights.clone_from(&instance.weights);
        } else if scales {
            instance.deformer = Deformer::Affine;
            instance.motion = Motion::Deforming;
            // A scaled mesh with a constant morph requires its weights at every time.
            if !weights.is_empty() {
                instance.deformer = Deformer::Morph;
            }
        } else if varies {
            instance.motion = Motion::Rigid;
        }
        if scales {
            instance.needs |= Needs::ANIMATED_SCALE;
        }
        if varies {
            instance.needs |= Needs::RIGID_MOTION;
        }
        Some(self.rest_of(instance.mesh, stretch, &weights))
    }

    /// Classifies an instance with joints: first finds the node of its frame, then whether the joints move relative
    /// to it. Returns its rest, or `None` if it never has an area.
    fn classify_skinned(&self, instance: &mut Instance, mesh: &Mesh, skin: &Skin) -> Option<RestMesh> {
        let joints: Vec<usize> = skin.joints.iter().map(|&joint| self.hierarchy.index_of(joint)).collect();
        let root = self.common_root(&joints);
        let rigid_below =
            |frame_node: Option<usize>| joints.iter().all(|&j| !self.hierarchy.varies_below(j, frame_node));
        let morphs = !mesh.morphs.is_empty() && self.hierarchy.weights_vary(instance.node);
        let baked = !morphs && rigid_below(root) && self.has_constant_scale(root);
        instance.frame_node = if baked { root } else { self.frame_node(root, &joints) };
        let start = |node: Option<usize>| node.map_or(DAffine3::IDENTITY, |node| self.samples[0][node]);
        let moving = instance.frame_node.is_some_and(|node| self.hierarchy.varies(node));
        let frame = frame_of(&start(instance.frame_node));
        if !moving {
            instance.constant_frame = Some(frame);
        } else {
            instance.needs |= Needs::RIGID_MOTION;
        }
        let mut posed = InstancePose { frame, deformation: Deformation::Rest, visible: true };
        instance.deformer = Deformer::Skin {
            joints: joints.clone(),
            inverse_bind: skin.inverse_bind.clone(),
            mirrored: false,
        };
        let linears: Vec<DMat3> = joints
            .iter()
            .zip(&skin.inverse_bind)
            .map(|(&joint, bind)| frame.inverse().matrix3 * (self.samples[0][joint] * *bind).matrix3)
            .collect();
        let mean = linears.iter().map(DMat3::determinant).sum::<f64>() / linears.len() as f64;
        let mirrors = mean < 0.0;
        if let Deformer::Skin { mirrored, .. } = &mut instance.deformer {
            *mirrored = mirrors;
        }
        let scale =
            linears.iter().map(|m| libm::cbrt(m.determinant().abs())).sum::<f64>() / linears.len() as f64;
        if scale.is_nan() || scale < 1e-9 {
            return None;
        }
        if baked {
            place(&self.hierarchy, instance, 0.0, &self.samples[0], &mut posed);
            instance.motion = if moving { Motion::Rigid } else { Motion::Static };
            let rest = self.baked_rest(instance, mesh, &posed);
            instance.deformer = Deformer::Rest;
            return Some(rest);
        }
        instance.motion = Motion::Deforming;
        instance.needs |= Needs::SKIN;
        if morphs {
            instance.needs |= Needs::MORPH;
        }
        let signed = if mirrors { -scale } else { scale };
        Some(self.rest_of(
            instance.mesh,
            snapped(DMat3::from_diagonal(DVec3::splat(signed))),
            &instance.weights,
        ))
    }

    /// Returns the lowest common ancestor of all joints, which may be a joint itself.
    fn common_root(&self, joints: &[usize]) -> Option<usize> {
        let path = |joint: usize| {
            let mut path: Vec<usize> =
                std::iter::successors(Some(joint), |&n| self.hierarchy.parent(n)).collect();
            path.reverse();
            path
        };
        let mut common = path(*joints.first()?);
        for &joint in &joints[1..] {
            let same = common.iter().zip(&path(joint)).take_while(|(a, b)| a == b).count();
            common.truncate(same);
        }
        common.last().copied()
    }

    /// Returns whether a node moves only rigidly. It may have a constant scale.
    fn has_constant_scale(&self, node: Option<usize>) -> bool {
        let Some(node) = node else { return true };
        let Some(turn) = rotation_of(self.samples[0][node].matrix3) else { return false };
        let first = turn.transpose() * self.samples[0][node].matrix3;
        !self.hierarchy.varies(node)
            || self.samples.iter().all(|worlds| {
                rotation_of(worlds[node].matrix3).is_some_and(|turn| {
                    nearly_equal(turn.transpose() * worlds[node].matrix3, first, STRETCH_TOLERANCE * 10.0)
                })
            })
    }

    /// Returns the node whose rigid part is the frame of a skinned body: the parent of its root. If the body stays
    /// clearly closer to the root, as with a walking root, the root itself is returned.
    fn frame_node(&self, root: Option<usize>, joints: &[usize]) -> Option<usize> {
        let root = root?;
        let parent = self.hierarchy.parent(root);
        let spread = |frame_node: Option<usize>| {
            let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            for worlds in &self.samples {
                let back = frame_node.map_or(RigidFrame::IDENTITY, |node| frame_of(&worlds[node])).inverse();
                for &joint in joints {
                    let at = back.transform_point3(worlds[joint].translation);
                    (low, high) = (low.min(at), high.max(at));
                }
            }
            (high - low).length()
        };
        if spread(Some(root)) < 0.8 * spread(parent) { Some(root) } else { parent }
    }

    /// Returns the mesh at default or constant weights under a constant stretch.
    fn rest_of(&self, id: MeshId, stretch: DMat3, weights: &[f32]) -> RestMesh {
        let mesh = &self.model.meshes[id.index()];
        let mut geometry = Geometry::default();
        deform::morph(mesh, if mesh.morphs.is_empty() { &[] } else { weights }, &mut geometry);
        if mesh.morphs.is_empty() {
            geometry.copy_from(&mesh.base);
        }
        let key = digest(weights.iter().map(|w| w.to_bits()));
        let linear = to_f32(stretch);
        deform::stretch(linear, &mut geometry);
        finish_rest(id, mesh, linear, stretch.determinant() < 0.0, geometry, key)
    }

    /// Returns a skinned mesh whose joints never move relative to each other, in its constant shape.
    fn baked_rest(&self, instance: &Instance, mesh: &Mesh, pose: &InstancePose) -> RestMesh {
        let (joints, weights) = match &pose.deformation {
            Deformation::Skin { joints, weights } => (joints.as_slice(), weights.as_slice()),
            _ => (&[] as &[_], &[] as &[f32]),
        };
        let mirrored = matches!(instance.deformer, Deformer::Skin { mirrored: true, .. });
        let mut geometry = Geometry::default();
        geometry.copy_from(&mesh.base);
        if !weights.is_empty() {
            deform::morph(mesh, weights, &mut geometry);
        }
        if let Some(skin) = &mesh.skin {
            deform::skin(joints, skin, mirrored, &mut geometry);
        }
        let bits = joints.iter().flat_map(|j| j.0).chain(weights.iter().copied()).map(f32::to_bits);
        finish_rest(instance.mesh, mesh, glam::Mat3::IDENTITY, mirrored, geometry, digest(bits))
    }

    /// Returns the id of an equal rest if there is one; otherwise adds the rest.
    fn intern_rest(&mut self, rest: RestMesh) -> RestId {
        let same = |other: &RestMesh| {
            other.mesh == rest.mesh
                && other.key == rest.key
                && other.mirrored == rest.mirrored
                && nearly_equal(
                    deform::to_f64(other.stretch),
                    deform::to_f64(rest.stretch),
                    STRETCH_TOLERANCE,
                )
        };
        let found = self.rests.iter().position(same);
        RestId::at(found.unwrap_or_else(|| {
            self.rests.push(rest);
            self.rests.len() - 1
        }))
    }
}

/// Returns the largest factor by which a stretch enlarges areas, squared.
fn area_scale(m: DMat3) -> f64 {
    [m.x_axis.cross(m.y_axis), m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis)]
        .iter()
        .map(|a| a.length_squared())
        .fold(0.0, f64::max)
}

fn digest(words: impl Iterator<Item = u32>) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    words.for_each(|word| {
        hasher.update(&word.to_le_bytes());
    });
    *hasher.finalize().as_bytes()
}

fn finish_rest(
    id: MeshId,
    mesh: &Mesh,
    stretch: glam::Mat3,
    mirrored: bool,
    geometry: Geometry,
    key: [u8; 32],
) -> RestMesh {
    let triangles = if mirrored {
        mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect()
    } else {
        Arc::clone(&mesh.triangles)
    };
    let area_m2 = area(&geometry.positions, &triangles);
    RestMesh { mesh: id, stretch, mirrored, geometry, triangles, area_m2, key, charts: OnceLock::new() }
}
