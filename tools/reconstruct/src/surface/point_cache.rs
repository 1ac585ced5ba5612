//! The points around an octant of a cell with their current AO, in groups of eight.
//!
//! Two caches stand one behind the other. The first holds the points of 2 x 2 x 2 cells (a *region*). The second holds
//! those points of a region that are near enough to an octant. Neighbouring fragments mostly share an octant, and
//! neighbouring octants a region, so entries are rarely filled.

use psao_codec::surface::NO_VALUE;

use super::grid::{IndexPoint, LevelGrid, Octant};
use crate::kernel::{LANES, Mark, PointGroup};

/// Function from an instance and a point of its set to the point's AO byte; `None` until the byte has arrived,
/// [`NO_VALUE`] for a point that does not count.
pub(crate) trait AoSource: Fn(u32, usize) -> Option<u8> + Sync {}

impl<F: Fn(u32, usize) -> Option<u8> + Sync> AoSource for F {}

/// A chart of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sheet {
    pub(crate) instance: u32,
    pub(crate) chart: u32,
}

impl Sheet {
    /// Returns the part of an entry's number that belongs to the chart, up to `mask`.
    #[inline]
    fn slot(self, mask: u32) -> i32 {
        (self.instance.wrapping_add(self.chart) & mask) as i32
    }
}

/// A chart of an instance at a level.
type LeveledSheet = (u8, Sheet);

/// Points in groups of eight.
#[derive(Clone)]
struct PointGroups {
    count: usize,
    groups: Vec<PointGroup>,
}

impl PointGroups {
    const EMPTY: Self = Self { count: 0, groups: Vec::new() };

    fn clear(&mut self) {
        self.count = 0;
        self.groups.clear();
    }

    /// Returns the group and the lane of one more point.
    #[inline]
    fn lane(&mut self) -> (&mut PointGroup, usize) {
        let lane = self.count % LANES;
        if lane == 0 {
            self.groups.push(PointGroup::EMPTY);
        }
        self.count += 1;
        let last = self.groups.len() - 1;
        (&mut self.groups[last], lane)
    }
}

/// The points of 2 x 2 x 2 cells.
#[derive(Clone)]
struct Region {
    /// Level, sheet and lowest cell; `None` for an empty entry.
    key: Option<(LeveledSheet, [i32; 3])>,
    points: PointGroups,
}

impl Region {
    fn fill(&mut self, ao: &impl AoSource, grid: &LevelGrid, sheet: LeveledSheet, base: [i32; 3]) {
        self.key = Some((sheet, base));
        self.points.clear();
        each_point(ao, grid, sheet.1, base, |placed, ao, mark| {
            let (group, lane) = self.points.lane();
            group.set(lane, placed.position, placed.normal, ao, mark);
        });
    }
}

/// Returns the accessibility of a byte.
pub(crate) fn accessibility(ao: u8) -> f32 {
    f32::from(ao) / 255.0
}

/// Calls `take` with each point of the 2 x 2 x 2 cells from `base` on that has a value, and its accessibility; and with each
/// point of the grid's own level that has not arrived.
fn each_point(
    ao: &impl AoSource,
    grid: &LevelGrid,
    sheet: Sheet,
    base: [i32; 3],
    mut take: impl FnMut(&IndexPoint, f32, Mark),
) {
    for step in 0..8 {
        let cell = [base[0] + (step & 1), base[1] + (step >> 1 & 1), base[2] + (step >> 2)];
        for placed in grid.cell(sheet.chart, cell) {
            let finest = grid.is_finest(placed);
            match ao(sheet.instance, placed.point as usize) {
                Some(NO_VALUE) => {}
                Some(ao) => take(placed, accessibility(ao), if finest { Mark::FINEST } else { Mark::NONE }),
                None if finest => take(placed, 0.0, Mark::MISSING),
                None => {}
            }
        }
    }
}

