//! Where a surface point is on a mesh as it is now.

use glam::Vec3;

use super::SurfacePoint;
use crate::scene::PosedMesh;

/// A point on a mesh in its pose, in the mesh's local space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPoint {
    /// Metres.
    pub position: Vec3,
    /// Unit normal: shading normal, bent by the normal map if there is one, on the point's side.
    pub normal: Vec3,
    /// First edge of the triangle: a direction that moves with the surface.
    pub edge: Vec3,
}

impl SurfacePoint {
    /// Returns where the point is on a mesh in its pose.
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
