//! Prediction of points from their parents while a frame's changes are made, block after block.

use std::sync::Arc;

use super::parents::{BlockParents, Parents, Prediction};
use super::section::changes::{ChangeError, Changes, MAX_LEVEL, changed_value};
use super::{BLOCK_POINTS, Geometry, Layout, NO_VALUE, PaddedIndex};
use crate::memory;

/// The AO of clients after a frame, while its changes are made. It keeps its buffers between frames.
#[derive(Debug, Default, Clone)]
pub(crate) struct NextValues {
    /// AO bytes, by padded index.
    pub(crate) values: Vec<u8>,
    /// By block: the points whose byte has changed, one bit each.
    moved: Vec<u64>,
    /// The blocks in which a byte has changed, ascending.
    blocks: Vec<u32>,
}

impl NextValues {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.values) + memory::list(&self.moved) + memory::list(&self.blocks)
    }

    /// Starts with the bytes before the frame.
    pub(crate) fn start(&mut self, values: &[u8]) {
        self.values.clear();
        self.values.extend_from_slice(values);
        self.moved.clear();
        self.moved.resize(values.len() / BLOCK_POINTS, 0);
        self.blocks.clear();
    }

    /// Returns whether a byte has changed in a block.
    pub(crate) fn has_moved(&self, block: usize) -> bool {
        self.moved[block] != 0
    }

    /// Returns the blocks in which a byte has changed, ascending.
    pub(crate) fn moved_blocks(&self) -> impl Iterator<Item = usize> + '_ {
        self.blocks.iter().map(|block| *block as usize)
    }
}

/// Makes the changes of a frame in the order of the padded indices, so that parents come before their children.
pub(crate) struct Predictor<'a> {
    layout: &'a Layout,
    /// AO bytes before the frame, by padded index.
    before: &'a [u8],
    next: &'a mut NextValues,
    geometry: &'a [Option<Arc<Geometry>>],
    /// Difference of one level in a byte.
    quantum: u8,
    /// First change that was refused.
    refused: Option<ChangeError>,
}

/// A block whose points are predicted.
#[derive(Clone, Copy)]
pub(crate) struct PredictedBlock<'a> {
    parents: Option<&'a BlockParents>,
    /// First padded index of the instance.
    start: usize,
    /// Number of blocks with parents in which a byte has changed.
    pub(crate) moved: usize,
}

impl<'a> Predictor<'a> {
    /// Starts a frame after the bytes in `before`.
    pub(crate) fn new(
        layout: &'a Layout,
        geometry: &'a [Option<Arc<Geometry>>],
        before: &'a [u8],
        next: &'a mut NextValues,
        quantum: u8,
    ) -> Predictor<'a> {
        next.start(before);
        Predictor { layout, before, next, geometry, quantum, refused: None }
    }

    /// Returns a block, before its points are made.
    pub(crate) fn block(&self, block: usize) -> PredictedBlock<'a> {
        let instance = self.layout.owner(block);
        let blocks = self.layout.blocks_of(instance as u32);
        let set = self.layout.members()[instance].set as usize;
        let parents = self.geometry[set].as_ref().and_then(|geometry| geometry.parents(block - blocks.start));
        let moved = |parents: &BlockParents| {
            parents.blocks.iter().filter(|other| self.next.has_moved(blocks.start + **other as usize)).count()
        };
        PredictedBlock { parents, start: blocks.start * BLOCK_POINTS, moved: parents.map_or(0, moved) }
    }

    /// Returns what the parents of a point predict for its change.
    #[inline]
    pub(crate) fn change(&self, block: &PredictedBlock<'_>, index: PaddedIndex) -> Prediction {
        let Some(parents) = block.parents else { return Prediction::default() };
        let parents: &Parents = &parents.points[index.0 % BLOCK_POINTS];
        // Most parents keep still. An unused place may have moved; then it takes longer to find the same.
        let has_moved = |parent: u32| {
            let parent = PaddedIndex(block.start + parent as usize);
            self.next.moved[parent.block()] & parent.bit() != 0
        };
        if !parents.points.into_iter().any(has_moved) {
            return Prediction::default();
        }
        parents.change(&self.before[block.start..], &self.next.values[block.start..]).unwrap_or_default()
    }

    /// Returns the byte of a point before its level is added.
    #[inline]
    pub(crate) fn predicted(&self, index: PaddedIndex, change: Prediction) -> u8 {
        match self.before[index.0] {
            NO_VALUE => NO_VALUE,
            value => (i16::from(value) + change.mean).clamp(1, 255) as u8,
        }
    }

    /// Sets a point to `level` quanta from its prediction. A level that has no effect, or that is out of range, is refused.
    #[inline]
    pub(crate) fn set(&mut self, index: PaddedIndex, predicted: u8, level: i16) {
        let value = if level == 0 { predicted } else { changed_value(predicted, level, self.quantum) };
        if level != 0 {
            let out_of_range = level.unsigned_abs() > MAX_LEVEL.unsigned_abs();
            let downwards = predicted == NO_VALUE && level < 0;
            if out_of_range || downwards || value == predicted {
                let error = ChangeError::Level { padded_index: index.0 as u32, level: level.into() };
                self.refused.get_or_insert(error);
            }
        }
        if value != self.before[index.0] {
            self.next.values[index.0] = value;
            let moved = &mut self.next.moved[index.block()];
            if *moved == 0 {
                self.next.blocks.push(index.block() as u32);
            }
            *moved |= index.bit();
        }
    }

    /// Makes a block of which no point is named: every point follows its parents.
    pub(crate) fn follow(&mut self, block: usize, predicted: &PredictedBlock<'_>) {
        if predicted.moved > 0 {
            self.points(block, predicted, |_, _| 0);
        }
    }

    /// Makes the points of a block, each with the level that `level` returns for its index and prediction.
    pub(crate) fn points(
        &mut self,
        block: usize,
        predicted: &PredictedBlock<'_>,
        mut level: impl FnMut(PaddedIndex, u8) -> i16,
    ) {
        let first = block * BLOCK_POINTS;
        for index in (first..first + self.layout.block_len(block)).map(PaddedIndex) {
            let change = self.change(predicted, index);
            let value = self.predicted(index, change);
            let level = level(index, value);
            self.set(index, value, level);
        }
    }

    /// Makes all changes of a frame. `present` tells which blocks clients have.
    pub(crate) fn apply(&mut self, changes: &Changes, present: &[bool]) {
        let mut named = changes.points.iter().peekable();
        let mut levels = changes.levels.iter().copied();
        for block in (0..present.len()).filter(|block| present[*block]) {
            let predicted = self.block(block);
            let Some((_, mask)) = named.next_if(|(named, _)| *named as usize == block) else {
                self.follow(block, &predicted);
                continue;
            };
            self.points(block, &predicted, |index, _| {
                if mask & index.bit() != 0 { levels.next().unwrap_or_default() } else { 0 }
            });
        }
    }

    /// Returns the first change that was refused as an error.
    pub(crate) fn finish(self) -> Result<(), ChangeError> {
        self.refused.map_or(Ok(()), Err)
    }
}
