//! Ambient occlusion of every fragment from cells of points (paper, section 3.5, Eq. 2 to 4).

use glam::{Mat3, Quat, Vec3};
use psao_codec::paper::{Pose, State};

use super::result::{ReconstructError, Reconstruction};
use super::walk::{check_instances, walk};
use crate::GBuffer;
use crate::kernel::Support;
use crate::paper::{InstanceCells, NeighbourhoodCache};

/// Reconstructs the ambient occlusion of every fragment of `view` from the points of `state`.
///
/// The last received pose takes the position and normal of a fragment into the local space of its instance. The points
/// of the 2 x 2 x 2 cells nearest to it, at most 56, are weighted by Eq. 2 and 3
/// ([`weight`](crate::kernel::weight())). The fragment's value is their weighted mean (Eq. 4), or 1 if no weight is
/// above 0. Background is 1.
///
/// The feature `rayon` spreads rows over all cores. The result does not depend on their number.
///
/// # Errors
///
/// [`ReconstructError::Instance`] when a fragment shows an instance beyond the stream's layout.
pub fn cells(state: &State, view: &GBuffer) -> Result<Reconstruction, ReconstructError> {
    let instances = state.layout().instances().len();
    check_instances(view, instances)?;
    // With the last received poses, points are right relative to the surface even when client and server do not run in
    // lockstep (paper, section 3.5).
    let poses = state.poses().iter().map(WorldToLocal::new);
    let cells = (0..instances as u32).filter_map(|instance| InstanceCells::of(state, instance));
    let spaces: Vec<(InstanceCells, WorldToLocal)> = cells.zip(poses).collect();
    Ok(walk(view, NeighbourhoodCache::new, |near, pixel, instance| {
        let Some((cells, to_local)) = spaces.get(instance as usize) else { return Support::NONE };
        let (position, normal) = (view.position()[pixel], view.normal()[pixel]);
        let query = cells.query(to_local.point(position), to_local.vector(normal));
        cells.blend_near(state, near, &query)
    }))
}

/// The inverse of an instance's rigid transform: from the world into its local space.
pub(super) struct WorldToLocal {
    rotation: Mat3,
    translation: Vec3,
}

impl WorldToLocal {
    pub(super) fn new(pose: &Pose) -> Self {
        let rotation = Mat3::from_quat(Quat::from_array(pose.rotation)).transpose();
        Self { rotation, translation: Vec3::from(pose.translation) }
    }

    /// Takes a position from the world into local space.
    #[inline]
    pub(super) fn point(&self, world: Vec3) -> Vec3 {
        self.rotation * (world - self.translation)
    }

    /// Takes a direction from the world into local space.
    #[inline]
    pub(super) fn vector(&self, world: Vec3) -> Vec3 {
        self.rotation * world
    }
}
