//! Levels of detail: the order of a set's points, so that the first points of every chart are spread over all of it.
//!
//! The points of a chart are split by hierarchical Poisson-disk sampling (M. `McCool` and E. Fiume, "Hierarchical Poisson
//! disk sampling distributions", 1992). A level takes each point that is far enough from those of its own chart in this
//! and all coarser levels; from one level to the next finer, the distance shrinks by √2. The last level takes the rest.

use super::SetLayout;

/// Rows of the picture in whose pixels the quality of a stream is given: the distance of neighbouring points that a server
/// keeps.
pub const PICTURE_ROWS: f32 = 1080.0;

/// Largest number of levels of a set.
pub const MAX_LEVELS: usize = 12;

/// Points from which a set has one more level than one of half as many.
const POINTS_OF_TWO_LEVELS: u32 = 128;

/// Distance that a level keeps between its points, in radii of the fit at that level. A disk of that radius then holds
/// about seven points.
const SPACING: f64 = 5.0 / 9.0;

/// Levels by which the second to eighth point of a chart are coarser than their distances allow: a fit needs some points.
const RAISED_LEVELS: [u8; 7] = [2, 2, 1, 1, 1, 1, 1];

/// The number of points in the levels of a set. The points are ordered by level, the coarsest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Levels {
    count: u8,
    /// Numbers of points in a level and all coarser ones, for all levels but the last; 0 beyond.
    ends: [u32; MAX_LEVELS - 1],
}

impl Default for Levels {
    /// One level with all points.
    fn default() -> Self {
        Levels { count: 1, ends: [0; MAX_LEVELS - 1] }
    }
}

impl Levels {
    /// Creates levels from the number of points up to the end of each, except for the last level, which ends with the set.
    /// Returns `None` for more than 11 numbers, or for numbers that descend.
    #[must_use]
    pub fn from_ends(ends: &[u32]) -> Option<Levels> {
        let mut levels = Levels::default();
        levels.ends.get_mut(..ends.len())?.copy_from_slice(ends);
        levels.count = ends.len() as u8 + 1;
        ends.is_sorted().then_some(levels)
    }

    /// Returns the number of levels, 1 to [`MAX_LEVELS`].
    #[must_use]
    pub fn count(&self) -> u8 {
        self.count
    }

    /// Returns the number of points in each level and all coarser ones, for all levels but the last.
    #[must_use]
    pub fn ends(&self) -> &[u32] {
        &self.ends[..usize::from(self.count) - 1]
    }

    /// Returns the level of a point of a set, 0 for the coarsest.
    #[inline]
    #[must_use]
    pub fn of_point(&self, point: u32) -> u8 {
        self.ends().partition_point(|end| *end <= point) as u8
    }

    /// Returns the number of points in a level and all coarser ones, of a set of `points` points.
    #[must_use]
    pub fn end(&self, level: u8, points: u32) -> u32 {
        self.ends().get(usize::from(level)).copied().unwrap_or(points)
    }
}

impl SetLayout {
    /// Returns the radius of the fit where points up to a level are taken, metres: `kernel_radius` at the last level, and
    /// √2 times that of the next finer level at others.
    #[must_use]
    pub fn level_radius(&self, level: u8) -> f32 {
        (level.saturating_add(1)..self.levels.count())
            .fold(self.kernel_radius, |radius, _| radius * std::f32::consts::SQRT_2)
    }

    /// Returns the coarsest level whose points are at most `spacing` metres apart, or else the last level.
    #[must_use]
    pub fn level_within(&self, spacing: f32) -> u8 {
        let mut level = self.levels.count().saturating_sub(1);
        let mut radius = self.kernel_radius;
        while level > 0 {
            radius *= std::f32::consts::SQRT_2;
            // Written so that NaN fails.
            let fits = radius * SPACING as f32 <= spacing;
            if !fits {
                break;
            }
            level -= 1;
        }
        level
    }

    /// Returns the points of each level, the coarsest first.
    pub fn level_points(&self) -> impl Iterator<Item = std::ops::Range<u32>> {
        let SetLayout { levels, points, .. } = *self;
        (0..levels.count()).map(move |level| {
            let first = level.checked_sub(1).map_or(0, |coarser| levels.end(coarser, points));
            first..levels.end(level, points)
        })
    }

    /// Returns the distance of neighbouring points where points up to a level are taken, metres.
    #[must_use]
    pub fn level_spacing(&self, level: u8) -> f32 {
        self.level_radius(level) * SPACING as f32
    }
}

/// A point to be put into a level.
#[derive(Debug, Clone, Copy)]
pub(super) struct LevelPoint {
    pub(super) coord: [u32; 3],
    pub(super) chart: u32,
}

