//! The server's end: one session a client.

mod datagrams;

use std::collections::VecDeque;
use std::sync::Arc;

use psao_codec::envelope::FrameKind;

use super::flight::Flight;
use super::negotiation::negotiate;
use super::outbox::{DropPolicy, Outbox, StreamPosition};
use super::timers::{Due, RateLimiter, Timers};
use super::{
    Access, Demand, NEWEST_VERSION, PEER_NAME, SendError, ServerEvent, ServerStats, SessionError, SharedBody,
    close_message, read,
};
use crate::fanout::ClientCursor;
use crate::message::{
    Accept, Ack, Auth, Budget, Close, CloseCode, Edit, Hello, Message, PeerLimits, Ping, Pong, Reject,
    RejectCode, Report, Request, Stamp, Text, View,
};
use crate::{FrameIndex, FrameType, Framer, HEADER_BYTES, Limits, Micros, SceneTable, WireFrame};

#[derive(Debug)]
enum Phase {
    /// No HELLO came yet.
    Waiting(Option<Auth>),
    /// HELLO came and was accepted.
    Joined(Hello),
    /// A CLOSE or REJECT went, or a CLOSE came.
    Closed,
}

/// A server's view of one client.
///
/// Give it what comes from the client with [`handle`](Self::handle) and, at the time that
/// [`next_deadline`](Self::next_deadline) says, the time alone with [`tick`](Self::tick); send what
/// [`output`](Self::output) gives and say how much of it went with [`advance`](Self::advance). Before each frame look at
/// its [`demand`](Self::demand): that depends on what it holds, whether it takes what is sent, and what it asked for.
/// [`Fanout`](crate::Fanout) does that for many clients. What waits for a client is bounded by
/// [`Limits::max_queue_bytes`].
#[derive(Debug)]
pub struct ServerSession {
    limits: Limits,
    scene: Arc<SceneTable>,
    access: Access,
    name: Text<64>,
    framer: Framer,
    outbox: Outbox,
    position: StreamPosition,
    phase: Phase,
    timers: Timers,
    frames_left: RateLimiter,
    bytes_left: RateLimiter,
    failed: Option<SessionError>,
    /// The client fell behind. It gets what it missed once the bytes that wait are gone.
    lagging: bool,
    flight: Flight,
    stamps: bool,
    /// Most bytes of a datagram, when the client wants updates as such.
    datagram_bytes: Option<u16>,
    datagrams: VecDeque<Vec<u8>>,
    /// Read and written by [`Fanout`](crate::Fanout) alone.
    pub(crate) cursor: ClientCursor,
    stats: ServerStats,
}

