//! A mesh in one pose: corners, normals and masks of its triangles.

use glam::{Vec3, Vec4};

use super::Scene;
use super::material::Material;
use super::mesh::{Geometry, Mesh, RestMesh};

/// A mesh in one pose. Points are placed on it, and hits refer to it.
#[derive(Clone, Copy, Debug)]
pub struct PosedMesh<'a> {
    /// Positions, normals and tangents in local space.
    pub geometry: &'a Geometry,
    /// Vertex numbers, counter-clockwise from the front.
    pub triangles: &'a [[u32; 3]],
    /// The mesh, for its texture coordinates.
    pub mesh: &'a Mesh,
    /// The material, for its normal map and mask.
    pub material: &'a Material,
}

impl<'a> PosedMesh<'a> {
    /// Returns a mesh at rest.
    #[must_use]
    pub fn at_rest(scene: &'a Scene, rest: &'a RestMesh) -> Self {
        Self::posed(scene, rest, rest.geometry())
    }

    /// Returns a mesh in the pose that `geometry` holds.
    #[must_use]
    pub fn posed(scene: &'a Scene, rest: &'a RestMesh, geometry: &'a Geometry) -> Self {
        let mesh = &scene.meshes()[rest.mesh().index()];
        Self { geometry, triangles: rest.triangles(), mesh, material: scene.material(mesh) }
    }
}

impl PosedMesh<'_> {
    /// Returns the corners of a triangle.
    #[must_use]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|corner| self.geometry.positions()[corner as usize])
    }

    /// Returns the unit normal of a triangle's front, or zero for a triangle without area.
    #[must_use]
    pub fn facing(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Returns the unit shading normal of the front, bent by the normal map if there is one. `bary` has the weights
    /// of the second and the third corner.
    #[must_use]
    pub fn shading_normal(&self, triangle: u32, bary: [f32; 2]) -> Vec3 {
        let corners = self.triangles[triangle as usize];
        let weights = [1.0 - bary[0] - bary[1], bary[0], bary[1]];
        let normals = corners.map(|corner| self.geometry.normals()[corner as usize]);
        let smooth = normals[0] * weights[0] + normals[1] * weights[1] + normals[2] * weights[2];
        let smooth = smooth.try_normalize().unwrap_or_else(|| self.facing(triangle)).normalize_or(Vec3::Y);
        match self.mesh.normal_uvs() {
            Some(uvs) if !self.geometry.tangents().is_empty() => {
                let uv = corners.map(|corner| uvs[corner as usize]);
                let uv = uv[0] * weights[0] + uv[1] * weights[1] + uv[2] * weights[2];
                let tangents = corners.map(|corner| self.geometry.tangents()[corner as usize]);
                let tangent = tangents[0] * weights[0] + tangents[1] * weights[1] + tangents[2] * weights[2];
                tangent_space_to_local(smooth, tangent, self.material.normal_at(uv))
            }
            _ => smooth,
        }
    }

    /// Returns whether the mask keeps the surface at a place; always true without a mask. `bary` has the weights of
    /// the second and the third corner.
    #[must_use]
    pub fn opaque(&self, triangle: u32, bary: [f32; 2]) -> bool {
        let Some(uvs) = self.mesh.uvs() else { return true };
        let [a, b, c] = self.triangles[triangle as usize].map(|corner| uvs[corner as usize]);
        self.material.is_opaque_at(a + (b - a) * bary[0] + (c - a) * bary[1])
    }

    /// Returns whether a mask may remove some of the surface.
    #[must_use]
    pub fn masked(&self) -> bool {
        self.material.mask().is_some() && self.mesh.uvs().is_some()
    }
}

/// Transforms a normal from tangent space to local space. The bitangent is normal x tangent times w (glTF 2.0,
/// section 3.9.3).
fn tangent_space_to_local(normal: Vec3, tangent: Vec4, bent: Vec3) -> Vec3 {
    let flat = tangent.truncate() - normal * normal.dot(tangent.truncate());
    let Some(along) = flat.try_normalize() else { return normal };
    let across = normal.cross(along) * if tangent.w < 0.0 { -1.0 } else { 1.0 };
    (along * bent.x + across * bent.y + normal * bent.z).try_normalize().unwrap_or(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_map_keeps_the_normal_and_a_bent_one_turns_it() {
        let tangent = Vec4::new(1.0, 0.5, 0.0, -1.0);
        assert_eq!(tangent_space_to_local(Vec3::Y, tangent, Vec3::Z), Vec3::Y);
        assert!(
            (tangent_space_to_local(Vec3::Y, tangent, Vec3::new(0.6, 0.0, 0.8)) - Vec3::new(0.6, 0.8, 0.0))
                .length()
                < 1e-6
        );
        // With w = -1 the bitangent is tangent x normal.
        assert!(
            (tangent_space_to_local(Vec3::Y, tangent, Vec3::new(0.0, 0.6, 0.8)) - Vec3::new(0.0, 0.8, 0.6))
                .length()
                < 1e-6
        );
        assert_eq!(tangent_space_to_local(Vec3::Y, Vec4::ZERO, Vec3::X), Vec3::Y);
    }
}