/// Returns the number of levels of a set of `points` points, and the level of each.
///
/// Only integers and products of `f64` decide, so the result is the same on every machine.
pub(super) fn assign(layout: &SetLayout, points: &[LevelPoint]) -> (u8, Vec<u8>) {
    let doublings = (points.len() as u32 / POINTS_OF_TWO_LEVELS).checked_ilog2().map_or(0, |log| log + 1);
    let count = (doublings as usize + 1).min(MAX_LEVELS) as u8;
    let last = count - 1;
    let mut levels = vec![last; points.len()];
    if last == 0 {
        return (count, levels);
    }
    let finest = finest_spacing(layout);
    let own = own_squares(points, finest);
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_unstable_by_key(|&point| (shuffle(point), point));
    let mut taken = Vec::new();
    // Squared distance of each point from the nearest one taken, as far as it is known.
    let mut nearest = vec![u64::MAX; points.len()];
    for level in 0..last {
        let most = spacing_square(finest, last - level);
        let mut grid = Grid::new(most as u64, points, &taken);
        order.retain(|&point| {
            let at = point as usize;
            let least = own[at].max(most / MOST_ROWS_FACTOR).min(most) as u64;
            if nearest[at] >= least {
                nearest[at] = grid.nearest(points, point);
            }
            let takes = nearest[at] >= least;
            if takes {
                levels[at] = level;
                taken.push(point);
                grid.add(points, point);
            }
            !takes
        });
    }
    taken.extend(order);
    raise_first(points, &taken, &mut levels);
    (count, levels)
}

/// Returns the distance that the finest level would keep between its points, nodes of the lattice.
fn finest_spacing(layout: &SetLayout) -> f64 {
    f64::from(layout.kernel_radius) / f64::from(layout.step) * SPACING
}

/// Returns the square of the distance that a level keeps, which is `above` levels coarser than the finest one.
fn spacing_square(finest: f64, above: u8) -> f64 {
    finest * finest * f64::from(1_u32 << above)
}

/// Returns the square of the distance between the points of a level, in nodes of the lattice.
pub(super) fn level_spacing_square(layout: &SetLayout, level: u8) -> f64 {
    spacing_square(finest_spacing(layout), layout.levels.count().saturating_sub(1).saturating_sub(level))
}

/// Puts the second to eighth point of every chart into coarser levels; the first one is in the coarsest. `taken` has the
/// points in the order in which they were taken.
fn raise_first(points: &[LevelPoint], taken: &[u32], levels: &mut [u8]) {
    let mut ranked: Vec<(u32, u32)> =
        (0..).zip(taken).map(|(rank, &point)| (points[point as usize].chart, rank)).collect();
    ranked.sort_unstable();
    for chart in ranked.chunk_by(|a, b| a.0 == b.0) {
        for ((_, place), raised) in chart[1..].iter().zip(RAISED_LEVELS) {
            let level = &mut levels[taken[*place as usize] as usize];
            *level = level.saturating_sub(raised);
        }
    }
}

/// Points per area of the finest level times the square of the distance that it would keep.
const AREA_PER_POINT: f64 = 1.43;
/// Number of rows of points that a narrow chart gets.
const ROWS: f64 = 3.0;
/// Largest factor by which the square of a distance is smaller for them.
const MOST_ROWS_FACTOR: f64 = 8.0;

/// Returns for each point the square of the distance that its chart asks for: its width, which is taken as area over
/// diameter, over the number of rows.
fn own_squares(points: &[LevelPoint], finest: f64) -> Vec<f64> {
    let mut by_chart: Vec<u32> = (0..points.len() as u32).collect();
    by_chart.sort_unstable_by_key(|&point| points[point as usize].chart);
    let mut squares = vec![0.0; points.len()];
    for chart in by_chart.chunk_by(|&a, &b| points[a as usize].chart == points[b as usize].chart) {
        let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
        for coord in chart.iter().map(|&point| points[point as usize].coord) {
            for axis in 0..3 {
                (low[axis], high[axis]) = (low[axis].min(coord[axis]), high[axis].max(coord[axis]));
            }
        }
        let diameter = (square_distance(low, high) as f64).sqrt() + finest;
        let width = chart.len() as f64 * AREA_PER_POINT * finest * finest / diameter;
        let distance = width / ROWS;
        chart.iter().for_each(|&point| squares[point as usize] = distance * distance);
    }
    squares
}

