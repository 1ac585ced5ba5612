//! Weighted sample elimination: from many random points to fewer that keep their distance.
//!
//! Yuksel 2015, "Sample Elimination for Generating Poisson Disk Sample Sets" (the paper's [Yuk15]), with its
//! parameters alpha = 8, beta = 0.65, gamma = 1.5 in two dimensions. The point with the heaviest neighbourhood goes,
//! its neighbours get lighter, and so on.
//!
//! Yuksel takes the points from a heap, one by one. Here a point goes as soon as it is heavier than all of its
//! neighbours, which gives the same points to the last bit, for these reasons:
//!
//! 1. Weights only drop. Of a point that is heavier than its neighbours and these, a heap has it first: none of them
//!    can overtake it before one of them has removed. So who goes where does not depend on what happens elsewhere.
//! 2. A heap gives points in order of what they recompute_weight when they go, again because weights only drop. So the points that
//!    a heap has first are those that weighed most when they went, in whatever order they went here; where more have
//!    removed than should, the lightest of them stay.
//! 3. A difference of floats depends on the order of the subtractions, and by 2 that order is known: where neighbours
//!    went in another one, the subtractions are done again before the point goes. Rounding keeps order (a <= b makes
//!    fl(a - c) <= fl(b - c) <= b), so a subtraction that is missing only makes a point heavier, and what is said in 1
//!    holds for rounded weights, and where a neighbour's weight is still too high.

mod grid;
mod region;
#[cfg(test)]
pub(super) mod tests;

use std::cmp::Reverse;

use glam::Vec3;
use rayon::prelude::*;

use grid::{Grid, Links};
use region::{CrossLink, Region};

/// Fewest points of a region: smaller ones wait for each other more than they work.
const MIN_REGION_POINTS: usize = 1 << 13;

/// How often regions may look at each link, on average, before one region alone is thought to be faster. Once is usual;
/// where points have thousands of neighbours, regions do little but wait for each other.
const MAX_VISITS_PER_LINK: usize = 8;

/// Largest possible Poisson-disk radius of `count` points on a surface of `area` square metres, in metres: half the
/// distance between neighbours in the densest packing (Yuksel, section 3, in two dimensions).
#[must_use]
pub fn poisson_radius(area: f64, count: usize) -> f32 {
    (area / (2.0 * 3f64.sqrt() * count.max(1) as f64)).sqrt() as f32
}

/// Weighted sample elimination: numbers of the `keep` points that are left, ascending. `radius` is [`poisson_radius`] of
/// the area and `keep`, finite; points within twice as much recompute_weight on each other. All points are left where there are no
/// more than `keep`. There may be up to 2^31 points. The result depends on the arguments alone, not on the number of threads or the machine; points that
/// are not finite have no neighbours.
#[must_use]
pub fn eliminate(points: &[Vec3], keep: usize, radius: f32) -> Vec<u32> {
    let threads = rayon::current_num_threads();
    // Two for each thread, so that one that is held up does not hold up the others for long.
    let regions = if threads == 1 { 1 } else { 2 * threads };
    eliminate_in(points, keep, radius, points.len().div_ceil(regions).max(MIN_REGION_POINTS))
}

/// As [`eliminate`], in regions of about this many points.
fn eliminate_in(points: &[Vec3], keep: usize, radius: f32, region: usize) -> Vec<u32> {
    let Some(surplus) = points.len().checked_sub(keep).filter(|&surplus| surplus > 0) else {
        return (0..points.len() as u32).collect();
    };
    let grid = Grid::new(points, 2.0 * radius);
    let weighting = Weighting::new(keep, points.len(), radius);
    let removed = remove(regions(&grid, weighting, region), surplus)
        .or_else(|| remove(regions(&grid, weighting, usize::MAX), surplus))
        .unwrap_or_default();
    let mut left = vec![true; points.len()];
    for point in removed {
        left[grid.number(point) as usize] = false;
    }
    (0u32..).zip(left).filter(|&(_, left)| left).map(|(number, _)| number).collect()
}

/// The `surplus` points that go first. `None` where the regions hold each other up so often that one alone is faster.
fn remove(mut regions: Vec<Region>, surplus: usize) -> Option<Vec<u32>> {
    let links: usize = regions.iter().map(Region::links).sum();
    // Points that went before the last sweep, by region: all of them weighed more than any that went in it.
    let mut settled = vec![0; regions.len()];
    loop {
        let sum: usize = settled.iter().sum();
        let threshold = estimate_threshold(&regions, surplus - sum);
        exchange_keys(&mut regions);
        regions.par_iter_mut().for_each(|region| region.sweep(threshold));
        while regions.iter().any(Region::is_blocked) {
            let link_visits: usize = regions.iter().map(Region::link_visits).sum();
            if regions.len() > 1 && link_visits > MAX_VISITS_PER_LINK * links {
                return None;
            }
            exchange_keys(&mut regions);
            regions.par_iter_mut().for_each(|region| region.retry(threshold));
        }
        let removed: Vec<usize> = regions.iter().map(|region| region.removed().len()).collect();
        if removed.iter().sum::<usize>() >= surplus {
            let parts = || regions.iter().zip(&settled);
            let mut last: Vec<Key> =
                parts().flat_map(|(region, &settled)| &region.removed()[settled..]).copied().collect();
            last.sort_unstable_by_key(|&key| Reverse(key));
            let sure = parts().flat_map(|(region, &settled)| &region.removed()[..settled]);
            return Some(sure.chain(&last[..surplus - sum]).map(|key| key.point()).collect());
        }
        settled = removed;
    }
}

