//! Playing a recording: decoding its records into states, past any damage.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameBody, FrameInfo, FrameKind, FrameMeta};
use psao_codec::{State, keyframe};

use super::{
    Damage, EditsInForce, FrameEntry, IndexEntry, RECORD_HEAD_BYTES, Reader, ReaderError, Record, Summary,
};
use crate::follow::{FollowError, Follower};
use crate::message::{Budget, Close, Edit, Gap, Message, MessageError, Report, Scene};
use crate::scene::SceneAssembler;
use crate::{
    FrameHeader, FrameIndex, FrameType, Group, HEADER_BYTES, Limits, Micros, SceneError, SceneTable, Sequence,
};

/// A keyframe or update that was applied. The state has the hash that its header names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlayedFrame {
    /// Header of its body: frame number, time, hash, sections.
    pub info: FrameInfo,
    /// Header of its wire frame: type, group, sequence.
    pub header: FrameHeader,
    /// Arrival at the recorder.
    pub arrival: Micros,
    /// Offset of its record in the file, in bytes.
    pub offset: u64,
    /// Its bytes on the wire.
    pub wire_bytes: u64,
    /// Bytes of its record in the file.
    pub record_bytes: u64,
}

impl PlayedFrame {
    /// Returns the recorded frame body, a part of `file`. `file` must be the bytes that the player was given. The
    /// result is empty if `file` is too short.
    #[must_use]
    pub fn body<'a>(&self, file: &'a [u8]) -> &'a [u8] {
        let start = usize::try_from(self.offset).unwrap_or(usize::MAX);
        let start = start.saturating_add(RECORD_HEAD_BYTES + HEADER_BYTES);
        let end = start.saturating_add(self.header.length as usize);
        file.get(start..end).unwrap_or_default()
    }
}

/// Event of a player.
#[derive(Clone, Debug, PartialEq)]
pub enum PlayerEvent {
    /// The scene table is whole.
    Scene(Arc<SceneTable>),
    /// The state is that of a newer frame.
    Frame(PlayedFrame),
    /// A keyframe or update could not be applied. The state stays unchanged until the next keyframe.
    Unusable {
        /// Offset of its record in the file, in bytes.
        offset: u64,
        /// Header of its wire frame.
        header: FrameHeader,
        /// Number of the frame, if its body could be parsed.
        frame: Option<FrameIndex>,
        /// Why.
        reason: FollowError,
    },
    /// A whole frame has an invalid message. A faulty program wrote it; damage would break the checksum.
    BadMessage {
        /// Offset of its record in the file, in bytes.
        offset: u64,
        /// Why.
        error: PlayerError,
    },
    /// Server statistics of a frame.
    Report(Report),
    /// Use of the byte budget by a frame.
    Budget(Budget),
    /// The scene was edited. Every later frame includes the edit.
    Edit(Edit),
    /// The recorder did not write some frames.
    Gap(Gap),
    /// The stream ended.
    Closed(Close),
    /// A stretch of the file could not be read.
    Damage(Damage),
}

/// Why a message of a recording is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlayerError {
    /// The message itself is invalid.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// The message does not fit the SCENE messages before it.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The edit names an instance that the scene lacks.
    #[error("EDIT of instance {instance}: the scene has {instances} instances")]
    NoInstance {
        /// The instance.
        instance: u32,
        /// Instances of the scene; 0 before the scene table.
        instances: usize,
    },
}

/// One record or damaged stretch that a player has read.
#[derive(Debug)]
pub(super) struct Step<'a> {
    /// The record; `None` for a damaged stretch.
    pub(super) record: Option<Record<'a>>,
    /// Its event; `None` for records that a player ignores.
    pub(super) event: Option<PlayerEvent>,
}

