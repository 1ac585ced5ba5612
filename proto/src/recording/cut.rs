//! Cutting a range of frames out of a recording.

use super::rewrite::{LossError, Rewriter};
use super::{FrameEntry, Player, PlayerEvent, RewriteError, RewriteOutcome, Summary};
use crate::{FrameIndex, Limits, StreamTime};

/// A range of frames of a recording. It starts at the first frame within the bounds and ends before the first later
/// frame beyond them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// By time on the stream's own clock, both ends included.
    Time(StreamTime, StreamTime),
    /// By number, both ends included.
    Frames(FrameIndex, FrameIndex),
}

impl Bounds {
    /// Compares an entry with the bounds: `Less` before, `Equal` within, `Greater` beyond them.
    fn compare(&self, entry: &FrameEntry) -> std::cmp::Ordering {
        use std::cmp::Ordering;
        let (value, from, to) = match *self {
            Self::Time(from, to) => (entry.time.0, from.0, to.0),
            Self::Frames(from, to) => (entry.frame.0.into(), from.0.into(), to.0.into()),
        };
        match value {
            value if value < from => Ordering::Less,
            value if value > to => Ordering::Greater,
            _ => Ordering::Equal,
        }
    }

    /// Returns whether an entry lies exactly at the start of the bounds.
    fn start_at(&self, entry: &FrameEntry) -> bool {
        match *self {
            Self::Time(from, _) => entry.time == from,
            Self::Frames(from, _) => entry.frame == from,
        }
    }

    /// Returns whether an entry lies exactly at the end of the bounds.
    fn end_at(&self, entry: &FrameEntry) -> bool {
        match *self {
            Self::Time(_, to) => entry.time == to,
            Self::Frames(_, to) => entry.frame == to,
        }
    }
}

impl std::fmt::Display for Bounds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Time(from, StreamTime(u64::MAX)) => write!(f, "from {} s on", seconds(from)),
            Self::Time(from, to) => write!(f, "from {} s to {} s", seconds(from), seconds(to)),
            Self::Frames(from, FrameIndex(u32::MAX)) => write!(f, "from frame {from} on"),
            Self::Frames(from, to) => write!(f, "from frame {from} to frame {to}"),
        }
    }
}

fn seconds(time: StreamTime) -> f64 {
    time.0 as f64 / 1e6
}

/// Why a range of frames cannot be cut out or played.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RangeError {
    /// No frame lies within the bounds.
    #[error(
        "there is no frame {bounds}: the recording has frames {first} to {last}, {} s to {} s",
        seconds(*start),
        seconds(*end)
    )]
    Outside {
        /// The requested range.
        bounds: Bounds,
        /// Lowest number of a frame.
        first: FrameIndex,
        /// Highest number of a frame.
        last: FrameIndex,
        /// Lowest time of a frame.
        start: StreamTime,
        /// Highest time of a frame.
        end: StreamTime,
    },
    /// The recording has no whole frame.
    #[error("the recording has no whole frame")]
    NoFrames,
    /// Frames lie within the bounds, but the frames that they build on are lost.
    #[error("none of the {frames} frames {bounds} can be played: what they build on is damaged or missing")]
    Unplayable {
        /// The requested range.
        bounds: Bounds,
        /// Number of frames within it.
        frames: usize,
    },
}

/// First and last entry of a range in an index, both included.
pub(super) struct Span {
    pub(super) first: usize,
    pub(super) last: usize,
}

impl Span {
    /// Finds the entries within `bounds`.
    pub(super) fn find(index: &[FrameEntry], bounds: &Bounds) -> Result<Self, RangeError> {
        if let Some(first) = index.iter().position(|entry| bounds.compare(entry).is_eq()) {
            let after = index.iter().skip(first).position(|entry| bounds.compare(entry).is_gt());
            let last = after.map_or(index.len(), |count| first + count) - 1;
            return Ok(Self { first, last });
        }
        let (frames, times) = (index.iter().map(|e| e.frame), index.iter().map(|e| e.time));
        let ends = (frames.clone().min(), frames.max(), times.clone().min(), times.max());
        let (Some(first), Some(last), Some(start), Some(end)) = ends else {
            return Err(RangeError::NoFrames);
        };
        Err(RangeError::Outside { bounds: *bounds, first, last, start, end })
    }
}

/// Cuts the frames within `bounds` out of a recording and passes the bytes of a new, self-contained recording to `put`.
///
/// The new recording starts with the scene table, the edits in force, and a keyframe. The keyframe is made from the
/// state at the first frame of the range, or copied if the recorded frame is a smaller keyframe. Later bodies are
/// copied byte for byte and their frames are renumbered, so the state after each has the recorded hash. The CLOSE of
/// the stream is copied if the range reaches the end. Arrival times count from the first frame's.
///
/// Damaged frames are left out, and the cut continues at the next keyframe. Memory holds one state and one frame.
///
/// # Errors
/// [`RewriteError`]; [`RewriteError::Range`] when no frame can be cut out. `put` is not called before the range is
/// found.
pub fn cut<E>(
    file: &[u8],
    bounds: &Bounds,
    limits: Limits,
    put: impl FnMut(&[u8]) -> Result<(), E>,
) -> Result<RewriteOutcome, RewriteError<E>> {
    let summary = Summary::scan(file, limits)?;
    let index = summary.frames();
    let Span { first, last } = Span::find(index, bounds)?;
    let (first_entry, last_entry) = (&index[first], &index[last]);
    let (before, after) = (first.checked_sub(1).map(|before| &index[before]), index.get(last + 1));
    // Damage beside the range may have destroyed frames of the range, unless the range starts or ends exactly there.
    let begin = match before {
        _ if bounds.start_at(first_entry) => first_entry.offset,
        before => before.map_or(0, |before| before.offset + 1),
    };
    let end = if bounds.end_at(last_entry) { last_entry.offset + 1 } else { u64::MAX };
    let mut player = Player::new(file, limits)?;
    player.jump(&summary, if bounds.start_at(first_entry) { first } else { first.saturating_sub(1) });
    let mut out = Rewriter::new(limits, put)?;
    let (mut started, mut missing) = (false, 0);
    while let Some(step) = player.next_step() {
        let offset = step.offset();
        if offset < end {
            missing = player.stats().lost;
        }
        if after.is_some_and(|after| offset >= after.offset) {
            break;
        }
        if offset < begin {
            out.losses.start_after(player.stats().lost, player.last_applied());
            continue;
        }
        if offset == first_entry.offset && bounds.start_at(first_entry) {
            // Frames missing before the range do not count.
            let before = first_entry.frame.0.checked_sub(1).map(FrameIndex);
            out.losses.start_after(player.stats().lost, before);
        }
        match (&step.event, &step.record) {
            (Some(PlayerEvent::Frame(frame)), Some(record)) if !started && offset >= first_entry.offset => {
                out.begin(record, &frame.info, &player)?;
                started = true;
            }
            // An edit after the last frame affects no frame of the range.
            (Some(PlayerEvent::Edit(_)), _) if offset > last_entry.offset => {}
            _ if offset >= end && LossError::of(&step).is_some() => {}
            _ if LossError::of(&step).is_some() => out.copy(&step, &player)?,
            _ if started => out.copy(&step, &player)?,
            _ => {}
        }
    }
    if !started {
        let frames = last + 1 - first;
        return Err(RangeError::Unplayable { bounds: *bounds, frames }.into());
    }
    if after.is_some() {
        out.drop_close();
    }
    out.end_of_file(missing)?;
    out.finish()?;
    Ok(out.losses.take())
}
