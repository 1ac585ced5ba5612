//! The reference for [`eliminate`](super::eliminate()), for tests and benches.
//!
//! It follows Yuksel (2015, section 3): a binary heap in which a decreased weight is sifted down in place, O(n log
//! n).

use glam::Vec3;

use super::eliminate::Weighting;

/// Computes the same result as [`eliminate`](super::eliminate()) with a heap.
#[must_use]
pub fn eliminate(points: &[Vec3], keep: usize, radius: f32) -> Vec<u32> {
    if keep >= points.len() {
        return (0..points.len() as u32).collect();
    }
    let grid = SortedGrid::new(points, 2.0 * radius);
    let neighbours = Neighbours::new(&grid, Weighting::new(keep, points.len(), radius));
    let mut heap = Heap::new(neighbours.totals());
    for _ in keep..points.len() {
        let Some(removed) = heap.pop() else { break };
        for (neighbour, weight) in neighbours.of(removed) {
            heap.subtract_weight(neighbour, weight);
        }
    }
    let mut kept: Vec<u32> = heap.members().map(|slot| grid.order[slot as usize]).collect();
    kept.sort_unstable();
    kept
}

/// Points sorted by cell, so that neighbours are close in memory. All code below numbers points in this order.
struct SortedGrid {
    order: Vec<u32>,
    points: Vec<Vec3>,
    keys: Vec<u64>,
    edge: f32,
}

/// Bits of a cell coordinate. One cell on each side stays free for neighbours.
const AXIS_BITS: u32 = 21;
/// Cell of points that are not finite. No other cell is its neighbour.
const NON_FINITE_CELL: u64 = 0;

impl SortedGrid {
    fn new(points: &[Vec3], reach: f32) -> Self {
        let finite = || points.iter().copied().filter(|point| point.is_finite());
        let low = finite().fold(Vec3::INFINITY, Vec3::min);
        let high = finite().fold(Vec3::NEG_INFINITY, Vec3::max);
        // Cells are large enough for their numbers not to overflow. Larger cells are slower but equally correct.
        let edge =
            reach.max((high - low).max_element() / ((1 << AXIS_BITS) - 4) as f32).max(f32::MIN_POSITIVE);
        let key = |point: Vec3| {
            if !point.is_finite() {
                return NON_FINITE_CELL;
            }
            let [x, y, z] = ((point - low) / edge).to_array().map(|at| at as u64 + 1);
            (z << (2 * AXIS_BITS)) | (y << AXIS_BITS) | x
        };
        let mut cells: Vec<(u64, u32)> = points.iter().map(|&point| key(point)).zip(0..).collect();
        cells.sort_unstable();
        let order: Vec<u32> = cells.iter().map(|&(_, point)| point).collect();
        Self {
            points: order.iter().map(|&point| points[point as usize]).collect(),
            keys: cells.iter().map(|&(key, _)| key).collect(),
            order,
            edge: reach.min(edge),
        }
    }

    /// Calls `visit` with every pair of points within reach, once in each direction, with the first points ascending.
    fn pairs(&self, mut visit: impl FnMut(usize, usize, f32)) {
        // Rows of three cells are contiguous. The starts of the nine rows ascend as the cells do.
        let mut rows = [0usize; 9];
        let limit = self.edge * self.edge;
        let mut start = 0;
        for cell in self.keys.chunk_by(|a, b| a == b) {
            let key = cell[0];
            if key == NON_FINITE_CELL {
                start += cell.len();
                continue;
            }
            let ranges = std::array::from_fn::<_, 9, _>(|row| {
                let (dz, dy) = ((row / 3) as u64, (row % 3) as u64);
                let middle = key + (dz << (2 * AXIS_BITS)) + (dy << AXIS_BITS)
                    - (1 << (2 * AXIS_BITS))
                    - (1 << AXIS_BITS);
                let from = &mut rows[row];
                while *from < self.keys.len() && self.keys[*from] < middle - 1 {
                    *from += 1;
                }
                let run = self.keys[*from..].iter().take_while(|&&other| other <= middle + 1).count();
                *from..*from + run
            });
            for point in start..start + cell.len() {
                for other in ranges.iter().cloned().flatten() {
                    let square = self.points[point].distance_squared(self.points[other]);
                    if square < limit && other != point {
                        visit(point, other, square);
                    }
                }
            }
            start += cell.len();
        }
    }
}

/// The neighbours of each point, with their weights.
struct Neighbours {
    starts: Vec<u32>,
    list: Vec<(u32, f32)>,
}

impl Neighbours {
    fn new(grid: &SortedGrid, weighting: Weighting) -> Self {
        let mut starts = Vec::with_capacity(grid.points.len() + 1);
        let mut list = Vec::with_capacity(grid.points.len() * 8);
        grid.pairs(|point, other, square| {
            while starts.len() <= point {
                starts.push(list.len() as u32);
            }
            list.push((other as u32, weighting.at(square.sqrt())));
        });
        starts.resize(grid.points.len() + 1, list.len() as u32);
        Self { starts, list }
    }

