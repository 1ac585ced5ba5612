//! One stream for many clients: a body is encoded once and sent to every client at the same position.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameInfo, FrameKind, FrameMeta};
use psao_codec::{ChangeLog, StateRef, keyframe, patch};

use crate::message::{Edit, EditAction};
use crate::session::{Demand, SendError, ServerSession, SharedBody};
use crate::{FrameIndex, Micros};

/// Result of giving one client the newest frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The client gets the stream's own update.
    Update,
    /// The client gets a keyframe, followed by a patch if the keyframe is of an earlier frame.
    Keyframe,
    /// The client gets a patch with the newest values of what it missed.
    Patch,
    /// The client gets nothing. It did not join yet, has left, or must first take the bytes that wait for it.
    Nothing,
    /// The client has the newest frame already.
    Current,
    /// The body for this demand is missing; [`Fanout::make`] makes it.
    Missing(Demand),
}

/// Position of one client in a [`Fanout`], stored in its session.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ClientCursor {
    /// Number of the last edit that was sent to the client.
    edits: u64,
    /// Epoch of the frames that the client holds.
    epoch: u32,
}

/// The newest frame.
#[derive(Clone, Debug)]
struct Newest {
    info: FrameInfo,
    body: SharedBody,
    /// The frame before it.
    previous: Option<FrameIndex>,
}

/// Brings each client to the newest frame. Clients in sync get the stream's own update, clients that fell behind get a
/// patch, and joining clients get a keyframe. Every body is made at most once per frame, whatever the number of
/// clients.
///
/// One change log for all clients, of 5 bytes per point, determines the content of patches. Nothing is kept for a
/// client that takes no bytes. A keyframe that was made for one joiner serves later ones too, followed by a patch. It
/// is replaced once that patch is larger than half of it.
///
/// ```
/// use psao_proto::sample::SampleServer;
/// use psao_proto::session::{Access, ClientEvent, ClientSession, ServerSession, SharedBody};
/// use psao_proto::{Delivery, Fanout, Limits, Micros, Profile};
///
/// let mut source = SampleServer::of(Profile::SURFACE)?; // in place of a tracer
/// let mut fanout = Fanout::new(source.coder());
/// let mut server = ServerSession::new(source.scene().clone(), Access::Open, Limits::default());
/// let mut client = ClientSession::new(Limits::default());
/// let mut deliveries = Vec::new();
/// for turn in 0..8 {
///     let now = Micros(turn * 16_667);
///     let frame = source.step()?;
///     fanout.advance(&frame.info, frame.body, source.state().into(), now);
///     // The client hangs for three frames; then one patch brings it up to date.
///     if !(3..6).contains(&turn) {
///         server.handle(&client.take_output(), now)?;
///         deliveries.push(fanout.give(&mut server, source.state().into())?);
///         client.handle(&server.take_output(), now)?;
///     }
/// }
/// assert_eq!(deliveries, [Delivery::Keyframe, Delivery::Update, Delivery::Update, Delivery::Patch, Delivery::Update]);
/// assert_eq!(client.state().map(|state| state.hash()), Some(source.state().hash()));
/// # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
/// ```
#[derive(Debug)]
pub struct Fanout {
    coder: BlockCoder,
    log: Option<ChangeLog>,
    newest: Option<Newest>,
    /// The keyframe for clients that join: of the newest frame, or of one from which a patch leads to it.
    join_keyframe: Option<SharedBody>,
    /// Whether the patch on top of the cached keyframe has become too large, so that the next joiner gets a new
    /// keyframe.
    join_keyframe_stale: bool,
    /// Patches to the newest frame, by their base and whether they have coder context. `None` if only a keyframe helps.
    patches: BTreeMap<(FrameIndex, bool), Option<SharedBody>>,
    /// Number of times that frame numbers restarted, as in a recording that is played in a loop. A client cannot use a
    /// frame of an earlier epoch.
    epoch: u32,
    edits: EditLog,
}

