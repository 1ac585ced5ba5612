//! Byte budgets: the order of changes if not all of them fit a frame.

use std::cmp::Reverse;

use super::model::change::ChangeModel;
use super::section::changes::Changes;
use super::section::writer::SectionWriter;
use super::{NO_VALUE, PaddedIndex, State};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameMeta, SectionTag, header_bytes};
use crate::memory;

/// The byte budget of a delta, and how long a point may wait.
///
/// If not all changes fit, those with the largest product of three factors go first: the *difference* between the byte
/// set and the one of clients (1 to 255), the *weight* of the point's block
/// ([`Encoder::set_weight`](super::Encoder::set_weight)), and the *age*. The age is the number of frames since the
/// point first differed by the threshold, including this one. Lower point ids go first among equals. Points that
/// have waited for `longest_age` frames go before all others, whatever the budget. A frame is a call of
/// [`Encoder::finish`](super::Encoder::finish).
///
/// # What holds
///
/// *Bytes.* A delta without arriving blocks takes at most `bytes`, with one exception: the points that have waited for
/// `longest_age` may alone take more, and then the frame has no others. A delta without a change still takes its
/// header, 29 B. Keyframes have no budget. Arriving blocks are sent completely, and changes get the bytes that they
/// leave.
///
/// *Error.* Let `T` be the threshold. For every point that clients hold and every frame `n` there is a frame `m` with
/// `n - longest_age <= m <= n` such that the byte held after frame `n` is less than `T` from the one last set before
/// frame `m` was finished. Suppose a point has differed since frame `d`. It was not sent in `d..=n`, so
/// `n < d + longest_age`; choose `m = d - 1`.
///
/// *Waiting.* Suppose that a section of `k` changes takes at most `f + c k` bytes, where `f` counts all of the body
/// that is not changes, and that at most `D` points differ at any time. A frame that postpones a point sends at least
/// `s = (15 / 16 bytes - f) / c - 1` others: the search ends when 15/16 of the budget are used, or when
/// `k + k / 16 + 1` changes are known not to fit. Let `q` be the largest quotient of two products of difference and weight, at most
/// `255 w / T` with weights of 1 to `w`. Then no point waits for more than `(q + 1) ceil(D / s)` frames. The reason:
/// once a point is `q` times `x = ceil(D / s)` frames old, only points that have waited for more than `x` frames can
/// go before it. Those that do so in the next `x` frames differed at the beginning of these frames. So there are fewer
/// than `D` of them, and `s` go in each frame. With equal products the bound is `2 ceil(D / s)`. A `longest_age` of
/// that many frames forces nothing; a shorter one may.
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
    /// Number of points that differ by the threshold and were not sent.
    pub points: u32,
    /// Number of frames that the oldest of them has waited, including this one: 1 to [`Budget::longest_age`], or 0
    /// without such points.
    pub oldest: u16,
    /// Number of points that were sent because they had waited for the longest age.
    pub forced: u32,
    /// Length of the frame body, bytes.
    pub used: u32,
}

/// A point that differs by the threshold.
#[derive(Debug, Clone, Copy)]
struct DueChange {
    index: PaddedIndex,
    level: i16,
    /// Number of earlier frames that postponed it.
    waited: u16,
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
    /// In the order of padded indices.
    due: Vec<DueChange>,
    ranks: Vec<Rank>,
    /// Rank of the last one chosen.
    last: Option<Rank>,
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
    /// AO bytes as last set, by padded index.
    pub(super) latest: &'a [u8],
    pub(super) meta: FrameMeta,
    pub(super) coder: BlockCoder,
}

impl BudgetQueue {
    pub(super) fn new(budget: Budget, blocks: usize) -> BudgetQueue {
        BudgetQueue {
            budget,
            weights: vec![1; blocks],
            waiting: Vec::new(),
            due: Vec::new(),
            ranks: Vec::new(),
            last: None,
            rate: None,
            model: ChangeModel::new(),
            postponed: Postponed::default(),
        }
    }

    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        let BudgetQueue { weights, waiting, due, ranks, model, .. } = self;
        let lists = memory::list(weights) + memory::list(waiting) + memory::list(due) + memory::list(ranks);
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

