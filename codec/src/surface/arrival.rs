//! Prediction of points that arrive: from their parents, and where none has a value, from the points before.

use std::sync::Arc;

use super::{BLOCK_POINTS, Geometry, Layout, NO_VALUE};

/// Stands for an unknown value.
const UNKNOWN_VALUE: u8 = 255;

/// Predicts the bytes of arriving points, block after block, and keeps what was found.
pub(crate) struct ArrivalPredictor<'a> {
    layout: &'a Layout,
    geometry: &'a [Option<Arc<Geometry>>],
    /// AO bytes, by padded index; 0 where nothing was received.
    values: &'a mut [u8],
}

/// What is known of an arriving point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointGuess {
    /// Its predicted byte, 1 to 255.
    pub(crate) predicted: u8,
    /// How far its parents lie apart; `None` if none of them has a value.
    pub(crate) spread: Option<u8>,
    /// The byte before along the curve, if there is one.
    pub(crate) before: Option<u8>,
    /// Its level.
    pub(crate) level: u8,
    /// The byte of the same point of the previous instance of the set.
    pub(crate) sibling: Option<u8>,
}

impl<'a> ArrivalPredictor<'a> {
    pub(crate) fn new(
        layout: &'a Layout,
        geometry: &'a [Option<Arc<Geometry>>],
        values: &'a mut [u8],
    ) -> ArrivalPredictor<'a> {
        ArrivalPredictor { layout, geometry, values }
    }

    /// Sets the points of a block to what `byte` returns for them. `known` tells which blocks clients have.
    pub(crate) fn block(&mut self, block: usize, known: &[bool], mut byte: impl FnMut(PointGuess) -> u8) {
        let instance = self.layout.owner(block);
        let blocks = self.layout.blocks_of(instance as u32);
        let (first, start) = (block * BLOCK_POINTS, blocks.start * BLOCK_POINTS);
        let set = self.layout.members()[instance].set as usize;
        let levels = self.layout.sets()[set].levels;
        let parents = self.geometry[set].as_ref().and_then(|geometry| geometry.parents(block - blocks.start));
        let sibling = self.layout.previous_of_set(instance);
        let sibling = sibling.map(|sibling| self.layout.blocks_of(sibling).start + block - blocks.start);
        let sibling = sibling.filter(|sibling| known[*sibling]).map(|sibling| sibling * BLOCK_POINTS);
        let from = if block > blocks.start && known[block - 1] { first - BLOCK_POINTS } else { first };
        for at in 0..self.layout.block_len(block) {
            let index = first + at;
            let parents = parents.and_then(|parents| parents.points[at].value(&self.values[start..]));
            let past = &self.values[from..index];
            let guess = PointGuess {
                predicted: parents.map_or_else(|| mean_of_past(past), |parents| parents.mean as u8),
                spread: parents.map(|parents| parents.spread),
                before: past.last().copied(),
                level: levels.of_point((index - start) as u32),
                sibling: sibling.map(|sibling| self.values[sibling + at]),
            };
            self.values[index] = byte(guess);
        }
    }
}

/// Returns the mean of the three bytes before, the last one of which counts twice. One that is missing, or that is no value,
/// counts as open.
fn mean_of_past(past: &[u8]) -> u8 {
    let mut before = past.iter().rev().map(|byte| if *byte == NO_VALUE { UNKNOWN_VALUE } else { *byte });
    let [a, b, c] = std::array::from_fn(|_| u32::from(before.next().unwrap_or(UNKNOWN_VALUE)));
    ((2 * a + b + c) / 4) as u8
}
