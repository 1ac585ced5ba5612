//! Playing a recording: records in, states out, and past whatever is damaged.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameBody, FrameInfo, FrameKind, FrameMeta};
use psao_codec::{State, keyframe};

use super::{Damage, EditsInForce, IndexEntry, RECORD_HEAD_BYTES, Reader, ReaderError, Record, Summary};
use crate::follow::{FollowError, Follower};
use crate::message::{Budget, Close, Edit, Gap, Message, MessageError, Report, Scene};
use crate::scene::SceneAssembler;
use crate::{
    FrameHeader, FrameIndex, FrameType, Group, HEADER_BYTES, Limits, Micros, SceneError, SceneTable, Sequence,
};

/// A keyframe or update that was applied: the hash of the state is the one in its header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlayedFrame {
    /// Header of its body: frame number, time, hash, sections.
    pub info: FrameInfo,
    /// Header of its wire frame: type, group, sequence.
    pub header: FrameHeader,
    /// When it arrived at the recorder.
    pub arrival: Micros,
    /// Bytes from the start of the file to its record.
    pub offset: u64,
    /// Bytes that it took on the wire.
    pub wire_bytes: u64,
    /// Bytes that its record takes in the file.
    pub record_bytes: u64,
}

impl PlayedFrame {
    /// The frame body, to be sent on as it was recorded: a part of `file`, the bytes that the player was given. Empty
    /// when `file` is another one and too short.
    #[must_use]
    pub fn body<'a>(&self, file: &'a [u8]) -> &'a [u8] {
        let start = usize::try_from(self.offset).unwrap_or(usize::MAX);
        let start = start.saturating_add(RECORD_HEAD_BYTES + HEADER_BYTES);
        let end = start.saturating_add(self.header.length as usize);
        file.get(start..end).unwrap_or_default()
    }
}

/// What a player met.
#[derive(Clone, Debug, PartialEq)]
pub enum PlayerEvent {
    /// The scene table is whole.
    Scene(Arc<SceneTable>),
    /// The state is that of a newer frame.
    Frame(PlayedFrame),
    /// A keyframe or update that could not be applied. The state is as before until the next keyframe.
    Unusable {
        /// Bytes from the start of the file to its record.
        offset: u64,
        /// Header of its wire frame.
        header: FrameHeader,
        /// Number of the frame, when its body says so.
        frame: Option<FrameIndex>,
        /// Why.
        reason: FollowError,
    },
    /// A whole frame whose message is bad, which damage does not do: a faulty program wrote it.
    BadMessage {
        /// Bytes from the start of the file to its record.
        offset: u64,
        /// Why.
        error: PlayerError,
    },
    /// What a frame cost the server.
    Report(Report),
    /// What a frame left for later.
    Budget(Budget),
    /// The scene was changed: every later frame is of the scene as this leaves it.
    Edit(Edit),
    /// Frames that the recorder did not write.
    Gap(Gap),
    /// The stream ended here.
    Closed(Close),
    /// A stretch of the file that could not be read.
    Damage(Damage),
}

/// Why a message of a recording is bad.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlayerError {
    /// In itself.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// After those before it.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// It changes an instance that the scene does not have.
    #[error("EDIT of instance {instance}: the scene has {instances} instances")]
    NoInstance {
        /// The instance.
        instance: u32,
        /// Instances of the scene; 0 before the scene table.
        instances: usize,
    },
}

/// What the player read, and what it made of it.
#[derive(Debug)]
pub(super) struct Step<'a> {
    /// The record; `None` for a damaged stretch.
    pub(super) record: Option<Record<'a>>,
    /// What it means; `None` for what a player has no use for.
    pub(super) event: Option<PlayerEvent>,
}

/// Counts of a player.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlayerStats {
    /// Keyframes and updates applied.
    pub applied: u64,
    /// Keyframes and updates that are in the file but could not be applied.
    pub unusable: u64,
    /// Keyframes and updates that are missing from the file, as far as the frames around them tell. Those missing at
    /// its end are not known.
    pub lost: u64,
    /// Damaged stretches.
    pub damages: u64,
    /// Bytes in them.
    pub damaged_bytes: u64,
    /// Whole frames whose message is bad.
    pub bad_messages: u64,
    /// Places where the recorder says that it wrote nothing.
    pub gaps: u64,
    /// Keyframes and updates that are missing there, as far as it knew.
    pub gap_frames: u64,
}

impl PlayerStats {
    /// Whether everything that was recorded was there and could be used. What a recorder says it did not record is no
    /// damage; `gaps` counts it.
    #[must_use]
    pub const fn is_clean(&self) -> bool {
        self.unusable == 0 && self.lost == 0 && self.damages == 0 && self.bad_messages == 0
    }
}

impl Step<'_> {
    /// Bytes from the start of the file to the record or the damage.
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

