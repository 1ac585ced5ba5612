//! Byte budgets: the order of changes if not all of them fit a frame.

use std::cmp::Reverse;

use super::model::change::ChangeModel;
use super::prediction::NextValues;
use super::section::changes::Changes;
use super::section::writer::SectionWriter;
use super::targets::Targets;
use super::{NO_VALUE, PaddedIndex, State};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, header_bytes};
use crate::memory;

/// The byte budget of a delta, and how long a point may wait.
///
/// A point is *due* if a frame without a budget would send it. If not all of them fit, those with the largest product of
/// three factors go first: the *difference* between the byte set and the one of clients before the frame (0 to 255), the
/// *weight* of the point's block ([`Encoder::set_weight`](super::Encoder::set_weight)), and the *age*. The age is the
/// number of frames in a row after which the point was not within its threshold, and 1. Lower point ids go first among
/// equals. Points that have waited for `longest_age` frames go before all others, whatever the budget. A frame is a call
/// of [`Encoder::finish`](super::Encoder::finish).
///
/// What is sent changes what parents predict. So a frame with a part of the due points chooses anew. Only these points
/// may change, and those that have waited for `longest_age` frames. It sends the ones that then are not within their
/// threshold.
///
/// # What holds
///
/// *Bytes.* A delta without arriving blocks takes at most `bytes`, with one exception: the points that have waited for
/// `longest_age` may alone take more, and then the frame has no others. A delta without a change still takes its
/// header, 29 B. Keyframes have no budget. Arriving blocks are sent completely, and changes get the bytes that they
/// leave.
///
/// *Error.* No point stays beyond its [threshold](super::Encoder::threshold) after more than `longest_age` frames in a
/// row: after that many, the next frame may send it whatever the budget. With prediction, a point can also get there
/// because its parents moved and its own correction was postponed. Then its byte may be one that was never right.
/// Without prediction a byte of clients only changes when it is sent. Let `T` then be the threshold. For every point and
/// every frame `n` there is a frame `m` with `n - longest_age <= m <= n` such that the byte held after frame `n` is less
/// than `T` from the one last set before frame `m` was finished. Suppose a point has differed since frame `d`. It was not
/// sent in `d..=n`, so `n < d + longest_age`; choose `m = d - 1`.
///
/// *Waiting*, without prediction. Suppose that a section of `k` changes takes at most `f + c k` bytes, where `f` counts
/// all of the body that is not changes, and that at most `D` points differ at any time. A frame that postpones a point
/// sends at least `s = (15 / 16 bytes - f) / c - 1` others: the search ends when 15/16 of the budget are used, or when
/// `k + k / 16 + 1` changes are known not to fit. Let `q` be the largest quotient of two products of difference and
/// weight, at most `255 w / T` with weights of 1 to `w`. Then no point waits for more than `(q + 1) ceil(D / s)` frames.
/// The reason: once a point is `q` times `x = ceil(D / s)` frames old, only points that have waited for more than `x`
/// frames can go before it. Those that do so in the next `x` frames differed at the beginning of these frames. So there
/// are fewer than `D` of them, and `s` go in each frame. With equal products the bound is `2 ceil(D / s)`. A
/// `longest_age` of that many frames forces nothing; a shorter one may. With prediction there is no such bound: a point
/// that is due because its parents move may differ by nothing yet.
///
/// With a budget that no frame exceeds anyway, the stream is identical to one without a budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Budget {
    /// Length of a frame body, bytes.
    pub bytes: u32,
    /// Number of frames that a point may wait; with 0 none waits.
    pub longest_age: u16,
}

impl Budget {
    /// Default of the longest age: a second at 60 Hz.
    pub const LONGEST_AGE: u16 = 60;

    /// Returns a budget of `bytes` bytes for each frame body, with [`LONGEST_AGE`](Self::LONGEST_AGE).
    #[must_use]
    pub const fn new(bytes: u32) -> Self {
        Self { bytes, longest_age: Self::LONGEST_AGE }
    }

    setters! {
        const fn:
        with_bytes: bytes as u32,
        with_longest_age: longest_age as u16,
    }
}