impl ServerSession {
    /// Creates the session of a client that has just connected.
    #[must_use]
    pub fn new(scene: Arc<SceneTable>, access: Access, limits: Limits) -> Self {
        Self {
            limits,
            scene,
            access,
            name: Text::cut(PEER_NAME),
            framer: Framer::new(limits),
            outbox: Outbox::default(),
            position: StreamPosition::default(),
            phase: Phase::Waiting(None),
            timers: Timers::default(),
            frames_left: RateLimiter::new(limits.max_frames_per_s),
            bytes_left: RateLimiter::new(limits.max_bytes_per_s),
            failed: None,
            lagging: false,
            flight: Flight::default(),
            stamps: false,
            datagram_bytes: None,
            datagrams: VecDeque::new(),
            cursor: ClientCursor::default(),
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
        if !bytes.is_empty() {
            self.timers.note_received();
        }
        if !self.is_closed() && !self.bytes_left.take(bytes.len(), now) {
            let limit = self.bytes_left.rate();
            return Err(self.fail(SessionError::Flood { what: "bytes", limit }));
        }
        let mut events = Vec::new();
        let result = Framer::drain(
            self,
            |session| &mut session.framer,
            bytes,
            |session, frame| {
                if session.is_closed() { Ok(()) } else { session.frame(frame, &mut events) }
            },
        );
        match result {
            Err(_) if matches!(self.phase, Phase::Closed) => Ok(events),
            Err(error) => Err(self.fail(error)),
            Ok(()) => Ok(events),
        }
    }

    /// Does what the time asks for: ends a handshake that takes too long, sends keep-alives, gives up a client that is
    /// silent or takes nothing. The first call starts the handshake's time.
    ///
    /// # Errors
    /// [`SessionError::HandshakeTimeout`], [`SessionError::Silent`], [`SessionError::Stalled`], or the error that ended
    /// the session before.
    pub fn tick(&mut self, now: Micros) -> Result<(), SessionError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        self.timers.set_now(now);
        let due = match self.phase {
            Phase::Waiting(_) => self.timers.handshake(&self.limits).map(|()| Due::Nothing),
            Phase::Joined(_) => self.timers.open(&self.limits, !self.outbox.is_empty(), true),
            Phase::Closed => Ok(Due::Nothing),
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
        match self.phase {
            Phase::Waiting(_) => self.timers.next_in_handshake(&self.limits),
            Phase::Joined(_) => self.timers.next_when_open(&self.limits, !self.outbox.is_empty(), true),
            Phase::Closed => None,
        }
    }

    /// Returns what brings the client to the newest frame. A client that fell behind demands nothing until it has taken
    /// the bytes that wait.
    #[must_use]
    pub fn demand(&self) -> Demand {
        let caught_up =
            || self.outbox.is_empty() && self.flight.len() <= self.limits.max_unacked as usize / 2;
        if !self.is_joined() || (self.lagging && !caught_up()) {
            return Demand::Nothing;
        }
        let now = self.timers.now();
        match (self.position.holds, self.datagram_bytes, self.flight.acked()) {
            (None, _, _) => Demand::Keyframe,
            (Some(holds), Some(_), acked) if self.flight.is_large(now) => {
                let base = acked.map_or(holds, |acked| holds.max(acked));
                if self.position.context_lost { Demand::Patch { base } } else { Demand::Update { base } }
            }
            (Some(_), Some(_), Some(base)) if self.flight.has_room(now) => Demand::Datagrams { base },
            // The keyframe that datagrams build on is on its way, or the network is full.
            (Some(_), Some(_), _) => Demand::Nothing,
            (Some(base), None, _) => Demand::Update { base },
        }
    }

    /// Sends a keyframe. Updates that still wait are dropped: the keyframe holds them. Returns whether the keyframe was
    /// queued; before the client has joined it is dropped.
    ///
    /// # Errors
    /// [`SendError::NotOpen`] after the session ended; [`SendError::OverPeerLimit`] when the frame is longer than
    /// the client takes: it can never follow, so close it. [`SendError::Kind`] for an update.
    pub fn send_keyframe(&mut self, body: &SharedBody) -> Result<bool, SendError> {
        if body.kind != FrameKind::Key {
            return Err(SendError::Kind);
        }
        if !self.check_body(body)? {
            return Ok(false);
        }
        self.drop_stale(false);
        self.flight.clear();
        let before = self.position;
        let head = self.position.numbering.keyframe_head(&body.bytes)?;
        self.push_state(&head, body, before);
        self.stats.keyframes += 1;
        Ok(true)
    }

    /// Sends an update that builds on the frame `base`. It is dropped unless that is the client's
    /// [`demand`](Self::demand). One that does not fit the queue, or comes on top of too many that were not acknowledged,
    /// makes the client lag: all updates that wait are dropped with it. Returns whether it was queued. What was dropped
    /// need not be sent again, because the next body that the client demands holds it.
    ///
    /// # Errors
    /// As [`send_keyframe`](Self::send_keyframe); [`SendError::Kind`] for a keyframe.
    pub fn send_update(&mut self, body: &SharedBody, base: FrameIndex) -> Result<bool, SendError> {
        if body.kind != FrameKind::Delta {
            return Err(SendError::Kind);
        }
        let wanted = [Demand::Update { base }, Demand::Patch { base }].contains(&self.demand());
        if !self.check_body(body)? || !wanted {
            self.stats.dropped += 1;
            return Ok(false);
        }
        let waits = !self.outbox.is_empty() && !self.fits(HEADER_BYTES + body.bytes.len());
        if waits || self.flight.len() >= self.limits.max_unacked as usize {
            self.fall_behind();
            self.stats.dropped += 1;
            return Ok(false);
        }
        let before = self.position;
        let head = self.position.numbering.update_head(&body.bytes)?;
        self.push_state(&head, body, before);
        self.stats.updates += 1;
        Ok(true)
    }

    /// Sends a report, unless the client is behind. Returns whether it was queued.
    ///
    /// # Errors
    /// [`SendError::NotOpen`], or [`SendError::Message`] when the report makes no sense.
    pub fn send_report(&mut self, report: &Report) -> Result<bool, SendError> {
        self.send_note(report)
    }

    /// Sends what a frame did with its byte budget, unless the client is behind. Returns whether it was queued.
    ///
    /// # Errors
    /// As [`send_report`](Self::send_report).
    pub fn send_budget(&mut self, budget: &Budget) -> Result<bool, SendError> {
        self.send_note(budget)
    }

    /// Tells the client of an edit that is part of every frame sent from here on. Returns whether it was queued.
    ///
    /// # Errors
    /// As [`send_report`](Self::send_report).
    pub fn send_edit(&mut self, edit: &Edit) -> Result<bool, SendError> {
        self.check_open()?;
        let frame = self.position.numbering.message(edit)?;
        if !self.is_joined() {
            return Ok(false);
        }
        self.push(frame, None, DropPolicy::Keep);
        Ok(true)
    }

    /// Ends the session: what waits is still sent, then a CLOSE. A client that has not joined gets a REJECT instead,
    /// with the code BUSY.
    pub fn close(&mut self, code: CloseCode, text: &str) {
        match self.phase {
            Phase::Waiting(_) => self.queue(&Reject::new(RejectCode::BUSY, text)),
            Phase::Joined(_) => self.queue(&Close::new(code, text)),
            Phase::Closed => {}
        }
        self.phase = Phase::Closed;
    }

    /// Returns the next bytes to send; empty when nothing waits.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        self.outbox.front()
    }

