//! Byte budgets: which changes go first when not all of them fit a frame.

use std::cmp::Reverse;

use super::model::change::ChangeModel;
use super::section::changes::Changes;
use super::section::writer::SectionWriter;
use super::{PaddedIndex, State};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameMeta, SectionTag, header_bytes};
use crate::memory;

/// How many bytes a delta takes at most, and how long a point may wait for its turn.
///
/// When not all changes fit, those with the largest product of *difference* (between the byte offered and the one that
/// clients hold, 1 to 255), *weight* (of the point's block, see [`Encoder::set_weight`](super::Encoder::set_weight)) and *age* (frames
/// since the point first differed by the threshold, this one included) go first, those of lower point ids among equals. Points
/// that have waited for `longest_age` frames go before all, and ignore_budget the budget. A frame is a call of
/// [`Encoder::finish`](super::Encoder::finish).
///
/// # What holds
///
/// *Bytes.* A delta without arriving blocks takes at most `bytes`, unless the points that have waited for `longest_age`
/// alone take more; then it has no others. One without a change takes its header all the same, 29 B. Keyframes
/// have no budget; arriving blocks go out whole, and changes get what they leave.
///
/// *Error.* With threshold `T`, for every point that clients hold and every frame `n` there is a frame `m` with
/// `n - longest_age <= m <= n` such that the byte held after frame `n` is less than `T` from the one last offered before
/// frame `m` was finished. For a point that differs after frame `n` and has since frame `d` was not sent from `d` on, and would
/// have been in frame `d + longest_age`; `m` is `d - 1`.
///
/// *Waiting.* Say that a section of `k` changes takes at most `f + c k` bytes, `f` counting all of the body that is not
/// changes, and that at most `D` points differ at any time. A frame that postpones a point sends at least
/// `s = (15 / 16 bytes - f) / c - 1` others: the search for how many fit ends when 15/16 of the budget are used, or when
/// `k + k / 16 + 1` of them are known not to fit. Let `q` be the largest quotient of two products of difference and weight, at
/// most `255 w / T` with weights of 1 to `w`. Then no point waits for more than `(q + 1) ceil(D / s)` frames: once it is
/// `q` times `x = ceil(D / s)` frames old, only points that have waited for more than `x` frames can go before it; those that do
/// in the next `x` frames differed at their beginning, so there are fewer than `D`, and `s` go in each frame. With equal
/// products the bound is `2 ceil(D / s)`. A `longest_age` of that many frames forces nothing; a shorter one may.
///
/// With a budget that every frame keeps by itself, the stream is that without a budget, byte for byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Bytes of a frame body.
    pub bytes: u32,
    /// Frames that a point may wait; 0 lets none wait.
    pub longest_age: u16,
}

impl Budget {
    /// Frames that a point may wait unless said otherwise: a second at 60 Hz.
    pub const LONGEST_AGE: u16 = 60;
}

/// What the last frame left for later.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Postponed {
    /// Points that differ by the threshold and were not sent.
    pub points: u32,
    /// Frames that the oldest of them has waited, this one included: 1 to [`Budget::longest_age`], 0 without such points.
    pub oldest: u16,
    /// Points that were sent because they had waited for the longest age.
    pub forced: u32,
    /// Bytes of the frame body.
    pub used: u32,
}

/// A point that differs by the threshold.
#[derive(Debug, Clone, Copy)]
struct DueChange {
    index: PaddedIndex,
    level: i16,
    /// Frames before this one that postponed it.
    waited: u16,
    priority: u64,
}

/// Order in which points are sent.
type Rank = (Reverse<u64>, PaddedIndex);

/// Priority of a point that must not wait any longer: above every product.
const FORCED: u64 = u64::MAX;
/// Trials whose number of points is guessed from the one before; later ones halve what is left.
const GUESSES: u32 = 5;

impl DueChange {
    fn rank(&self) -> Rank {
        (Reverse(self.priority), self.index)
    }
}

/// What came of writing some of the changes.
#[derive(Debug, Clone, Copy)]
struct Trial {
    /// Whether the body has its budget at most.
    fits: bool,
    /// Bytes of the body, as far as it was written.
    used: usize,
    /// Bytes that the section could take.
    room: usize,
    /// How many changes would fill the budget if all set_used as many bytes as these.
    would_fit: usize,
}

