//! The server's end: one session per client.

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
    /// No HELLO was received yet.
    Waiting(Option<Auth>),
    /// HELLO was received and accepted.
    Joined(Hello),
    /// A CLOSE or REJECT was sent, or a CLOSE was received.
    Closed,
}

/// A server session: the server's end of the connection to one client.
///
/// Pass received bytes to [`handle`](Self::handle), and call [`tick`](Self::tick) at the time of
/// [`next_deadline`](Self::next_deadline). Send the bytes of [`output`](Self::output) and confirm them with
/// [`advance`](Self::advance).
///
/// Before each frame, ask for the client's [`demand`](Self::demand). It depends on the frames that the client holds, on
/// the bytes that wait, and on the client's requests. [`Fanout`](crate::Fanout) does this for many clients.
/// [`Limits::max_queue_bytes`] bounds the bytes that wait for a client.
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
    /// Whether the client fell behind. It gets a newer frame once no bytes wait.
    lagging: bool,
    flight: Flight,
    stamps: bool,
    /// Largest datagram in bytes, if the client asked for updates as datagrams.
    datagram_bytes: Option<u16>,
    datagrams: VecDeque<Vec<u8>>,
    /// Used by [`Fanout`](crate::Fanout) only.
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

    /// Processes bytes from the client, in any chunking, at the time `now`.
    ///
    /// # Errors
    /// [`SessionError`] when the session cannot go on. Later calls return the same error. The output may still hold a
    /// REJECT or CLOSE for the client.
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

    /// Processes deadlines: ends a handshake that takes too long, sends keep-alives, and gives up a client that is
    /// silent or takes no bytes. The first call starts the time of the handshake.
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

    /// Returns the time of the next deadline for [`tick`](Self::tick); `None` before the first call with a time, and
    /// after the end.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Micros> {
        match self.phase {
            Phase::Waiting(_) => self.timers.next_in_handshake(&self.limits),
            Phase::Joined(_) => self.timers.next_when_open(&self.limits, !self.outbox.is_empty(), true),
            Phase::Closed => None,
        }
    }

    /// Returns the kind of body that brings the client to the newest frame. A client that fell behind demands nothing
    /// until it has taken the bytes that wait.
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
            // The base keyframe of the datagrams is not acknowledged yet, or the network is full.
            (Some(_), Some(_), _) => Demand::Nothing,
            (Some(base), None, _) => Demand::Update { base },
        }
    }

    /// Sends a keyframe. It replaces updates that still wait. Returns whether the keyframe was queued; before the
    /// client has joined it is dropped.
    ///
    /// # Errors
    /// [`SendError::NotOpen`] after the session ended; [`SendError::OverPeerLimit`] when the frame is longer than
    /// the client takes. Such a client can never follow the stream, so close its session. [`SendError::Kind`] for an
    /// update.
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

    /// Sends an update that builds on the frame `base`. Returns whether it was queued. It is dropped unless the
    /// client's [`demand`](Self::demand) names that base.
    ///
    /// An update that does not fit the queue, or that follows too many unacknowledged ones, makes the client fall
    /// behind. It is dropped with all updates that wait. Dropped updates need not be sent again, because the next body
    /// that the client demands contains them.
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
    /// [`SendError::NotOpen`], or [`SendError::Message`] when the report is invalid.
    pub fn send_report(&mut self, report: &Report) -> Result<bool, SendError> {
        self.send_note(report)
    }

    /// Sends the use of the byte budget by a frame, unless the client is behind. Returns whether it was queued.
    ///
    /// # Errors
    /// As [`send_report`](Self::send_report).
    pub fn send_budget(&mut self, budget: &Budget) -> Result<bool, SendError> {
        self.send_note(budget)
    }

    /// Sends an edit that every later frame includes. Returns whether it was queued.
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

    /// Ends the session with a CLOSE behind the bytes that wait. A client that did not join yet gets a REJECT with the
    /// code BUSY instead.
    pub fn close(&mut self, code: CloseCode, text: &str) {
        match self.phase {
            Phase::Waiting(_) => self.queue(&Reject::new(RejectCode::BUSY, text)),
            Phase::Joined(_) => self.queue(&Close::new(code, text)),
            Phase::Closed => {}
        }
        self.phase = Phase::Closed;
    }

    /// Returns the next bytes to send; empty when none wait.
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

    /// Returns all bytes that wait, and marks them as sent.
    #[must_use]
    pub fn take_output(&mut self) -> Vec<u8> {
        self.timers.note_progress();
        self.outbox.take()
    }

    /// Returns the number of bytes that wait.
    #[must_use]
    pub const fn queued_bytes(&self) -> usize {
        self.outbox.len()
    }

    /// Returns the number of bytes received of an incomplete frame.
    #[must_use]
    pub fn unfinished_bytes(&self) -> usize {
        self.framer.pending()
    }

    /// Returns whether the client has joined and did not leave.
    #[must_use]
    pub const fn is_joined(&self) -> bool {
        matches!(self.phase, Phase::Joined(_))
    }

    /// Returns whether the session is over. The output may still hold its last frames.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        matches!(self.phase, Phase::Closed)
    }

    /// Returns whether the client fell behind and did not catch up yet.
    #[must_use]
    pub const fn is_lagging(&self) -> bool {
        self.lagging
    }

    /// Returns the counts so far.
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

    /// Checks that the client takes a body of this size. Returns whether the client has joined.
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

    /// Drops waiting frames where their policy allows it, and moves the client's position back accordingly.
    fn drop_stale(&mut self, keep_first: bool) {
        let before = self.outbox.len();
        let (dropped, position) = self.outbox.drop_stale(keep_first);
        self.stats.dropped += dropped;
        self.stats.wire_bytes -= (before - self.outbox.len()) as u64;
        if let Some(position) = position {
            // Datagrams sent since then cannot be taken back.
            self.position = StreamPosition {
                context_lost: position.context_lost || self.position.context_lost,
                ..position
            };
            self.flight.forget_after(position.holds);
        }
    }

    /// Queues a keyframe or update, with its STAMP before it if the client asked for stamps.
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
        // A keyframe's delay depends on its size, so it does not tell about the network.
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

    /// Queues a message that is known to be valid.
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
            // A client that fails the handshake gets a message of the handshake.
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
                // A client that takes no bytes gets no more answers.
                if self.fits(0) {
                    self.queue(&Pong { sent, received: now, replied: now });
                }
            }
            // Only its arrival matters.
            (FrameType::PONG, _) => drop(read::<Pong>(payload)?),
            (kind, _) if kind.name().is_some() => {
                return Err(SessionError::Unexpected { kind, state: "serving the client" });
            }
            // Frames of unknown types are skipped.
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

    /// Sets the time for the frames that are sent next.
    pub(crate) fn set_now(&mut self, now: Micros) {
        self.timers.set_now(now);
    }

    /// Makes the client need a keyframe, whatever frame it holds.
    pub(crate) fn need_keyframe(&mut self) {
        self.drop_stale(false);
        self.position.holds = None;
        self.lagging = false;
        self.flight.clear();
        self.datagrams.clear();
    }

    fn acked(&mut self, ack: Ack) -> ServerEvent {
        let before = self.flight.len();
        let hash_matches = self.flight.acknowledge(&ack, self.timers.now());
        // Acknowledgements do not count against the client's frame rate, however fast the server sends.
        self.frames_left.refund(before - self.flight.len());
        if hash_matches {
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