    /// Marks the first `count` bytes of [`output`](Self::output) as sent.
    pub fn advance(&mut self, count: usize) {
        if count > 0 {
            self.timers.note_progress();
        }
        self.outbox.advance(count);
    }

    /// All bytes that wait, marked as sent.
    #[must_use]
    pub fn take_output(&mut self) -> Vec<u8> {
        self.timers.note_progress();
        self.outbox.take()
    }

    /// Bytes that wait.
    #[must_use]
    pub const fn queued_bytes(&self) -> usize {
        self.outbox.len()
    }

    /// Bytes that came in of a frame that is not whole yet.
    #[must_use]
    pub fn unfinished_bytes(&self) -> usize {
        self.framer.pending()
    }

    /// Returns whether the client has joined and not left.
    #[must_use]
    pub const fn is_joined(&self) -> bool {
        matches!(self.phase, Phase::Joined(_))
    }

    /// Returns whether the session is over. The output may still hold its last frames.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        matches!(self.phase, Phase::Closed)
    }

    /// Returns whether the client fell behind and still lacks what it missed.
    #[must_use]
    pub const fn is_lagging(&self) -> bool {
        self.lagging
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> ServerStats {
        self.stats
    }

    fn send_note<M: Message>(&mut self, message: &M) -> Result<bool, SendError> {
        self.check_open()?;
        let frame = self.position.numbering.message(message)?;
        if !self.is_joined() || self.lagging || self.position.holds.is_none() || !self.fits(frame.len()) {
            self.stats.dropped += 1;
            return Ok(false);
        }
        self.push(frame, None, DropPolicy::Droppable);
        Ok(true)
    }

    const fn check_open(&self) -> Result<(), SendError> {
        if self.is_closed() { Err(SendError::NotOpen) } else { Ok(()) }
    }

    /// Whether the client has joined, and the body is one that it takes.
    fn check_body(&self, body: &SharedBody) -> Result<bool, SendError> {
        let hello = match &self.phase {
            Phase::Waiting(_) => return Ok(false),
            Phase::Joined(hello) => hello,
            Phase::Closed => return Err(SendError::NotOpen),
        };
        let (bytes, limit) = (body.bytes.len(), hello.limits.frame_bytes);
        if bytes > limit as usize {
            return Err(SendError::OverPeerLimit { bytes, limit });
        }
        Ok(true)
    }

    fn fits(&self, bytes: usize) -> bool {
        self.outbox.len().saturating_add(bytes) <= self.limits.max_queue_bytes as usize
    }

    fn fall_behind(&mut self) {
        self.drop_stale(true);
        self.stats.lags += 1;
        self.lagging = true;
    }

    /// Drops what waits and can be dropped; the client then stands where it stood before that.
    fn drop_stale(&mut self, keep_first: bool) {
        let before = self.outbox.len();
        let (dropped, position) = self.outbox.drop_stale(keep_first);
        self.stats.dropped += dropped;
        self.stats.wire_bytes -= (before - self.outbox.len()) as u64;
        if let Some(position) = position {
            // Datagrams that went since then went all the same.
            self.position = StreamPosition {
                context_lost: position.context_lost || self.position.context_lost,
                ..position
            };
            self.flight.forget_after(position.holds);
        }
    }

    /// Queues a keyframe or update, its STAMP before it.
    fn push_state(&mut self, head: &[u8], body: &SharedBody, before: StreamPosition) {
        if self.stamps {
            let sent = self.timers.now();
            let stamp = Stamp { frame: body.frame, captured: body.captured.min(sent), sent };
            if let Ok(stamp) = before.numbering.message(&stamp) {
                self.push(stamp, None, DropPolicy::Droppable);
            }
        }
        self.push(head.to_vec(), Some(Arc::clone(&body.bytes)), DropPolicy::State(before));
        (self.position.holds, self.position.context_lost) = (Some(body.frame), false);
        self.lagging = false;
        // How long a keyframe takes says how large it is.
        let bytes = if body.kind == FrameKind::Key { 0 } else { body.bytes.len() as u64 };
        self.flight.expect((body.frame, body.hash), self.timers.now(), bytes, false);
    }

    fn push(&mut self, head: Vec<u8>, body: Option<Arc<[u8]>>, policy: DropPolicy) {
        if self.outbox.is_empty() {
            self.timers.note_progress();
        }
        self.stats.wire_bytes += (head.len() + body.as_ref().map_or(0, |body| body.len())) as u64;
        self.outbox.push(head, body, policy);
    }

    /// Queues a message that is known to be good.
    fn queue<M: Message>(&mut self, message: &M) {
        if let Ok(frame) = self.position.numbering.message(message) {
            self.push(frame, None, DropPolicy::Keep);
        }
    }

    fn fail(&mut self, error: SessionError) -> SessionError {
        self.drop_stale(false);
        self.datagrams.clear();
        match (&self.phase, &error) {
            (Phase::Closed, _) => {}
            (_, SessionError::BadHello(reject)) => self.queue(&reject.clone()),
            // A client that failed the handshake is told why by a message of the handshake.
            (Phase::Waiting(_), SessionError::NotPsao { .. }) => {}
            (Phase::Waiting(_), _) => self.queue(&Reject::new(RejectCode::BAD_HELLO, &error.to_string())),
            (Phase::Joined(_), _) => {
                if let Some(close) = close_message(&error) {
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
        if !self.frames_left.take(1, self.timers.now()) {
            return Err(SessionError::Flood { what: "frames", limit: self.frames_left.rate() });
        }
        match (kind, &mut self.phase) {
            (FrameType::HELLO, Phase::Waiting(_)) => events.push(self.hello(payload)?),
            (FrameType::AUTH, Phase::Waiting(auth @ None)) => *auth = Some(read(payload)?),
            (FrameType::CLOSE, _) => {
                events.push(ServerEvent::Closed(read(payload)?));
                self.phase = Phase::Closed;
            }
            (kind, Phase::Waiting(_)) => {
                return Err(SessionError::Unexpected { kind, state: "waiting for HELLO" });
            }
            (FrameType::VIEW, _) => events.push(ServerEvent::View(read::<View>(payload)?.camera)),
            (FrameType::EDIT, _) => events.push(ServerEvent::Edit(read(payload)?)),
            (FrameType::ACK, _) => {
                let ack = read(payload)?;
                events.push(self.acked(ack));
            }
            (FrameType::REQUEST, _) => events.extend(self.request(read(payload)?)),
            (FrameType::PING, _) => {
                let Ping { sent } = read(payload)?;
                let now = self.timers.now();
                // A client that takes no answers gets no more of them.
                if self.fits(0) {
                    self.queue(&Pong { sent, received: now, replied: now });
                }
            }
            // That it came is all there is to know.
            (FrameType::PONG, _) => drop(read::<Pong>(payload)?),
            (kind, _) if kind.name().is_some() => {
                return Err(SessionError::Unexpected { kind, state: "serving the client" });
            }
            // The unknown-type rule: skip it.
            _ => self.stats.unknown += 1,
        }
        Ok(())
    }

    fn request(&mut self, request: Request) -> Option<ServerEvent> {
        match request {
            Request::Keyframe { reason } => {
                self.need_keyframe();
                return Some(ServerEvent::KeyframeWanted(reason));
            }
            Request::Stamps => self.stamps = true,
            Request::Datagrams { bytes } => self.datagram_bytes = Some(bytes),
        }
        None
    }

    /// Sets the time of what is sent next.
    pub(crate) fn set_now(&mut self, now: Micros) {
        self.timers.set_now(now);
    }

    /// Makes the client need a keyframe, whatever it holds.
    pub(crate) fn need_keyframe(&mut self) {
        self.drop_stale(false);
        self.position.holds = None;
        self.lagging = false;
        self.flight.clear();
        self.datagrams.clear();
    }

    fn acked(&mut self, ack: Ack) -> ServerEvent {
        let before = self.flight.len();
        let right = self.flight.acknowledge(&ack, self.timers.now());
        // However fast frames go, a client that acknowledges each does not say too much.
        self.frames_left.refund(before - self.flight.len());
        if right {
            return ServerEvent::Acked(ack);
        }
        self.stats.diverged += 1;
        self.need_keyframe();
        ServerEvent::Diverged(ack)
    }

    fn hello(&mut self, payload: &[u8]) -> Result<ServerEvent, SessionError> {
        let Phase::Waiting(auth) = &self.phase else {
            return Err(SessionError::Unexpected { kind: FrameType::HELLO, state: "serving the client" });
        };
        self.access.check(auth.as_ref()).map_err(SessionError::BadHello)?;
        let hello = negotiate(payload, &self.scene)?;
        let scene = self.position.numbering.scene(&self.scene)?;
        self.queue(&Accept {
            version: hello.newest.min(NEWEST_VERSION),
            profile: self.scene.profile(),
            limits: PeerLimits::from(&self.limits),
            name: self.name.clone(),
        });
        for frame in scene {
            self.push(frame, None, DropPolicy::Keep);
        }
        self.phase = Phase::Joined(hello.clone());
        Ok(ServerEvent::Joined(hello))
    }
}
