//! The clients of a server, shared by their connections and the frame loop.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameInfo};
use tokio::sync::Notify;
use tokio::time::{Instant, timeout};

use super::{Peer, PeerError, elapsed_since};
use crate::message::{Budget, CameraPose, CloseCode, Edit, Report, Token};
use crate::session::{Access, SendError, ServerEvent, ServerSession, SessionError};
use crate::{Delivery, Fanout, FrameIndex, Limits, Micros, SceneTable};

/// Largest number of events that wait for the frame loop. Beyond it the oldest are dropped and counted.
const MAX_EVENTS: usize = 1024;
/// How many rejected connections may be told `BUSY` at a time. Beyond that, new ones are closed without a reply.
const MAX_REJECTING: usize = 64;

/// Number of a client: 1 for the first that connected, never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientId(pub u64);

/// Event of a hub, for the frame loop and for logs.
#[derive(Clone, Debug, PartialEq)]
pub enum HubEvent {
    /// A client was accepted.
    Joined {
        /// The client.
        client: ClientId,
        /// Its address.
        peer: Peer,
        /// Its name for itself.
        name: String,
    },
    /// A client asks for an edit of the scene.
    Edit {
        /// The client.
        client: ClientId,
        /// The requested edit.
        edit: Edit,
    },
    /// A connection ended, whether or not its client had joined.
    Left {
        /// The client.
        client: ClientId,
        /// Its address.
        peer: Peer,
        /// Why, unless either end sent a CLOSE.
        error: Option<PeerError>,
    },
    /// Connections cannot be accepted, for example because the process has no file descriptor left. Reported once,
    /// until one is accepted again.
    AcceptFailed {
        /// The system's message.
        what: String,
    },
    /// Connections were closed without a reply, because too many were being rejected already.
    Dropped {
        /// Their number since the last such event.
        connections: u64,
    },
    /// Events were dropped before the next one, because nobody took them.
    Missed {
        /// Their number.
        events: u64,
    },
}

/// Numbers of clients by what they get of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Broadcast {
    /// Clients that get it as an update.
    pub updates: u32,
    /// Clients that get a keyframe.
    pub keyframes: u32,
    /// Clients that fell behind and get the newest values of what they missed.
    pub patches: u32,
    /// Clients that are behind and get what they missed later.
    pub behind: u32,
}

/// The clients of one stream. Cloning it gives another handle to the same clients.
///
/// Only methods named `wait_...` and [`close`](Self::close) wait for clients.
#[derive(Clone, Debug)]
pub struct Hub {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    scene: Arc<SceneTable>,
    access: Access,
    limits: Limits,
    started: Instant,
    /// Taken before `inner` where both are.
    fanout: Mutex<Fanout>,
    inner: Mutex<Inner>,
    /// Notified when a client joins, leaves or acknowledges.
    changed: Notify,
}

#[derive(Debug, Default)]
struct Inner {
    clients: BTreeMap<ClientId, Slot>,
    events: VecDeque<HubEvent>,
    /// Events that were forgotten, connections that were dropped, since the last time that events were taken.
    missed: u64,
    dropped: u64,
    last_id: u64,
    closing: bool,
}

#[derive(Debug)]
struct Slot {
    peer: Peer,
    session: ServerSession,
    /// Wakes the connection's writer.
    wake: Arc<Notify>,
    view: Option<CameraPose>,
    /// The newest frame that was sent and not acknowledged.
    unacked: Option<FrameIndex>,
    error: Option<PeerError>,
}

impl Slot {
    /// Processes an event of the session of `client`. Returns the event for the frame loop, if there is one.
    fn heard(&mut self, client: ClientId, event: ServerEvent) -> Option<HubEvent> {
        match event {
            ServerEvent::Joined(hello) => {
                return Some(HubEvent::Joined { client, peer: self.peer, name: hello.name.to_string() });
            }
            ServerEvent::Edit(edit) => return Some(HubEvent::Edit { client, edit }),
            ServerEvent::View(view) => self.view = Some(view),
            ServerEvent::Acked(ack) => self.unacked = self.unacked.filter(|&frame| frame > ack.frame),
            // It will acknowledge the keyframe instead.
            ServerEvent::KeyframeWanted(_) | ServerEvent::Diverged(_) | ServerEvent::Closed(_) => {
                self.unacked = None;
            }
        }
        None
    }
}