/// Why a client could not be given a frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FanoutError {
    /// The session refused the frame.
    #[error(transparent)]
    Send(#[from] SendError),
    /// A body could not be encoded.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

impl Fanout {
    /// Creates a fan-out for a stream before its first frame. `coder` is the stream's, for keyframes and patches.
    #[must_use]
    pub fn new(coder: BlockCoder) -> Self {
        Self {
            coder,
            log: None,
            newest: None,
            join_keyframe: None,
            join_keyframe_stale: false,
            patches: BTreeMap::new(),
            epoch: 0,
            edits: EditLog::default(),
        }
    }

    /// Takes the next frame: its header, its body and the server's state after it. `captured` is the time that the
    /// frame shows, by the clock of the sessions.
    pub fn advance(
        &mut self,
        info: &FrameInfo,
        body: impl Into<Arc<[u8]>>,
        state: StateRef<'_>,
        captured: Micros,
    ) {
        let body = SharedBody::new(info, body, captured);
        let previous = self.newest.as_ref().map(|newest| newest.info.frame);
        match &mut self.log {
            Some(log) => log.record(state),
            None => self.log = Some(ChangeLog::new(state)),
        }
        self.patches.clear();
        self.epoch += u32::from(previous.is_some_and(|previous| info.frame <= previous));
        if info.kind == FrameKind::Key {
            self.join_keyframe = Some(body.clone());
        } else if let (Some(log), Some(joining)) = (&self.log, &self.join_keyframe)
            && (self.join_keyframe_stale || !log.reaches(joining.frame))
        {
            self.join_keyframe = None;
        }
        self.join_keyframe_stale = false;
        self.newest = Some(Newest { info: info.clone(), body, previous });
    }

    /// Takes an edit that all frames from the next one on include. Every client gets the edit before these frames.
    pub fn edit(&mut self, edit: &Edit) {
        self.edits.push(edit);
    }

    /// Gives a client the newest frame and makes the bodies that it needs. `state` is the one of the last
    /// [`advance`](Self::advance).
    ///
    /// # Errors
    /// [`FanoutError::Send`] when the session is over or does not take the frame, [`FanoutError::Encode`] when a body
    /// cannot be made.
    pub fn give(
        &mut self,
        session: &mut ServerSession,
        state: StateRef<'_>,
    ) -> Result<Delivery, FanoutError> {
        loop {
            match self.deliver(session)? {
                Delivery::Missing(demand) => self.make(demand, state)?,
                delivery => return Ok(delivery),
            }
        }
    }

    /// Gives a client the newest frame, or returns [`Delivery::Missing`] when a body must be made first. A caller that
    /// holds a lock over the sessions can thus make bodies outside the lock.
    ///
    /// # Errors
    /// [`SendError`] when the session is over or does not take the frame.
    pub fn deliver(&mut self, session: &mut ServerSession) -> Result<Delivery, SendError> {
        let Some(newest) = &self.newest else { return Ok(Delivery::Nothing) };
        if std::mem::replace(&mut session.cursor.epoch, self.epoch) != self.epoch {
            session.need_keyframe();
        }
        session.set_now(newest.body.captured);
        let mut joined = false;
        loop {
            let demand = session.demand();
            let (missing, base, context) = match demand {
                Demand::Nothing => return Ok(Delivery::Nothing),
                Demand::Keyframe => {
                    let Some(joining) = &self.join_keyframe else { return Ok(Delivery::Missing(demand)) };
                    let whole = joining.frame == newest.info.frame || session.takes_datagrams();
                    if !whole && !self.patches.contains_key(&(joining.frame, true)) {
                        return Ok(Delivery::Missing(Demand::Patch { base: joining.frame }));
                    }
                    self.edits.send_new(session)?;
                    if !session.send_keyframe(joining)? {
                        return Ok(Delivery::Nothing);
                    }
                    joined = true;
                    continue;
                }
                Demand::Update { base } | Demand::Patch { base } | Demand::Datagrams { base }
                    if base >= newest.info.frame =>
                {
                    return Ok(if joined { Delivery::Keyframe } else { Delivery::Current });
                }
                Demand::Update { base } if Some(base) == newest.previous => {
                    self.edits.send_new(session)?;
                    if newest.body.kind == FrameKind::Key {
                        session.send_keyframe(&newest.body)?;
                        return Ok(Delivery::Keyframe);
                    }
                    let sent = session.send_update(&newest.body, base)?;
                    return Ok(if sent { Delivery::Update } else { Delivery::Nothing });
                }
                Demand::Update { base } | Demand::Patch { base } => (Demand::Patch { base }, base, true),
                Demand::Datagrams { base } => (demand, base, false),
            };
            let Some(made) = self.patches.get(&(base, context)) else {
                return Ok(Delivery::Missing(missing));
            };
            self.edits.send_new(session)?;
            let Some(patch) = made else {
                // No patch leads from the client's frame to the newest one.
                session.need_keyframe();
                continue;
            };
            let sent = match demand {
                Demand::Datagrams { .. } => session.send_datagrams(patch, base)?,
                _ => session.send_update(patch, base)?,
            };
            return Ok(match sent {
                // The body may be too large for datagrams.
                false if session.demand() != demand => continue,
                false => Delivery::Nothing,
                true if joined => Delivery::Keyframe,
                true => Delivery::Patch,
            });
        }
    }

    /// Makes the body of the newest frame that a demand needs. `state` is the one of the last
    /// [`advance`](Self::advance).
    ///
    /// # Errors
    /// [`EncodeError`] of the codec's `keyframe` and `patch`.
    pub fn make(&mut self, demand: Demand, state: StateRef<'_>) -> Result<(), EncodeError> {
        let (Some(newest), Some(log)) = (&self.newest, &self.log) else { return Ok(()) };
        let FrameInfo { frame, time, changed_points, .. } = newest.info;
        let meta = |kind| FrameMeta { kind, frame, time, changed_points };
        let shared = |kind, bytes: Vec<u8>| {
            let (hash, captured) = (newest.info.hash, newest.body.captured);
            SharedBody { kind, frame, hash, captured, bytes: bytes.into() }
        };
        let (base, context) = match demand {
            Demand::Nothing => return Ok(()),
            Demand::Keyframe => {
                let bytes = keyframe(state, meta(FrameKind::Key), self.coder, &[])?;
                self.join_keyframe = Some(shared(FrameKind::Key, bytes));
                return Ok(());
            }
            Demand::Update { base } | Demand::Patch { base } => (base, true),
            Demand::Datagrams { base } => (base, false),
        };
        let bytes = patch(state, log, base, meta(FrameKind::Delta), self.coder, context)?;
        let made = bytes.map(|bytes| shared(FrameKind::Delta, bytes));
        let old = self.join_keyframe.as_ref().filter(|joining| joining.frame == base);
        if let (Some(made), Some(joining)) = (&made, old)
            && made.bytes.len() > joining.bytes.len() / 2
        {
            self.join_keyframe_stale = true;
        }
        self.patches.insert((base, context), made);
        Ok(())
    }
}

/// The edits in force, each with its number among all edits.
#[derive(Clone, Debug, Default)]
struct EditLog {
    /// Newest last. An instance has at most one edit of its pose and one of its visibility.
    entries: VecDeque<(u64, Edit)>,
    count: u64,
}

impl EditLog {
    fn push(&mut self, edit: &Edit) {
        let moves = |edit: &Edit| matches!(edit.action, EditAction::Move { .. } | EditAction::Release);
        self.entries.retain(|(_, old)| old.instance != edit.instance || moves(old) != moves(edit));
        self.count += 1;
        self.entries.push_back((self.count, *edit));
    }

    /// Sends a client the edits that it did not get yet.
    fn send_new(&self, session: &mut ServerSession) -> Result<(), SendError> {
        for (number, edit) in &self.entries {
            if *number > session.cursor.edits {
                session.send_edit(edit)?;
            }
        }
        session.cursor.edits = self.count;
        Ok(())
    }
}
