//! Weighted sample elimination: reduces many random points to fewer, evenly spaced ones.
//!
//! The method is that of Yuksel 2015, "Sample Elimination for Generating Poisson Disk Sample Sets" (the paper's
//! [Yuk15]). Its parameters are alpha = 8, beta = 0.65 and gamma = 1.5 in two dimensions. It removes the point with
//! the heaviest neighbourhood, reduces the weights of its neighbours, and repeats.
//!
//! Yuksel takes the points from a heap, one by one. This implementation removes a point as soon as it is heavier than
//! all of its neighbours. The result is bit-identical to that of the heap, for these reasons:
//!
//! 1. Weights only decrease. If a point is heavier than its neighbours, a heap removes it before them: no neighbour
//!    can overtake it before one of them is removed. So the order of removal in one place does not depend on other
//!    places.
//! 2. A heap removes points in descending order of their weight at removal, again because weights only decrease. So
//!    the points that a heap removes first are those with the largest weights at removal, in whatever order this
//!    implementation removes them. If it removes too many, the lightest of them are kept.
//! 3. A difference of floats depends on the order of the subtractions, and by 2 that order is known. If neighbours
//!    were removed in another order, the subtractions are repeated before the point is removed. Rounding preserves
//!    order (a <= b implies fl(a - c) <= fl(b - c) <= b), so a missing subtraction only makes a point heavier.
//!    Therefore 1 also holds for rounded weights, and while a neighbour's weight is still too high.

mod grid;
mod region;
#[cfg(test)]
pub(super) mod tests;

use std::cmp::Reverse;

use glam::Vec3;
use rayon::prelude::*;

use grid::{Grid, Links};
use region::{CrossLink, Region};

/// Fewest points of a region. Smaller regions spend more time waiting for each other than working.
const MIN_REGION_POINTS: usize = 1 << 13;

/// Largest average number of visits to a link before a single region is expected to be faster. The usual number is 1.
/// Regions mostly wait for each other if points have thousands of neighbours.
const MAX_VISITS_PER_LINK: usize = 8;

/// Returns the largest possible Poisson-disk radius in metres of `count` points on a surface of `area` square metres.
/// It is half the distance between neighbours in the densest packing (Yuksel, section 3, in two dimensions).
#[must_use]
pub fn poisson_radius(area: f64, count: usize) -> f32 {
    (area / (2.0 * 3f64.sqrt() * count.max(1) as f64)).sqrt() as f32
}

/// Reduces points to `keep` points by weighted sample elimination. Returns the numbers of the kept points, ascending,
/// or all numbers if there are at most `keep` points. `radius` is [`poisson_radius`] of the area and `keep`; it is
/// finite. Points within twice the radius put weight on each other.
///
/// There may be up to 2^31 points. Points that are not finite have no neighbours. The result depends on the arguments
/// alone, not on the number of threads or the machine.
#[must_use]
pub fn eliminate(points: &[Vec3], keep: usize, radius: f32) -> Vec<u32> {
    let threads = rayon::current_num_threads();
    // Two regions per thread, so that a waiting region delays the others less.
    let regions = if threads == 1 { 1 } else { 2 * threads };
    eliminate_in(points, keep, radius, points.len().div_ceil(regions).max(MIN_REGION_POINTS))
}

/// Does the same as [`eliminate`] in regions of about `region` points.
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

/// Returns the `surplus` points that are removed first, or `None` if the regions wait for each other so often that a
/// single region is faster.
fn remove(mut regions: Vec<Region>, surplus: usize) -> Option<Vec<u32>> {
    let links: usize = regions.iter().map(Region::links).sum();
    // Number of points removed before the last sweep, per region. All of them weighed more than any point of the last
    // sweep.
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
            let mut last: Vec<RemovalKey> =
                parts().flat_map(|(region, &settled)| &region.removed()[settled..]).copied().collect();
            last.sort_unstable_by_key(|&key| Reverse(key));
            let sure = parts().flat_map(|(region, &settled)| &region.removed()[..settled]);
            return Some(sure.chain(&last[..surplus - sum]).map(|key| key.point()).collect());
        }
        settled = removed;
    }
}

/// Divides the points into regions of about `length` points.
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

/// Copies the keys of all exported points to the regions in which they are ghosts.
fn exchange_keys(regions: &mut [Region]) {
    let exported_keys: Vec<_> = regions.par_iter().map(Region::export_keys).collect();
    regions.par_iter_mut().for_each(|region| region.import_keys(&exported_keys));
}

/// Estimates a weight that about `count` points exceed when they are removed. Surplus removals are undone at the end
/// and missing ones need another sweep, so the estimate affects only time.
fn estimate_threshold(regions: &[Region], count: usize) -> RemovalKey {
    let mut classes = vec![0; CLASSES];
    regions.iter().for_each(|region| region.count_classes(&mut classes));
    // Some points become lighter before they are removed.
    let wanted = count + count / 4 * 3 + 16;
    let mut sum = 0;
    let class = (0..CLASSES).rev().find(|&class| {
        sum += classes[class];
        sum >= wanted
    });
    RemovalKey::lowest_of(class.unwrap_or(0))
}

/// The weight of a neighbour as a function of its distance (Yuksel, section 3).
#[derive(Clone, Copy)]
pub(super) struct Weighting {
    /// Distance in metres within which points put weight on each other.
    pub(super) reach: f32,
    nearest: f32,
}

impl Weighting {
    pub(super) fn new(keep: usize, from: usize, radius: f32) -> Self {
        let share = keep as f32 / from as f32;
        // The exponent gamma = 1.5 is computed by a square root, which is the same on every machine.
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

/// Weight and number of a point; the number is below 2^31. The greatest key is removed first: the heaviest point, and
/// of equal ones the one with the lowest number. Keys of removed points are below all others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct RemovalKey(u64);

/// Number of bits in a class of weights: sign, exponent and five bits of the fraction.
const CLASS_BITS: u32 = 14;
const CLASSES: usize = 1 << CLASS_BITS;

impl RemovalKey {
    /// A key below every other.
    const NONE: Self = Self(0);
    /// A key above every other.
    const FIRST: Self = Self(u64::MAX);
    /// Bit that is set until the point is removed.
    const PRESENT: u64 = 1 << 63;
    /// Bits of the point's number, inverted.
    const POINT: u64 = (1 << 31) - 1;

    fn new(weight: f32, point: u32) -> Self {
        // Maps the float to an integer that grows with the weight, with one value for both zeros.
        let bits = (weight + 0.0).to_bits();
        let ordered = if bits >> 31 == 0 { bits | (1 << 31) } else { !bits };
        Self(Self::PRESENT | (u64::from(ordered) << 31)).of(point)
    }

    /// Returns the same key with another point's number.
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

    /// Returns the key of the point after its removal.
    fn removed(self) -> Self {
        Self(self.0 & !Self::PRESENT)
    }

    fn is_removed(self) -> bool {
        self.0 & Self::PRESENT == 0
    }

    /// Returns the key that the point had at its removal.
    fn key_at_removal(self) -> Self {
        Self(self.0 | Self::PRESENT)
    }

    /// Returns the class of the weight, below [`CLASSES`]. It is higher for heavier weights.
    fn class(self) -> usize {
        (self.0 >> (63 - CLASS_BITS)) as usize % CLASSES
    }

    /// Returns a lower bound of all keys in a class and higher classes. It is above the keys of removed points.
    fn lowest_of(class: usize) -> Self {
        Self(Self::PRESENT | ((class as u64) << (63 - CLASS_BITS)))
    }
}