impl Hub {
    /// Creates a hub without clients, for a stream before its first frame. `coder` is the stream's, for keyframes and
    /// patches.
    #[must_use]
    pub fn new(scene: Arc<SceneTable>, coder: BlockCoder, access: Access, limits: Limits) -> Self {
        let shared = Shared {
            scene,
            access,
            limits,
            started: Instant::now(),
            fanout: Mutex::new(Fanout::new(coder)),
            inner: Mutex::default(),
            changed: Notify::new(),
        };
        Self { shared: Arc::new(shared) }
    }

    /// Gives a frame to every client. Clients in sync get `body`; the others get what brings them to it, made once for
    /// all clients at the same position. `state` is the server's after the frame, `captured` the time that the frame
    /// shows, by [`now`](Self::now).
    ///
    /// # Errors
    /// [`EncodeError`] when a keyframe or patch cannot be made. Clients that need neither have their update.
    pub fn broadcast(
        &self,
        info: &FrameInfo,
        body: impl Into<Arc<[u8]>>,
        state: StateRef<'_>,
        captured: Micros,
    ) -> Result<Broadcast, EncodeError> {
        let mut fanout = self.shared.fanout.lock().unwrap_or_else(PoisonError::into_inner);
        fanout.advance(info, body, state, captured);
        let mut counts = Broadcast::default();
        let mut waiting: Vec<ClientId> = self.lock().clients.keys().copied().collect();
        while !waiting.is_empty() {
            let mut missing = BTreeSet::new();
            let now = self.now();
            let mut inner = self.lock();
            waiting.retain(|id| {
                let Some(slot) = inner.clients.get_mut(id) else { return false };
                slot.tick(now);
                let delivery = slot.deliver(&mut fanout, info.frame);
                counts.count(delivery, slot.session.is_joined());
                let Delivery::Missing(demand) = delivery else { return false };
                missing.insert(demand);
                true
            });
            // Made without the lock: it takes a while, and the connections go on meanwhile.
            drop(inner);
            for demand in missing {
                fanout.make(demand, state)?;
            }
        }
        Ok(counts)
    }

    /// Takes an edit that all frames from the next one on include. Every client gets the edit.
    pub fn edit(&self, edit: &Edit) {
        self.shared.fanout.lock().unwrap_or_else(PoisonError::into_inner).edit(edit);
    }

    /// Returns the time by the hub's clock: microseconds since it was created. Clients learn it from STAMPs and PONGs.
    #[must_use]
    pub fn now(&self) -> Micros {
        elapsed_since(self.shared.started)
    }

    /// Gives a report to every client that is not behind.
    pub fn report(&self, report: &Report) {
        self.note(|session| session.send_report(report));
    }

    /// Gives the use of the byte budget by a frame to every client that is not behind.
    pub fn budget(&self, budget: &Budget) {
        self.note(|session| session.send_budget(budget));
    }

    fn note(&self, send: impl Fn(&mut ServerSession) -> Result<bool, SendError>) {
        for slot in self.lock().clients.values_mut() {
            // A client works without these messages, so errors are ignored.
            let _ = send(&mut slot.session);
            slot.wake.notify_one();
        }
    }

    /// Returns the events since the last call.
    #[must_use]
    pub fn take_events(&self) -> Vec<HubEvent> {
        let mut inner = self.lock();
        let (missed, dropped) = (std::mem::take(&mut inner.missed), std::mem::take(&mut inner.dropped));
        let missed = (missed > 0).then_some(HubEvent::Missed { events: missed });
        let dropped = (dropped > 0).then_some(HubEvent::Dropped { connections: dropped });
        missed.into_iter().chain(inner.events.drain(..)).chain(dropped).collect()
    }

    /// Returns the cameras of the clients that sent one.
    #[must_use]
    pub fn views(&self) -> Vec<CameraPose> {
        self.lock().clients.values().filter(|s| s.session.is_joined()).filter_map(|s| s.view).collect()
    }

    /// Returns the number of clients that have joined and did not leave.
    #[must_use]
    pub fn joined(&self) -> usize {
        self.lock().clients.values().filter(|slot| slot.session.is_joined()).count()
    }

    /// Returns the number of bytes that wait for all clients together.
    #[must_use]
    pub fn queued_bytes(&self) -> usize {
        self.lock().clients.values().map(|slot| slot.session.queued_bytes()).sum()
    }