/// Counts of a player.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlayerStats {
    /// Keyframes and updates applied.
    pub applied: u64,
    /// Keyframes and updates in the file that could not be applied.
    pub unusable: u64,
    /// Keyframes and updates missing from the file, as far as the frames around them show. Frames missing at the end
    /// are not known.
    pub lost: u64,
    /// Damaged stretches.
    pub damages: u64,
    /// Bytes in them.
    pub damaged_bytes: u64,
    /// Whole frames with an invalid message.
    pub bad_messages: u64,
    /// Gaps that the recorder reported.
    pub gaps: u64,
    /// Keyframes and updates missing in these gaps, as far as the recorder knew.
    pub gap_frames: u64,
}

impl PlayerStats {
    /// Returns whether everything that was recorded could be read and applied. Gaps that the recorder reported are not
    /// errors; `gaps` counts them.
    #[must_use]
    pub const fn is_clean(&self) -> bool {
        self.unusable == 0 && self.lost == 0 && self.damages == 0 && self.bad_messages == 0
    }
}

impl Step<'_> {
    /// Returns the offset of the record or damage in the file, in bytes.
    pub(super) fn offset(&self) -> u64 {
        match (&self.record, &self.event) {
            (Some(record), _) => record.offset(),
            (None, Some(PlayerEvent::Damage(damage))) => damage.offset,
            (None, _) => 0,
        }
    }
}

/// Plays a recording into a state.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use psao_proto::Limits;
/// use psao_proto::recording::{Player, PlayerEvent};
///
/// # let (_, file) = psao_proto::recording::Writer::new(Limits::default());
/// let mut player = Player::new(&file, Limits::default())?;
/// while let Some(event) = player.next_event() {
///     match event {
///         PlayerEvent::Frame(frame) => println!("frame {}: {} B", frame.info.frame, frame.wire_bytes),
///         PlayerEvent::Damage(damage) => eprintln!("{damage}"),
///         _ => {}
///     }
/// }
/// assert!(player.stats().is_clean());
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Player<'a> {
    reader: Reader<'a>,
    playback: Playback,
}

/// State of playing a recording, apart from the reader.
#[derive(Debug)]
pub(super) struct Playback {
    limits: Limits,
    assembler: SceneAssembler,
    scene: Option<Arc<SceneTable>>,
    follower: Option<Follower>,
    edits: EditsInForce,
    /// Header of the last frame applied since the scene table.
    current: Option<FrameMeta>,
    /// The last keyframe or update whose body could be parsed, applied or not.
    last: Option<(Group, Sequence, FrameIndex)>,
    /// Whether damage followed it.
    damaged: bool,
    stats: PlayerStats,
}

impl<'a> Player<'a> {
    /// Creates a player at the start of a whole file.
    ///
    /// # Errors
    /// [`ReaderError`] when the bytes are not a recording that this version reads.
    pub fn new(bytes: &'a [u8], limits: Limits) -> Result<Self, ReaderError> {
        Ok(Self { reader: Reader::with_limits(bytes, limits)?, playback: Playback::new(limits) })
    }

    /// Plays on to the next event and returns it; `None` at the end of the file.
    pub fn next_event(&mut self) -> Option<PlayerEvent> {
        loop {
            if let Some(event) = self.next_step()?.event {
                return Some(event);
            }
        }
    }