/// Cuts the points into regions of about `length`.
fn regions(grid: &Grid, weighting: Weighting, length: usize) -> Vec<Region> {
    let cell_ranges = grid.cell_ranges(length);
    let links = |cells: &_| (grid.points_of(cells), grid.links_ahead(cells, weighting));
    let ahead: Vec<(_, Links)> = cell_ranges.par_iter().map(links).collect();
    let mut cross_links: Vec<CrossLink> =
        ahead.iter().flat_map(|(own, links)| CrossLink::out_of(own.clone(), links)).collect();
    cross_links.sort_unstable_by_key(|link| (link.to, link.from));
    let mut regions: Vec<Region> = ahead
        .into_par_iter()
        .map(|(own, ahead)| {
            let first = |number| cross_links.partition_point(|link| link.to < number);
            let behind = first(own.start)..first(own.end);
            Region::new(own, ahead, &cross_links[behind])
        })
        .collect();
    Region::connect_ghosts(&mut regions);
    regions
}

/// Tells every region how its ghosts stand.
fn exchange_keys(regions: &mut [Region]) {
    let exported_keys: Vec<_> = regions.par_iter().map(Region::export_keys).collect();
    regions.par_iter_mut().for_each(|region| region.import_keys(&exported_keys));
}

/// A weight such that about `open` points recompute_weight more when they go. Too many are put right at the end, too few by another
/// go, so this is a matter of time alone.
fn estimate_threshold(regions: &[Region], open: usize) -> Key {
    let mut classes = vec![0; CLASSES];
    regions.iter().for_each(|region| region.count_classes(&mut classes));
    // Some get lighter before their turn comes.
    let wanted = open + open / 4 * 3 + 16;
    let mut sum = 0;
    let class = (0..CLASSES).rev().find(|&class| {
        sum += classes[class];
        sum >= wanted
    });
    Key::lowest_of(class.unwrap_or(0))
}

/// The weight that a neighbour at some distance puts on a point (Yuksel, section 3).
#[derive(Clone, Copy)]
pub(super) struct Weighting {
    /// Metres within which points recompute_weight on each other.
    pub(super) reach: f32,
    nearest: f32,
}

impl Weighting {
    pub(super) fn new(keep: usize, from: usize, radius: f32) -> Self {
        let share = keep as f32 / from as f32;
        // gamma = 1.5 as a root, which is the same on every machine.
        let nearest = radius * (1.0 - share * share.sqrt()) * 0.65;
        Self { reach: 2.0 * radius, nearest: 2.0 * nearest }
    }

    pub(super) fn at(&self, distance: f32) -> f32 {
        let base = 1.0 - distance.max(self.nearest).min(self.reach) / self.reach;
        let square = base * base;
        let fourth = square * square;
        fourth * fourth
    }
}

/// What a point weighs, and its number, below 2^31. The greatest goes first: the heaviest point, and of equals the one
/// with the lowest number. Keys of points that are removed are below all of those that are not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key(u64);

/// Bits of a class of weights: sign, exponent and five of the fraction.
const CLASS_BITS: u32 = 14;
const CLASSES: usize = 1 << CLASS_BITS;

impl Key {
    /// Below every other.
    const NONE: Self = Self(0);
    /// Above every other.
    const FIRST: Self = Self(u64::MAX);
    /// Set until the point is removed.
    const PRESENT: u64 = 1 << 63;
    /// The point's number, upside down.
    const POINT: u64 = (1 << 31) - 1;

    fn new(weight: f32, point: u32) -> Self {
        // Sign and magnitude become a number that grows with the weight; both zeros become one.
        let bits = (weight + 0.0).to_bits();
        let ordered = if bits >> 31 == 0 { bits | (1 << 31) } else { !bits };
        Self(Self::PRESENT | (u64::from(ordered) << 31)).of(point)
    }

    /// The same of another point.
    fn of(self, point: u32) -> Self {
        Self((self.0 & !Self::POINT) | (!u64::from(point) & Self::POINT))
    }

    fn weight(self) -> f32 {
        let ordered = (self.0 >> 31) as u32;
        f32::from_bits(if ordered >> 31 == 1 { ordered & !(1 << 31) } else { !ordered })
    }

    fn point(self) -> u32 {
        (!self.0 & Self::POINT) as u32
    }

    /// The key once the point is removed.
    fn removed(self) -> Self {
        Self(self.0 & !Self::PRESENT)
    }

    fn is_removed(self) -> bool {
        self.0 & Self::PRESENT == 0
    }

    /// The key when the point went.
    fn key_at_removal(self) -> Self {
        Self(self.0 | Self::PRESENT)
    }

    /// Class of the weight, higher for heavier ones, below [`CLASSES`].
    fn class(self) -> usize {
        (self.0 >> (63 - CLASS_BITS)) as usize % CLASSES
    }

    /// Not above any key of a class or a higher one, but above those of points that are removed.
    fn lowest_of(class: usize) -> Self {
        Self(Self::PRESENT | ((class as u64) << (63 - CLASS_BITS)))
    }
}
