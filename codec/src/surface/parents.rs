//! Parents of points: the nearest points of coarser levels, from which a point is predicted.

use std::sync::OnceLock;

use super::cells::CellIndex;
use super::levels::{level_spacing_square, square_distance};
use super::{BLOCK_POINTS, Geometry, NO_VALUE, SetLayout};
use crate::memory;

/// Largest number of parents of a point.
pub(crate) const MOST_PARENTS: usize = 4;
/// Square of the largest distance of a parent, in squares of the spacing of the next coarser level.
const REACH_SQUARE: f64 = 2.25;

/// The parents of a point: numbers of points of its set, and their weights. Unused places have the weight 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Parents {
    pub(crate) points: [u32; MOST_PARENTS],
    pub(crate) weights: [u8; MOST_PARENTS],
}

/// What the parents of a point predict.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Prediction {
    /// Weighted mean of their bytes, or of the changes of their bytes.
    pub(crate) mean: i16,
    /// Difference of the largest and the smallest of these.
    pub(crate) spread: u8,
}

impl Parents {
    /// Chooses among candidates, given as squared distance and number.
    fn nearest(near: &mut Vec<(u64, u32)>) -> Parents {
        if near.len() > MOST_PARENTS {
            near.select_nth_unstable(MOST_PARENTS - 1);
            near.truncate(MOST_PARENTS);
        }
        near.sort_unstable();
        let far = near.last().map_or(0, |(square, _)| *square);
        let mut parents = Parents::default();
        for (at, (square, point)) in near.iter().enumerate() {
            parents.points[at] = *point;
            parents.weights[at] = weight(*square, far);
        }
        parents
    }

    /// Returns the weighted mean of what `of` returns for each parent, rounded to the nearest integer and halves upwards,
    /// and how far they lie apart. Returns `None` if `of` returns `None` for all.
    #[inline]
    fn mean(&self, of: impl Fn(u32) -> Option<i32>) -> Option<Prediction> {
        let (mut sum, mut weights, mut low, mut high) = (0, 0, i32::MAX, i32::MIN);
        for (point, weight) in self.points.into_iter().zip(self.weights) {
            if weight == 0 {
                break;
            }
            if let Some(number) = of(point) {
                sum += i32::from(weight) * number;
                weights += i32::from(weight);
                (low, high) = (low.min(number), high.max(number));
            }
        }
        // The mean of equal numbers needs no division; most changes are 0.
        let mean =
            if low == high { low } else { (2 * sum + weights).checked_div_euclid(2 * weights)? } as i16;
        Some(Prediction { mean, spread: (high - low).min(255) as u8 })
    }

    /// Predicts the byte of a point that arrives. `values` has the bytes of its instance.
    #[inline]
    pub(crate) fn value(&self, values: &[u8]) -> Option<Prediction> {
        self.mean(|point| {
            let value = values[point as usize];
            (value != NO_VALUE).then_some(value.into())
        })
    }

    /// Predicts the change of a point from the bytes of its instance before and after.
    #[inline]
    pub(crate) fn change(&self, before: &[u8], after: &[u8]) -> Option<Prediction> {
        self.mean(|point| {
            let (before, after) = (before[point as usize], after[point as usize]);
            (before != NO_VALUE && after != NO_VALUE).then(|| i32::from(after) - i32::from(before))
        })
    }
}

/// Returns the weight of a parent: that of (1 - d² / r²), where r² is 4/3 of the square of the farthest one's distance.
fn weight(square: u64, far: u64) -> u8 {
    (252 * (4 * far - 3 * square)).checked_div(4 * far).map_or(253, |weight| weight as u8 + 1)
}

/// The parents of the points of a block.
#[derive(Debug)]
pub(crate) struct BlockParents {
    pub(crate) points: Box<[Parents]>,
    /// Numbers of the other blocks of the set that have parents, ascending.
    pub(crate) blocks: Box<[u32]>,
}

/// Cell indices and parents of a geometry, each made when it is first needed.
#[derive(Debug, Default)]
pub(super) struct ParentTable {
    indices: Vec<OnceLock<CellIndex>>,
    blocks: Vec<OnceLock<BlockParents>>,
}

impl ParentTable {
    /// Creates the table of a set in which nothing was needed yet.
    pub(super) fn new(layout: &SetLayout, points: usize) -> ParentTable {
        let levels = usize::from(layout.levels.count());
        let blocks = if levels > 1 { points.div_ceil(BLOCK_POINTS) } else { 0 };
        ParentTable {
            indices: std::iter::repeat_with(OnceLock::new).take(levels).collect(),
            blocks: std::iter::repeat_with(OnceLock::new).take(blocks).collect(),
        }
    }

    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        let indices = self.indices.iter().filter_map(OnceLock::get).map(CellIndex::heap_bytes).sum::<usize>();
        let parents = |block: &BlockParents| size_of_val(&*block.points) + size_of_val(&*block.blocks);
        let blocks = self.blocks.iter().filter_map(OnceLock::get).map(parents).sum::<usize>();
        memory::list(&self.indices) + memory::list(&self.blocks) + indices + blocks
    }
}

/// A copy finds its parents anew.
impl Clone for ParentTable {
    fn clone(&self) -> ParentTable {
        ParentTable {
            indices: std::iter::repeat_with(OnceLock::new).take(self.indices.len()).collect(),
            blocks: std::iter::repeat_with(OnceLock::new).take(self.blocks.len()).collect(),
        }
    }
}

/// Tables of equal points are equal, whatever was needed of them.
impl PartialEq for ParentTable {
    fn eq(&self, _: &ParentTable) -> bool {
        true
    }
}

impl Geometry {
    /// Returns the parents of a block of the set; `None` where no point has any because the set has one level.
    #[inline]
    pub(crate) fn parents(&self, block: usize) -> Option<&BlockParents> {
        Some(self.parents.blocks.get(block)?.get_or_init(|| self.find_parents(block)))
    }

    fn find_parents(&self, block: usize) -> BlockParents {
        let first = block * BLOCK_POINTS;
        let points: Box<[Parents]> = (first..self.len().min(first + BLOCK_POINTS))
            .map(|point| self.parents_of(point as u32))
            .collect();
        let used = points.iter().flat_map(|parents| {
            parents
                .points
                .into_iter()
                .zip(parents.weights)
                .filter(|(_, weight)| *weight > 0)
                .map(|(point, _)| point)
        });
        let mut blocks: Vec<u32> = used.map(|point| point / BLOCK_POINTS as u32).collect();
        blocks.sort_unstable();
        blocks.dedup();
        blocks.retain(|other| *other as usize != block);
        BlockParents { points, blocks: blocks.into() }
    }

    fn parents_of(&self, point: u32) -> Parents {
        let Some(coarser) = self.level(point as usize).checked_sub(1) else { return Parents::default() };
        let reach = (level_spacing_square(&self.layout, coarser) * REACH_SQUARE) as u64;
        let end = self.layout.levels.end(coarser, self.layout.points).min(self.len() as u32);
        let index = self.parents.indices[usize::from(coarser)].get_or_init(|| {
            let place = |point: u32| (self.charts[point as usize], self.coords[point as usize]);
            CellIndex::new((reach.isqrt() as u32).saturating_add(1), end, place)
        });
        let (chart, coord) = (self.charts[point as usize], self.coords[point as usize]);
        let mut near = Vec::new();
        for other in index.around(chart, coord) {
            let square = square_distance(self.coords[other as usize], coord);
            if square <= reach {
                near.push((square, other));
            }
        }
        Parents::nearest(&mut near)
    }
}
