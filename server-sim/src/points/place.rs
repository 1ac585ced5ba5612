//! The place of a surface point on a mesh in its current pose.

use glam::Vec3;

use super::SurfacePoint;
use crate::scene::PosedMesh;

/// A point on a posed mesh, in the mesh's local space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPoint {
    /// Metres.
    pub position: Vec3,
    /// Unit shading normal on the point's side, bent by the normal map if there is one.
    pub normal: Vec3,
    /// First edge of the triangle: a direction that moves with the surface.
    pub edge: Vec3,
}

impl SurfacePoint {
    /// Returns the place of the point on a posed mesh.
    #[must_use]
    pub fn place_on(&self, mesh: &PosedMesh<'_>) -> PlacedPoint {
        let [a, b, c] = mesh.corners(self.triangle);
        let normal = mesh.shading_normal(self.triangle, self.bary);
        PlacedPoint {
            position: a + (b - a) * self.bary[0] + (c - a) * self.bary[1],
            normal: if self.back { -normal } else { normal },
            edge: b - a,
        }
    }
}
