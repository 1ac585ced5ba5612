//! The spatial index of a set's points, derived from the geometry alone.

use glam::Vec3;
use psao_codec::surface::{Geometry, SetLayout};

use super::chart_tree::{ChartTree, Nearest};
use super::grid::{IndexPoint, LevelGrid};

/// Spatial index of a set's points: a grid for each level, with the points up to that level, and a tree for places with few
/// points around them.
///
/// It depends on the geometry alone, so one index serves all instances of a set in every frame. It holds every point,
/// wherever the points lie.
#[derive(Clone, Debug)]
pub struct SurfaceIndex {
    layout: SetLayout,
    /// By level; there is at least one.
    grids: Vec<LevelGrid>,
    tree: ChartTree,
}

impl SurfaceIndex {
    /// Indexes the points of a set in O(n log n) time. It takes about 36 bytes a point for a set with one level, and twice
    /// as many for one with many levels.
    #[must_use]
    pub fn new(geometry: &Geometry) -> Self {
        let layout = *geometry.layout();
        let grids: Vec<LevelGrid> =
            (0..layout.levels.count()).map(|level| LevelGrid::new(geometry, level)).collect();
        let chart = |point: &IndexPoint| geometry.chart(point.point as usize);
        let tree = ChartTree::new(grids.last().map_or(&[], LevelGrid::points), chart);
        Self { layout, grids, tree }
    }

    /// Returns the size of the index on the heap in bytes.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        self.grids.iter().map(LevelGrid::heap_bytes).sum::<usize>() + self.tree.heap_bytes()
    }

    /// Returns the level for points of this distance from each other, metres.
    #[inline]
    pub(crate) fn level_within(&self, spacing: f32) -> u8 {
        self.layout.level_within(spacing)
    }

    /// Returns the grid of a level of the set.
    #[inline]
    pub(crate) fn grid(&self, level: u8) -> &LevelGrid {
        &self.grids[usize::from(level)]
    }

    /// Returns the points of a chart that are nearest to a place, among those up to a level for which `counts` is true.
    pub(crate) fn nearest(
        &self,
        (chart, level): (u32, u8),
        place: Vec3,
        counts: impl Fn(&IndexPoint) -> bool,
    ) -> Nearest {
        let end = self.layout.levels.end(level, self.layout.points);
        let counts = |point: &IndexPoint| point.point < end && counts(point);
        self.tree.nearest(self.points(), chart, place.to_array(), counts)
    }

    /// Returns a point that [`nearest`](Self::nearest) has found.
    pub(crate) fn point(&self, at: u32) -> &IndexPoint {
        &self.points()[at as usize]
    }

    fn points(&self) -> &[IndexPoint] {
        self.grids.last().map_or(&[], LevelGrid::points)
    }
}