    /// Waits until at least `count` clients have joined, or for `patience`. Returns whether they have joined.
    pub async fn wait_joined(&self, count: usize, patience: Duration) -> bool {
        self.wait_until(|_| self.joined() >= count, patience).await
    }

    /// Waits until every client has acknowledged `frame` and the ones before it, or for `patience`. Returns whether
    /// they have. It does not wait for clients that fell behind, asked for a keyframe or left.
    pub async fn wait_acked(&self, frame: FrameIndex, patience: Duration) -> bool {
        let acked = |slot: &Slot| !slot.session.is_joined() || slot.unacked.is_none_or(|owed| owed > frame);
        self.wait_until(|hub| hub.lock().clients.values().all(acked), patience).await
    }

    /// Closes every session and takes no more clients. Waits until the last bytes are sent, or for `patience`.
    pub async fn close(&self, code: CloseCode, text: &str, patience: Duration) {
        {
            let mut inner = self.lock();
            inner.closing = true;
            for slot in inner.clients.values_mut() {
                slot.session.close(code, text);
                slot.wake.notify_one();
            }
        }
        self.shared.changed.notify_waiters();
        self.wait_until(|hub| hub.lock().clients.is_empty(), patience).await;
    }

    async fn wait_until(&self, done: impl Fn(&Self) -> bool, patience: Duration) -> bool {
        timeout(patience, self.until(&done)).await.is_ok() || done(self)
    }

    async fn until(&self, done: impl Fn(&Self) -> bool) {
        loop {
            let changed = self.shared.changed.notified();
            tokio::pin!(changed);
            // Listening starts before looking, so that no change in between is missed.
            changed.as_mut().enable();
            if done(self) {
                return;
            }
            changed.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // No code panics while it holds the lock. If one did, every slot would still be valid.
        self.shared.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    // The methods below are for the connections.

    /// Takes a connection; the notify wakes its writer. Beyond the limit, or when the hub is closing, the client is
    /// rejected. Returns `None` when too many are being rejected already.
    pub(super) fn add(&self, peer: Peer) -> Option<(ClientId, Arc<Notify>)> {
        let mut inner = self.lock();
        let limit = self.shared.limits.max_clients as usize;
        if inner.clients.len() >= limit.saturating_add(MAX_REJECTING) {
            inner.dropped += 1;
            return None;
        }
        inner.last_id += 1;
        let id = ClientId(inner.last_id);
        let mut session =
            ServerSession::new(self.shared.scene.clone(), self.shared.access.clone(), self.shared.limits);
        let full = inner.clients.len() >= limit;
        let turned_away = if full {
            Some("the server has as many clients as it takes; try later")
        } else {
            inner.closing.then_some("the stream is over")
        };
        if let Some(text) = turned_away {
            session.close(CloseCode::STOPPED, text);
        }
        let error = full.then_some(PeerError::TurnedAway { limit: self.shared.limits.max_clients });
        let wake = Arc::new(Notify::new());
        let slot = Slot { peer, session, wake: wake.clone(), view: None, unacked: None, error };
        inner.clients.insert(id, slot);
        Some((id, wake))
    }

    /// Processes bytes from a client. Returns whether the session is still open.
    pub(super) fn received(&self, id: ClientId, bytes: &[u8]) -> bool {
        let now = self.now();
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return false };
        let heard: Vec<HubEvent> = match slot.session.handle(bytes, now) {
            Ok(events) => events.into_iter().filter_map(|event| slot.heard(id, event)).collect(),
            Err(error) => {
                slot.error.get_or_insert(PeerError::session(error));
                Vec::new()
            }
        };
        slot.wake.notify_one();
        let goes_on = !slot.session.is_closed();
        for event in heard {
            inner.push_event(event);
        }
        drop(inner);
        self.shared.changed.notify_waiters();
        goes_on
    }

    /// Returns the next bytes for a client, at most `limit`, and whether they are the last. They count as sent.
    pub(super) fn take_output(&self, id: ClientId, limit: usize) -> (Vec<u8>, bool) {
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return (Vec::new(), true) };
        let mut out = Vec::new();
        while out.len() < limit && !slot.session.output().is_empty() {
            let front = slot.session.output();
            let count = front.len().min(limit - out.len());
            out.extend_from_slice(front.get(..count).unwrap_or_default());
            slot.session.advance(count);
        }
        (out, slot.session.is_closed() && slot.session.output().is_empty())
    }