/// Gives each point that may be near the places of an octant to `take`: those of [`PointCache::of`] in their order,
/// without any memory.
pub(crate) fn each_near(
    ao: &impl AoSource,
    grid: &LevelGrid,
    sheet: Sheet,
    octant: Octant,
    mut take: impl FnMut(&IndexPoint, f32, Mark),
) {
    let [low, high] = grid.corners(octant).map(|corner| corner.to_array());
    let reach = grid.reach() * grid.reach();
    each_point(ao, grid, sheet, LevelGrid::base(octant), |placed, ao, mark| {
        let mut square = 0.0_f32;
        for axis in 0..3 {
            square += square_past(low[axis], high[axis], placed.position[axis]);
        }
        if square <= reach {
            take(placed, ao, mark);
        }
    });
}

/// Returns the squared distance on one axis from `at` to the interval from `low` to `high`.
#[inline]
fn square_past(low: f32, high: f32, at: f32) -> f32 {
    let past = (low - at).max(at - high).max(0.0);
    past * past
}

/// The points of a region that may be near the places in an octant.
#[derive(Clone)]
struct OctantPoints {
    key: Option<(LeveledSheet, Octant)>,
    points: PointGroups,
}

impl OctantPoints {
    fn fill(&mut self, region: &Region, grid: &LevelGrid, sheet: LeveledSheet, octant: Octant) {
        self.key = Some((sheet, octant));
        self.points.clear();
        let [low, high] = grid.corners(octant).map(|corner| corner.to_array());
        let reach = grid.reach() * grid.reach();
        for group in &region.points.groups {
            let mut square = [0.0_f32; LANES];
            for axis in 0..3 {
                for (square, &at) in square.iter_mut().zip(&group.position[axis]) {
                    *square += square_past(low[axis], high[axis], at);
                }
            }
            for (lane, &square) in square.iter().enumerate() {
                if square <= reach {
                    self.points.take(group, lane);
                }
            }
        }
    }
}

impl PointGroups {
    /// Adds a copy of a point.
    #[inline]
    fn take(&mut self, from: &PointGroup, at: usize) {
        let (group, lane) = self.lane();
        for axis in 0..3 {
            group.position[axis][lane] = from.position[axis][at];
            group.normal[axis][lane] = from.normal[axis][at];
        }
        group.ao[lane] = from.ao[at];
        group.mark[lane] = from.mark[at];
    }
}

/// Cache of the regions and octants that were needed last.
pub(crate) struct PointCache {
    regions: Vec<Region>,
    near: Vec<OctantPoints>,
}

impl PointCache {
    /// Number of entries. Adjacent regions of a chart never share an entry, nor do octants less than four apart,
    /// nor four consecutive charts.
    const REGION_ENTRIES: usize = 32;
    const OCTANT_ENTRIES: usize = 256;

    pub(crate) fn new() -> Self {
        Self {
            regions: vec![Region { key: None, points: PointGroups::EMPTY }; Self::REGION_ENTRIES],
            near: vec![OctantPoints { key: None, points: PointGroups::EMPTY }; Self::OCTANT_ENTRIES],
        }
    }

    /// Returns the points that may be near the places in an octant.
    #[inline]
    pub(crate) fn of(
        &mut self,
        ao: &impl AoSource,
        grid: &LevelGrid,
        sheet: LeveledSheet,
        octant: Octant,
    ) -> &[PointGroup] {
        let Octant([x, y, z]) = octant;
        let slot = x & 3 | (y & 3) << 2 | (z & 3) << 4 | sheet.1.slot(3) << 6;
        let near = &mut self.near[slot as usize];
        if near.key != Some((sheet, octant)) {
            near.fill(region(&mut self.regions, ao, grid, sheet, octant), grid, sheet, octant);
        }
        &near.points.groups
    }
}

/// Returns the region of an octant.
fn region<'a>(
    regions: &'a mut [Region],
    ao: &impl AoSource,
    grid: &LevelGrid,
    sheet: LeveledSheet,
    octant: Octant,
) -> &'a Region {
    let base = LevelGrid::base(octant);
    let [x, y, z] = base;
    let slot = x & 1 | (y & 1) << 1 | (z & 1) << 2 | sheet.1.slot(3) << 3;
    let region = &mut regions[slot as usize];
    if region.key != Some((sheet, base)) {
        region.fill(ao, grid, sheet, base);
    }
    region
}
