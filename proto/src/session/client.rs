//! The client's end of a session.

mod datagrams;

use std::sync::Arc;

use psao_codec::envelope::{FrameBody, FrameError};
use psao_codec::{State, setters};

use super::clock::Clock;
use super::datagram::Reassembler;
use super::outbox::{DropPolicy, Outbox};
use super::timers::{Due, Timers};
use super::{
    AppliedFrame, ClientEvent, ClientStats, ClockEstimate, MIN_DATAGRAM_BYTES, NEWEST_VERSION,
    OLDEST_VERSION, PEER_NAME, SendError, SessionError, close_message, read,
};
use crate::follow::{FollowError, Follower};
use crate::message::{
    Accept, Ack, Auth, CameraPose, Close, CloseCode, CoderSet, Edit, Hello, KeyframeReason, Message, Ping,
    Pong, ProfileSet, Reject, Request, Scene, Stamp, Text, Token, View,
};
use crate::scene::SceneAssembler;
use crate::{
    CoderId, FrameIndex, FrameType, Framer, Group, Limits, Micros, Profile, SceneError, SceneTable, Sequence,
    StateHash, WireFrame, write_frame,
};

/// Profiles that this crate's codec can decode.
const PROFILES: ProfileSet = ProfileSet(0).with(Profile::PAPER).with(Profile::SURFACE);
/// Block coders that this crate's codec can decode.
const CODERS: CoderSet =
    CoderSet(0).with(CoderId::STORED).with(CoderId::LZ4).with(CoderId::ZSTD).with(CoderId::RANGE);

/// Options of a client session.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ClientOptions {
    /// Name of the client, cut to 64 bytes. By default this crate's name and version.
    pub name: Option<String>,
    /// The token that the server requires, if any.
    pub token: Option<Token>,
    /// Digest of the client's scene. A stream of another scene is refused.
    pub scene: Option<[u8; 32]>,
    /// Whether to request a STAMP before every frame.
    pub stamps: bool,
    /// Largest datagram in bytes, to request updates as datagrams. The transport of the session must carry datagrams.
    pub datagrams: Option<u16>,
}

impl ClientOptions {
    setters! {
        with_name: name as Option<String>,
        with_token: token as Option<Token>,
        with_scene: scene as Option<[u8; 32]>,
        with_stamps: stamps as bool,
        with_datagrams: datagrams as Option<u16>,
    }
}

#[derive(Debug)]
enum Phase {
    /// HELLO is sent.
    Greeting,
    /// ACCEPT was received; the scene table is incomplete.
    Loading(Profile, SceneAssembler),
    /// The scene table is complete.
    Running(Box<Follower>),
    /// A CLOSE was sent or received. The state stays.
    Closed(Option<Box<Follower>>),
}

/// A client session: handshake, scene table, and a state that follows the server's.
///
/// Pass received bytes to [`push`](Self::push), and take events until there are none. Send the bytes of
/// [`take_output`](Self::take_output), and call [`tick`](Self::tick) at the time of [`next_deadline`](Self::next_deadline).
#[derive(Debug)]
pub struct ClientSession {
    limits: Limits,
    framer: Framer,
    outbox: Outbox,
    phase: Phase,
    timers: Timers,
    clock: Clock,
    options: ClientOptions,
    failed: Option<SessionError>,
    /// The STAMP of the next frame.
    stamp: Option<Stamp>,
    reassembler: Reassembler,
    datagrams: Vec<Vec<u8>>,
    /// Whether a keyframe was requested and did not arrive yet.
    keyframe_requested: bool,
    stats: ClientStats,
}

