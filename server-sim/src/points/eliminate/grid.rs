//! Points sorted by the cells of a grid, and their neighbours.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::Weighting;

/// Largest number of bits of a cell coordinate.
const AXIS_BITS: u32 = 21;
/// Cell of points that are not finite. No other cell is its neighbour.
const NON_FINITE_CELL: u64 = 0;
/// Keys after the last cell, so that three cells can always be compared.
const PADDING: [u64; 3] = [u64::MAX; 3];

/// The points sorted by cell, so that neighbours are close in memory. All code below numbers points in this order,
/// which also orders points of equal weight.
pub(super) struct Grid {
    /// Original number of each point.
    numbers: Vec<u32>,
    points: Vec<Vec3>,
    /// Ascending keys of the cells that contain points, then [`PADDING`].
    cells: Vec<u64>,
    /// First point of each of these cells, then the number of points.
    starts: Vec<u32>,
    /// Differences of keys between neighbours along y and along z. Along x the difference is 1.
    steps: [u64; 2],
}

/// A neighbour, and the weight that the two points put on each other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Link {
    pub(super) to: u32,
    pub(super) weight: f32,
}

/// Neighbours of consecutive points, in one list.
pub(super) struct Links {
    /// Offsets of each point's neighbours in the list, then the length of the list.
    pub(super) starts: Vec<u32>,
    /// Neighbours of one point after the other, ascending.
    pub(super) list: Vec<Link>,
}

impl Links {
    /// Builds the list from pairs of a point below `count` and a neighbour.
    pub(super) fn collect(count: usize, mut pairs: Vec<(u32, Link)>) -> Self {
        pairs.sort_unstable_by_key(|&(point, link)| (point, link.to));
        let start = |point| pairs.partition_point(|&(other, _)| other < point) as u32;
        let starts = (0..=count as u32).map(start).collect();
        Self { starts, list: pairs.into_iter().map(|(_, link)| link).collect() }
    }

    /// Returns the range of a point's neighbours in the list.
    pub(super) fn range(&self, point: usize) -> Range<usize> {
        self.starts[point] as usize..self.starts[point + 1] as usize
    }

    /// Returns the neighbours of a point.
    pub(super) fn of(&self, point: usize) -> &[Link] {
        &self.list[self.range(point)]
    }
}

impl Grid {
    /// Sorts points into cells of at least `reach` metres.
    pub(super) fn new(points: &[Vec3], reach: f32) -> Self {
        let finite = || points.iter().copied().filter(|point| point.is_finite());
        let low = finite().fold(Vec3::INFINITY, Vec3::min);
        let high = finite().fold(Vec3::NEG_INFINITY, Vec3::max);
        // Cells are large enough for their numbers not to overflow. Larger cells are slower but equally correct.
        let edge =
            reach.max((high - low).max_element() / ((1 << AXIS_BITS) - 4) as f32).max(f32::MIN_POSITIVE);
        // One cell on each side stays free for neighbours.
        let cell = |point: Vec3| ((point - low) / edge).to_array().map(|at| at as u64 + 1);
        let bits = cell(high).map(|last| u64::BITS - (last + 1).leading_zeros());
        let steps = [1 << bits[0], 1 << (bits[0] + bits[1])];
        let key = |point: Vec3| {
            if !point.is_finite() {
                return NON_FINITE_CELL;
            }
            let [x, y, z] = cell(point);
            z * steps[1] + y * steps[0] + x
        };
        let keys = points.par_iter().map(|&point| key(point));
        let number_bits = u64::BITS - (points.len() as u64).leading_zeros();
        if bits.iter().sum::<u32>() + number_bits <= u64::BITS {
            // Single numbers sort faster than pairs.
            let both = |(number, key): (usize, u64)| (key << number_bits) | number as u64;
            let low = (1 << number_bits) - 1;
            Self::sorted(points, steps, keys.enumerate().map(both), |both| {
                (both >> number_bits, (both & low) as u32)
            })
        } else {
            let pair = |(number, key): (usize, u64)| (key, number as u32);
            Self::sorted(points, steps, keys.enumerate().map(pair), |pair| pair)
        }
    }

    /// Builds the grid from items that sort by key and then by number; `split` returns both.
    fn sorted<T: Copy + Ord + Send + Sync>(
        points: &[Vec3],
        steps: [u64; 2],
        order: impl IndexedParallelIterator<Item = T>,
        split: impl Fn(T) -> (u64, u32) + Sync,
    ) -> Self {
        let mut order: Vec<T> = order.collect();
        order.par_sort_unstable();
        let (mut cells, mut starts) = (Vec::new(), Vec::new());
        for (place, &item) in (0..).zip(&order) {
            let (key, _) = split(item);
            if cells.last() != Some(&key) {
                cells.push(key);
                starts.push(place);
            }
        }
        cells.extend(PADDING);
        starts.push(points.len() as u32);
        let numbers: Vec<u32> = order.par_iter().map(|&item| split(item).1).collect();
        Self {
            points: numbers.par_iter().map(|&number| points[number as usize]).collect(),
            numbers,
            cells,
            starts,
            steps,
        }
    }

