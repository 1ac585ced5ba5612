//! The points around a patch of fragments with their current AO, eight side by side.
//!
//! In two steps, each of which keeps what was needed last: the points of 2 x 2 x 2 cells with their AO (*region*), and
//! of these the ones that are near enough to a patch. Fragments near each other mostly share their patch, and patches
//! their region, so neither is made often.

use super::index::{IndexPoint, Patch, SurfaceIndex};
use crate::kernel::{Group, LANES};

/// AO byte of an instance's point, which its set's geometry numbers; `None` until it has come.
pub(crate) trait Ao: Fn(u32, usize) -> Option<u8> + Sync {}

impl<F: Fn(u32, usize) -> Option<u8> + Sync> Ao for F {}

/// Points, eight side by side.
#[derive(Clone)]
struct Groups {
    count: usize,
    groups: Vec<Group>,
}

impl Groups {
    const NONE: Self = Self { count: 0, groups: Vec::new() };

    fn clear(&mut self) {
        self.count = 0;
        self.groups.clear();
    }

    /// The lane for one more point.
    #[inline]
    fn lane(&mut self) -> (&mut Group, usize) {
        let lane = self.count % LANES;
        if lane == 0 {
            self.groups.push(Group::EMPTY);
        }
        self.count += 1;
        let last = self.groups.len() - 1;
        (&mut self.groups[last], lane)
    }
}

/// The points of 2 x 2 x 2 cells.
#[derive(Clone)]
struct Region {
    /// Instance and lowest cell.
    key: Option<(u32, [i32; 3])>,
    points: Groups,
}

impl Region {
    fn fill(&mut self, ao: &impl Ao, index: &SurfaceIndex, instance: u32, base: [i32; 3]) {
        self.key = Some((instance, base));
        self.points.clear();
        each_arrived(ao, index, instance, base, |placed, ao| {
            let (group, lane) = self.points.lane();
            group.set(lane, placed.position, placed.normal, ao);
        });
    }
}

/// Gives each point of the 2 x 2 x 2 cells from `base` on whose AO has come to `take`, with its accessibility.
fn each_arrived(
    ao: &impl Ao,
    index: &SurfaceIndex,
    instance: u32,
    base: [i32; 3],
    mut take: impl FnMut(&IndexPoint, f32),
) {
    for step in 0..8 {
        let cell = [base[0] + (step & 1), base[1] + (step >> 1 & 1), base[2] + (step >> 2)];
        for placed in index.cell(cell) {
            if let Some(ao) = ao(instance, placed.point as usize) {
                take(placed, f32::from(ao) / 255.0);
            }
        }
    }
}

/// Gives each point that may be near the places of a patch to `take`: those of [`Patches::of`] in their order, without
/// any memory.
pub(crate) fn each_near(
    ao: &impl Ao,
    index: &SurfaceIndex,
    instance: u32,
    patch: Patch,
    mut take: impl FnMut(&IndexPoint, f32),
) {
    let [low, high] = index.corners(patch).map(|corner| corner.to_array());
    let reach = index.reach() * index.reach();
    each_arrived(ao, index, instance, SurfaceIndex::base(patch), |placed, ao| {
        let mut square = 0.0_f32;
        for axis in 0..3 {
            square += square_past(low[axis], high[axis], placed.position[axis]);
        }
        if square <= reach {
            take(placed, ao);
        }
    });
}

/// Squared distance on one axis from `at` to the interval from `low` to `high`.
#[inline]
fn square_past(low: f32, high: f32, at: f32) -> f32 {
    let past = (low - at).max(at - high).max(0.0);
    past * past
}

/// The points of a region that may be near the fragments of a patch.
#[derive(Clone)]
struct PatchPoints {
    key: Option<(u32, Patch)>,
    points: Groups,
}

impl PatchPoints {
    fn fill(&mut self, region: &Region, index: &SurfaceIndex, instance: u32, patch: Patch) {
        self.key = Some((instance, patch));
        self.points.clear();
        let [low, high] = index.corners(patch).map(|corner| corner.to_array());
        let reach = index.reach() * index.reach();
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

impl Groups {
    /// Adds a copy of a point.
    #[inline]
    fn take(&mut self, from: &Group, at: usize) {
        let (group, lane) = self.lane();
        for axis in 0..3 {
            group.position[axis][lane] = from.position[axis][at];
            group.normal[axis][lane] = from.normal[axis][at];
        }
        group.ao[lane] = from.ao[at];
    }
}

/// Regions and patches that were needed last.
pub(crate) struct Patches {
    regions: Vec<Region>,
    near: Vec<PatchPoints>,
}

impl Patches {
    /// Slots: regions that touch never share one, nor patches less than four apart, nor two instances that follow
    /// each other.
    const REGIONS: usize = 16;
    const PATCHES: usize = 128;

    pub(crate) fn new() -> Self {
        Self {
            regions: vec![Region { key: None, points: Groups::NONE }; Self::REGIONS],
            near: vec![PatchPoints { key: None, points: Groups::NONE }; Self::PATCHES],
        }
    }

    /// The points that may be near the fragments of a patch.
    #[inline]
    pub(crate) fn of(&mut self, ao: &impl Ao, index: &SurfaceIndex, instance: u32, patch: Patch) -> &[Group] {
        let Patch([x, y, z]) = patch;
        let slot = x & 3 | (y & 3) << 2 | (z & 3) << 4 | (instance as i32 & 1) << 6;
        let near = &mut self.near[slot as usize];
        if near.key != Some((instance, patch)) {
            near.fill(region(&mut self.regions, ao, index, instance, patch), index, instance, patch);
        }
        &near.points.groups
    }
}

/// The region of a patch.
fn region<'a>(
    regions: &'a mut [Region],
    ao: &impl Ao,
    index: &SurfaceIndex,
    instance: u32,
    patch: Patch,
) -> &'a Region {
    let base = SurfaceIndex::base(patch);
    let [x, y, z] = base;
    let slot = x & 1 | (y & 1) << 1 | (z & 1) << 2 | (instance as i32 & 1) << 3;
    let region = &mut regions[slot as usize];
    if region.key != Some((instance, base)) {
        region.fill(ao, index, instance, base);
    }
    region
}