impl ClientSession {
    /// Creates the session of a client that has just connected. Its HELLO waits in the output.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self::with(limits, ClientOptions::default())
    }

    /// Creates a session with options.
    #[must_use]
    pub fn with(limits: Limits, options: ClientOptions) -> Self {
        let hello = Hello {
            oldest: OLDEST_VERSION,
            newest: NEWEST_VERSION,
            profiles: PROFILES,
            coders: CODERS,
            limits: (&limits).into(),
            name: Text::cut(options.name.as_deref().unwrap_or(PEER_NAME)),
        };
        let auth = options.token.clone().map(|token| Auth { token });
        let mut session = Self {
            limits,
            framer: Framer::new(limits),
            outbox: Outbox::default(),
            phase: Phase::Greeting,
            timers: Timers::default(),
            clock: Clock::default(),
            options,
            failed: None,
            stamp: None,
            reassembler: Reassembler::default(),
            datagrams: Vec::new(),
            keyframe_requested: false,
            stats: ClientStats::default(),
        };
        if let Some(auth) = auth {
            session.queue(&auth);
        }
        session.queue(&hello);
        session
    }

    /// Takes bytes from the server, in any chunking, at the time `now`. [`next_event`](Self::next_event) processes them. Take
    /// all events before the next call: the session then holds at most one unfinished frame. Bytes after the end of the
    /// session are ignored.
    ///
    /// # Errors
    /// [`SessionError`] when the stream cannot go on. Later calls return the same error; the state stays.
    pub fn push(&mut self, bytes: &[u8], now: Micros) -> Result<(), SessionError> {
        self.tick(now)?;
        if self.is_closed() {
            return Ok(());
        }
        if !bytes.is_empty() {
            self.timers.note_received();
        }
        self.stats.wire_bytes += bytes.len() as u64;
        self.framer.push(bytes);
        Ok(())
    }

    /// Processes frames up to the next event, and returns it; `None` when more bytes are needed, or the session is closed.
    /// Until the next call, [`state`](Self::state) is that after the event's frame.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn next_event(&mut self) -> Result<Option<ClientEvent>, SessionError> {
        self.next_event_with(&mut |_| {})
    }

    /// Does the same as [`next_event`](Self::next_event), and passes every whole frame to `tap` before it is processed, for
    /// example to a recorder.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn next_event_with(
        &mut self,
        tap: &mut dyn FnMut(&WireFrame<'_>),
    ) -> Result<Option<ClientEvent>, SessionError> {
        // Bytes behind a CLOSE are ignored, valid or not.
        while !self.is_closed() {
            let mut event = None;
            let one = Framer::take_one(
                self,
                |session| &mut session.framer,
                |session, frame| {
                    tap(frame);
                    event = session.frame(frame)?;
                    Ok(())
                },
            );
            match one {
                Ok(true) if event.is_none() => {}
                Ok(_) => return Ok(event),
                Err(error) => return Err(self.fail(error)),
            }
        }
        self.failed.clone().map_or(Ok(None), Err)
    }

    /// Takes bytes and returns all events that they bring. The state is then that of the last event.
    ///
    /// # Errors
    /// As [`push`](Self::push); the events before the error are lost.
    pub fn handle(&mut self, bytes: &[u8], now: Micros) -> Result<Vec<ClientEvent>, SessionError> {
        self.push(bytes, now)?;
        std::iter::from_fn(|| self.next_event().transpose()).collect()
    }

    /// Processes deadlines: ends a handshake that takes too long, sends keep-alives, and gives up a silent server. The
    /// first call starts the time of the handshake.
    ///
    /// # Errors
    /// [`SessionError::HandshakeTimeout`], [`SessionError::Silent`], or the error that ended the session before.
    pub fn tick(&mut self, now: Micros) -> Result<(), SessionError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        self.timers.set_now(now);
        let due = match &self.phase {
            Phase::Greeting | Phase::Loading(..) => {
                self.timers.handshake(&self.limits).map(|()| Due::Nothing)
            }
            Phase::Running(_) => self.timers.open(&self.limits, !self.outbox.is_empty(), false),
            Phase::Closed(_) => Ok(Due::Nothing),
        };
        match due {
            Ok(Due::Ping) => self.queue(&Ping { sent: self.timers.now() }),
            Ok(Due::Nothing) => {}
            Err(error) => return Err(self.fail(error)),
        }
        Ok(())
    }

    /// Returns the time of the next deadline for [`tick`](Self::tick); `None` before the first call with a time, and
    /// after the end.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Micros> {
        match &self.phase {
            Phase::Greeting | Phase::Loading(..) => self.timers.next_in_handshake(&self.limits),
            Phase::Running(_) => self.timers.next_when_open(&self.limits, !self.outbox.is_empty(), false),
            Phase::Closed(_) => None,
        }
    }

    /// Returns the estimate of the server's clock; `None` before the first PONG.
    #[must_use]
    pub fn clock(&self) -> Option<ClockEstimate> {
        self.clock.estimate()
    }

    /// Returns the next bytes to send; empty when none wait.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        self.outbox.front()
    }

    /// Marks the first `count` bytes of [`output`](Self::output) as sent.
    pub fn advance(&mut self, count: usize) {
        self.outbox.advance(count);
    }

    /// Returns all bytes that wait to be sent, and marks them as sent.
    #[must_use]
    pub fn take_output(&mut self) -> Vec<u8> {
        self.outbox.take()
    }

    /// Sends the client's camera to the server.
    ///
    /// # Errors
    /// [`SendError::Message`] for an invalid camera, [`SendError::NotOpen`] before ACCEPT or after CLOSE.
    pub fn set_view(&mut self, camera: &CameraPose) -> Result<(), SendError> {
        self.send(&View { camera: *camera })
    }

    /// Asks the server to edit the scene. A server may ignore the edit.
    ///
    /// # Errors
    /// As [`set_view`](Self::set_view).
    pub fn edit(&mut self, edit: &Edit) -> Result<(), SendError> {
        self.send(edit)
    }

    /// Requests a keyframe, unless one was requested already.
    pub fn request_keyframe(&mut self, reason: KeyframeReason) {
        if self.keyframe_requested || self.send(&Request::Keyframe { reason }).is_err() {
            return;
        }
        self.keyframe_requested = true;
        self.stats.requests += 1;
    }

    /// Ends the session with a CLOSE. The state stays.
    pub fn close(&mut self, code: CloseCode, text: &str) {
        if matches!(self.phase, Phase::Closed(_)) || self.failed.is_some() {
            return;
        }
        self.queue(&Close::new(code, text));
        self.enter_closed();
    }

    /// Returns the state after the last frame applied, also after an error or CLOSE; `None` before the scene table.
    #[must_use]
    pub fn state(&self) -> Option<&State> {
        self.follower().map(Follower::state)
    }

    /// Returns whether the state is that of the newest frame received.
    #[must_use]
    pub fn is_current(&self) -> bool {
        self.follower().is_some_and(Follower::is_current)
    }

    /// Returns whether a CLOSE was sent or received.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        matches!(self.phase, Phase::Closed(_))
    }

    /// Returns the number of bytes received of an incomplete frame.
    #[must_use]
    pub fn unfinished_bytes(&self) -> usize {
        self.framer.pending()
    }

    /// Returns the counts so far.
    #[must_use]
    pub const fn stats(&self) -> ClientStats {
        self.stats
    }

    fn follower(&self) -> Option<&Follower> {
        match &self.phase {
            Phase::Running(follower) | Phase::Closed(Some(follower)) => Some(follower),
            _ => None,
        }
    }

    fn send<M: Message>(&mut self, message: &M) -> Result<(), SendError> {
        if self.failed.is_some() || matches!(self.phase, Phase::Greeting | Phase::Closed(_)) {
            return Err(SendError::NotOpen);
        }
        message.to_payload()?;
        self.queue(message);
        Ok(())
    }

    /// Queues a message that is known to be valid. All frames of a client have group 0 and sequence 0.
    fn queue<M: Message>(&mut self, message: &M) {
        let mut out = Vec::new();
        if let Ok(payload) = message.to_payload()
            && write_frame(&mut out, M::KIND, Group(0), Sequence(0), &payload).is_ok()
        {
            self.outbox.push(out, None, DropPolicy::Keep);
        }
    }

    /// Queues an acknowledgement. It replaces one that still waits.
    fn acknowledge(&mut self, ack: &Ack) {
        self.outbox.drop_stale(false);
        let mut out = Vec::new();
        if let Ok(payload) = ack.to_payload()
            && write_frame(&mut out, FrameType::ACK, Group(0), Sequence(0), &payload).is_ok()
        {
            self.outbox.push(out, None, DropPolicy::Droppable);
        }
    }

    fn fail(&mut self, error: SessionError) -> SessionError {
        if let Some(close) = close_message(&error) {
            self.queue(&close);
        }
        self.failed = Some(error.clone());
        self.enter_closed();
        error
    }

    fn enter_closed(&mut self) {
        self.phase = match std::mem::replace(&mut self.phase, Phase::Closed(None)) {
            Phase::Running(follower) => Phase::Closed(Some(follower)),
            Phase::Closed(follower) => Phase::Closed(follower),
            Phase::Greeting | Phase::Loading(..) => Phase::Closed(None),
        };
    }

    /// Processes a frame. Returns its event, if it has one.
    fn frame(&mut self, frame: &WireFrame<'_>) -> Result<Option<ClientEvent>, SessionError> {
        let (kind, payload) = (frame.header.kind, frame.payload());
        match (kind, &mut self.phase) {
            (FrameType::ACCEPT, Phase::Greeting) => return self.accept(read(payload)?).map(Some),
            (FrameType::REJECT, Phase::Greeting) => {
                return Err(SessionError::Rejected(read::<Reject>(payload)?));
            }
            (FrameType::SCENE, Phase::Loading(profile, assembler)) => {
                let accepted = *profile;
                let scene: Scene = read(payload)?;
                if let Some(table) = assembler.push(scene, &self.limits)? {
                    return self.scene_ready(table, accepted).map(Some);
                }
            }
            (FrameType::KEYFRAME | FrameType::UPDATE, Phase::Running(_)) => {
                return Ok(self.state_frame(frame));
            }
            (FrameType::REPORT, Phase::Running(_)) => return Ok(Some(ClientEvent::Report(read(payload)?))),
            (FrameType::BUDGET, Phase::Running(_)) => return Ok(Some(ClientEvent::Budget(read(payload)?))),
            (FrameType::EDIT, Phase::Running(_)) => return Ok(Some(ClientEvent::Edited(read(payload)?))),
            (FrameType::STAMP, Phase::Running(_)) => self.stamp = Some(read(payload)?),
            (FrameType::PING, Phase::Loading(..) | Phase::Running(_)) => {
                let Ping { sent } = read(payload)?;
                let now = self.timers.now();
                self.queue(&Pong { sent, received: now, replied: now });
            }
            (FrameType::PONG, Phase::Loading(..) | Phase::Running(_)) => {
                self.clock.take(&read(payload)?, self.timers.now());
            }
            (FrameType::CLOSE, _) => {
                let close = read(payload)?;
                self.enter_closed();
                return Ok(Some(ClientEvent::Closed(close)));
            }
            (kind, phase) if kind.name().is_some() => {
                return Err(SessionError::Unexpected { kind, state: describe(phase) });
            }
            // Frames of unknown types are skipped.
            _ => self.stats.unknown += 1,
        }
        Ok(None)
    }

    fn accept(&mut self, accept: Accept) -> Result<ClientEvent, SessionError> {
        let version = accept.version;
        if !(OLDEST_VERSION..=NEWEST_VERSION).contains(&version) {
            return Err(SessionError::Version { peer: "server", oldest: version, newest: version });
        }
        if !PROFILES.has(accept.profile) {
            return Err(SessionError::NotOffered { what: "a profile" });
        }
        self.phase = Phase::Loading(accept.profile, SceneAssembler::default());
        self.queue(&Ping { sent: self.timers.now() });
        if self.options.stamps {
            self.queue(&Request::Stamps);
        }
        if let Some(bytes) = self.options.datagrams {
            self.queue(&Request::Datagrams { bytes: bytes.max(MIN_DATAGRAM_BYTES) });
        }
        Ok(ClientEvent::Accepted(accept))
    }

    fn scene_ready(&mut self, table: SceneTable, accepted: Profile) -> Result<ClientEvent, SessionError> {
        let found = table.profile();
        if found != accepted {
            return Err(SceneError::Profile { found }.into());
        }
        if !CODERS.has(table.info().coder) {
            return Err(SessionError::NotOffered { what: "a block coder" });
        }
        // Zeros stand for no digest.
        let found = table.info().digest;
        let differs = |expected: &[u8; 32]| *expected != found && found != [0; 32];
        if let Some(expected) = self.options.scene.filter(differs) {
            let name = table.info().name.to_string();
            return Err(SessionError::OtherScene { name, expected, found });
        }
        self.phase = Phase::Running(Box::new(Follower::new(table.layout())));
        Ok(ClientEvent::SceneReady(Arc::new(table)))
    }

    fn state_frame(&mut self, frame: &WireFrame<'_>) -> Option<ClientEvent> {
        let Phase::Running(follower) = &mut self.phase else { return None };
        let header = frame.header;
        if header.kind == FrameType::KEYFRAME {
            self.keyframe_requested = false;
        }
        // The body is parsed and its checksum computed only here.
        let body = FrameBody::parse(frame.payload(), &self.limits.codec);
        let superseded = |body: &FrameBody<'_>| follower.skip_superseded(header, body);
        if self.options.datagrams.is_some() && body.as_ref().is_ok_and(superseded) {
            self.stats.late_datagram_frames += 1;
            return None;
        }
        let number = body.as_ref().map_or_else(|_| FrameIndex::default(), |body| body.info().frame);
        let reason = match follower.follow(header, body, &self.limits) {
            Ok(info) => {
                self.stats.applied += 1;
                self.acknowledge(&Ack { frame: info.frame, hash: info.hash });
                let (group, sequence, wire_bytes) = (header.group, header.sequence, header.wire_bytes());
                let stamp = self.stamp.take().filter(|stamp| stamp.frame == info.frame);
                let received = self.timers.now();
                let frame = AppliedFrame { info, group, sequence, wire_bytes, received, stamp };
                return Some(ClientEvent::Applied(frame));
            }
            Err(reason) => reason,
        };
        if let FollowError::Body(FrameError::Hash { stored, computed, .. }) = reason {
            return Some(self.mismatch(number, stored, computed));
        }
        self.stats.unusable += 1;
        self.request_keyframe(match &reason {
            FollowError::Gap { .. } | FollowError::Waiting | FollowError::NoScene => KeyframeReason::GAP,
            FollowError::Body(_) | FollowError::Kind { .. } => KeyframeReason::BODY,
        });
        Some(ClientEvent::Unusable { header, reason })
    }

    /// Reports a frame whose state hash differs from the server's.
    fn mismatch(&mut self, frame: FrameIndex, expected: StateHash, found: StateHash) -> ClientEvent {
        self.stats.unusable += 1;
        self.stats.hash_mismatches += 1;
        self.request_keyframe(KeyframeReason::HASH);
        ClientEvent::HashMismatch { frame, expected, found }
    }
}

const fn describe(phase: &Phase) -> &'static str {
    match phase {
        Phase::Greeting => "waiting for the server to accept",
        Phase::Loading(..) => "waiting for the scene",
        Phase::Running(_) => "following the stream",
        Phase::Closed(_) => "closed",
    }
}