/// The points that wait, and the choice among those that are due.
#[derive(Debug)]
pub(super) struct BudgetQueue {
    budget: Budget,
    /// By block.
    weights: Vec<u16>,
    /// What the last frame postponed: slots, ascending, with the frames that they have waited.
    waiting: Vec<(PaddedIndex, u16)>,
    /// In the order of slots.
    due: Vec<DueChange>,
    ranks: Vec<Rank>,
    /// Rank of the last one chosen.
    last: Option<Rank>,
    /// Changes of the last frame that had any, and the bytes of their section.
    rate: Option<(usize, usize)>,
    /// A copy of the clients' model, to code on.
    model: ChangeModel,
    postponed: Postponed,
}

/// A frame that lacks its changes.
pub(super) struct PendingFrame<'a> {
    pub(super) writer: &'a mut SectionWriter,
    /// What clients hold.
    pub(super) sent: &'a mut State,
    /// Bytes as last offered, by slot.
    pub(super) offered: &'a [u8],
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

    /// Weights by block.
    pub(super) fn weights(&self) -> &[u16] {
        &self.weights
    }

    /// Weights by block, to be changed; never 0.
    pub(super) fn weights_mut(&mut self) -> &mut [u16] {
        &mut self.weights
    }

    /// What the last frame left for later.
    pub(super) fn postponed(&self) -> &Postponed {
        &self.postponed
    }

    /// Takes note of the bytes that a frame set_used.
    pub(super) fn set_used(&mut self, bytes: usize) {
        self.postponed.used = bytes as u32;
    }

    /// Everything was sent.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.postponed = Postponed::default();
    }

    /// Writes as many of `changes` as fit and takes the others out; what the frame's header says of its points. Where it
    /// fails, nothing has changed but `changes`.
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

    /// Takes the changes over and gives each its priority; how many must not wait.
    fn rank(&mut self, frame: &PendingFrame<'_>, changes: &Changes) -> usize {
        let mut waiting = self.waiting.iter().copied().peekable();
        let mut forced = 0;
        self.due.clear();
        for (index, level) in changes.iter() {
            while waiting.next_if(|(before, _)| *before < index).is_some() {}
            let waited = waiting.next_if(|(same, _)| *same == index).map_or(0, |(_, waited)| waited);
            let priority = if waited >= self.budget.longest_age {
                forced += 1;
                FORCED
            } else {
                let difference = frame.offered[index.0].abs_diff(frame.sent.values[index.0]);
                let weight = self.weights[index.block()];
                u64::from(difference) * u64::from(weight) * (u64::from(waited) + 1)
            };
            self.due.push(DueChange { index, level, waited, priority });
        }
        self.ranks.clear();
        self.ranks.extend(self.due.iter().map(DueChange::rank));
        forced
    }

    /// Writes as many changes as fit, at least those that are forced; how many.
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
        // The most that fit, or those that are forced; the fewest that do not fit.
        let (mut fits, mut over) = (forced, all);
        let mut trials = 0;
        while over - fits > 1 + fits / 16 && !(trial.fits && trial.used as u64 * 16 >= most * 15) {
            let sensible = trials < GUESSES && (fits + 1..over).contains(&guess);
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

    /// Writes the first `count` in the order of ranks on a copy of the model, in place of what was tried before; without
    /// `ignore_budget` no further than the budget.
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

    /// Leaves the first `count` in the order of ranks in `changes`.
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

    /// Bytes of the body as it is.
    fn body_bytes(&self, frame: &PendingFrame<'_>, count: usize) -> usize {
        let header = header_bytes(&frame.writer.sections, self.changed_points(frame, count));
        header + frame.writer.blocks.len()
    }

    /// Points that the header of a frame with `count` changes names: what the caller says, unless that cannot be because some
    /// wait or waited; then those that the frame has.
    fn changed_points(&self, frame: &PendingFrame<'_>, count: usize) -> u32 {
        if self.waiting.is_empty() && count == self.due.len() {
            return frame.meta.changed_points;
        }
        let of_points = |tag| matches!(tag, SectionTag::VALUES | SectionTag::CHANGES);
        let sections = frame.writer.sections.iter().filter(|section| of_points(section.tag));
        sections.map(|section| section.records).sum()
    }
}

/// How many changes `room` bytes have room for when `count` take `bytes`.
fn proportional(count: usize, room: usize, bytes: usize) -> usize {
    (count as u64 * room as u64 / bytes.max(1) as u64) as usize
}

/// Where the changes of a frame begin.
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