    /// Returns the original number of a point.
    pub(super) fn number(&self, point: u32) -> u32 {
        self.numbers[point as usize]
    }

    /// Divides the cells into ranges of about `length` points each. Returns ranges of cell indices.
    pub(super) fn cell_ranges(&self, length: usize) -> Vec<Range<usize>> {
        let cells = self.starts.len() - 1;
        let mut ranges = Vec::new();
        let mut from = 0;
        while from < cells {
            let full = self.starts[from] as usize + length.max(1);
            let to = self.starts.partition_point(|&start| (start as usize) < full).min(cells);
            ranges.push(from..to);
            from = to;
        }
        ranges
    }

    /// Returns the points of a range of cells.
    pub(super) fn points_of(&self, cells: &Range<usize>) -> Range<u32> {
        self.starts[cells.start]..self.starts[cells.end]
    }

    /// Returns, for the points of a range of cells, their neighbours with higher numbers.
    pub(super) fn links_ahead(&self, cells: &Range<usize>, weighting: Weighting) -> Links {
        let count = self.points_of(cells).len();
        let mut links = Links { starts: Vec::with_capacity(count + 1), list: Vec::with_capacity(count * 4) };
        links.starts.push(0);
        // Rows of three cells are contiguous. The start of each row ascends as the cells do.
        let [y, z] = self.steps;
        let offsets = [y - 1, z - y - 1, z - 1, z + y - 1];
        let first = self.cells[cells.start];
        let mut rows = offsets.map(|offset| self.cells.partition_point(|&cell| cell < first + offset));
        let mut found = Vec::new();
        for index in cells.clone() {
            let key = self.cells[index];
            let own = self.starts[index] as usize..self.starts[index + 1] as usize;
            if key == NON_FINITE_CELL {
                links.starts.extend(own.map(|_| links.list.len() as u32));
                continue;
            }
            // First the rest of this cell and the next cell, then the four rows ahead.
            let next = index + 1 + usize::from(self.cells[index + 1] == key + 1);
            let mut ahead: [Range<usize>; 5] = std::array::from_fn(|_| own.end..self.starts[next] as usize);
            for ((offset, row), range) in offsets.iter().zip(&mut rows).zip(&mut ahead[1..]) {
                *range = self.row(key + offset, row);
            }
            found.resize(own.len() + ahead.iter().map(Range::len).sum::<usize>(), Link::default());
            for point in own {
                ahead[0].start = point + 1;
                let mut end = 0;
                for range in &ahead {
                    end = self.near(self.points[point], range.clone(), weighting.reach, &mut found, end);
                }
                let weighed = |link: &Link| Link { weight: weighting.at(link.weight.sqrt()), ..*link };
                links.list.extend(found[..end].iter().map(weighed));
                links.starts.push(links.list.len() as u32);
            }
        }
        links
    }

    /// Returns the points of the three cells from `low` on. Advances `from` to the first of these cells.
    fn row(&self, low: u64, from: &mut usize) -> Range<usize> {
        // There is no branch per cell: almost every step is short, and the branch would be unpredictable.
        let below = |from: usize, key: u64| {
            self.cells[from..from + 3].iter().map(|&cell| usize::from(cell < key)).sum::<usize>()
        };
        loop {
            let step = below(*from, low);
            *from += step;
            if step < 3 {
                break;
            }
        }
        self.starts[*from] as usize..self.starts[*from + below(*from, low + 3)] as usize
    }

    /// Writes those of `points` that are within reach of `at` into `found`, starting at `end`. The square of the
    /// distance takes the place of the weight. Returns the new end.
    fn near(&self, at: Vec3, points: Range<usize>, reach: f32, found: &mut [Link], mut end: usize) -> usize {
        let limit = reach * reach;
        for (to, point) in (points.start as u32..).zip(&self.points[points]) {
            // Write always and count conditionally, because a branch would be unpredictable.
            let square = at.distance_squared(*point);
            found[end] = Link { to, weight: square };
            end += usize::from(square < limit);
        }
        end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_go_by_cell_and_number_however_many_bits_a_key_has() {
        let count = 1000;
        // One reach results in 10 bits per axis, the other in 21.
        for reach in [0.01, 1e-9] {
            let points: Vec<Vec3> =
                (0..count).map(|i| Vec3::new((i % 7) as f32, (i % 5) as f32, ((i * i) % 3) as f32)).collect();
            let grid = Grid::new(&points, reach);
            let mut expected: Vec<u32> = (0..count).collect();
            expected.sort_by_key(|&i| ((i * i) % 3, i % 5, i % 7));
            assert_eq!(grid.numbers, expected);
            assert_eq!(grid.starts.len() - 1 + PADDING.len(), grid.cells.len());
        }
    }
}
