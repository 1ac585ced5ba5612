//! Models: the common result of the readers and the built-in scenes. A model has the nodes, primitives, skins and
//! animation curves of all parts; instances are built from it.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3, Vec4};

use crate::scene::animation::{Curve, Property};
use crate::scene::ids::MaterialId;
use crate::scene::material::Material;
use crate::scene::mesh::Mesh;
use crate::scene::raw_mesh::RawMesh;
use crate::scene::report::SceneReport;

/// A node's own transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LocalTransform {
    /// Scale, then rotation, then translation; it can be animated.
    Trs { translation: DVec3, rotation: DQuat, scale: DVec3 },
    /// A fixed matrix, which may shear.
    Matrix(DAffine3),
}

impl LocalTransform {
    /// The identity.
    pub(crate) const IDENTITY: Self =
        Self::Trs { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };

    /// Returns a translation.
    pub(crate) fn at(translation: DVec3) -> Self {
        Self::Trs { translation, rotation: DQuat::IDENTITY, scale: DVec3::ONE }
    }

    /// Returns a rotation followed by a translation.
    pub(crate) fn rigid(translation: DVec3, rotation: DQuat) -> Self {
        Self::Trs { translation, rotation, scale: DVec3::ONE }
    }

    /// Returns the transform as a matrix.
    pub(crate) fn affine(&self) -> DAffine3 {
        match *self {
            Self::Trs { translation, rotation, scale } => {
                let turn = DMat3::from_quat(rotation);
                let matrix3 =
                    DMat3::from_cols(turn.x_axis * scale.x, turn.y_axis * scale.y, turn.z_axis * scale.z);
                DAffine3 { matrix3, translation }
            }
            Self::Matrix(matrix) => matrix,
        }
    }
}

/// A node of the hierarchy. Parents form no cycle.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) parent: Option<usize>,
    pub(crate) local: LocalTransform,
    /// Whether the node and everything below it is visible, unless a channel says otherwise.
    pub(crate) visible: bool,
}

/// Joints of a skin, and for each the transform from mesh space to joint space.
#[derive(Debug, Clone)]
pub(crate) struct Skin {
    pub(crate) joints: Vec<usize>,
    pub(crate) inverse_bind: Vec<DAffine3>,
}

/// One primitive at one node.
#[derive(Debug, Clone)]
pub(crate) struct MeshNode {
    pub(crate) name: String,
    pub(crate) node: usize,
    pub(crate) mesh: usize,
    /// Index into the model's skins. The skin has all joints that the mesh refers to.
    pub(crate) skin: Option<usize>,
    /// One weight per morph target of the mesh.
    pub(crate) weights: Vec<f32>,
}

/// Timing of an animation: its own time is `time * speed + phase`, modulo its own length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AnimationClip {
    pub(crate) length_s: f64,
    pub(crate) speed: f64,
    pub(crate) phase_s: f64,
}

impl AnimationClip {
    /// Returns the clip's own time at a scene time.
    pub(crate) fn local_time(&self, time_s: f64) -> f64 {
        if self.length_s > 0.0 {
            let local = (time_s * self.speed + self.phase_s).rem_euclid(self.length_s);
            if local.is_finite() { local } else { 0.0 }
        } else {
            0.0
        }
    }
}

/// A curve that drives one property of one node.
#[derive(Debug, Clone)]
pub(crate) struct Channel {
    pub(crate) node: usize,
    pub(crate) property: Property,
    /// The first of the property's numbers that the curve drives. It is 0 except for single morph weights.
    pub(crate) first: usize,
    pub(crate) clip: usize,
    pub(crate) curve: Arc<Curve>,
}

/// The content of a scene before instances are built. Indices are in range.
#[derive(Debug, Clone, Default)]
pub(crate) struct Model {
    pub(crate) nodes: Vec<Node>,
    pub(crate) meshes: Vec<Mesh>,
    pub(crate) materials: Vec<Material>,
    pub(crate) skins: Vec<Skin>,
    pub(crate) mesh_nodes: Vec<MeshNode>,
    pub(crate) clips: Vec<AnimationClip>,
    pub(crate) channels: Vec<Channel>,
    pub(crate) report: SceneReport,
    mesh_keys: std::collections::BTreeMap<[u8; 32], usize>,
}

impl Model {
    /// Adds a node.
    pub(crate) fn add_node(&mut self, parent: Option<usize>, local: LocalTransform) -> usize {
        self.nodes.push(Node { parent, local, visible: true });
        self.nodes.len() - 1
    }

    /// Adds a material, or returns the index of an equal one.
    pub(crate) fn add_material(&mut self, material: Material) -> usize {
        self.materials.iter().position(|m| *m == material).unwrap_or_else(|| {
            self.materials.push(material);
            self.materials.len() - 1
        })
    }

    /// Adds a mesh, or returns the index of an equal one. Returns `None` if the mesh has no surface.
    pub(crate) fn add_mesh(&mut self, raw: RawMesh, material: usize) -> Option<usize> {
        let id = MaterialId::at(material);
        let mesh = raw.into_mesh(id, &self.materials[material], &mut self.report)?;
        let next = self.meshes.len();
        let index = *self.mesh_keys.entry(content_key(&mesh)).or_insert(next);
        if index == next {
            self.meshes.push(mesh);
        }
        Some(index)
    }

    /// Adds a primitive at a node.
    pub(crate) fn add_mesh_node(&mut self, name: &str, node: usize, mesh: usize) {
        self.mesh_nodes.push(MeshNode { name: name.to_owned(), node, mesh, skin: None, weights: Vec::new() });
    }
}

/// Returns a digest of everything in a mesh except its name.
fn content_key(mesh: &Mesh) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    let mut section = |count: usize, words: &mut dyn Iterator<Item = u32>| {
        let mut bytes = Vec::with_capacity(count * 4 + 8);
        bytes.extend((count as u64).to_le_bytes());
        words.for_each(|word| bytes.extend(word.to_le_bytes()));
        hasher.update(&bytes);
    };
    let mut floats = |list: &[f32]| section(list.len(), &mut list.iter().map(|v| v.to_bits()));
    let flat3 = |list: &[Vec3]| list.iter().flat_map(Vec3::to_array).collect::<Vec<f32>>();
    let flat2 = |list: Option<&Vec<Vec2>>| {
        list.map(|l| l.iter().flat_map(Vec2::to_array).collect::<Vec<f32>>()).unwrap_or_default()
    };
    floats(&flat3(&mesh.base.positions));
    floats(&flat3(&mesh.base.normals));
    floats(&mesh.base.tangents.iter().flat_map(Vec4::to_array).collect::<Vec<f32>>());
    floats(&flat2(mesh.uvs.as_ref()));
    floats(&flat2(mesh.normal_uvs.as_ref()));
    for morph in &mesh.morphs {
        [&morph.positions, &morph.normals, &morph.tangents].iter().for_each(|list| floats(&flat3(list)));
    }
    floats(mesh.skin.as_ref().map_or(&[], |skin| skin.weights.as_flattened()));
    let joints = mesh.skin.as_ref().map_or(&[] as &[u16], |skin| skin.joints.as_flattened());
    section(joints.len(), &mut joints.iter().map(|j| u32::from(*j)));
    let triangles = mesh.triangles.as_flattened();
    section(triangles.len(), &mut triangles.iter().copied());
    section(1, &mut std::iter::once(mesh.material.0));
    *hasher.finalize().as_bytes()
}