    /// Sets the time of the client's session. Returns whether the session is still open.
    pub(super) fn tick(&self, id: ClientId) -> bool {
        let now = self.now();
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return false };
        slot.tick(now);
        slot.wake.notify_one();
        !slot.session.is_closed()
    }

    /// Returns the time until the deadline of the client's session, if it has one.
    pub(super) fn time_to_deadline(&self, id: ClientId) -> Option<Duration> {
        let inner = self.lock();
        let deadline = inner.clients.get(&id)?.session.next_deadline()?;
        Some(Duration::from_micros(deadline.since(self.now()).0))
    }

    /// Records why a connection ended or broke.
    pub(super) fn fault(&self, id: ClientId, fault: PeerError) {
        if let Some(slot) = self.lock().clients.get_mut(&id) {
            slot.session.close(CloseCode::FAILED, "the connection broke");
            slot.error.get_or_insert(fault);
        }
    }

    /// Ends a client that sends no more. That is an error unless either end has sent a CLOSE.
    pub(super) fn disconnected(&self, id: ClientId) {
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return };
        if !slot.session.is_closed() {
            let unfinished = slot.session.unfinished_bytes();
            drop(inner);
            self.fault(id, PeerError::Disconnected { unfinished });
        }
    }

    /// Closes a client that took no bytes for [`Limits::stall`].
    pub(super) fn stalled(&self, id: ClientId) {
        if let Some(slot) = self.lock().clients.get_mut(&id) {
            let error = SessionError::Stalled { waited: self.shared.limits.stall };
            slot.session.close(CloseCode::TIMEOUT, &error.to_string());
            slot.error.get_or_insert(PeerError::Session(error));
        }
    }

    /// Reports that a connection could not be accepted.
    pub(super) fn accept_failed(&self, error: &std::io::Error) {
        self.lock().push_event(HubEvent::AcceptFailed { what: error.to_string() });
    }

    /// Removes a connection that has ended.
    pub(super) fn remove(&self, id: ClientId) {
        let mut inner = self.lock();
        if let Some(slot) = inner.clients.remove(&id) {
            inner.push_event(HubEvent::Left { client: id, peer: slot.peer, error: slot.error });
        }
        drop(inner);
        self.shared.changed.notify_waiters();
    }

    pub(super) fn limits(&self) -> Limits {
        self.shared.limits
    }

    /// Returns the token that clients must show, if any.
    pub(super) fn token(&self) -> Option<&Token> {
        match &self.shared.access {
            Access::Token(token) => Some(token),
            Access::Open => None,
        }
    }

    /// Waits until the hub takes no more clients.
    pub(super) async fn closing(&self) {
        self.until(|hub| hub.lock().closing).await;
    }
}

impl Slot {
    /// Sets the time of the session.
    fn tick(&mut self, now: Micros) {
        if let Err(error) = self.session.tick(now) {
            self.error.get_or_insert(PeerError::session(error));
        }
    }

    /// Gives the client the newest frame. One that cannot take it at all is closed.
    fn deliver(&mut self, fanout: &mut Fanout, frame: FrameIndex) -> Delivery {
        let delivery = match fanout.deliver(&mut self.session) {
            Ok(delivery) => delivery,
            Err(error) => {
                if !self.session.is_closed() {
                    self.session.close(CloseCode::FAILED, &error.to_string());
                    self.error.get_or_insert(PeerError::Unservable(error));
                }
                Delivery::Nothing
            }
        };
        match delivery {
            Delivery::Update | Delivery::Keyframe | Delivery::Patch => self.unacked = Some(frame),
            Delivery::Nothing => self.unacked = None,
            Delivery::Current | Delivery::Missing(_) => {}
        }
        self.wake.notify_one();
        delivery
    }
}

impl Broadcast {
    fn count(&mut self, delivery: Delivery, joined: bool) {
        match delivery {
            Delivery::Update => self.updates += 1,
            Delivery::Keyframe => self.keyframes += 1,
            Delivery::Patch => self.patches += 1,
            Delivery::Nothing => self.behind += u32::from(joined),
            Delivery::Current | Delivery::Missing(_) => {}
        }
    }
}

impl Inner {
    fn push_event(&mut self, event: HubEvent) {
        if self.events.len() >= MAX_EVENTS {
            self.events.pop_front();
            self.missed += 1;
        }
        self.events.push_back(event);
    }
}
