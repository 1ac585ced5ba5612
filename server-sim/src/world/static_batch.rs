//! Static instances in one body in world space.

use std::sync::Arc;

use glam::Vec3;
use psao_codec::memory;

use super::build::corners;
use crate::bvh::{Blas, Effort, Placement};
use crate::scene::{Geometry, InstanceId, PosedMesh, Scene, ScenePose};
use crate::shortcuts::Shortcuts;

/// One body of many static instances.
#[derive(Clone, Debug)]
pub(super) struct StaticBatch {
    pub(super) blas: Arc<Blas>,
    /// First triangle of each instance in the body, and the instance.
    starts: Vec<(u32, u32)>,
}

impl StaticBatch {
    /// Builds the batch of some instances of a scene at their current placements.
    pub(super) fn build(
        scene: &Scene,
        pose: &ScenePose,
        instances: &[usize],
        placements: &[Placement],
        shortcuts: Shortcuts,
    ) -> Self {
        let (mut starts, mut masked) = (Vec::new(), Vec::new());
        for &index in instances {
            let posed = PosedMesh::at_rest(scene, scene.rest(&scene.instances()[index]));
            starts.push((masked.len() as u32, index as u32));
            let is_masked = posed.masked() || !shortcuts.contains(Shortcuts::MASKS);
            masked.resize(masked.len() + posed.triangles.len(), is_masked);
        }
        let mut batch = Self { blas: Arc::default(), starts };
        let triangles = batch.triangles(scene, pose, placements, |_| true);
        let blas = Blas::build(&triangles, Effort::Best).with_masks(|triangle| masked[triangle as usize]);
        batch.blas = Arc::new(blas);
        batch
    }

    /// Refits the body, without the triangles of instances that are not `present`.
    pub(super) fn refit(
        &mut self,
        scene: &Scene,
        pose: &ScenePose,
        placements: &[Placement],
        present: &[bool],
    ) {
        let triangles = self.triangles(scene, pose, placements, |index| present[index]);
        Arc::make_mut(&mut self.blas).refit(&triangles);
    }

    /// Returns the bytes held on the heap.
    pub(super) fn heap_bytes(&self) -> usize {
        self.blas.heap_bytes() + memory::list(&self.starts)
    }

    /// Returns the instances from which it was built.
    pub(super) fn instances(&self) -> impl Iterator<Item = usize> + '_ {
        self.starts.iter().map(|&(_, index)| index as usize)
    }

    /// Returns the instance and its triangle for a triangle of the body.
    pub(super) fn source(&self, triangle: u32) -> (u32, u32) {
        let at = self.starts.partition_point(|&(first, _)| first <= triangle) - 1;
        let (first, instance) = self.starts[at];
        (instance, triangle - first)
    }

    /// Returns its triangles in world space. Triangles of absent instances are NaN, which no ray hits.
    fn triangles(
        &self,
        scene: &Scene,
        pose: &ScenePose,
        placements: &[Placement],
        present: impl Fn(usize) -> bool,
    ) -> Vec<[Vec3; 3]> {
        let mut geometry = Geometry::default();
        let mut triangles = Vec::new();
        for index in self.instances() {
            scene.local_geometry(InstanceId(index as u32), pose, &mut geometry);
            let posed = PosedMesh::posed(scene, scene.rest(&scene.instances()[index]), &geometry);
            let (at, is_present) = (&placements[index], present(index));
            let placed = |corner: Vec3| if is_present { at.point(corner) } else { Vec3::NAN };
            triangles.extend(corners(&posed).into_iter().map(|triangle| triangle.map(placed)));
        }
        triangles
    }
}
