//! The clients of a server, shared by their connections and the frame loop.

use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use psao_codec::frame::{FrameInfo, FrameKind};
use tokio::sync::Notify;
use tokio::time::timeout;

use crate::message::{CameraPose, CloseCode, Edit, Report};
use crate::session::{SendError, Sent, ServerEvent, ServerSession, SessionError};
use crate::{FrameIndex, Limits, Micros, SceneTable};

/// Most events that wait for the frame loop; beyond it the oldest are forgotten.
const MAX_EVENTS: usize = 1024;

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
        peer: SocketAddr,
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
        peer: SocketAddr,
        /// Why, when it did not simply close.
        error: Option<SessionError>,
    },
}

/// What became of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Broadcast {
    /// Clients that get it as an update.
    pub updates: u32,
    /// Clients that get a keyframe instead.
    pub keyframes: u32,
    /// Clients that are behind and get a keyframe later.
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
    limits: Limits,
    inner: Mutex<Inner>,
    /// Something changed that a waiting frame loop may care about.
    changed: Notify,
}

#[derive(Debug, Default)]
struct Inner {
    clients: BTreeMap<ClientId, Slot>,
    events: VecDeque<HubEvent>,
    last_id: u64,
    closing: bool,
}

#[derive(Debug)]
struct Slot {
    peer: SocketAddr,
    session: ServerSession,
    /// Wakes the connection's writer.
    wake: Arc<Notify>,
    view: Option<CameraPose>,
    /// The newest frame that was sent and not acknowledged.
    owes: Option<FrameIndex>,
    error: Option<SessionError>,
}

impl Slot {
    fn heard(&mut self, event: ServerEvent) -> Option<HubEventKind> {
        match event {
            ServerEvent::Joined(hello) => return Some(HubEventKind::Joined(hello.name.to_string())),
            ServerEvent::Edit(edit) => return Some(HubEventKind::Edit(edit)),
            ServerEvent::View(view) => self.view = Some(view),
            ServerEvent::Acked(ack) => self.owes = self.owes.filter(|&frame| frame > ack.frame),
            // It will acknowledge the keyframe instead.
            ServerEvent::KeyframeWanted(_) | ServerEvent::Closed(_) => self.owes = None,
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
    /// A hub without clients.
    #[must_use]
    pub fn new(scene: Arc<SceneTable>, limits: Limits) -> Self {
        let shared = Shared { scene, limits, inner: Mutex::default(), changed: Notify::new() };
        Self { shared: Arc::new(shared) }
    }

    /// Gives a frame to every client. `body` goes to those that follow; whoever needs a keyframe gets what `keyframe`
    /// makes of the state after the frame. It is asked once, and only if some client needs it. A frame that is a
    /// keyframe itself goes to all.
    ///
    /// # Errors
    /// What `keyframe` fails with; the clients that need none have their update.
    pub fn broadcast<E>(
        &self,
        info: &FrameInfo,
        body: &[u8],
        keyframe: impl FnOnce() -> Result<Vec<u8>, E>,
    ) -> Result<Broadcast, E> {
        let is_key = info.kind == FrameKind::Key;
        let mut counts = Broadcast::default();
        let mut waiting = Vec::new();
        for (&id, slot) in &mut self.lock().clients {
            if !slot.session.is_joined() {
            } else if is_key {
                counts.keyframes += slot.give(info.frame, |session| session.send_keyframe(body));
            } else if slot.session.wants_keyframe() {
                waiting.push(id);
            } else {
                let sent = slot.give(info.frame, |session| session.send_update(body));
                counts.updates += sent;
                counts.behind += 1 - sent;
            }
        }
        if waiting.is_empty() {
            return Ok(counts);
        }
        // Made without the lock: it takes a while, and the connections go on meanwhile.
        let body = keyframe()?;
        let mut inner = self.lock();
        for id in waiting {
            if let Some(slot) = inner.clients.get_mut(&id) {
                counts.keyframes += slot.give(info.frame, |session| session.send_keyframe(&body));
            }
        }
        Ok(counts)
    }

    /// Gives a report to every client that is not behind.
    pub fn report(&self, report: &Report) {
        for slot in self.lock().clients.values_mut() {
            // A report that a client does not get is nobody's loss.
            let _ = slot.session.send_report(report);
            slot.wake.notify_one();
        }
    }

    /// What happened since the last call.
    #[must_use]
    pub fn take_events(&self) -> Vec<HubEvent> {
        self.lock().events.drain(..).collect()
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
        self.wait_until(|hub| hub.lock().clients.is_empty(), patience).await;
    }

    async fn wait_until(&self, done: impl Fn(&Self) -> bool, patience: Duration) -> bool {
        let waiting = async {
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
        };
        timeout(patience, waiting).await.is_ok() || done(self)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing panics under the lock; if something did, every slot is still whole.
        self.shared.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    // What follows is for the connections.

    /// Takes a connection in; the notify wakes its writer. Beyond the limit, or when the hub is closing, the client is
    /// told so.
    pub(super) fn add(&self, peer: SocketAddr) -> (ClientId, Arc<Notify>) {
        let mut inner = self.lock();
        inner.last_id += 1;
        let id = ClientId(inner.last_id);
        let mut session = ServerSession::new(self.shared.scene.clone(), self.shared.limits);
        let full = inner.clients.len() >= self.shared.limits.max_clients as usize;
        if full || inner.closing {
            let text = if full {
                "the server has as many clients as it takes; try later"
            } else {
                "the stream is over"
            };
            session.close(CloseCode::STOPPED, text);
        }
        let wake = Arc::new(Notify::new());
        let slot = Slot { peer, session, wake: wake.clone(), view: None, owes: None, error: None };
        inner.clients.insert(id, slot);
        (id, wake)
    }

    /// Bytes from a client; gives whether the session goes on.
    pub(super) fn received(&self, id: ClientId, bytes: &[u8], now: Micros) -> bool {
        let mut inner = self.lock();
        let Some(slot) = inner.clients.get_mut(&id) else { return false };
        let peer = slot.peer;
        let heard = match slot.session.handle(bytes, now) {
            Ok(events) => events.into_iter().filter_map(|event| slot.heard(event)).collect(),
            Err(error) => {
                slot.error.get_or_insert(error);
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

    /// Whether the client has joined, so its handshake has no deadline any more.
    pub(super) fn is_joined(&self, id: ClientId) -> bool {
        self.lock().clients.get(&id).is_some_and(|slot| slot.session.is_joined())
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

    pub(super) fn is_closing(&self) -> bool {
        self.lock().closing
    }
}

impl Slot {
    /// Sends something of `frame`; 1 if the client will get it, 0 if not. A client that cannot take it at all is closed.
    fn give(
        &mut self,
        frame: FrameIndex,
        send: impl FnOnce(&mut ServerSession) -> Result<Sent, SendError>,
    ) -> u32 {
        let result = send(&mut self.session);
        self.wake.notify_one();
        match result {
            Ok(Sent::Queued) => {
                self.owes = Some(frame);
                return 1;
            }
            Ok(Sent::Dropped) => {}
            Err(error) => self.session.close(CloseCode::FAILED, &error.to_string()),
        }
        self.owes = None;
        0
    }
}

impl Inner {
    fn tell(&mut self, event: HubEvent) {
        if self.events.len() >= MAX_EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }
}
