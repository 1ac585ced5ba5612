//! The client's end.

mod datagrams;

use std::sync::Arc;

use psao_codec::State;
use psao_codec::envelope::{FrameBody, FrameError, FrameInfo};

use super::clock::Clock;
use super::datagram::Reassembler;
use super::outbox::{DropPolicy, Outbox};
use super::timers::{Due, Timers};
use super::{
    ClockEstimate, MIN_DATAGRAM_BYTES, NEWEST_VERSION, OLDEST_VERSION, PEER_NAME, SendError, SessionError,
    close_message, read,
};
use crate::follow::{FollowError, Follower};
use crate::message::{
    Accept, Ack, Auth, Budget, CameraPose, Close, CloseCode, CoderSet, Edit, Hello, KeyframeReason, Message,
    Ping, Pong, ProfileSet, Reject, Report, Request, Scene, Stamp, Text, Token, View,
};
use crate::scene::SceneAssembler;
use crate::{
    CoderId, FrameHeader, FrameIndex, FrameType, Framer, Group, Limits, Micros, Profile, SceneError,
    SceneTable, Sequence, StateHash, WireFrame, write_frame,
};

/// Profiles that this crate's codec applies.
const PROFILES: ProfileSet = ProfileSet(0).with(Profile::PAPER).with(Profile::SURFACE);
/// Block coders that this crate's codec undoes.
const CODERS: CoderSet =
    CoderSet(0).with(CoderId::STORED).with(CoderId::LZ4).with(CoderId::ZSTD).with(CoderId::RANGE);

/// A frame that the client applied.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AppliedFrame {
    /// Header of its body: frame number, time, hash, sections.
    pub info: FrameInfo,
    /// Its group.
    pub group: Group,
    /// Its place in the group.
    pub sequence: Sequence,
    /// Bytes that it took on the wire, the headers of frames or datagrams included.
    pub wire_bytes: u64,
    /// When its last byte was given to the session.
    pub received: Micros,
    /// When it was made and sent, by the server's clock ([`ClientSession::clock`]), for a client that asked.
    pub stamp: Option<Stamp>,
}

/// Options of a client when it connects.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ClientOptions {
    /// What it calls itself (cut to 64 bytes); this crate's name and version by default.
    pub name: Option<String>,
    /// The token that the server wants, if it wants one.
    pub token: Option<Token>,
    /// Digest of the scene that it draws: a stream of another scene is refused.
    pub scene: Option<[u8; 32]>,
    /// Ask for a STAMP before every frame.
    pub stamps: bool,
    /// Largest datagram in bytes, to ask for updates as datagrams; what carries the session must carry them.
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

/// What happened at a client.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The server takes this client; the scene follows.
    Accepted(Accept),
    /// The scene table is whole; a keyframe follows.
    SceneReady(Arc<SceneTable>),
    /// The state is that of a newer frame.
    Applied(AppliedFrame),
    /// The state after an update would not have been the server's. The update was not applied and a keyframe was asked
    /// for.
    HashMismatch {
        /// The frame.
        frame: FrameIndex,
        /// The server's hash after it.
        expected: StateHash,
        /// The hash that the client would have had.
        found: StateHash,
    },
    /// A keyframe or update could not be used for another reason. The state is as before; a keyframe was asked for.
    Unusable {
        /// Header of its wire frame.
        header: FrameHeader,
        /// Why.
        reason: FollowError,
    },
    /// What a frame cost the server.
    Report(Report),
    /// What a frame had to leave for later.
    Budget(Budget),
    /// This edit of the scene is part of every frame from here on.
    Edited(Edit),
    /// The server ended the stream. Nothing follows.
    Closed(Close),
}

/// Counts of a client session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClientStats {
    /// Bytes that came in.
    pub wire_bytes: u64,
    /// Keyframes and updates applied.
    pub applied: u64,
    /// Keyframes and updates that were not.
    pub unusable: u64,
    /// Of those, how many because of a hash that differs.
    pub hash_mismatches: u64,
    /// Keyframes asked for.
    pub requests: u64,
    /// Frames of a type that this version does not know.
    pub unknown: u64,
    /// Datagrams that came.
    pub datagrams: u64,
    /// Those that were none of this protocol.
    pub bad_datagrams: u64,
    /// Bodies in datagrams that came too late, or build on a frame that is not here; updates on the connection that
    /// datagrams made superfluous.
    pub late_datagram_frames: u64,
}

#[derive(Debug)]
enum Phase {
    /// HELLO is out.
    Greeting,
    /// ACCEPT came; the scene table is coming.
    Loading(Profile, SceneAssembler),
    /// The scene table is whole.
    Running(Box<Follower>),
    /// A CLOSE went or came. What was received stays.
    Closed(Option<Box<Follower>>),
}

