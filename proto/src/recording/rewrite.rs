//! Shared parts of [`cut`](super::cut()), [`Concatenation`](super::Concatenation) and [`recover`](super::recover()).
//!
//! Frames of recordings are copied into a new recording. Everything that is left out is counted and marked with a GAP.

use std::sync::Arc;

use psao_codec::envelope::{EncodeError, FrameInfo};

use super::player::Step;
use super::{
    Damage, DamageKind, EditsInForce, FILE_HEADER_BYTES, Player, PlayerError, PlayerEvent, RangeError,
    ReaderError, Record, Writer, WriterError,
};
use crate::message::{Gap, GapReason, Message, MessageError};
use crate::{FollowError, FrameIndex, FrameType, Limits, Micros, Numbering, SceneTable, WireFrameError};

/// Why a recording could not be rewritten. The bytes written before the error are of no use.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RewriteError<E> {
    /// The bytes are not a recording.
    #[error(transparent)]
    Reader(#[from] ReaderError),
    /// No frame of the range can be played.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// A keyframe of the state could not be encoded.
    #[error("cannot make a keyframe: {0}")]
    Keyframe(#[from] EncodeError),
    /// A message could not be encoded.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// A wire frame could not be written.
    #[error(transparent)]
    Frame(#[from] WireFrameError),
    /// A record could not be written.
    #[error(transparent)]
    Writer(#[from] WriterError),
    /// The caller's `put` failed.
    #[error("{0}")]
    Put(E),
}

/// Part of a recording that is missing from the new one.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LossError {
    /// A stretch that could not be read.
    #[error("{0}")]
    Damage(Damage),
    /// A whole keyframe or update that could not be applied.
    #[error("{} at offset {offset} left out, {bytes} bytes: {reason}", name(*frame))]
    Frame {
        /// Offset of its record in the file, in bytes.
        offset: u64,
        /// Bytes of its record.
        bytes: u64,
        /// Its number, if its body could be parsed.
        frame: Option<FrameIndex>,
        /// Why.
        reason: FollowError,
    },
    /// A whole frame with an invalid message.
    #[error("message at offset {offset} left out, {bytes} bytes: {error}")]
    Message {
        /// Offset of its record in the file, in bytes.
        offset: u64,
        /// Bytes of its record.
        bytes: u64,
        /// Why.
        error: PlayerError,
    },
}

fn name(frame: Option<FrameIndex>) -> String {
    frame.map_or_else(|| "a frame".to_owned(), |frame| format!("frame {frame}"))
}

impl LossError {
    /// Returns the loss that a step of the player reports, if any.
    pub(super) fn of(step: &Step<'_>) -> Option<Self> {
        let bytes = step.record.map_or(0, |record| record.record_bytes());
        Some(match step.event.clone()? {
            PlayerEvent::Damage(damage) => Self::Damage(damage),
            PlayerEvent::Unusable { offset, frame, reason, .. } => {
                Self::Frame { offset, bytes, frame, reason }
            }
            PlayerEvent::BadMessage { offset, error } => Self::Message { offset, bytes, error },
            _ => return None,
        })
    }

    /// Returns the number of bytes lost.
    #[must_use]
    pub const fn bytes(&self) -> u64 {
        match self {
            Self::Damage(damage) => damage.lost_bytes,
            Self::Frame { bytes, .. } | Self::Message { bytes, .. } => *bytes,
        }
    }

    /// Returns whether only the file header is lost, and nothing of the stream.
    fn is_only_the_file_header(&self) -> bool {
        matches!(self, Self::Damage(damage)
            if damage.kind == DamageKind::FileHeader && damage.lost_bytes <= FILE_HEADER_BYTES as u64)
    }
}

/// Counts and losses of rewriting one recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RewriteOutcome {
    /// Keyframes and updates written.
    pub frames: u64,
    /// Keyframes and updates lost, as far as known.
    pub lost_frames: u64,
    /// Bytes lost to damage.
    pub lost_bytes: u64,
    /// Each loss, in the order of the file.
    pub losses: Vec<LossError>,
}

/// Counts losses and makes the GAP message for each place.
#[derive(Debug, Default)]
pub(super) struct LossCounter {
    sum: RewriteOutcome,
    /// The player's count of missing frames at the last GAP.
    counted: u64,
    /// Bytes and frames lost since the last frame was written.
    pending: Option<(u64, u64)>,
    /// Number of the last frame written.
    last: Option<FrameIndex>,
    /// Number of the last frame lost since then, if known.
    last_lost: Option<FrameIndex>,
}

impl LossCounter {
    /// Ignores losses up to frame `last`. `missing` is the player's count of missing frames.
    pub(super) const fn start_after(&mut self, missing: u64, last: Option<FrameIndex>) {
        self.counted = missing;
        self.last = last;
    }

    /// Counts a loss.
    pub(super) fn add(&mut self, loss: LossError) {
        let bytes = loss.bytes();
        let frames = u64::from(matches!(loss, LossError::Frame { .. }));
        self.sum.lost_bytes += bytes;
        self.sum.lost_frames += frames;
        if !loss.is_only_the_file_header() {
            let (all_bytes, all_frames) = self.pending.get_or_insert_default();
            *all_bytes += bytes;
            *all_frames += frames;
        }
        if let LossError::Frame { frame: Some(frame), .. } = &loss {
            self.last_lost = Some(*frame);
        }
        self.sum.losses.push(loss);
    }

    /// Returns the GAP for the frames lost before frame `next`, or before the end for `None`. `missing` is the player's
    /// count of missing frames.
    pub(super) fn take_gap(&mut self, missing: u64, next: Option<FrameIndex>) -> Option<Gap> {
        let unseen = missing.saturating_sub(std::mem::replace(&mut self.counted, missing));
        self.sum.lost_frames += unseen;
        let first = self.last.map_or(0, |last| last.0.saturating_add(1));
        self.last = next.or(self.last);
        if unseen > 0 {
            self.pending.get_or_insert_default();
        }
        let (bytes, seen) = self.pending.take()?;
        let frames = u32::try_from(seen + unseen).unwrap_or(u32::MAX);
        let last = match (self.last_lost.take(), next) {
            // The stream may have restarted since.
            (Some(lost), Some(next)) if lost >= next => lost.0,
            (_, Some(next)) => next.0.saturating_sub(1),
            (_, None) => first.saturating_add(frames.saturating_sub(1)),
        };
        let (first_lost, last_lost) = (FrameIndex(first), FrameIndex(last));
        Some(Gap { first_lost, last_lost, frames, bytes, reason: GapReason::DAMAGE })
    }

    /// Counts a written frame.
    pub(super) const fn count_frame(&mut self) {
        self.sum.frames += 1;
    }

    /// Returns the counts so far and resets them for the next recording.
    pub(super) fn take(&mut self) -> RewriteOutcome {
        std::mem::take(self).sum
    }
}

/// Writes the frames that a player reads into a new recording, with new group numbers.
#[derive(Debug)]
pub(super) struct Rewriter<P> {
    writer: Writer,
    numbering: Numbering,
    put: P,
    /// The scene table written last, and the edits since.
    scene: Option<Arc<SceneTable>>,
    edits: EditsInForce,
    /// A scene table that was read but not written yet.
    pending_scene: Option<Arc<SceneTable>>,
    /// An arrival time in the input file, and the matching one in the new recording.
    arrival_origin: Option<(Micros, Micros)>,
    last_arrival: Micros,
    /// The CLOSE read last.
    last_close: Option<(Micros, Vec<u8>)>,
    pub(super) losses: LossCounter,
}

impl<E, P: FnMut(&[u8]) -> Result<(), E>> Rewriter<P> {
    pub(super) fn new(limits: Limits, mut put: P) -> Result<Self, RewriteError<E>> {
        let (writer, head) = Writer::new(limits);
        put(&head).map_err(RewriteError::Put)?;
        Ok(Self {
            writer,
            numbering: Numbering::default(),
            put,
            scene: None,
            edits: EditsInForce::default(),
            pending_scene: None,
            arrival_origin: None,
            last_arrival: Micros::default(),
            last_close: None,
            losses: LossCounter::default(),
        })
    }

    /// Prepares for another input file, whose first record arrives one frame interval after the last record.
    pub(super) fn next_file(&mut self) {
        let interval = self.scene.as_ref().map_or(0.0, |scene| 1e6 / f64::from(scene.info().fps));
        self.last_arrival = self.last_arrival.plus(Micros(interval.round() as u64));
        self.arrival_origin = None;
    }

    /// Starts with the state after the frame that the player has just applied: scene table, edits, keyframe. The
    /// recorded frame is copied if it is a smaller keyframe. `info` is the header of its body.
    pub(super) fn begin(
        &mut self,
        record: &Record<'_>,
        info: &FrameInfo,
        player: &Player<'_>,
    ) -> Result<(), RewriteError<E>> {
        self.pending_scene = player.scene().cloned();
        for edit in player.edits().iter() {
            self.message(record.arrival, FrameType::EDIT, &edit.to_payload()?)?;
            self.edits.apply(edit);
        }
        self.gap(record.arrival, player)?;
        let recorded = record.frame.payload();
        let is_keyframe = record.frame.header.kind == FrameType::KEYFRAME;
        let made = player.keyframe().transpose()?;
        match &made {
            Some(made) if !is_keyframe || made.len() < recorded.len() => {
                self.state_frame(record.arrival, FrameType::KEYFRAME, info, made)
            }
            _ => self.state_frame(record.arrival, record.frame.header.kind, info, recorded),
        }
    }

    /// Copies the record that the player has just read, or counts its loss.
    pub(super) fn copy(&mut self, step: &Step<'_>, player: &Player<'_>) -> Result<(), RewriteError<E>> {
        if let Some(loss) = LossError::of(step) {
            self.losses.add(loss);
            return Ok(());
        }
        let Some(record) = &step.record else { return Ok(()) };
        let (kind, payload) = (record.frame.header.kind, record.frame.payload());
        match (&step.event, kind) {
            (Some(PlayerEvent::Scene(table)), _) => self.pending_scene = Some(table.clone()),
            (Some(PlayerEvent::Frame(frame)), _) => {
                self.gap(record.arrival, player)?;
                self.state_frame(record.arrival, kind, &frame.info, payload)?;
            }
            (Some(PlayerEvent::Closed(_)), _) => {
                self.last_close = Some((self.map_arrival(record.arrival), payload.to_vec()));
            }
            (Some(PlayerEvent::Edit(edit)), _) => {
                self.message(record.arrival, kind, payload)?;
                self.edits.apply(edit);
            }
            // A scene table is written whole or not at all, index and parity are made anew, and handshakes are not
            // part of a stream.
            (None, FrameType::SCENE | FrameType::ACCEPT | FrameType::REJECT) => {}
            (None, FrameType::INDEX | FrameType::PARITY) => {}
            _ => self.message(record.arrival, kind, payload)?,
        }
        Ok(())
    }

    /// Ends an input file. `missing` is the player's count of missing frames.
    pub(super) fn end_of_file(&mut self, missing: u64) -> Result<(), RewriteError<E>> {
        match self.losses.take_gap(missing, None) {
            None => Ok(()),
            Some(gap) => self.write(self.last_arrival, FrameType::GAP, &gap.to_payload()?),
        }
    }

    /// Writes a GAP for the frames lost before the one that the player has just applied.
    fn gap(&mut self, arrival: Micros, player: &Player<'_>) -> Result<(), RewriteError<E>> {
        match self.losses.take_gap(player.stats().lost, player.last_applied()) {
            None => Ok(()),
            Some(gap) => self.message(arrival, FrameType::GAP, &gap.to_payload()?),
        }
    }

    /// Drops the CLOSE read last, because the new recording ends before the stream does.
    pub(super) fn drop_close(&mut self) {
        self.last_close = None;
    }

    /// Writes the CLOSE read last and the index, and returns the length of the file.
    pub(super) fn finish(&mut self) -> Result<u64, RewriteError<E>> {
        if let Some((arrival, payload)) = self.last_close.take() {
            let frame = self.numbering.control(FrameType::CLOSE, &payload);
            self.append(arrival, &frame, None)?;
        }
        let end = self.writer.finish()?;
        (self.put)(&end).map_err(RewriteError::Put)?;
        Ok(self.writer.file_bytes())
    }

    /// Writes a keyframe or update. `info` is the header of the recorded body. A keyframe made from a state has another
    /// header, but the same number and time, and the index needs no more.
    fn state_frame(
        &mut self,
        arrival: Micros,
        kind: FrameType,
        info: &FrameInfo,
        body: &[u8],
    ) -> Result<(), RewriteError<E>> {
        let arrival = self.map_arrival(arrival);
        self.write_pending_scene(arrival)?;
        let frame = match kind {
            FrameType::KEYFRAME => self.numbering.keyframe(body)?,
            _ => self.numbering.update(body)?,
        };
        self.last_close = None;
        self.losses.count_frame();
        self.append(arrival, &frame, Some(info))
    }

    fn message(&mut self, arrival: Micros, kind: FrameType, payload: &[u8]) -> Result<(), RewriteError<E>> {
        let arrival = self.map_arrival(arrival);
        self.write(arrival, kind, payload)
    }

    fn write(&mut self, arrival: Micros, kind: FrameType, payload: &[u8]) -> Result<(), RewriteError<E>> {
        self.write_pending_scene(arrival)?;
        let in_a_group = kind != FrameType::GAP;
        let numbering = if in_a_group { self.numbering } else { Numbering::default() };
        self.append(arrival, &numbering.control(kind, payload), None)
    }

    /// Writes the pending scene table, unless it is the one in force and no edit has changed the scene. In that case
    /// the next keyframe is enough.
    fn write_pending_scene(&mut self, arrival: Micros) -> Result<(), RewriteError<E>> {
        let Some(table) = self.pending_scene.take() else { return Ok(()) };
        if self.scene.as_ref() == Some(&table) && self.edits.is_empty() {
            return Ok(());
        }
        for frame in self.numbering.scene(&table)? {
            self.append(arrival, &frame, None)?;
        }
        self.scene = Some(table);
        self.edits = EditsInForce::default();
        Ok(())
    }

    fn map_arrival(&mut self, arrival: Micros) -> Micros {
        let (there, here) = *self.arrival_origin.get_or_insert((arrival, self.last_arrival));
        here.plus(arrival.since(there))
    }

    fn append(
        &mut self,
        arrival: Micros,
        frame: &[u8],
        info: Option<&FrameInfo>,
    ) -> Result<(), RewriteError<E>> {
        let record = self.writer.append_parsed(arrival, frame, info)?;
        self.last_arrival = self.last_arrival.max(arrival);
        (self.put)(&record).map_err(RewriteError::Put)
    }
}
