//! The AO that clients should have, and the choice of changes that bring them there.

use std::sync::Arc;

use super::prediction::{NextValues, Predictor};
use super::section::changes::{Changes, REMOVAL};
use super::{EncoderSettings, Geometry, GeometrySource, Layout, NO_VALUE, PaddedIndex, State};
use crate::memory;

/// The AO byte of an open point.
const OPEN: u8 = 255;
/// Stands for the threshold of a point that may have any byte.
const ANY: u8 = 0;
/// Number of levels below a block from which on its points have the threshold of the settings.
const COARSE: u8 = 2;

/// The AO as last set, and how far clients may be off.
#[derive(Debug)]
pub(super) struct Targets {
    settings: EncoderSettings,
    /// AO bytes as last set, by padded index.
    latest: Vec<u8>,
    /// By padded index: the threshold that was given with it, or [`ANY`] where none was set.
    given: Vec<u8>,
    /// By block: points of present blocks that differ by their threshold.
    differing: Vec<u64>,
    /// By block: the number of levels of present blocks below it, at most [`COARSE`]. Sets whose points have no parents count
    /// as coarse.
    below: Vec<u8>,
}

impl Targets {
    /// Creates the targets of a stream in which nothing was set.
    pub(super) fn new(layout: &Layout, settings: &EncoderSettings) -> Targets {
        let blocks = layout.blocks();
        let below = |block: usize| {
            let set = &layout.sets()[layout.members()[layout.owner(block)].set as usize];
            let predicted = settings.geometry == GeometrySource::Sent && set.levels.count() > 1;
            if predicted { 0 } else { COARSE }
        };
        Targets {
            settings: *settings,
            latest: vec![255; blocks * super::BLOCK_POINTS],
            given: vec![ANY; blocks * super::BLOCK_POINTS],
            differing: vec![0; blocks],
            below: (0..blocks).map(below).collect(),
        }
    }

    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        let Targets { settings: _, latest, given, differing, below } = self;
        memory::list(latest) + memory::list(given) + memory::list(differing) + memory::list(below)
    }

    /// Returns the AO bytes as last set, by padded index.
    pub(super) fn latest(&self) -> &[u8] {
        &self.latest
    }

    /// Returns the number of points that differ by their threshold.
    pub(super) fn differing_points(&self) -> u32 {
        self.differing.iter().map(|mask| mask.count_ones()).sum()
    }

    /// Takes the AO and the threshold of a point, of which clients may not have any byte.
    pub(super) fn take(&mut self, index: PaddedIndex, ao: u8, threshold: u8) {
        (self.latest[index.0], self.given[index.0]) = (ao, threshold.max(self.settings.threshold));
    }

    /// Sets a point of which clients have the byte `held`. Returns whether it differs.
    #[inline]
    pub(super) fn set(&mut self, index: PaddedIndex, ao: u8, threshold: u8, held: u8) -> bool {
        self.take(index, ao, threshold);
        let (differs, bit) = (self.differs(index, held), index.bit());
        let mask = &mut self.differing[index.block()];
        *mask = if differs { *mask | bit } else { *mask & !bit };
        differs
    }

    /// Lets a point follow its parents until it is set again.
    pub(super) fn release(&mut self, index: PaddedIndex) {
        self.given[index.0] = ANY;
        self.differing[index.block()] &= !index.bit();
    }

    /// Returns the threshold of a point.
    #[inline]
    pub(super) fn threshold(&self, index: PaddedIndex) -> u8 {
        let EncoderSettings { threshold, finest_threshold, .. } = self.settings;
        let usual = match self.below[index.block()] {
            0 => finest_threshold,
            1 => threshold.midpoint(finest_threshold),
            _ => threshold,
        };
        if self.given[index.0] == ANY { u8::MAX } else { self.given[index.0].max(usual) }
    }

    /// Returns whether a byte of clients differs from the one set. One that is no value differs from all others.
    #[inline]
    fn differs(&self, index: PaddedIndex, held: u8) -> bool {
        let latest = self.latest[index.0];
        if self.given[index.0] == ANY {
            return false;
        }
        (latest == NO_VALUE) != (held == NO_VALUE) || latest.abs_diff(held) >= self.threshold(index)
    }

    /// Returns the byte and the threshold of each padded index for blocks that arrive, and their quantum. A point
    /// that pictures need less exactly arrives within the threshold of the settings, and one that was not set as
    /// predicted. An open one arrives exactly: what is open everywhere costs next to nothing, and should look so.
    pub(super) fn arrivals(&self) -> (impl Fn(usize) -> (u8, u8), u8) {
        let EncoderSettings { threshold, arrival_threshold, .. } = self.settings;
        let target = move |index: usize| match self.given[index] {
            ANY => (u8::MAX, u8::MAX),
            given if given != threshold => (self.latest[index], threshold),
            _ if self.latest[index] == OPEN => (OPEN, 1),
            _ => (self.latest[index], arrival_threshold),
        };
        (target, quantum_of(arrival_threshold))
    }

    /// Removes what differs, because all blocks arrive again.
    pub(super) fn clear(&mut self) {
        self.differing.fill(0);
    }

    /// Updates the thresholds before a block arrives that `sent` does not have: its parents are no longer the finest.
    /// `geometry` has the points that the stream carries, by set.
    pub(super) fn arrive(&mut self, sent: &State, geometry: &[Option<Arc<Geometry>>], block: usize) {
        let layout = &sent.layout;
        let instance = layout.owner(block);
        let start = layout.blocks_of(instance as u32).start;
        let Some(geometry) = &geometry[layout.members()[instance].set as usize] else { return };
        let level = |block: usize| geometry.level((block - start) * super::BLOCK_POINTS);
        let mut raised = vec![block];
        while let Some(block) = raised.pop() {
            let Some(parents) = geometry.parents(block - start) else { return };
            let wanted = (self.below[block] + 1).min(COARSE);
            for parent in parents.blocks.iter().map(|parent| start + *parent as usize) {
                // A block may have points of two levels, so that it is among the parents of another one of its level.
                if level(parent) < level(block) && self.below[parent] < wanted {
                    self.below[parent] = wanted;
                    self.mark(sent, parent, &sent.values);
                    raised.push(parent);
                }
            }
        }
    }

    /// Finds out which points of a block differ from the bytes in `values`.
    fn mark(&mut self, sent: &State, block: usize, values: &[u8]) {
        if sent.present[block] {
            let points = sent.block_range(block).map(PaddedIndex);
            let differing = points.filter(|index| self.differs(*index, values[index.0]));
            self.differing[block] = differing.fold(0, |mask, index| mask | index.bit());
        }
    }

    /// Updates what differs after a frame of [`choose`](Self::choose).
    pub(super) fn update(&mut self, sent: &State, next: &NextValues) {
        for block in 0..self.differing.len() {
            if self.is_touched(block, next) {
                self.mark(sent, block, &next.values);
            }
        }
    }

    /// Returns whether a point of a block differed or was changed.
    fn is_touched(&self, block: usize, next: &NextValues) -> bool {
        self.differing[block] != 0 || next.has_moved(block)
    }

    /// Returns the points that still differ if clients have `next`, ascending.
    pub(super) fn missed<'a>(
        &'a self,
        sent: &'a State,
        next: &'a NextValues,
    ) -> impl Iterator<Item = PaddedIndex> + 'a {
        let blocks = (0..self.differing.len()).filter(|block| self.is_touched(*block, next));
        let points = blocks.flat_map(|block| sent.block_range(block)).map(PaddedIndex);
        points.filter(|index| self.differs(*index, next.values[index.0]))
    }

    /// Chooses the changes that bring every point for which `may_change` returns true within its threshold, and makes them.
    /// Parents come first, and a point that they predict well needs no change.
    pub(super) fn choose(
        &self,
        sent: &State,
        (changes, next): (&mut Changes, &mut NextValues),
        mut may_change: impl FnMut(PaddedIndex) -> bool,
    ) {
        let quantum = self.settings.quantum();
        changes.clear();
        changes.quantum = quantum;
        let State { layout, geometry, values, present, .. } = sent;
        let mut predictor = Predictor::new(layout, geometry, values, next, quantum);
        for block in (0..present.len()).filter(|block| present[*block]) {
            let predicted = predictor.block(block);
            if predicted.moved == 0 && self.differing[block] == 0 {
                continue;
            }
            predictor.points(block, &predicted, |index, value| {
                if !self.differs(index, value) || !may_change(index) {
                    return 0;
                }
                let level = level(value, self.latest[index.0], quantum.into());
                changes.push(index, level);
                level
            });
        }
        let fits = predictor.finish();
        debug_assert!(fits.is_ok(), "{fits:?}");
    }
}

/// Returns the step of bytes with a threshold: one and a half of it, rounded down.
pub(super) const fn quantum_of(threshold: u8) -> u8 {
    threshold.saturating_add(threshold / 2)
}

/// Returns the level that takes a point's byte nearest to another one.
fn level(from: u8, to: u8, quantum: i32) -> i16 {
    let nearest = |difference: i32| (difference + quantum / 2) / quantum;
    match (from, to) {
        (_, NO_VALUE) => REMOVAL,
        (NO_VALUE, _) => 1 + nearest(i32::from(to) - 1) as i16,
        _ => {
            let difference = i32::from(to) - i32::from(from);
            (nearest(difference.abs()).max(1) * difference.signum()) as i16
        }
    }
}
