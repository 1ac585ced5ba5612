//! The clients of a server, shared by their connections and the frame loop.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameInfo};
use tokio::sync::Notify;
use tokio::time::{Instant, timeout};

use super::{Peer, PeerFault, since};
use crate::message::{Budget, CameraPose, CloseCode, Edit, Report, Token};
use crate::session::{Access, SendError, Sent, ServerEvent, ServerSession, SessionError};
use crate::{Fanout, FrameIndex, Limits, Micros, Offer, SceneTable};

/// Most events that wait for the frame loop; beyond it the oldest are forgotten, and counted.
const MAX_EVENTS: usize = 1024;
/// Connections over the limit of clients that are told so; further ones are dropped without a word.
const MAX_TOLD: usize = 64;

/// Number of a client: 1 for the first that connected, never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientId(pub u64);

/// What happened at a hub, for the frame loop and for people.
#[derive(Clone, Debug, PartialEq)]
pub enum HubEvent {
    /// A client was accepted.
    Joined {
        /// The client.
        client: ClientId,
        /// Where it is.
        peer: Peer,
        /// What it calls itself.
        name: String,
    },
    /// A client wants the scene changed.
    Edit {
        /// The client.
        client: ClientId,
        /// What it wants.
        edit: Edit,
    },
    /// A client, or something that was none, is gone.
    Left {
        /// The client.
        client: ClientId,
        /// Where it was.
        peer: Peer,
        /// Why, when it was not by a CLOSE of either end.
        error: Option<PeerFault>,
    },
    /// Connections cannot be accepted, as when the process has no file descriptor left. Told once until one can again.
    AcceptFailed {
        /// What the system says.
        what: String,
    },
    /// Connections that were dropped without a word, since so many were being turned away already.
    Dropped {
        /// How many since this was told last.
        connections: u64,
    },
    /// Events that are missing before the next, since nobody took them.
    Missed {
        /// How many.
        events: u64,
    },
}

/// What became of a frame.
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
/// Its methods never wait for a client, but for those whose name says so.
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
    /// Something changed that a waiting frame loop may care about.
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
    owes: Option<FrameIndex>,
    error: Option<PeerFault>,
}

impl Slot {
    fn heard(&mut self, event: ServerEvent) -> Option<HubEventKind> {
        match event {
            ServerEvent::Joined(hello) => return Some(HubEventKind::Joined(hello.name.to_string())),
            ServerEvent::Edit(edit) => return Some(HubEventKind::Edit(edit)),
            ServerEvent::View(view) => self.view = Some(view),
            ServerEvent::Acked(ack) => self.owes = self.owes.filter(|&frame| frame > ack.frame),
            // It will acknowledge the keyframe instead.
            ServerEvent::KeyframeWanted(_) | ServerEvent::Diverged(_) | ServerEvent::Closed(_) => {
                self.owes = None;
            }
        }
        None
    }
}

/// An event that lacks its client.
enum HubEventKind {
    Joined(String),
    Edit(Edit),
}

impl Hub {
    /// A hub without clients, for a stream before its first frame. `coder` is the stream's, for keyframes and patches.
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

