//! The server's end: one session a client.

use std::sync::Arc;

use psao_codec::stream::Layout;

use super::outbox::Outbox;
use super::{Deadline, NEWEST_VERSION, OLDEST_VERSION, PEER_NAME, SendError, SessionError, farewell, read};
use crate::message::{
    Accept, Ack, CameraPose, Close, CloseCode, Edit, Hello, KeyframeReason, Message, MessageError,
    PeerLimits, Reject, RejectCode, Report, Request, Text, View,
};
use crate::{CoderId, FrameType, Framer, HEADER_BYTES, Limits, Micros, Numbering, SceneTable, WireFrame};

/// What a client did.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerEvent {
    /// It was accepted; the scene is on its way and it waits for a keyframe.
    Joined(Hello),
    /// It looks from here now.
    View(CameraPose),
    /// It wants the scene changed. A server may ignore it.
    Edit(Edit),
    /// It holds a frame.
    Acked(Ack),
    /// It cannot go on without a keyframe; [`ServerSession::wants_keyframe`] says so until it got one.
    KeyframeWanted(KeyframeReason),
    /// It left. Nothing follows.
    Closed(Close),
}

/// What became of a frame that was given to a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// It waits in the output.
    Queued,
    /// It was dropped: the client has not joined, or needs a keyframe first. Nothing is owed for it; the keyframe will
    /// hold what it held.
    Dropped,
}

/// Counts of a server session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerStats {
    /// Bytes queued for the client, dropped ones left out.
    pub wire_bytes: u64,
    /// Keyframes queued.
    pub keyframes: u64,
    /// Updates queued.
    pub updates: u64,
    /// Updates and other frames dropped, before or after they were queued.
    pub dropped: u64,
    /// How often the client fell behind.
    pub lags: u64,
    /// Frames of a type that this version does not know.
    pub unknown: u64,
}

#[derive(Debug)]
enum Phase {
    /// Nothing came yet.
    Waiting,
    /// HELLO came and was accepted.
    Joined(Hello),
    /// A CLOSE or REJECT went, or a CLOSE came.
    Closed,
}

/// A server's view of one client.
///
/// Give it what comes from the client with [`handle`](Self::handle); send what [`output`](Self::output) gives and say
/// how much of it went with [`advance`](Self::advance). Before each update look at
/// [`wants_keyframe`](Self::wants_keyframe): a client that joins, asks or fell behind needs a keyframe and takes no
/// updates until it has one. What waits for a client is bounded by [`Limits::max_queue_bytes`].
#[derive(Debug)]
pub struct ServerSession {
    limits: Limits,
    scene: Arc<SceneTable>,
    name: Text<64>,
    framer: Framer,
    outbox: Outbox,
    numbering: Numbering,
    phase: Phase,
    deadline: Deadline,
    failed: Option<SessionError>,
    needs_keyframe: bool,
    /// The client fell behind: what it needs waits until the rest is gone.
    lagging: bool,
    stats: ServerStats,
}

impl ServerSession {
    /// A client has connected.
    #[must_use]
    pub fn new(scene: Arc<SceneTable>, limits: Limits) -> Self {
        Self {
            limits,
            scene,
            name: Text::cut(PEER_NAME),
            framer: Framer::new(limits),
            outbox: Outbox::default(),
            numbering: Numbering::default(),
            phase: Phase::Waiting,
            deadline: Deadline::default(),
            failed: None,
            needs_keyframe: false,
            lagging: false,
            stats: ServerStats::default(),
        }
    }

