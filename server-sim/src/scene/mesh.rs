//! Meshes: one primitive as it was modelled, and the geometry that is made of it.

use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3, Vec4};
use psao_codec::memory;

use crate::scene::ids::{MaterialId, MeshId};

/// Vertex positions (metres), unit normals and, for meshes with a normal map, tangents (xyz unit, w the
/// bitangent's sign). Reused from frame to frame, so that a steady state allocates nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) tangents: Vec<Vec4>,
}

impl Geometry {
    /// Bytes held.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.positions) + memory::list(&self.normals) + memory::list(&self.tangents)
    }

    /// Positions, one per vertex, metres in the instance's local space.
    #[must_use]
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Unit normals, one per vertex.
    #[must_use]
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Tangents, one per vertex, or none where nothing needs them.
    #[must_use]
    pub fn tangents(&self) -> &[Vec4] {
        &self.tangents
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.positions.clone_from(&other.positions);
        self.normals.clone_from(&other.normals);
        self.tangents.clone_from(&other.tangents);
    }
}

/// Which joints a vertex follows, and how much: `sets` groups of four per vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinWeights {
    pub(crate) sets: usize,
    pub(crate) joints: Vec<[u16; 4]>,
    pub(crate) weights: Vec<[f32; 4]>,
}

impl SkinWeights {
    /// Groups of four influences per vertex; vertex `v` owns groups `v * sets .. (v + 1) * sets`.
    #[must_use]
    pub fn sets(&self) -> usize {
        self.sets
    }

    /// Joint numbers within the instance's skin, `sets` groups per vertex.
    #[must_use]
    pub fn joints(&self) -> &[[u16; 4]] {
        &self.joints
    }

    /// Weights, in the order of the joints; those of a vertex add up to 1.
    #[must_use]
    pub fn weights(&self) -> &[[f32; 4]] {
        &self.weights
    }

    /// The largest joint number that carries weight.
    pub(crate) fn last_joint(&self) -> u16 {
        let all = self.joints.iter().flatten().zip(self.weights.iter().flatten());
        all.filter(|(_, weight)| **weight > 0.0).map(|(joint, _)| *joint).max().unwrap_or(0)
    }
}

/// Displacements of one morph target, one per vertex; a part that the target leaves alone is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MorphTarget {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) tangents: Vec<Vec3>,
}

impl MorphTarget {
    /// Displacements of the positions, mesh units.
    #[must_use]
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Displacements of the normals.
    #[must_use]
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Displacements of the tangents.
    #[must_use]
    pub fn tangents(&self) -> &[Vec3] {
        &self.tangents
    }
}

/// One primitive as it was modelled, before any transform. At least one triangle; all numbers finite.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    pub(crate) name: String,
    pub(crate) material: MaterialId,
    pub(crate) base: Geometry,
    pub(crate) uvs: Option<Vec<Vec2>>,
    pub(crate) normal_uvs: Option<Vec<Vec2>>,
    pub(crate) triangles: Arc<[[u32; 3]]>,
    pub(crate) skin: Option<SkinWeights>,
    pub(crate) morphs: Vec<MorphTarget>,
}

impl Mesh {
    /// Name from the file, may be empty.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its material.
    #[must_use]
    pub fn material(&self) -> MaterialId {
        self.material
    }

    /// Positions, normals and tangents as modelled: unscaled, unskinned, unmorphed.
    #[must_use]
    pub fn base(&self) -> &Geometry {
        &self.base
    }

    /// Texture coordinates of the mask, one per vertex. A mesh without them is opaque, whatever its material.
    #[must_use]
    pub fn uvs(&self) -> Option<&[Vec2]> {
        self.uvs.as_deref()
    }

    /// Texture coordinates of the normal map, one per vertex; `Some` wherever the material has a normal map
    /// that applies here. The tangents are present exactly then.
    #[must_use]
    pub fn normal_uvs(&self) -> Option<&[Vec2]> {
        self.normal_uvs.as_deref()
    }

    /// Vertex numbers of each triangle as modelled, counter-clockwise from the front. A mirrored rest turns
    /// them round: take [`RestMesh::triangles`] for anything that has a front.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Joints and weights, if the mesh can be skinned.
    #[must_use]
    pub fn skin(&self) -> Option<&SkinWeights> {
        self.skin.as_ref()
    }

    /// Morph targets.
    #[must_use]
    pub fn morphs(&self) -> &[MorphTarget] {
        &self.morphs
    }
}

/// A mesh in metric local space at rest, shared by all instances that use it at that scale.
///
/// For a rigid instance this is its geometry at all times. For a deforming one it is what its surface points
/// are generated on: the undeformed mesh at the deformed one's size.
#[derive(Debug, Clone)]
pub struct RestMesh {
    pub(crate) mesh: MeshId,
    pub(crate) stretch: Mat3,
    pub(crate) mirrored: bool,
    pub(crate) geometry: Geometry,
    pub(crate) triangles: Arc<[[u32; 3]]>,
    pub(crate) area_m2: f64,
    pub(crate) key: [u8; 32],
}

impl RestMesh {
    /// The mesh it was made of.
    #[must_use]
    pub fn mesh(&self) -> MeshId {
        self.mesh
    }

    /// Scale, shear and mirroring that were baked in.
    #[must_use]
    pub fn stretch(&self) -> Mat3 {
        self.stretch
    }

    /// Whether the baked part mirrors, so that triangles are wound the other way than in the mesh.
    #[must_use]
    pub fn mirrored(&self) -> bool {
        self.mirrored
    }

    /// Positions, normals and tangents, metres.
    #[must_use]
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Vertex numbers of each triangle, counter-clockwise from the front, in the order of the mesh's. The same
    /// triangles hold for the deformed geometry of every instance. Of a mesh that deforms some may have no
    /// area at rest.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Area of one side of all triangles, square metres; masked-out parts count.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        self.area_m2
    }
}

/// Twice the area times the unit normal of a triangle, in doubles.
pub(crate) fn area_vector(positions: &[Vec3], triangle: [u32; 3]) -> glam::DVec3 {
    let [a, b, c] = triangle.map(|v| positions[v as usize].as_dvec3());
    (b - a).cross(c - a)
}

/// Area of one side of all triangles.
pub(crate) fn area(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    triangles.iter().map(|&t| area_vector(positions, t).length() * 0.5).sum()
}
