//! Scenes: geometry, materials, animation and a camera path, from glTF 2.0 files or built in.
//!
//! A scene is a list of **instances**, one per node and primitive. Each has a metric **local space**, which a rigid
//! transform ([`RigidFrame`]) relates to the world. All scale, shear and mirroring is part of its local geometry.
//! Instances of the same mesh at the same scale share one [`RestMesh`], whatever their animation.
//!
//! * [`Scene::pose`] gives the frames and the deformations of all instances at a given time.
//! * [`ScenePose::apply`] adds the changes that clients made: [`Edits`].
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
//! The reader supports all of glTF that affects surfaces: node hierarchies, rigid and skinned animation, morph
//! targets, masks, double-sided materials, normal maps, strips, fans and sparse accessors. It applies the extensions
//! that do so, such as quantisation, compression and instancing. A primitive without normals is flat-shaded, as the
//! specification requires (section 3.7.2.1). Contradictory input is a [`SceneError`]. Unusual but harmless input has a
//! defined result that [`SceneReport`] counts.

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

/// A scene that can be posed at any time.
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

/// Description of a scene without its model.
#[derive(Debug, Clone)]
pub(crate) struct SceneHeader {
    name: String,
    source: String,
    digest: [u8; 32],
    duration_s: f64,
    ao_radius_m: f32,
    /// `None` selects a camera that sees the whole scene.
    camera: Option<CameraPath>,
}

impl Scene {
    /// Loads a built-in scene by its name, or a scene file (`.toml`), or a model (`.gltf`, `.glb`).
    ///
    /// A model by itself plays all of its animations. It lasts as long as the longest of them, or 10 s without
    /// animation. A still camera sees the whole model.
    ///
    /// # Errors
    ///
    /// Returns a [`SceneError`] that names the file, the place in it and the problem there.
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

    /// Returns the names of the scenes that need no file.
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

    /// Returns a camera that sees the whole scene at its start.
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

    /// Returns the name of the scene.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the name or path from which it was loaded.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Returns the BLAKE3 digest of all files of the scene, or of name and version of a built-in scene. Equal digests
    /// mean equal scenes.
    #[must_use]
    pub fn digest(&self) -> &[u8; 32] {
        &self.digest
    }

    /// Returns the length of the clip, seconds. Animations loop with their own lengths.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Returns the default AO radius of the scene in metres.
    #[must_use]
    pub fn ao_radius_m(&self) -> f32 {
        self.ao_radius_m
    }

    /// Returns the meshes as modelled, one per distinct primitive.
    #[must_use]
    pub fn meshes(&self) -> &[Mesh] {
        &self.meshes
    }

    /// Returns the materials.
    #[must_use]
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Returns the meshes at rest in metric local space, one per distinct mesh and scale.
    #[must_use]
    pub fn rests(&self) -> &[RestMesh] {
        &self.rests
    }

    /// Returns the instances, one per node and primitive.
    #[must_use]
    pub fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// Returns the mesh at rest of an instance.
    #[must_use]
    pub fn rest(&self, instance: &Instance) -> &RestMesh {
        &self.rests[instance.rest.index()]
    }

    /// Returns the material of a mesh.
    #[must_use]
    pub fn material(&self, mesh: &Mesh) -> &Material {
        &self.materials[mesh.material.index()]
    }

    /// Returns the camera's path.
    #[must_use]
    pub fn camera_path(&self) -> &CameraPath {
        &self.camera
    }

    /// Returns the camera at a given time for a 16:9 picture. It moves smoothly between the path's keys and stands
    /// still beyond its ends.
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

    /// Returns what was dropped or repaired while the scene was loaded.
    #[must_use]
    pub fn report(&self) -> &SceneReport {
        &self.report
    }

    /// Returns the features that this scene requires of a codec and a client.
    #[must_use]
    pub fn needs(&self) -> SceneNeeds {
        SceneNeeds::new(self.instances.iter().map(Instance::needs).collect())
    }
}

#[cfg(test)]
pub(crate) mod tests;