/// What playing records has led to so far.
#[derive(Debug)]
pub(super) struct Playback {
    limits: Limits,
    assembler: SceneAssembler,
    scene: Option<Arc<SceneTable>>,
    follower: Option<Follower>,
    edits: EditsInForce,
    /// Header of the last frame applied of this scene.
    current: Option<FrameMeta>,
    /// The last keyframe or update whose body said its number, applied or not.
    last: Option<(Group, Sequence, FrameIndex)>,
    /// Whether something was damaged since.
    damaged: bool,
    stats: PlayerStats,
}

impl<'a> Player<'a> {
    /// A player at the start of a whole file.
    ///
    /// # Errors
    /// [`ReaderError`] when the bytes are not a recording that this version reads.
    pub fn new(bytes: &'a [u8], limits: Limits) -> Result<Self, ReaderError> {
        Ok(Self { reader: Reader::with_limits(bytes, limits)?, playback: Playback::new(limits) })
    }

    /// Goes on to whatever comes next; `None` at the end of the file.
    pub fn next_event(&mut self) -> Option<PlayerEvent> {
        loop {
            if let Some(event) = self.next_step()?.event {
                return Some(event);
            }
        }
    }

    /// As [`next_event`](Self::next_event), record by record.
    pub(super) fn next_step(&mut self) -> Option<Step<'a>> {
        self.playback.step(&mut self.reader)
    }

    /// Goes to the last keyframe that is not behind entry `entry` of the summary's index, with the scene and the edits
    /// that hold there, and without playing what lies before. The frames up to `entry` come next. Without such a
    /// keyframe it goes to the start of the file.
    ///
    /// The summary must be that of this file.
    pub fn jump(&mut self, summary: &Summary, entry: usize) {
        let before = summary.index().get(..=entry).unwrap_or(summary.index());
        let Some(key) = before.iter().rfind(|entry| entry.keyframe) else {
            self.reader.rewind();
            return;
        };
        for offset in summary.prerequisites_of(key.offset) {
            self.reader.seek(offset);
            // What is bad in it shows when the keyframe cannot be applied.
            if let Some(Ok(record)) = self.reader.next() {
                let _ = self.playback.record(&record);
            }
        }
        self.seek(key);
    }

    /// Goes to a keyframe of an index; the next frame applied is that one. The scene must have been played before, or
    /// the keyframe will be [`FollowError::NoScene`]; [`jump`](Self::jump) sees to that.
    pub fn seek(&mut self, keyframe: &IndexEntry) {
        self.reader.seek(keyframe.offset);
        self.playback.lose_position();
    }

    /// The state after the last frame applied; `None` before the scene.
    #[must_use]
    pub fn state(&self) -> Option<&State> {
        self.playback.state()
    }

    /// The scene table, once it was played.
    #[must_use]
    pub const fn scene(&self) -> Option<&Arc<SceneTable>> {
        self.playback.scene.as_ref()
    }

    /// Number of the last frame applied of this scene.
    pub(super) fn last_applied(&self) -> Option<FrameIndex> {
        self.playback.current.map(|meta| meta.frame)
    }

    /// The edits that hold for the next frame.
    #[must_use]
    pub const fn edits(&self) -> &EditsInForce {
        &self.playback.edits
    }

    /// A keyframe body of the state after the last frame applied, by the stream's own coder: what a client needs that
    /// joins here. Number, time and statistics are that frame's. `None` before the first frame of a scene.
    ///
    /// # Errors
    /// [`EncodeError`], from the coder.
    pub fn keyframe(&self) -> Option<Result<Vec<u8>, EncodeError>> {
        let (state, meta) = (self.state()?, self.playback.current?);
        let coder = BlockCoder::of(self.scene()?.info().coder);
        Some(keyframe(state, meta, coder, &[]))
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> PlayerStats {
        self.playback.stats
    }
}

impl Playback {
    /// Starts with nothing played.
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

    /// Plays the next record of a reader; `None` at the end of its file.
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

    /// Returns the state after the last frame applied; `None` before the scene.
    pub(super) fn state(&self) -> Option<&State> {
        self.follower.as_ref().map(Follower::state)
    }

    /// Returns counts so far.
    pub(super) const fn stats(&self) -> PlayerStats {
        self.stats
    }

    /// Waits for a keyframe, as after a jump.
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
            // Handshakes, an index, and types of later versions: nothing to play.
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

    /// Counts the frames missing before this one, where the numbering or damage says that some are. A stream may skip
    /// frame numbers by itself, as for a client that fell behind; those are not lost.
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
            // How many groups came before is unknown; in this one, its place tells.
            self.stats.lost += u64::from(sequence.0);
        }
        self.last = Some((group, sequence, frame));
        self.damaged = false;
    }
}