/// Returns a number that looks random, different for each point (the finaliser of `MurmurHash3` for 32 bits, A. Appleby).
fn shuffle(point: u32) -> u32 {
    let point = (point ^ (point >> 16)).wrapping_mul(0x85eb_ca6b);
    let point = (point ^ (point >> 13)).wrapping_mul(0xc2b2_ae35);
    point ^ (point >> 16)
}

/// The points taken so far, in chains by the hash of their cell.
struct Grid {
    /// Edge of a cell in nodes: the distance that is kept, or a little more.
    edge: u64,
    least: u64,
    heads: Vec<u32>,
    next: Vec<(u32, u32)>,
}

const NONE: u32 = u32::MAX;

impl Grid {
    fn new(least: u64, points: &[LevelPoint], taken: &[u32]) -> Grid {
        let heads = vec![NONE; (2 * taken.len() + 64).next_power_of_two()];
        let mut grid = Grid { edge: least.isqrt() + 1, least, heads, next: Vec::new() };
        taken.iter().for_each(|&point| grid.add(points, point));
        grid
    }

    fn bucket(&self, [x, y, z]: [u64; 3], chart: u32) -> usize {
        let key = x.wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ y.wrapping_mul(0xff51_afd7_ed55_8ccd)
            ^ z.wrapping_mul(0xc4ce_b9fe_1a85_ec53)
            ^ u64::from(chart).wrapping_mul(0x2545_f491_4f6c_dd1d);
        (key ^ key >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) as usize >> 20 & (self.heads.len() - 1)
    }

    fn cell(&self, point: &LevelPoint) -> [u64; 3] {
        point.coord.map(|axis| u64::from(axis) / self.edge)
    }

    fn add(&mut self, points: &[LevelPoint], point: u32) {
        if self.next.len() > self.heads.len() {
            let chained = std::mem::take(&mut self.next);
            self.heads = vec![NONE; 2 * self.heads.len()];
            chained.into_iter().for_each(|(point, _)| self.add(points, point));
        }
        let placed = &points[point as usize];
        let bucket = self.bucket(self.cell(placed), placed.chart);
        self.next.push((point, self.heads[bucket]));
        self.heads[bucket] = self.next.len() as u32 - 1;
    }

    /// Returns the squared distance of a point from the nearest of its chart, if that is below the one that is kept.
    fn nearest(&self, points: &[LevelPoint], point: u32) -> u64 {
        let placed = &points[point as usize];
        let middle = self.cell(placed);
        let mut nearest = u64::MAX;
        for step in 0..27_u64 {
            let steps = [step % 3, step / 3 % 3, step / 9];
            let cell = std::array::from_fn(|axis| (middle[axis] + steps[axis]).wrapping_sub(1));
            let mut at = self.heads[self.bucket(cell, placed.chart)];
            while let Some(&(other, next)) = self.next.get(at as usize) {
                let other = &points[other as usize];
                if other.chart == placed.chart {
                    nearest = nearest.min(square_distance(other.coord, placed.coord));
                }
                at = next;
            }
        }
        if nearest < self.least { nearest } else { u64::MAX }
    }
}