    /// Takes bytes from the client, in any chunking, at the time `now`.
    ///
    /// # Errors
    /// [`SessionError`] when the session cannot go on; the same error comes again after that. The output may still
    /// hold a REJECT or CLOSE for the client.
    pub fn handle(&mut self, bytes: &[u8], now: Micros) -> Result<Vec<ServerEvent>, SessionError> {
        self.tick(now)?;
        let mut framer = std::mem::replace(&mut self.framer, Framer::new(self.limits));
        framer.push(bytes);
        let mut events = Vec::new();
        let result = loop {
            match framer.next_frame() {
                Ok(None) => break Ok(()),
                Err(error) => break Err(error.into()),
                Ok(Some(_)) if matches!(self.phase, Phase::Closed) => {}
                Ok(Some(frame)) => {
                    if let Err(error) = self.frame(&frame, &mut events) {
                        break Err(error);
                    }
                }
            }
        };
        self.framer = framer;
        match result {
            Err(_) if matches!(self.phase, Phase::Closed) => Ok(events),
            Err(error) => Err(self.fail(error)),
            Ok(()) => Ok(events),
        }
    }

    /// Checks the handshake's deadline. The first call starts it.
    ///
    /// # Errors
    /// [`SessionError::HandshakeTimeout`], or the error that ended the session before.
    pub fn tick(&mut self, now: Micros) -> Result<(), SessionError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        match self.phase {
            Phase::Waiting => self.deadline.check(now, &self.limits).map_err(|error| self.fail(error)),
            Phase::Joined(_) | Phase::Closed => Ok(()),
        }
    }

    /// Whether the client needs a keyframe now. A client that fell behind says so once its queue is empty.
    #[must_use]
    pub fn wants_keyframe(&self) -> bool {
        let ready = !self.lagging || self.outbox.is_empty();
        matches!(self.phase, Phase::Joined(_)) && self.needs_keyframe && ready
    }

    /// Sends the body of a keyframe, as of `psao_codec::stream::keyframe` or the first frame of an encoder. Updates that
    /// still wait are dropped: the keyframe holds them.
    ///
    /// # Errors
    /// [`SendError::NotOpen`] after the session ended; [`SendError::OverPeerLimit`] when it does not take so long
    /// a frame, which it then can never follow: close it.
    pub fn send_keyframe(&mut self, body: &[u8]) -> Result<Sent, SendError> {
        if !self.check_body(body)? {
            return Ok(Sent::Dropped);
        }
        let frame = self.numbering.keyframe(body)?;
        self.drop_stale(false);
        self.push(frame, true);
        self.stats.keyframes += 1;
        self.needs_keyframe = false;
        self.lagging = false;
        Ok(Sent::Queued)
    }

    /// Sends the body of an update, unless the client needs a keyframe first. An update that does not fit the queue
    /// makes the client lag: all updates that wait are dropped with it.
    ///
    /// # Errors
    /// As [`send_keyframe`](Self::send_keyframe).
    pub fn send_update(&mut self, body: &[u8]) -> Result<Sent, SendError> {
        if !self.check_body(body)? || self.needs_keyframe {
            self.stats.dropped += 1;
            return Ok(Sent::Dropped);
        }
        if !self.outbox.is_empty() && !self.fits(HEADER_BYTES + body.len()) {
            self.lag();
            self.stats.dropped += 1;
            return Ok(Sent::Dropped);
        }
        let frame = self.numbering.update(body)?;
        self.push(frame, true);
        self.stats.updates += 1;
        Ok(Sent::Queued)
    }

    /// Sends a report, unless the client is behind.
    ///
    /// # Errors
    /// [`SendError::NotOpen`], or [`SendError::Message`] when the report makes no sense.
    pub fn send_report(&mut self, report: &Report) -> Result<Sent, SendError> {
        if self.is_closed() {
            return Err(SendError::NotOpen);
        }
        let frame = self.numbering.message(report)?;
        if !self.is_joined() || self.needs_keyframe || !self.fits(frame.len()) {
            self.stats.dropped += 1;
            return Ok(Sent::Dropped);
        }
        self.push(frame, true);
        Ok(Sent::Queued)
    }

    /// Ends the session: what waits is still sent, then a CLOSE. A client that has not joined gets a REJECT instead,
    /// with the code BUSY.
    pub fn close(&mut self, code: CloseCode, text: &str) {
        match self.phase {
            Phase::Waiting => self.queue(&Reject::new(RejectCode::BUSY, text)),
            Phase::Joined(_) => self.queue(&Close::new(code, text)),
            Phase::Closed => {}
        }
        self.phase = Phase::Closed;
    }

    /// The next bytes to send; empty when nothing waits.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        self.outbox.front()
    }

    /// Marks the first `count` bytes of [`output`](Self::output) as sent.
    pub fn advance(&mut self, count: usize) {
        self.outbox.advance(count);
    }

    /// All bytes that wait, marked as sent.
    #[must_use]
    pub fn take_output(&mut self) -> Vec<u8> {
        self.outbox.take()
    }

    /// Bytes that wait.
    #[must_use]
    pub const fn queued_bytes(&self) -> usize {
        self.outbox.len()
    }

    /// Whether the client has joined and not left.
    #[must_use]
    pub const fn is_joined(&self) -> bool {
        matches!(self.phase, Phase::Joined(_))
    }

    /// Whether the session is over. The output may still hold its last frames.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        matches!(self.phase, Phase::Closed)
    }

    /// Whether the client fell behind and has not got its keyframe yet.
    #[must_use]
    pub const fn is_lagging(&self) -> bool {
        self.lagging
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> ServerStats {
        self.stats
    }

    /// Whether the client has joined, and the body is one that it takes.
    fn check_body(&self, body: &[u8]) -> Result<bool, SendError> {
        let hello = match &self.phase {
            Phase::Waiting => return Ok(false),
            Phase::Joined(hello) => hello,
            Phase::Closed => return Err(SendError::NotOpen),
        };
        let limit = hello.limits.frame_bytes;
        if body.len() > limit as usize {
            return Err(SendError::OverPeerLimit { bytes: body.len(), limit });
        }
        Ok(true)
    }

    fn fits(&self, bytes: usize) -> bool {
        self.outbox.len().saturating_add(bytes) <= self.limits.max_queue_bytes as usize
    }

    fn lag(&mut self) {
        self.drop_stale(true);
        self.stats.lags += 1;
        self.lagging = true;
        self.needs_keyframe = true;
    }

    fn drop_stale(&mut self, keep_first: bool) {
        let before = self.outbox.len();
        self.stats.dropped += self.outbox.drop_stale(keep_first);
        self.stats.wire_bytes -= (before - self.outbox.len()) as u64;
    }

    fn push(&mut self, frame: Vec<u8>, droppable: bool) {
        self.stats.wire_bytes += frame.len() as u64;
        self.outbox.push(frame, droppable);
    }

    /// Queues a message that is known to be good.
    fn queue<M: Message>(&mut self, message: &M) {
        if let Ok(frame) = self.numbering.message(message) {
            self.push(frame, false);
        }
    }

    fn fail(&mut self, error: SessionError) -> SessionError {
        match (&self.phase, &error) {
            (Phase::Closed, _) => {}
            (_, SessionError::BadHello(reject)) => self.queue(&reject.clone()),
            // Whoever has not said HELLO in time or in order is told why in the words of the handshake.
            (Phase::Waiting, SessionError::NotPsao { .. }) => {}
            (Phase::Waiting, _) => self.queue(&Reject::new(RejectCode::BAD_HELLO, &error.to_string())),
            (Phase::Joined(_), _) => {
                if let Some(close) = farewell(&error) {
                    self.queue(&close);
                }
            }
        }
        self.phase = Phase::Closed;
        self.failed = Some(error.clone());
        error
    }

    fn frame(&mut self, frame: &WireFrame<'_>, events: &mut Vec<ServerEvent>) -> Result<(), SessionError> {
        let (kind, payload) = (frame.header.kind, frame.payload());
        match (kind, &self.phase) {
            (FrameType::HELLO, Phase::Waiting) => events.push(self.hello(payload)?),
            (FrameType::CLOSE, _) => {
                events.push(ServerEvent::Closed(read(payload)?));
                self.phase = Phase::Closed;
            }
            (kind, Phase::Waiting) => {
                return Err(SessionError::Unexpected { kind, state: "waiting for HELLO" });
            }
            (FrameType::VIEW, _) => events.push(ServerEvent::View(read::<View>(payload)?.camera)),
            (FrameType::EDIT, _) => events.push(ServerEvent::Edit(read(payload)?)),
            (FrameType::ACK, _) => events.push(ServerEvent::Acked(read(payload)?)),
            (FrameType::REQUEST, _) => {
                let Request::Keyframe { reason } = read(payload)?;
                self.needs_keyframe = true;
                self.drop_stale(false);
                events.push(ServerEvent::KeyframeWanted(reason));
            }
            (kind, _) if kind.name().is_some() => {
                return Err(SessionError::Unexpected { kind, state: "serving the client" });
            }
            // The unknown-type rule: skip it.
            _ => self.stats.unknown += 1,
        }
        Ok(())
    }

    fn hello(&mut self, payload: &[u8]) -> Result<ServerEvent, SessionError> {
        let reject = |code, text: &str| SessionError::BadHello(Reject::new(code, text));
        let hello: Hello = match versions(payload) {
            Some((oldest, newest)) if oldest > NEWEST_VERSION || newest < OLDEST_VERSION => {
                let error = SessionError::Version { peer: "client", oldest, newest };
                return Err(reject(RejectCode::VERSION, &error.to_string()));
            }
            _ => read(payload).map_err(|e: MessageError| reject(RejectCode::BAD_HELLO, &e.to_string()))?,
        };
        let info = self.scene.info();
        if !hello.profiles.has(info.profile) {
            return Err(reject(RejectCode::PROFILE, "the client cannot apply the stream's profile"));
        }
        if !hello.coders.has(info.coder) || !hello.coders.has(CoderId::STORED) {
            return Err(reject(RejectCode::CODER, "the client cannot undo the stream's block coder"));
        }
        if let Some(text) = over_limits(self.scene.layout(), &hello.limits) {
            return Err(reject(RejectCode::LIMITS, &text));
        }
        let scene = self.numbering.scene(&self.scene)?;
        let limits = PeerLimits::from(&self.limits);
        let accept = Accept {
            version: hello.newest.min(NEWEST_VERSION),
            profile: info.profile,
            limits,
            name: self.name.clone(),
        };
        self.queue(&accept);
        for frame in scene {
            self.push(frame, false);
        }
        self.needs_keyframe = true;
        self.phase = Phase::Joined(hello.clone());
        Ok(ServerEvent::Joined(hello))
    }
}

/// What the client would have to raise before it can hold the scene; nothing when it can.
fn over_limits(layout: &Layout, takes: &PeerLimits) -> Option<String> {
    let instances = layout.instances() as u32;
    let needs = match layout {
        Layout::Cells(layout) => [
            ("instances", instances, takes.instances),
            ("buckets", layout.bucket_total(), takes.buckets),
            ("cells", layout.cell_capacity(), takes.cells),
        ],
        Layout::Surface(layout) => [
            ("instances", instances, takes.instances),
            ("point sets", layout.sets().len() as u32, takes.instances),
            ("points", layout.points(), takes.points),
        ],
    };
    let over = |(what, need, take): &(&str, u32, u32)| {
        (need > take)
            .then(|| format!("the scene has {need} {what}; the client takes {take}: raise its limits"))
    };
    needs.iter().find_map(over)
}

/// The versions at the start of any HELLO, however much the rest of it has changed.
fn versions(payload: &[u8]) -> Option<(u16, u16)> {
    let &[o0, o1, n0, n1] = payload.first_chunk()?;
    Some((u16::from_le_bytes([o0, o1]), u16::from_le_bytes([n0, n1])))
}