/// What the last frame postponed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Postponed {
    /// Number of points that are not within their threshold after the frame.
    pub points: u32,
    /// Number of frames that the oldest of them has waited, including this one: 1 to [`Budget::longest_age`], or 0
    /// without such points.
    pub oldest: u16,
    /// Number of points that were sent because they had waited for the longest age.
    pub forced: u32,
    /// Length of the frame body, bytes.
    pub used: u32,
}

/// A point that a frame without a budget would send.
#[derive(Debug, Clone, Copy)]
struct DueChange {
    index: PaddedIndex,
    priority: u64,
}

/// Rank of a point: lower ranks are sent first.
type Rank = (Reverse<u64>, PaddedIndex);

/// Priority of a point that must not wait any longer: above every product.
const FORCED_PRIORITY: u64 = u64::MAX;
/// Number of trials with a guessed number of points; later trials halve the remaining range.
const MAX_GUESSES: u32 = 5;

impl DueChange {
    fn rank(&self) -> Rank {
        (Reverse(self.priority), self.index)
    }
}

/// Result of writing some of the changes.
#[derive(Debug, Clone, Copy)]
struct Trial {
    /// Whether the body is within the budget.
    fits: bool,
    /// Length of the body as far as it was written, bytes.
    used: usize,
    /// Bytes available for the section.
    room: usize,
    /// Number of changes that would fill the budget if all took as many bytes as these.
    would_fit: usize,
}

/// The points that wait, and the choice among those that are due.
#[derive(Debug)]
pub(super) struct BudgetQueue {
    budget: Budget,
    /// By block.
    weights: Vec<u16>,
    /// Postponed points of the last frame, ascending, and the number of frames that each has waited.
    waiting: Vec<(PaddedIndex, u16)>,
    /// Those of the frame before it; kept for the buffer.
    waited: Vec<(PaddedIndex, u16)>,
    /// In the order of padded indices.
    due: Vec<DueChange>,
    ranks: Vec<Rank>,
    /// By block: the points that may change.
    allowed: Vec<u64>,
    /// Number of changes of the last frame that had any, and the length of their section in bytes.
    rate: Option<(usize, usize)>,
    /// A copy of the clients' model, for trials.
    model: ChangeModel,
    postponed: Postponed,
}

/// A frame without its changes.
pub(super) struct PendingFrame<'a> {
    pub(super) writer: &'a mut SectionWriter,
    /// State of clients.
    pub(super) sent: &'a mut State,
    pub(super) targets: &'a Targets,
    /// The AO of clients after the frame.
    pub(super) next: &'a mut NextValues,
    pub(super) coder: BlockCoder,
}