    /// Writes as many of `changes` as fit and removes the others. Returns the number of changed points for the header.
    /// If it fails, only `changes` is modified.
    pub(super) fn write(
        &mut self,
        mut frame: PendingFrame<'_>,
        changes: &mut Changes,
    ) -> Result<u32, EncodeError> {
        let start = WriterMark::of(frame.writer);
        let forced = self.rank(&frame, changes);
        let count = self.fill(&mut frame, changes, start, forced)?;
        if count > 0 {
            self.rate = Some((count, frame.writer.blocks.len() - start.bytes));
            if frame.coder == BlockCoder::Range {
                std::mem::swap(&mut frame.sent.model, &mut self.model);
            }
        }
        let changed_points = self.changed_points(&frame, count);
        self.waiting.clear();
        let left = self.due.iter().filter(|due| self.last.is_none_or(|last| due.rank() > last));
        self.waiting.extend(left.map(|due| (due.index, due.waited.saturating_add(1))));
        self.postponed = Postponed {
            points: self.waiting.len() as u32,
            oldest: self.waiting.iter().map(|(_, waited)| *waited).max().unwrap_or(0),
            forced: forced as u32,
            used: 0,
        };
        Ok(changed_points)
    }

    /// Takes the changes and gives each its priority. Returns how many must not wait.
    fn rank(&mut self, frame: &PendingFrame<'_>, changes: &Changes) -> usize {
        let mut waiting = self.waiting.iter().copied().peekable();
        let mut forced = 0;
        self.due.clear();
        for (index, level) in changes.iter() {
            while waiting.next_if(|(before, _)| *before < index).is_some() {}
            let waited = waiting.next_if(|(same, _)| *same == index).map_or(0, |(_, waited)| waited);
            let priority = if waited >= self.budget.longest_age {
                forced += 1;
                FORCED_PRIORITY
            } else {
                let difference = difference(frame.sent.values[index.0], frame.latest[index.0]);
                let weight = self.weights[index.block()];
                u64::from(difference) * u64::from(weight) * (u64::from(waited) + 1)
            };
            self.due.push(DueChange { index, level, waited, priority });
        }
        self.ranks.clear();
        self.ranks.extend(self.due.iter().map(DueChange::rank));
        forced
    }

    /// Writes as many changes as fit, at least the forced ones. Returns their number.
    fn fill(
        &mut self,
        frame: &mut PendingFrame<'_>,
        changes: &mut Changes,
        start: WriterMark,
        forced: usize,
    ) -> Result<usize, EncodeError> {
        let (all, most) = (self.due.len(), u64::from(self.budget.bytes));
        let mut trial = self.attempt(frame, changes, start, all, all == forced)?;
        if trial.fits || all == forced {
            return Ok(all);
        }
        let mut guess = self
            .rate
            .map_or(trial.would_fit * 15 / 16, |(count, bytes)| proportional(count, trial.room, bytes));
        let mut written = None;
        if forced > 0 {
            trial = self.attempt(frame, changes, start, forced, true)?;
            if !trial.fits {
                return Ok(forced);
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
        Ok(fits)
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
        self.choose(count, changes);
        let budget = self.budget.bytes as usize;
        let room = budget.saturating_sub(self.body_bytes(frame, count));
        let most = if ignore_budget { usize::MAX } else { room };
        let mut stopped = None;
        if count > 0 {
            if frame.coder == BlockCoder::Range {
                self.model.clone_from(&frame.sent.model);
            }
            stopped = frame.writer.changes(frame.sent.view(), &mut self.model, changes, frame.coder, most)?;
        }
        let bytes = frame.writer.blocks.len() - start.bytes;
        let used = self.body_bytes(frame, count);
        let would_fit = stopped.unwrap_or_else(|| proportional(count, room, bytes));
        Ok(Trial { fits: stopped.is_none() && used <= budget, used, room, would_fit })
    }

    /// Leaves the first `count` changes by rank in `changes`.
    fn choose(&mut self, count: usize, changes: &mut Changes) {
        self.last = match count.checked_sub(1) {
            None => None,
            Some(last) => Some(*self.ranks.select_nth_unstable(last).1),
        };
        changes.clear();
        for due in self.due.iter().filter(|due| self.last.is_some_and(|last| due.rank() <= last)) {
            changes.push(due.index, due.level);
        }
    }

    /// Returns the current length of the body in bytes.
    fn body_bytes(&self, frame: &PendingFrame<'_>, count: usize) -> usize {
        let header = header_bytes(&frame.writer.sections, self.changed_points(frame, count));
        header + frame.writer.blocks.len()
    }

    /// Returns the number of changed points for the header of a frame with `count` changes. It is the caller's number
    /// unless points wait or waited; then it is the number of points in the frame.
    fn changed_points(&self, frame: &PendingFrame<'_>, count: usize) -> u32 {
        if self.waiting.is_empty() && count == self.due.len() {
            return frame.meta.changed_points;
        }
        let of_points = |tag| matches!(tag, SectionTag::VALUES | SectionTag::CHANGES);
        let sections = frame.writer.sections.iter().filter(|section| of_points(section.tag));
        sections.map(|section| section.records).sum()
    }
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