/// Returns the squared distance of two nodes of the lattice.
pub(super) fn square_distance(a: [u32; 3], b: [u32; 3]) -> u64 {
    a.into_iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(b)).pow(2)).sum()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Geometry, RestPoint};
    use super::*;
    use crate::testing::lattice;

    /// What [`assign`] does, without grids and memory.
    fn naive(layout: &SetLayout, points: &[LevelPoint]) -> Vec<u8> {
        let count =
            (0..12).take_while(|log| points.len() >= POINTS_OF_TWO_LEVELS as usize >> 1 << log).count();
        let last = count.max(1) as u8 - 1;
        let far = f64::from(layout.kernel_radius) * 256.0 * 5.0 / 9.0;
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|point| shuffle(*point as u32));
        let mut taken: Vec<usize> = Vec::new();
        let mut levels = vec![last; points.len()];
        // Squares of a third of the width of each chart.
        let own: Vec<f64> = (0..4)
            .map(|chart| {
                let of_chart: Vec<_> = points.iter().filter(|point| point.chart == chart).collect();
                let extent = |axis: usize| {
                    let along = of_chart.iter().map(|point| point.coord[axis]);
                    f64::from(along.clone().max().unwrap_or(0) - along.min().unwrap_or(0))
                };
                let diameter = (0..3).map(|axis| extent(axis) * extent(axis)).sum::<f64>().sqrt() + far;
                let width = of_chart.len() as f64 * 1.43 * far * far / diameter;
                (width / 3.0) * (width / 3.0)
            })
            .collect();
        for level in 0..last {
            let most = far * far * f64::from(1 << (last - level));
            for at in order.iter().copied().filter(|at| !taken.contains(at)).collect::<Vec<_>>() {
                let least = own[points[at].chart as usize].max(most / 8.0).min(most) as u64;
                let near = |other: &usize| {
                    points[*other].chart == points[at].chart
                        && square_distance(points[*other].coord, points[at].coord) < least
                };
                if !taken.iter().any(near) {
                    levels[at] = level;
                    taken.push(at);
                }
            }
        }
        taken.extend(order.iter().copied().filter(|at| !taken.contains(at)).collect::<Vec<_>>());
        for chart in 0..4 {
            let of_chart = taken.iter().filter(|at| points[**at].chart == chart);
            for (at, raised) in of_chart.zip([0, 2, 2, 1, 1, 1, 1, 1]) {
                levels[*at] = levels[*at].saturating_sub(raised);
            }
        }
        levels
    }

    fn cloud() -> impl Strategy<Value = Vec<LevelPoint>> {
        let point = (prop::array::uniform2(0_u32..256), 0_u32..4)
            .prop_map(|([x, z], chart)| LevelPoint { coord: [x, 10 * chart, z], chart });
        prop::collection::vec(point, 0..600)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn levels_are_those_of_the_definition(points in cloud(), kernel_radius in 0.01_f32..0.3) {
            let layout = lattice(4, kernel_radius);
            let (count, levels) = assign(&layout, &points);
            prop_assert!((1..=MAX_LEVELS as u8).contains(&count));
            prop_assert_eq!(levels, naive(&layout, &points));
        }

        #[test]
        fn the_points_of_a_level_reach_every_point_of_their_chart(points in cloud()) {
            let layout = SetLayout { points: points.len() as u32, ..lattice(4, 0.08) };
            let (count, levels) = assign(&layout, &points);
            for level in 0..count - 1 {
                let reach = (f64::from(0.08_f32) * 256.0 * SPACING).powi(2) * f64::from(1 << (count - 1 - level));
                for point in &points {
                    let near = |(other, of): (&LevelPoint, &u8)| {
                        *of <= level
                            && other.chart == point.chart
                            && square_distance(other.coord, point.coord) as f64 <= reach
                    };
                    prop_assert!(points.iter().zip(&levels).any(near), "level {level}");
                }
            }
        }

        #[test]
        fn a_geometry_is_in_the_order_of_its_levels_however_points_are_given(points in cloud(), turn in 0_usize..600) {
            let at = |point: &LevelPoint| RestPoint {
                position: point.coord.map(|axis| axis as f32 / 256.0),
                normal: [0.0, 1.0, 0.0],
                chart: point.chart,
            };
            let mut given: Vec<RestPoint> = points.iter().map(at).collect();
            let made = Geometry::round(lattice(4, 0.05), &given);
            given.rotate_left(turn.min(points.len()));
            prop_assert_eq!(&Geometry::round(lattice(4, 0.05), &given).geometry, &made.geometry);
            let levels: Vec<u8> = (0..made.geometry.len()).map(|point| made.geometry.level(point)).collect();
            prop_assert!(levels.is_sorted());
            let layout = made.geometry.layout();
            let ends: Vec<u32> = layout.level_points().map(|points| points.end).collect();
            prop_assert_eq!(ends.last(), Some(&layout.points));
            for (level, end) in (0..).zip(ends) {
                prop_assert_eq!(layout.levels.end(level, layout.points), end);
                prop_assert_eq!(levels.iter().filter(|of| **of <= level).count() as u32, end);
            }
        }
    }

    #[test]
    fn a_level_is_as_fine_as_asked_or_the_last() {
        let levels = Levels::from_ends(&[10, 20, 40]).unwrap();
        let layout = SetLayout { points: 80, levels, ..lattice(4, 0.09) };
        assert_eq!(levels.of_point(9), 0);
        assert_eq!([10, 19, 20, 39, 40, 79].map(|point| levels.of_point(point)), [1, 1, 2, 2, 3, 3]);
        // Points of the last level are 5 cm apart, those of the coarsest 14.1 cm.
        let wanted = [0.0, 0.049, 0.0501, 0.071, 0.101, 0.142, f32::INFINITY, f32::NAN];
        assert_eq!(wanted.map(|spacing| layout.level_within(spacing)), [3, 3, 3, 2, 1, 0, 0, 3]);
        for level in 0..4 {
            assert_eq!(layout.level_within(layout.level_spacing(level)), level);
        }
        assert_eq!(Levels::from_ends(&[3, 2]), None);
        assert_eq!(Levels::from_ends(&[0; 11]).map(|levels| levels.count()), Some(12));
        assert_eq!(Levels::from_ends(&[0; 12]), None);
    }
}