impl BudgetQueue {
    pub(super) fn new(budget: Budget, blocks: usize) -> BudgetQueue {
        BudgetQueue {
            budget,
            weights: vec![1; blocks],
            waiting: Vec::new(),
            waited: Vec::new(),
            due: Vec::new(),
            ranks: Vec::new(),
            allowed: vec![0; blocks],
            rate: None,
            model: ChangeModel::new(),
            postponed: Postponed::default(),
        }
    }

    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        let BudgetQueue { weights, waiting, waited, due, ranks, allowed, model, .. } = self;
        let lists = memory::list(weights) + memory::list(waiting) + memory::list(due) + memory::list(ranks);
        let lists = lists + memory::list(waited) + memory::list(allowed);
        size_of::<Self>() + lists + model.heap_bytes()
    }

    /// Returns the weights by block.
    pub(super) fn weights(&self) -> &[u16] {
        &self.weights
    }

    /// Returns the weights by block, to be changed; a weight is never 0.
    pub(super) fn weights_mut(&mut self) -> &mut [u16] {
        &mut self.weights
    }

    /// Returns what the last frame postponed.
    pub(super) fn postponed(&self) -> &Postponed {
        &self.postponed
    }

    /// Sets the length of the frame in bytes.
    pub(super) fn set_used(&mut self, bytes: usize) {
        self.postponed.used = bytes as u32;
    }

    /// Removes all waiting points, because everything was sent.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.postponed = Postponed::default();
    }

    /// Writes as many of `changes` as fit and removes the others. If it fails, only `changes` is modified.
    pub(super) fn write(
        &mut self,
        mut frame: PendingFrame<'_>,
        changes: &mut Changes,
    ) -> Result<(), EncodeError> {
        let start = WriterMark::of(frame.writer);
        let forced = self.rank(&frame, changes);
        self.fill(&mut frame, changes, start, forced)?;
        if !changes.levels.is_empty() {
            self.rate = Some((changes.levels.len(), frame.writer.blocks.len() - start.bytes));
            if frame.coder == BlockCoder::Range {
                std::mem::swap(&mut frame.sent.model, &mut self.model);
            }
        }
        let forced = changes.points.padded_indices().filter(|index| self.must_go(*index)).count();
        self.update_waiting(&frame);
        self.postponed = Postponed {
            points: self.waiting.len() as u32,
            oldest: self.waiting.iter().map(|(_, waited)| *waited).max().unwrap_or(0),
            forced: forced as u32,
            used: 0,
        };
        Ok(())
    }

    /// Returns whether a point has waited for the longest age.
    fn must_go(&self, index: PaddedIndex) -> bool {
        let found = self.waiting.binary_search_by_key(&index, |(waiting, _)| *waiting);
        found.map_or(0, |at| self.waiting[at].1) >= self.budget.longest_age
    }

    /// Takes the changes and gives each its priority. Returns how many must not wait.
    fn rank(&mut self, frame: &PendingFrame<'_>, changes: &Changes) -> usize {
        let mut waiting = self.waiting.iter().copied().peekable();
        let mut forced = 0;
        self.due.clear();
        for (index, _) in changes.iter() {
            while waiting.next_if(|(before, _)| *before < index).is_some() {}
            let waited = waiting.next_if(|(same, _)| *same == index).map_or(0, |(_, waited)| waited);
            let priority = if waited >= self.budget.longest_age {
                forced += 1;
                FORCED_PRIORITY
            } else {
                let difference = difference(frame.sent.values[index.0], frame.targets.latest()[index.0]);
                let weight = self.weights[index.block()];
                u64::from(difference) * u64::from(weight) * (u64::from(waited) + 1)
            };
            self.due.push(DueChange { index, priority });
        }
        self.ranks.clear();
        self.ranks.extend(self.due.iter().map(DueChange::rank));
        forced
    }

    /// Writes as many changes as fit, at least the forced ones.
    fn fill(
        &mut self,
        frame: &mut PendingFrame<'_>,
        changes: &mut Changes,
        start: WriterMark,
        forced: usize,
    ) -> Result<(), EncodeError> {
        let (all, most) = (self.due.len(), u64::from(self.budget.bytes));
        let mut trial = self.attempt(frame, changes, start, all, all == forced)?;
        if trial.fits || all == forced {
            return Ok(());
        }
        let mut guess = self
            .rate
            .map_or(trial.would_fit * 15 / 16, |(count, bytes)| proportional(count, trial.room, bytes));
        let mut written = None;
        if forced > 0 {
            trial = self.attempt(frame, changes, start, forced, true)?;
            if !trial.fits {
                return Ok(());
            }
            written = Some(forced);
        }
        // The largest number known to fit (or forced), and the smallest known not to fit.
        let (mut fits, mut over) = (forced, all);
        let mut trials = 0;
        while over - fits > 1 + fits / 16 && !(trial.fits && trial.used as u64 * 16 >= most * 15) {
            let sensible = trials < MAX_GUESSES && (fits + 1..over).contains(&guess);
            let count = if sensible { guess } else { fits + (over - fits) / 2 };
            trials += 1;
            trial = self.attempt(frame, changes, start, count, false)?;
            if trial.fits {
                (fits, written) = (count, Some(count));
                guess = trial.would_fit * 31 / 32;
            } else {
                (over, written) = (count, None);
                guess = trial.would_fit * 15 / 16;
            }
        }
        if written != Some(fits) {
            self.attempt(frame, changes, start, fits, true)?;
        }
        Ok(())
    }

    /// Writes the first `count` changes by rank on a copy of the model. It replaces what was tried before. It stops at
    /// the budget unless `ignore_budget` is set.
    fn attempt(
        &mut self,
        frame: &mut PendingFrame<'_>,
        changes: &mut Changes,
        start: WriterMark,
        count: usize,
        ignore_budget: bool,
    ) -> Result<Trial, EncodeError> {
        start.rewind(frame.writer);
        self.choose(frame, count, changes);
        let budget = self.budget.bytes as usize;
        let room = budget.saturating_sub(body_bytes(frame));
        let most = if ignore_budget { usize::MAX } else { room };
        let mut stopped = None;
        if !changes.levels.is_empty() {
            if frame.coder == BlockCoder::Range {
                self.model.clone_from(&frame.sent.model);
            }
            stopped = frame.writer.changes(frame.sent.view(), &mut self.model, changes, frame.coder, most)?;
        }
        let bytes = frame.writer.blocks.len() - start.bytes;
        let used = body_bytes(frame);
        let would_fit = stopped.unwrap_or_else(|| proportional(count, room, bytes));
        Ok(Trial { fits: stopped.is_none() && used <= budget, used, room, would_fit })
    }

    /// Chooses the changes if only the first `count` points by rank may change, and those that must not wait.
    fn choose(&mut self, frame: &mut PendingFrame<'_>, count: usize, changes: &mut Changes) {
        let PendingFrame { sent, targets, next, .. } = frame;
        if count == self.due.len() {
            targets.choose(sent, (changes, next), |_| true);
            return;
        }
        self.allowed.fill(0);
        let longest = self.budget.longest_age;
        let forced = self.waiting.iter().filter(|(_, waited)| *waited >= longest).map(|(index, _)| *index);
        let last = count.checked_sub(1).map(|last| *self.ranks.select_nth_unstable(last).1);
        let first = self.due.iter().filter(|due| last.is_some_and(|last| due.rank() <= last));
        for index in forced.chain(first.map(|due| due.index)) {
            self.allowed[index.block()] |= index.bit();
        }
        targets.choose(sent, (changes, next), |index| self.allowed[index.block()] & index.bit() != 0);
    }

    /// Collects the points that differ after the frame, and how long each has waited.
    fn update_waiting(&mut self, frame: &PendingFrame<'_>) {
        std::mem::swap(&mut self.waiting, &mut self.waited);
        self.waiting.clear();
        let mut before = self.waited.iter().copied().peekable();
        for index in frame.targets.missed(frame.sent, frame.next) {
            while before.next_if(|(earlier, _)| *earlier < index).is_some() {}
            let waited = before.next_if(|(same, _)| *same == index).map_or(0, |(_, waited)| waited);
            self.waiting.push((index, waited.saturating_add(1)));
        }
    }
}

/// Returns the current length of the body in bytes.
fn body_bytes(frame: &PendingFrame<'_>) -> usize {
    header_bytes(&frame.writer.sections, frame.writer.points()) + frame.writer.blocks.len()
}

/// Returns how far a byte is from another one. A value that comes or goes counts as the largest difference.
fn difference(from: u8, to: u8) -> u8 {
    if (from == NO_VALUE) == (to == NO_VALUE) { from.abs_diff(to) } else { u8::MAX }
}

/// Returns how many changes fit `room` bytes if `count` take `bytes`.
fn proportional(count: usize, room: usize, bytes: usize) -> usize {
    (count as u64 * room as u64 / bytes.max(1) as u64) as usize
}

/// Start of the changes of a frame.
#[derive(Debug, Clone, Copy)]
struct WriterMark {
    sections: usize,
    bytes: usize,
}

impl WriterMark {
    fn of(writer: &SectionWriter) -> WriterMark {
        WriterMark { sections: writer.sections.len(), bytes: writer.blocks.len() }
    }

    fn rewind(self, writer: &mut SectionWriter) {
        writer.sections.truncate(self.sections);
        writer.blocks.truncate(self.bytes);
    }
}