    /// Gives a frame to every client: `body` to those that follow, and to the others what brings them to it, made once
    /// for all who stand in the same place. `state` is the server's after the frame, `captured` when the scene was as the
    /// frame has it, as [`now`](Self::now) had it then.
    ///
    /// # Errors
    /// [`EncodeError`] when a keyframe or patch cannot be made; the clients that need none have their update.
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
            let mut needs = BTreeSet::new();
            let now = self.now();
            let mut inner = self.lock();
            waiting.retain(|id| {
                let Some(slot) = inner.clients.get_mut(id) else { return false };
                slot.tick(now);
                let offer = slot.offer(&mut fanout, info.frame);
                counts.count(offer, slot.session.is_joined());
                needs.extend(match offer {
                    Offer::Needs(need) => Some(need),
                    _ => None,
                });
                matches!(offer, Offer::Needs(_))
            });
            // Made without the lock: it takes a while, and the connections go on meanwhile.
            drop(inner);
            for need in needs {
                fanout.make(need, state)?;
            }
        }
        Ok(counts)
    }

    /// Takes an edit that is part of the frames from the next on; every client hears of it.
    pub fn edit(&self, edit: &Edit) {
        self.shared.fanout.lock().unwrap_or_else(PoisonError::into_inner).edit(edit);
    }

    /// The time by the hub's clock: microseconds since it was made. Clients learn it from STAMPs and PONGs.
    #[must_use]
    pub fn now(&self) -> Micros {
        since(self.shared.started)
    }

    /// Gives a report to every client that is not behind.
    pub fn report(&self, report: &Report) {
        self.note(|session| session.send_report(report));
    }

    /// Tells every client that is not behind what a frame did with its byte budget.
    pub fn budget(&self, budget: &Budget) {
        self.note(|session| session.send_budget(budget));
    }

    fn note(&self, send: impl Fn(&mut ServerSession) -> Result<Sent, SendError>) {
        for slot in self.lock().clients.values_mut() {
            // A note that a client does not get is nobody's loss.
            let _ = send(&mut slot.session);
            slot.wake.notify_one();
        }
    }

    /// What happened since the last call.
    #[must_use]
    pub fn take_events(&self) -> Vec<HubEvent> {
        let mut inner = self.lock();
        let (missed, dropped) = (std::mem::take(&mut inner.missed), std::mem::take(&mut inner.dropped));
        let missed = (missed > 0).then_some(HubEvent::Missed { events: missed });
        let dropped = (dropped > 0).then_some(HubEvent::Dropped { connections: dropped });
        missed.into_iter().chain(inner.events.drain(..)).chain(dropped).collect()
    }

    /// Where the clients look from: one camera for each that said so.
    #[must_use]
    pub fn views(&self) -> Vec<CameraPose> {
        self.lock().clients.values().filter(|s| s.session.is_joined()).filter_map(|s| s.view).collect()
    }

    /// Clients that have joined and not left.
    #[must_use]
    pub fn joined(&self) -> usize {
        self.lock().clients.values().filter(|slot| slot.session.is_joined()).count()
    }

    /// Bytes that wait for all clients together.
    #[must_use]
    pub fn queued_bytes(&self) -> usize {
        self.lock().clients.values().map(|slot| slot.session.queued_bytes()).sum()
    }

    /// Waits until at least `count` clients have joined; gives whether they have.
    pub async fn wait_joined(&self, count: usize, patience: Duration) -> bool {
        self.wait_until(|_| self.joined() >= count, patience).await
    }

    /// Waits until no client owes an acknowledgement of `frame` or an earlier one; gives whether that is so. A client
    /// that fell behind, asked for a keyframe or left owes none.
    pub async fn wait_acked(&self, frame: FrameIndex, patience: Duration) -> bool {
        let acked = |slot: &Slot| !slot.session.is_joined() || slot.owes.is_none_or(|owed| owed > frame);
        self.wait_until(|hub| hub.lock().clients.values().all(acked), patience).await
    }

    /// Says goodbye to every client, takes no more, and waits until what they still get is sent, or for `patience`.
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
        // Nothing panics under the lock; if something did, every slot is still whole.
        self.shared.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    // What follows is for the connections.

    /// Takes a connection in; the notify wakes its writer. Beyond the limit, or when the hub is closing, the client is
    /// told so; nothing is given when too many are being told already.
    pub(super) fn add(&self, peer: Peer) -> Option<(ClientId, Arc<Notify>)> {
        let mut inner = self.lock();
        let limit = self.shared.limits.max_clients as usize;
        if inner.clients.len() >= limit.saturating_add(MAX_TOLD) {
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
        let error = full.then_some(PeerFault::TurnedAway { limit: self.shared.limits.max_clients });
        let wake = Arc::new(Notify::new());
        let slot = Slot { peer, session, wake: wake.clone(), view: None, owes: None, error };
        inner.clients.insert(id, slot);
        Some((id, wake))
    }

    /// Bytes from a client; gives whether the session goes on.
    pub(super) fn received(&self, id: ClientId, bytes: &[u8]) -> bool {
        let now = self.now();
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return false };
        let peer = slot.peer;
        let heard = match slot.session.handle(bytes, now) {
            Ok(events) => events.into_iter().filter_map(|event| slot.heard(event)).collect(),
            Err(error) => {
                slot.error.get_or_insert(PeerFault::session(error));
                Vec::new()
            }
        };
        slot.wake.notify_one();
        let goes_on = !slot.session.is_closed();
        for kind in heard {
            inner.tell(match kind {
                HubEventKind::Joined(name) => HubEvent::Joined { client: id, peer, name },
                HubEventKind::Edit(edit) => HubEvent::Edit { client: id, edit },
            });
        }
        drop(inner);
        self.shared.changed.notify_waiters();
        goes_on
    }

    /// The next bytes for a client, at most `limit`, and whether the session is over with them. They count as sent.
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

    /// Tells the client's session the time alone; gives whether it goes on.
    pub(super) fn tick(&self, id: ClientId) -> bool {
        let now = self.now();
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return false };
        slot.tick(now);
        slot.wake.notify_one();
        !slot.session.is_closed()
    }

    /// How long until the client's session wants to be told the time, if ever.
    pub(super) fn patience(&self, id: ClientId) -> Option<Duration> {
        let inner = self.lock();
        let deadline = inner.clients.get(&id)?.session.next_deadline()?;
        Some(Duration::from_micros(deadline.since(self.now()).0))
    }

    /// The connection ended or broke. Nothing goes on after it.
    pub(super) fn fault(&self, id: ClientId, fault: PeerFault) {
        if let Some(slot) = self.lock().clients.get_mut(&id) {
            slot.session.close(CloseCode::FAILED, "the connection broke");
            slot.error.get_or_insert(fault);
        }
    }

    /// Nothing more comes from the client; that is in order when either end has said goodbye.
    pub(super) fn disconnected(&self, id: ClientId) {
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return };
        if !slot.session.is_closed() {
            let unfinished = slot.session.unfinished_bytes();
            drop(inner);
            self.fault(id, PeerFault::Disconnected { unfinished });
        }
    }

    /// The client has taken nothing for [`Limits::stall`]: it is told so, should it wake.
    pub(super) fn stalled(&self, id: ClientId) {
        if let Some(slot) = self.lock().clients.get_mut(&id) {
            let error = SessionError::Stalled { waited: self.shared.limits.stall };
            slot.session.close(CloseCode::TIMEOUT, &error.to_string());
            slot.error.get_or_insert(PeerFault::Session(error));
        }
    }

    /// A connection could not be accepted.
    pub(super) fn accept_failed(&self, error: &std::io::Error) {
        self.lock().tell(HubEvent::AcceptFailed { what: error.to_string() });
    }

    /// The connection is gone.
    pub(super) fn remove(&self, id: ClientId) {
        let mut inner = self.lock();
        if let Some(slot) = inner.clients.remove(&id) {
            inner.tell(HubEvent::Left { client: id, peer: slot.peer, error: slot.error });
        }
        drop(inner);
        self.shared.changed.notify_waiters();
    }

    pub(super) fn limits(&self) -> Limits {
        self.shared.limits
    }

    /// The token that clients must show, if any.
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
    /// Tells the session the time.
    fn tick(&mut self, now: Micros) {
        if let Err(error) = self.session.tick(now) {
            self.error.get_or_insert(PeerFault::session(error));
        }
    }

    /// Gives the client the newest frame. One that cannot take it at all is closed.
    fn offer(&mut self, fanout: &mut Fanout, frame: FrameIndex) -> Offer {
        let offer = match fanout.offer(&mut self.session) {
            Ok(offer) => offer,
            Err(error) => {
                if !self.session.is_closed() {
                    self.session.close(CloseCode::FAILED, &error.to_string());
                    self.error.get_or_insert(PeerFault::Unservable(error));
                }
                Offer::Nothing
            }
        };
        match offer {
            Offer::Update | Offer::Keyframe | Offer::Patch => self.owes = Some(frame),
            Offer::Nothing => self.owes = None,
            Offer::Current | Offer::Needs(_) => {}
        }
        self.wake.notify_one();
        offer
    }
}

impl Broadcast {
    fn count(&mut self, offer: Offer, joined: bool) {
        match offer {
            Offer::Update => self.updates += 1,
            Offer::Keyframe => self.keyframes += 1,
            Offer::Patch => self.patches += 1,
            Offer::Nothing => self.behind += u32::from(joined),
            Offer::Current | Offer::Needs(_) => {}
        }
    }
}

impl Inner {
    fn tell(&mut self, event: HubEvent) {
        if self.events.len() >= MAX_EVENTS {
            self.events.pop_front();
            self.missed += 1;
        }
        self.events.push_back(event);
    }
}