    /// Plays one record.
    pub(super) fn next_step(&mut self) -> Option<Step<'a>> {
        self.playback.step(&mut self.reader)
    }

    /// Moves to the last keyframe that is not after entry `entry` of [`Summary::frames`], and loads the scene table and
    /// the edits in force there. Other earlier records are skipped; the frames up to `entry` come next. Without such a
    /// keyframe it moves to the start of the file.
    ///
    /// `summary` must be the summary of this file.
    pub fn jump(&mut self, summary: &Summary, entry: usize) {
        let before = summary.frames().get(..=entry).unwrap_or(summary.frames());
        let Some(key) = before.iter().rfind(|entry| entry.keyframe) else {
            self.reader.rewind();
            return;
        };
        for entry in summary.prerequisites_of(key.offset) {
            self.prerequisite(entry);
        }
        self.seek(key);
    }

    /// Plays a scene table or an edit. An error shows later, when a keyframe cannot be applied.
    fn prerequisite(&mut self, entry: &IndexEntry) {
        self.reader.seek(entry.offset);
        while let Some(Ok(record)) = self.reader.next() {
            let kind = record.frame.header.kind;
            let wanted = matches!(kind, FrameType::SCENE | FrameType::EDIT);
            // Only the last frame of a scene table is an event.
            if kind.carries_state() || wanted && self.playback.record(&record).is_some() {
                break;
            }
        }
    }

    /// Moves to a keyframe of [`Summary::frames`], which is the next frame to be applied. The scene table must have
    /// been played before, or the keyframe fails with [`FollowError::NoScene`]; [`jump`](Self::jump) takes care of
    /// that.
    pub fn seek(&mut self, keyframe: &FrameEntry) {
        self.reader.seek(keyframe.offset);
        self.playback.lose_position();
    }

    /// Returns the state after the last frame applied; `None` before the scene table.
    #[must_use]
    pub fn state(&self) -> Option<&State> {
        self.playback.state()
    }

    /// Returns the scene table; `None` before it was played.
    #[must_use]
    pub const fn scene(&self) -> Option<&Arc<SceneTable>> {
        self.playback.scene.as_ref()
    }

    /// Returns the number of the last frame applied since the scene table.
    pub(super) fn last_applied(&self) -> Option<FrameIndex> {
        self.playback.current.map(|meta| meta.frame)
    }

    /// Returns the edits in force for the next frame.
    #[must_use]
    pub const fn edits(&self) -> &EditsInForce {
        &self.playback.edits
    }

    /// Encodes a keyframe body of the current state with the stream's block coder, for a client that joins here.
    /// Number, time and statistics are those of the last frame applied. Returns `None` before the first frame of a
    /// scene.
    ///
    /// # Errors
    /// [`EncodeError`] of the block coder.
    pub fn keyframe(&self) -> Option<Result<Vec<u8>, EncodeError>> {
        let (state, meta) = (self.state()?, self.playback.current?);
        let coder = BlockCoder::of(self.scene()?.info().coder);
        Some(keyframe(state, meta, coder, &[]))
    }

    /// Returns the counts so far.
    #[must_use]
    pub const fn stats(&self) -> PlayerStats {
        self.playback.stats
    }
}

impl Playback {
    /// Creates a playback before the first record.
    pub(super) fn new(limits: Limits) -> Self {
        Self {
            limits,
            assembler: SceneAssembler::default(),
            scene: None,
            follower: None,
            edits: EditsInForce::default(),
            current: None,
            last: None,
            damaged: false,
            stats: PlayerStats::default(),
        }
    }

