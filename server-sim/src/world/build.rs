//! Builds bottom-level trees from meshes of the scene.

use std::sync::Arc;

use glam::Vec3;

use crate::bvh::{Blas, Effort, Placement};
use crate::scene::{PosedMesh, RigidFrame, Scene};
use crate::shortcuts::Shortcuts;

/// Converts an instance's rigid frame to a placement.
pub(super) fn placement(frame: &RigidFrame) -> Placement {
    Placement { rotation: frame.matrix(), translation: frame.translation }
}

/// Returns the corners of all triangles of a mesh, in its local space.
pub(super) fn corners(posed: &PosedMesh<'_>) -> Vec<[Vec3; 3]> {
    (0..posed.triangles.len() as u32).map(|triangle| posed.corners(triangle)).collect()
}

/// Builds the tree of a mesh in its pose.
pub(super) fn build(posed: &PosedMesh<'_>, shortcuts: Shortcuts) -> Blas {
    let blas = Blas::build(&corners(posed), Effort::Best);
    if posed.masked() || !shortcuts.contains(Shortcuts::MASKS) { blas.with_masks(|_| true) } else { blas }
}

/// Builds the tree of the mesh at rest with index `rest`.
pub(super) fn build_rest(scene: &Scene, rest: usize, shortcuts: Shortcuts) -> Arc<Blas> {
    Arc::new(build(&PosedMesh::at_rest(scene, &scene.rests()[rest]), shortcuts))
}
