//! Scenes: geometry, materials, animation and a camera path, from glTF 2.0 files or built in.
//!
//! A scene is a list of **instances**, one per node and primitive. Each has a metric **local space** that is
//! related to the world by a rigid transform only ([`RigidFrame`]): all scale, shear and mirroring is baked
//! into its local geometry. Instances of the same mesh at the same scale share one [`RestMesh`], whatever
//! their animation does.
//!
//! * [`Scene::pose`] gives the frames of all instances, and what deforms them, at a given time.
//! * [`ScenePose::apply`] puts on top what clients changed: [`Edits`].
//! * [`Scene::local_geometry`] gives an instance's deformed vertices in its local space at that time.
//!
//! ```
//! use psao_server::scene::{Geometry, InstanceId, Scene};
//!
//! let scene = Scene::load("colonnade")?;
//! let pose = scene.pose(1.5);
//! let mut geometry = Geometry::default();
//! scene.local_geometry(InstanceId(0), &pose, &mut geometry);
//! let world = pose.instances()[0].frame().point(geometry.positions()[0]);
//! assert!(world.is_finite());
//! # Ok::<(), psao_server::scene::SceneError>(())
//! ```
//!
//! glTF is read in full as far as surfaces are concerned: node hierarchies, rigid and skinned animation, morph
//! targets, masks, double-sided materials, normal maps, strips and fans, sparse accessors. Without normals a
//! primitive is flat-shaded, as the specification demands (section 3.7.2.1). Input that contradicts itself is a
//! [`SceneError`]; odd but harmless input has a defined result that [`SceneReport`] counts.

mod animation;
mod builtin;
mod camera;
mod deform;
mod edits;
mod error;
mod file;
mod from_triangles;
mod gltf;
mod hierarchy;
mod ids;
mod instance;
mod instance_builder;
mod io;
pub mod limits;
mod material;
mod mesh;
mod model;
mod needs;
mod pose;
mod posed_mesh;
mod raw_mesh;
mod report;
mod rigid;
mod texture;

use std::path::Path;

use glam::Vec3;
use psao_proto::message::CameraPose;

pub use camera::{CameraKey, CameraPath};
pub use deform::JointMatrix;
pub use edits::{EditError, Edits};
pub use error::{GltfProblem, SceneError};
pub use ids::{InstanceId, MaterialId, MeshId, RestId};
pub use instance::{Deformation, Instance, InstancePose, Motion, ScenePose};
pub use material::{AlphaMask, Material, NormalMap};
pub use mesh::{Geometry, Mesh, MorphTarget, RestMesh, SkinWeights};
pub use needs::{Needs, SceneNeeds};
pub use posed_mesh::PosedMesh;
pub use report::SceneReport;
pub use rigid::RigidFrame;
pub use texture::{Texture, Wrap};

use model::Model;

/// A scene, ready to be posed at any time.
#[derive(Debug)]
pub struct Scene {
    name: String,
    source: String,
    digest: [u8; 32],
    duration_s: f64,
    ao_radius_m: f32,
    camera: CameraPath,
    hierarchy: hierarchy::NodeHierarchy,
    materials: Vec<Material>,
    meshes: Vec<Mesh>,
    rests: Vec<RestMesh>,
    instances: Vec<Instance>,
    report: SceneReport,
}

/// What describes a scene apart from its model.
#[derive(Debug, Clone)]
pub(crate) struct SceneHeader {
    name: String,
    source: String,
    digest: [u8; 32],
    duration_s: f64,
    ao_radius_m: f32,
    /// `None`: one that sees all of it.
    camera: Option<CameraPath>,
}

impl Scene {
    /// Loads a built-in scene by its name, or a scene file (`.toml`), or a model (`.gltf`, `.glb`).
    ///
    /// A model by itself plays all of its animations, lasts as long as the longest of them (10 s without any)
    /// and is seen whole by a still camera.
    ///
    /// # Errors
    ///
    /// A [`SceneError`] that names the file, the place in it and what is wrong there.
    pub fn load(name_or_path: &str) -> Result<Self, SceneError> {
        if let Some(scene) = builtin::build(name_or_path) {
            return scene;
        }
        let path = Path::new(name_or_path);
        let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        match extension.as_deref() {
            Some("toml") => file::load(path, name_or_path),
            Some("gltf" | "glb") => file::load_model(path, name_or_path),
            _ => Err(SceneError::UnknownScene {
                name: name_or_path.to_owned(),
                builtin: Self::builtin_names(),
            }),
        }
    }