/// A client: from the first byte to a state that follows the server's.
///
/// Give it what comes from the server with [`handle`](Self::handle), send what [`take_output`](Self::take_output)
/// gives, and call [`tick`](Self::tick) at the time that [`next_deadline`](Self::next_deadline) says.
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
    /// The STAMP of the frame that follows.
    stamp: Option<Stamp>,
    reassembler: Reassembler,
    datagrams: Vec<Vec<u8>>,
    /// A keyframe was asked for and did not come yet.
    keyframe_requested: bool,
    stats: ClientStats,
}

impl ClientSession {
    /// A client that has just connected. Its HELLO waits in the output.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self::with(limits, ClientOptions::default())
    }

    /// A client with options.
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

    /// Takes bytes from the server, in any chunking, at the time `now`.
    ///
    /// # Errors
    /// [`SessionError`] when the stream cannot go on; the same error comes again after that. Events before the error
    /// are lost with it, the state is not.
    pub fn handle(&mut self, bytes: &[u8], now: Micros) -> Result<Vec<ClientEvent>, SessionError> {
        self.handle_with(bytes, now, &mut |_| {})
    }

    /// As [`handle`](Self::handle), and shows every whole frame to `tap` before it is used: a recorder at the client
    /// writes these.
    ///
    /// # Errors
    /// As [`handle`](Self::handle).
    pub fn handle_with(
        &mut self,
        bytes: &[u8],
        now: Micros,
        tap: &mut dyn FnMut(&WireFrame<'_>),
    ) -> Result<Vec<ClientEvent>, SessionError> {
        self.tick(now)?;
        if !bytes.is_empty() {
            self.timers.note_received();
        }
        self.stats.wire_bytes += bytes.len() as u64;
        let mut events = Vec::new();
        let result = Framer::drain(
            self,
            |session| &mut session.framer,
            bytes,
            |session, frame| {
                if session.is_closed() {
                    return Ok(());
                }
                tap(frame);
                session.frame(frame, &mut events)
            },
        );
        match result {
            // What a peer sends behind its CLOSE is of no interest, broken or not.
            Err(_) if matches!(self.phase, Phase::Closed(_)) => Ok(events),
            Err(error) => Err(self.fail(error)),
            Ok(()) => Ok(events),
        }
    }

    /// Does what the time asks for: ends a handshake that takes too long, sends keep-alives, gives up a server that is
    /// silent. The first call starts the handshake's time.
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

    /// The next time at which [`tick`](Self::tick) has something to do; `None` before the first time it was told, and
    /// after the end.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Micros> {
        match &self.phase {
            Phase::Greeting | Phase::Loading(..) => self.timers.next_in_handshake(&self.limits),
            Phase::Running(_) => self.timers.next_when_open(&self.limits, !self.outbox.is_empty(), false),
            Phase::Closed(_) => None,
        }
    }

    /// What the server's clock says, once it has answered a PING.
    #[must_use]
    pub fn clock(&self) -> Option<ClockEstimate> {
        self.clock.estimate()
    }

    /// The next bytes to send to the server; empty when nothing waits.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        self.outbox.front()
    }

    /// Marks the first `count` bytes of [`output`](Self::output) as sent.
    pub fn advance(&mut self, count: usize) {
        self.outbox.advance(count);
    }

    /// All bytes that wait to be sent, marked as sent.
    #[must_use]
    pub fn take_output(&mut self) -> Vec<u8> {
        self.outbox.take()
    }

    /// Tells the server where the client looks from.
    ///
    /// # Errors
    /// [`SendError::Message`] for a camera that makes no picture, [`SendError::NotOpen`] before ACCEPT or after CLOSE.
    pub fn set_view(&mut self, camera: &CameraPose) -> Result<(), SendError> {
        self.send(&View { camera: *camera })
    }

    /// Asks the server to change the scene. A server may ignore it.
    ///
    /// # Errors
    /// As [`set_view`](Self::set_view).
    pub fn edit(&mut self, edit: &Edit) -> Result<(), SendError> {
        self.send(edit)
    }

    /// Asks for a keyframe, unless one is on its way.
    pub fn request_keyframe(&mut self, reason: KeyframeReason) {
        if self.keyframe_requested || self.send(&Request::Keyframe { reason }).is_err() {
            return;
        }
        self.keyframe_requested = true;
        self.stats.requests += 1;
    }

    /// Ends the session. What was received stays.
    pub fn close(&mut self, code: CloseCode, text: &str) {
        if matches!(self.phase, Phase::Closed(_)) || self.failed.is_some() {
            return;
        }
        self.queue(&Close::new(code, text));
        self.enter_closed();
    }

    /// The state, once the scene is known. It is that of the last frame applied, also after an error or a close.
    #[must_use]
    pub fn state(&self) -> Option<&State> {
        self.follower().map(Follower::state)
    }

    /// Whether the state is that of the newest frame that came, so nothing is being waited for.
    #[must_use]
    pub fn is_current(&self) -> bool {
        self.follower().is_some_and(Follower::is_current)
    }

    /// Whether a CLOSE went or came.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        matches!(self.phase, Phase::Closed(_))
    }

    /// Bytes that came in of a frame that is not whole yet.
    #[must_use]
    pub fn unfinished_bytes(&self) -> usize {
        self.framer.pending()
    }

    /// Counts so far.
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

    /// Queues a message that is known to be good. A client's frames are all in group 0, place 0.
    fn queue<M: Message>(&mut self, message: &M) {
        let mut out = Vec::new();
        if let Ok(payload) = message.to_payload()
            && write_frame(&mut out, M::KIND, Group(0), Sequence(0), &payload).is_ok()
        {
            self.outbox.push(out, None, DropPolicy::Keep);
        }
    }

    /// Acknowledges a frame; one that waits to be acknowledged needs it no more.
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

    fn frame(&mut self, frame: &WireFrame<'_>, events: &mut Vec<ClientEvent>) -> Result<(), SessionError> {
        let (kind, payload) = (frame.header.kind, frame.payload());
        match (kind, &mut self.phase) {
            (FrameType::ACCEPT, Phase::Greeting) => events.push(self.accept(read(payload)?)?),
            (FrameType::REJECT, Phase::Greeting) => {
                return Err(SessionError::Rejected(read::<Reject>(payload)?));
            }
            (FrameType::SCENE, Phase::Loading(profile, assembler)) => {
                let accepted = *profile;
                let scene: Scene = read(payload)?;
                if let Some(table) = assembler.push(scene, &self.limits)? {
                    events.push(self.scene_ready(table, accepted)?);
                }
            }
            (FrameType::KEYFRAME | FrameType::UPDATE, Phase::Running(_)) => self.state_frame(frame, events),
            (FrameType::REPORT, Phase::Running(_)) => events.push(ClientEvent::Report(read(payload)?)),
            (FrameType::BUDGET, Phase::Running(_)) => events.push(ClientEvent::Budget(read(payload)?)),
            (FrameType::EDIT, Phase::Running(_)) => events.push(ClientEvent::Edited(read(payload)?)),
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
                events.push(ClientEvent::Closed(read(payload)?));
                self.enter_closed();
            }
            (kind, phase) if kind.name().is_some() => {
                return Err(SessionError::Unexpected { kind, state: describe(phase) });
            }
            // The unknown-type rule: skip it.
            _ => self.stats.unknown += 1,
        }
        Ok(())
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
        let found = table.info().digest;
        if let Some(expected) = self.options.scene.filter(|expected| *expected != found) {
            let name = table.info().name.to_string();
            return Err(SessionError::OtherScene { name, expected, found });
        }
        self.phase = Phase::Running(Box::new(Follower::new(table.layout())));
        Ok(ClientEvent::SceneReady(Arc::new(table)))
    }

    fn state_frame(&mut self, frame: &WireFrame<'_>, events: &mut Vec<ClientEvent>) {
        let Phase::Running(follower) = &mut self.phase else { return };
        let header = frame.header;
        if header.kind == FrameType::KEYFRAME {
            self.keyframe_requested = false;
        }
        // The one time that the header is read and the checksum computed.
        let body = FrameBody::parse(frame.payload(), &self.limits.codec);
        let passed = |body: &FrameBody<'_>| follower.skip_superseded(header, body);
        if self.options.datagrams.is_some() && body.as_ref().is_ok_and(passed) {
            self.stats.late_datagram_frames += 1;
            return;
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
                events.push(ClientEvent::Applied(frame));
                return;
            }
            Err(reason) => reason,
        };
        if let FollowError::Body(FrameError::Hash { stored, computed, .. }) = reason {
            return self.mismatch(number, stored, computed, events);
        }
        self.stats.unusable += 1;
        self.request_keyframe(match &reason {
            FollowError::Gap { .. } | FollowError::Waiting | FollowError::NoScene => KeyframeReason::GAP,
            FollowError::Body(_) | FollowError::Kind { .. } => KeyframeReason::BODY,
        });
        events.push(ClientEvent::Unusable { header, reason });
    }

    /// The state after a frame would not have been the server's.
    fn mismatch(
        &mut self,
        frame: FrameIndex,
        expected: StateHash,
        found: StateHash,
        events: &mut Vec<ClientEvent>,
    ) {
        self.stats.unusable += 1;
        self.stats.hash_mismatches += 1;
        self.request_keyframe(KeyframeReason::HASH);
        events.push(ClientEvent::HashMismatch { frame, expected, found });
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