    fn of(&self, point: u32) -> impl Iterator<Item = (u32, f32)> + '_ {
        let range = self.starts[point as usize] as usize..self.starts[point as usize + 1] as usize;
        self.list[range].iter().copied()
    }

    fn totals(&self) -> Vec<f32> {
        let ranges = self.starts.windows(2).map(|pair| pair[0] as usize..pair[1] as usize);
        ranges.map(|range| self.list[range].iter().map(|&(_, weight)| weight).sum()).collect()
    }
}

/// A binary heap, heaviest first, in which weights can decrease in place. Of equal weights the lowest number is
/// first.
struct Heap {
    weights: Vec<f32>,
    /// Points in heap order.
    slots: Vec<u32>,
    /// Place of each point in `slots`, or [`REMOVED`] for a removed point.
    places: Vec<u32>,
}

const REMOVED: u32 = u32::MAX;

impl Heap {
    fn new(weights: Vec<f32>) -> Self {
        let slots: Vec<u32> = (0..weights.len() as u32).collect();
        let mut heap = Self { places: slots.clone(), slots, weights };
        for place in (0..heap.slots.len() / 2).rev() {
            heap.sift_down(place);
        }
        heap
    }

    fn before(&self, a: u32, b: u32) -> bool {
        let (wa, wb) = (self.weights[a as usize], self.weights[b as usize]);
        wa > wb || (wa == wb && a < b)
    }

    fn pop(&mut self) -> Option<u32> {
        let top = *self.slots.first()?;
        let last = self.slots.pop()?;
        self.places[top as usize] = REMOVED;
        if !self.slots.is_empty() {
            self.slots[0] = last;
            self.places[last as usize] = 0;
            self.sift_down(0);
        }
        Some(top)
    }

    /// Subtracts weight from a point that is still in the heap.
    fn subtract_weight(&mut self, point: u32, by: f32) {
        let place = self.places[point as usize];
        if place != REMOVED {
            self.weights[point as usize] -= by;
            self.sift_down(place as usize);
        }
    }

    fn sift_down(&mut self, mut place: usize) {
        let moving = self.slots[place];
        loop {
            let left = 2 * place + 1;
            let Some(&first) = self.slots.get(left) else { break };
            let (mut child, mut best) = (left, first);
            if let Some(&second) = self.slots.get(left + 1)
                && self.before(second, first)
            {
                (child, best) = (left + 1, second);
            }
            if !self.before(best, moving) {
                break;
            }
            self.slots[place] = best;
            self.places[best as usize] = place as u32;
            place = child;
        }
        self.slots[place] = moving;
        self.places[moving as usize] = place as u32;
    }

    fn members(&self) -> impl Iterator<Item = u32> + '_ {
        self.slots.iter().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::eliminate::tests::on_sphere;
    use crate::points::poisson_radius;
    use proptest::prelude::*;

    /// Compares all pairs and scans for the heaviest point, without a heap or grid.
    fn naive(points: &[Vec3], keep: usize, radius: f32) -> Vec<u32> {
        let grid = SortedGrid::new(points, 2.0 * radius);
        let weighting = Weighting::new(keep, points.len(), radius);
        let sorted = &grid.points;
        let weight = |a: usize, b: usize| {
            let near = a != b && sorted[a].distance_squared(sorted[b]) < 4.0 * radius * radius;
            if near { weighting.at(sorted[a].distance_squared(sorted[b]).sqrt()) } else { 0.0 }
        };
        let mut alive: Vec<usize> = (0..points.len()).collect();
        let mut totals: Vec<f32> = alive.iter().map(|&a| alive.iter().map(|&b| weight(a, b)).sum()).collect();
        while alive.len() > keep {
            let heaviest = (0..alive.len())
                .max_by(|&a, &b| totals[alive[a]].total_cmp(&totals[alive[b]]).then(b.cmp(&a)));
            let removed = alive.remove(heaviest.unwrap());
            for &other in &alive {
                totals[other] -= weight(removed, other);
            }
        }
        let mut kept: Vec<u32> = alive.into_iter().map(|slot| grid.order[slot]).collect();
        kept.sort_unstable();
        kept
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(64) })]
        #[test]
        fn keeps_what_a_scan_of_all_pairs_keeps(seed in any::<u64>(), count in 2usize..150, flat in any::<bool>()) {
            let mut points = on_sphere(count, seed);
            if flat {
                points.iter_mut().for_each(|point| point.y = 0.25);
            }
            let keep = count / 2;
            let radius = poisson_radius(if flat { 3.0 } else { 12.0 }, keep);
            let kept = eliminate(&points, keep, radius);
            prop_assert_eq!(kept.len(), keep);
            prop_assert_eq!(kept, naive(&points, keep, radius));
        }
    }
}