    /// Names of the scenes that need no file.
    #[must_use]
    pub fn builtin_names() -> &'static [&'static str] {
        builtin::NAMES
    }

    pub(crate) fn from_model(model: Model, header: SceneHeader) -> Result<Self, SceneError> {
        let parts = instance_builder::build_instances(&model, header.duration_s, &header.source)?;
        let mut scene = Self {
            name: header.name,
            source: header.source,
            digest: header.digest,
            duration_s: header.duration_s,
            ao_radius_m: header.ao_radius_m,
            camera: CameraPath::around(Vec3::ZERO, 1.0),
            hierarchy: parts.hierarchy,
            materials: model.materials,
            meshes: model.meshes,
            rests: parts.rests,
            instances: parts.instances,
            report: parts.report,
        };
        scene.camera = header.camera.unwrap_or_else(|| scene.overview());
        Ok(scene)
    }

    /// A camera that sees the whole scene at its start.
    fn overview(&self) -> CameraPath {
        let pose = self.pose(0.0);
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut geometry = Geometry::default();
        for (i, at) in pose.instances().iter().enumerate() {
            self.local_geometry(InstanceId::at(i), &pose, &mut geometry);
            let turn = at.frame().matrix();
            for local in geometry.positions() {
                let world = turn * *local + at.frame().translation;
                (low, high) = (low.min(world), high.max(world));
            }
        }
        CameraPath::around((low + high) * 0.5, (high - low).length() * 0.5)
    }

    /// Name of the scene.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The name or path that it was loaded by.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.source
    }

    /// BLAKE3 digest of all files that were read for it (of name and version for a built-in scene): the same
    /// digest means the same scene.
    #[must_use]
    pub fn digest(&self) -> &[u8; 32] {
        &self.digest
    }

    /// Length of the clip, seconds. Animations loop with their own lengths.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Radius within which geometry occludes, unless something else is asked for; metres.
    #[must_use]
    pub fn ao_radius_m(&self) -> f32 {
        self.ao_radius_m
    }

    /// The meshes as modelled, one per different primitive.
    #[must_use]
    pub fn meshes(&self) -> &[Mesh] {
        &self.meshes
    }

    /// The materials.
    #[must_use]
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// The meshes at rest in metric local space, one per different mesh and scale.
    #[must_use]
    pub fn rests(&self) -> &[RestMesh] {
        &self.rests
    }

    /// The instances, one per node and primitive.
    #[must_use]
    pub fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// The mesh at rest of an instance.
    #[must_use]
    pub fn rest(&self, instance: &Instance) -> &RestMesh {
        &self.rests[instance.rest.index()]
    }

    /// The material of a mesh.
    #[must_use]
    pub fn material(&self, mesh: &Mesh) -> &Material {
        &self.materials[mesh.material.index()]
    }

    /// The camera's path.
    #[must_use]
    pub fn camera_path(&self) -> &CameraPath {
        &self.camera
    }

    /// The camera at a given time, for a picture of 16 to 9: smooth between the path's keys, clamped at its ends.
    #[must_use]
    pub fn camera(&self, time_s: f64) -> CameraPose {
        let key = self.camera.at(time_s);
        CameraPose {
            eye: key.eye.to_array(),
            target: key.target.to_array(),
            up: key.up.to_array(),
            fov_y_deg: self.camera.fov_y_deg(),
            aspect: 16.0 / 9.0,
        }
    }

    /// What was left out or repaired while the scene was loaded.
    #[must_use]
    pub fn report(&self) -> &SceneReport {
        &self.report
    }

    /// What a codec and a client need for this scene: everything else can be left out.
    #[must_use]
    pub fn needs(&self) -> SceneNeeds {
        SceneNeeds::new(self.instances.iter().map(Instance::needs).collect())
    }
}

#[cfg(test)]
pub(crate) mod tests;
