//! Meshes: one primitive as modelled, and the geometry derived from it.

use std::sync::{Arc, OnceLock};

use glam::{Mat3, Vec2, Vec3, Vec4};
use psao_codec::memory;
use psao_codec::surface::Charts;

use crate::scene::ids::{MaterialId, MeshId};

/// Vertex positions (metres), unit normals and, for meshes with a normal map, tangents (xyz unit, w the bitangent's
/// sign). Reuse it from frame to frame, so that a steady state allocates nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) tangents: Vec<Vec4>,
}

impl Geometry {
    /// Returns the bytes held on the heap.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.positions) + memory::list(&self.normals) + memory::list(&self.tangents)
    }

    /// Returns the positions, one per vertex, metres in the instance's local space.
    #[must_use]
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Returns the unit normals, one per vertex.
    #[must_use]
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Returns the tangents, one per vertex; empty for a mesh without a normal map.
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

/// Joints that each vertex follows, with weights: `sets` groups of four per vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinWeights {
    pub(crate) sets: usize,
    pub(crate) joints: Vec<[u16; 4]>,
    pub(crate) weights: Vec<[f32; 4]>,
}

impl SkinWeights {
    /// Returns the number of groups of four influences per vertex. Vertex `v` owns groups `v * sets .. (v + 1) *
    /// sets`.
    #[must_use]
    pub fn sets(&self) -> usize {
        self.sets
    }

    /// Returns the joint numbers within the instance's skin, `sets` groups per vertex.
    #[must_use]
    pub fn joints(&self) -> &[[u16; 4]] {
        &self.joints
    }

    /// Returns the weights in the order of the joints. The weights of a vertex sum to 1.
    #[must_use]
    pub fn weights(&self) -> &[[f32; 4]] {
        &self.weights
    }

    /// Returns the largest joint number with a positive weight.
    pub(crate) fn last_joint(&self) -> u16 {
        let all = self.joints.iter().flatten().zip(self.weights.iter().flatten());
        all.filter(|(_, weight)| **weight > 0.0).map(|(joint, _)| *joint).max().unwrap_or(0)
    }
}

/// Displacements of one morph target, one per vertex. The list of an attribute that the target does not change is
/// empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MorphTarget {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) tangents: Vec<Vec3>,
}

impl MorphTarget {
    /// Returns the displacements of the positions in mesh units.
    #[must_use]
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Returns the displacements of the normals.
    #[must_use]
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Returns the displacements of the tangents.
    #[must_use]
    pub fn tangents(&self) -> &[Vec3] {
        &self.tangents
    }
}

/// One primitive as modelled, before any transform. It has at least one triangle, and all numbers are finite.
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
    /// Returns the name from the file; it may be empty.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the id of its material.
    #[must_use]
    pub fn material(&self) -> MaterialId {
        self.material
    }

    /// Returns the positions, normals and tangents as modelled, before scale, skin and morph targets.
    #[must_use]
    pub fn base(&self) -> &Geometry {
        &self.base
    }

    /// Returns the texture coordinates of the mask, one per vertex. A mesh without them is opaque, whatever its
    /// material.
    #[must_use]
    pub fn uvs(&self) -> Option<&[Vec2]> {
        self.uvs.as_deref()
    }

    /// Returns the texture coordinates of the normal map, one per vertex. They are `Some` exactly if the material has
    /// a normal map that applies to this mesh; the mesh then has tangents, too.
    #[must_use]
    pub fn normal_uvs(&self) -> Option<&[Vec2]> {
        self.normal_uvs.as_deref()
    }

    /// Returns the vertex numbers of each triangle as modelled, counter-clockwise from the front. A mirrored rest
    /// reverses them: use [`RestMesh::triangles`] wherever the front matters.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Returns the joints and weights if the mesh can be skinned.
    #[must_use]
    pub fn skin(&self) -> Option<&SkinWeights> {
        self.skin.as_ref()
    }

    /// Returns the morph targets.
    #[must_use]
    pub fn morphs(&self) -> &[MorphTarget] {
        &self.morphs
    }
}

/// A mesh at rest in metric local space. All instances with the same mesh and scale share it.
///
/// For a rigid instance this is its geometry at all times. For a deforming instance it is the undeformed mesh in the
/// size of the deformed one; surface points are generated on it.
#[derive(Debug, Clone)]
pub struct RestMesh {
    pub(crate) mesh: MeshId,
    pub(crate) stretch: Mat3,
    pub(crate) mirrored: bool,
    pub(crate) geometry: Geometry,
    pub(crate) triangles: Arc<[[u32; 3]]>,
    pub(crate) area_m2: f64,
    pub(crate) key: [u8; 32],
    pub(crate) charts: OnceLock<Charts>,
}

impl RestMesh {
    /// Returns the id of its mesh.
    #[must_use]
    pub fn mesh(&self) -> MeshId {
        self.mesh
    }

    /// Returns the scale, shear and mirroring that are part of the geometry.
    #[must_use]
    pub fn stretch(&self) -> Mat3 {
        self.stretch
    }

    /// Returns whether the stretch mirrors, so that the winding of triangles is the reverse of the mesh's.
    #[must_use]
    pub fn mirrored(&self) -> bool {
        self.mirrored
    }

    /// Returns the positions, normals and tangents, metres.
    #[must_use]
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Returns the vertex numbers of each triangle, counter-clockwise from the front, in the order of the mesh. The
    /// same triangles apply to the deformed geometry of every instance. Triangles of a deforming mesh may have no
    /// area at rest.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Returns the charts of its triangles. They are derived at the first call.
    #[must_use]
    pub fn charts(&self) -> &Charts {
        self.charts.get_or_init(|| {
            let positions: Vec<[f32; 3]> = self.geometry.positions.iter().map(Vec3::to_array).collect();
            Charts::of_mesh(&positions, &self.triangles)
        })
    }

    /// Returns the area of one side of all triangles in square metres, masked-out parts included.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        self.area_m2
    }
}

/// Returns twice the area times the unit normal of a triangle, in double precision.
pub(crate) fn area_vector(positions: &[Vec3], triangle: [u32; 3]) -> glam::DVec3 {
    let [a, b, c] = triangle.map(|v| positions[v as usize].as_dvec3());
    (b - a).cross(c - a)
}

/// Returns the area of one side of all triangles.
pub(crate) fn area(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    triangles.iter().map(|&t| area_vector(positions, t).length() * 0.5).sum()
}