    /// Plays the next record of a reader; returns `None` at the end of the file.
    pub(super) fn step<'a>(&mut self, reader: &mut Reader<'a>) -> Option<Step<'a>> {
        match reader.next()? {
            Ok(record) => Some(Step { record: Some(record), event: self.record(&record) }),
            Err(damage) => {
                self.damaged = true;
                self.stats.damages += 1;
                self.stats.damaged_bytes += damage.lost_bytes;
                Some(Step { record: None, event: Some(PlayerEvent::Damage(damage)) })
            }
        }
    }

    /// Returns the state after the last frame applied; `None` before the scene table.
    pub(super) fn state(&self) -> Option<&State> {
        self.follower.as_ref().map(Follower::state)
    }

    /// Returns the counts so far.
    pub(super) const fn stats(&self) -> PlayerStats {
        self.stats
    }

    /// Requires a keyframe next, as after a jump.
    fn lose_position(&mut self) {
        self.last = None;
        self.damaged = false;
        if let Some(follower) = &mut self.follower {
            follower.lose_position();
        }
    }

    fn record(&mut self, record: &Record<'_>) -> Option<PlayerEvent> {
        let payload = record.frame.payload();
        let event = match record.frame.header.kind {
            FrameType::SCENE => self.scene_message(payload).transpose()?,
            FrameType::KEYFRAME | FrameType::UPDATE => return Some(self.state_frame(record)),
            FrameType::REPORT => Report::from_payload(payload).map(PlayerEvent::Report).map_err(Into::into),
            FrameType::BUDGET => Budget::from_payload(payload).map(PlayerEvent::Budget).map_err(Into::into),
            FrameType::CLOSE => Close::from_payload(payload).map(PlayerEvent::Closed).map_err(Into::into),
            FrameType::EDIT => self.edit(payload),
            FrameType::GAP => self.gap(payload),
            // Handshakes, an index, and types of later versions have nothing to play.
            _ => return None,
        };
        Some(event.unwrap_or_else(|error| {
            self.stats.bad_messages += 1;
            PlayerEvent::BadMessage { offset: record.offset(), error }
        }))
    }

    fn scene_message(&mut self, payload: &[u8]) -> Result<Option<PlayerEvent>, PlayerError> {
        let scene = Scene::from_payload(payload)?;
        let Some(table) = self.assembler.push_or_restart(scene, &self.limits)? else { return Ok(None) };
        let table = Arc::new(table);
        self.follower = Some(Follower::new(table.layout()));
        self.scene = Some(table.clone());
        self.edits = EditsInForce::default();
        self.current = None;
        Ok(Some(PlayerEvent::Scene(table)))
    }

    fn edit(&mut self, payload: &[u8]) -> Result<PlayerEvent, PlayerError> {
        let edit = Edit::from_payload(payload)?;
        let instances = self.scene.as_ref().map_or(0, |scene| scene.layout().instances());
        if edit.instance as usize >= instances {
            return Err(PlayerError::NoInstance { instance: edit.instance, instances });
        }
        self.edits.apply(&edit);
        Ok(PlayerEvent::Edit(edit))
    }

    fn gap(&mut self, payload: &[u8]) -> Result<PlayerEvent, PlayerError> {
        let gap = Gap::from_payload(payload)?;
        self.stats.gaps += 1;
        self.stats.gap_frames += u64::from(gap.frames);
        Ok(PlayerEvent::Gap(gap))
    }

    fn state_frame(&mut self, record: &Record<'_>) -> PlayerEvent {
        let (header, body) = (record.frame.header, record.frame.payload());
        let body = FrameBody::parse(body, &self.limits.codec);
        let number = body.as_ref().ok().map(|body| body.info().frame);
        if let Some(frame) = number {
            self.count_lost(header, frame);
        }
        let result = match &mut self.follower {
            Some(follower) => follower.follow(header, body, &self.limits),
            None => Err(FollowError::NoScene),
        };
        let offset = record.offset();
        match result {
            Ok(info) => {
                self.stats.applied += 1;
                let &FrameInfo { frame, time, changed_points, .. } = &info;
                self.current = Some(FrameMeta { kind: FrameKind::Key, frame, time, changed_points });
                PlayerEvent::Frame(PlayedFrame {
                    info,
                    header,
                    arrival: record.arrival,
                    offset,
                    wire_bytes: record.wire_bytes(),
                    record_bytes: record.record_bytes(),
                })
            }
            Err(reason) => {
                self.stats.unusable += 1;
                PlayerEvent::Unusable { offset, header, frame: number, reason }
            }
        }
    }

    /// Counts the frames missing before this one, if the sequence numbers or damage show a gap. A stream may skip frame
    /// numbers itself, for example for a client that fell behind. Such frames are not lost.
    fn count_lost(&mut self, header: FrameHeader, frame: FrameIndex) {
        let FrameHeader { group, sequence, .. } = header;
        if let Some((last_group, last_sequence, last_frame)) = self.last {
            let follows = if header.kind == FrameType::KEYFRAME {
                sequence == Sequence(0)
            } else {
                (group, sequence) == (last_group, last_sequence.next())
            };
            if self.damaged || !follows {
                self.stats.lost += u64::from(frame.0.saturating_sub(last_frame.0).saturating_sub(1));
            }
        } else if self.damaged {
            // Earlier groups are unknown; within this group the sequence number is the count.
            self.stats.lost += u64::from(sequence.0);
        }
        self.last = Some((group, sequence, frame));
        self.damaged = false;
    }
}
