//! One stream for many clients: what is encoded once is sent to all who stand in the same place.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameInfo, FrameKind, FrameMeta};
use psao_codec::{ChangeLog, StateRef, keyframe, patch};

use crate::message::{Edit, EditAction};
use crate::session::{SendError, Sent, ServerSession, SharedBody, Wants};
use crate::{FrameIndex, Micros};

/// What became of the newest frame for one client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// It gets the stream's own update.
    Update,
    /// It gets a keyframe, and what has changed since that was made.
    Keyframe,
    /// It gets the newest values of what it missed.
    Patch,
    /// It gets nothing: it has not joined, has left, or is behind and has to take what waits first.
    Nothing,
    /// It has the newest frame already.
    Current,
    /// A body has to be made first, by [`Fanout::make`].
    Needs(Need),
}

/// A body that some clients need beside the stream's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Need {
    /// A keyframe of the newest frame.
    Keyframe,
    /// What has changed since a frame.
    Patch {
        /// The frame.
        base: FrameIndex,
        /// Whether the stream's own updates are to follow it.
        context: bool,
    },
}

/// The newest frame.
#[derive(Clone, Debug)]
struct Newest {
    info: FrameInfo,
    body: SharedBody,
    /// The frame before it.
    previous: Option<FrameIndex>,
}

/// Gives each client what brings it to the newest frame: the stream's own update to all who follow, a patch to whoever
/// fell behind, a keyframe to whoever joins. Every body is made at most once a frame, whatever the number of clients.
///
/// What clients missed is known from one change log for all of them, 5 bytes a point; nothing is kept for a client that takes
/// nothing. A keyframe that was made for one joiner serves later ones too, with a patch behind it, until the patch
/// grows to half of it.
///
/// ```
/// use psao_proto::sample::SampleServer;
/// use psao_proto::session::{Access, ClientEvent, ClientSession, ServerSession, SharedBody};
/// use psao_proto::{Fanout, Limits, Micros, Offer, Profile};
///
/// let mut source = SampleServer::of(Profile::SURFACE)?; // stands for the thing that traces
/// let mut fanout = Fanout::new(source.coder());
/// let mut server = ServerSession::new(source.scene().clone(), Access::Open, Limits::default());
/// let mut client = ClientSession::new(Limits::default());
/// let mut offers = Vec::new();
/// for turn in 0..8 {
///     let now = Micros(turn * 16_667);
///     let frame = source.step()?;
///     fanout.advance(&frame.info, frame.body, source.state().into(), now);
///     // The client hangs for three frames; what it missed comes in one.
///     if !(3..6).contains(&turn) {
///         server.handle(&client.take_output(), now)?;
///         offers.push(fanout.give(&mut server, source.state().into())?);
///         client.handle(&server.take_output(), now)?;
///     }
/// }
/// assert_eq!(offers, [Offer::Keyframe, Offer::Update, Offer::Update, Offer::Patch, Offer::Update]);
/// assert_eq!(client.state().map(|state| state.hash()), Some(source.state().hash()));
/// # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
/// ```
#[derive(Debug)]
pub struct Fanout {
    coder: BlockCoder,
    log: Option<ChangeLog>,
    newest: Option<Newest>,
    /// A keyframe for whoever joins: of the newest frame, or of one from which a patch leads to it.
    joining: Option<SharedBody>,
    /// The patch from it has grown: the next frame's joiners get a new one.
    joining_is_worn: bool,
    /// What was made for the newest frame; nothing where only a keyframe helps.
    patches: BTreeMap<Need, Option<SharedBody>>,
    /// How often frame numbers began again, as in a recording that is played over and over: what a client holds of an
    /// earlier round is of no use.
    round: u32,
    edits: EditLog,
}

/// Why a client could not be given a frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FanoutError {
    /// The session does not take it.
    #[error(transparent)]
    Send(#[from] SendError),
    /// A body could not be made.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

impl Fanout {
    /// Of a stream before its first frame. `coder` is the stream's, for keyframes and patches.
    #[must_use]
    pub fn new(coder: BlockCoder) -> Self {
        Self {
            coder,
            log: None,
            newest: None,
            joining: None,
            joining_is_worn: false,
            patches: BTreeMap::new(),
            round: 0,
            edits: EditLog::default(),
        }
    }

    /// Takes the next frame: its header, its body and the server's state after it. `captured` is when the scene was as
    /// the frame has it, by the clock that the sessions are told.
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
        self.round += u32::from(previous.is_some_and(|previous| info.frame <= previous));
        if info.kind == FrameKind::Key {
            self.joining = Some(body.clone());
        } else if let (Some(log), Some(joining)) = (&self.log, &self.joining)
            && (self.joining_is_worn || !log.reaches(joining.frame))
        {
            self.joining = None;
        }
        self.joining_is_worn = false;
        self.newest = Some(Newest { info: info.clone(), body, previous });
    }

    /// Takes an edit that is part of the frames from the next on; every client hears of it before the first of them.
    pub fn edit(&mut self, edit: &Edit) {
        self.edits.push(edit);
    }

    /// Gives a client the newest frame, and makes what that takes. `state` is the one of the last
    /// [`advance`](Self::advance).
    ///
    /// # Errors
    /// [`FanoutError::Send`] when the session is over or does not take the frame, [`FanoutError::Encode`] when a body
    /// cannot be made.
    pub fn give(&mut self, session: &mut ServerSession, state: StateRef<'_>) -> Result<Offer, FanoutError> {
        loop {
            match self.offer(session)? {
                Offer::Needs(need) => self.make(need, state)?,
                offer => return Ok(offer),
            }
        }
    }

    /// Gives a client the newest frame if what that takes is there, or says what has to be made: for whoever holds a
    /// lock over the sessions and makes nothing under it.
    ///
    /// # Errors
    /// [`SendError`] when the session is over or does not take the frame.
    pub fn offer(&mut self, session: &mut ServerSession) -> Result<Offer, SendError> {
        let Some(newest) = &self.newest else { return Ok(Offer::Nothing) };
        if std::mem::replace(&mut session.round, self.round) != self.round {
            session.need_keyframe();
        }
        session.tell(newest.body.captured);
        let mut joined = false;
        loop {
            let wants = session.wants();
            let (need, base) = match wants {
                Wants::Nothing => return Ok(Offer::Nothing),
                Wants::Keyframe => {
                    let Some(joining) = &self.joining else { return Ok(Offer::Needs(Need::Keyframe)) };
                    let rest = Need::Patch { base: joining.frame, context: true };
                    let whole = joining.frame == newest.info.frame || session.takes_datagrams();
                    if !whole && !self.patches.contains_key(&rest) {
                        return Ok(Offer::Needs(rest));
                    }
                    self.edits.tell(session)?;
                    if session.send_keyframe(joining)? == Sent::Dropped {
                        return Ok(Offer::Nothing);
                    }
                    joined = true;
                    continue;
                }
                Wants::Update { base } | Wants::Patch { base } | Wants::Datagrams { base }
                    if base >= newest.info.frame =>
                {
                    return Ok(if joined { Offer::Keyframe } else { Offer::Current });
                }
                Wants::Update { base } if Some(base) == newest.previous => {
                    self.edits.tell(session)?;
                    if newest.body.kind == FrameKind::Key {
                        session.send_keyframe(&newest.body)?;
                        return Ok(Offer::Keyframe);
                    }
                    let sent = session.send_update(&newest.body, base)?;
                    return Ok(if sent == Sent::Queued { Offer::Update } else { Offer::Nothing });
                }
                Wants::Update { base } | Wants::Patch { base } => (Need::Patch { base, context: true }, base),
                Wants::Datagrams { base } => (Need::Patch { base, context: false }, base),
            };
            let Some(made) = self.patches.get(&need) else { return Ok(Offer::Needs(need)) };
            self.edits.tell(session)?;
            let Some(patch) = made else {
                // No patch leads from what the client holds to the newest frame.
                session.need_keyframe();
                continue;
            };
            let sent = match wants {
                Wants::Datagrams { .. } => session.send_datagrams(patch, base)?,
                _ => session.send_update(patch, base)?,
            };
            return Ok(match sent {
                // It may have turned out too large for datagrams.
                Sent::Dropped if session.wants() != wants => continue,
                Sent::Dropped => Offer::Nothing,
                Sent::Queued if joined => Offer::Keyframe,
                Sent::Queued => Offer::Patch,
            });
        }
    }

    /// Makes a body for the newest frame; `state` is the one of the last [`advance`](Self::advance).
    ///
    /// # Errors
    /// [`EncodeError`] as of the codec's `keyframe` and `patch`.
    pub fn make(&mut self, need: Need, state: StateRef<'_>) -> Result<(), EncodeError> {
        let (Some(newest), Some(log)) = (&self.newest, &self.log) else { return Ok(()) };
        let FrameInfo { frame, time, changed_points, .. } = newest.info;
        let meta = |kind| FrameMeta { kind, frame, time, changed_points };
        let shared = |kind, bytes: Vec<u8>| {
            let (hash, captured) = (newest.info.hash, newest.body.captured);
            SharedBody { kind, frame, hash, captured, bytes: bytes.into() }
        };
        match need {
            Need::Keyframe => {
                let bytes = keyframe(state, meta(FrameKind::Key), self.coder, &[])?;
                self.joining = Some(shared(FrameKind::Key, bytes));
            }
            Need::Patch { base, context } => {
                let bytes = patch(state, log, base, meta(FrameKind::Delta), self.coder, context)?;
                let made = bytes.map(|bytes| shared(FrameKind::Delta, bytes));
                let old = self.joining.as_ref().filter(|joining| joining.frame == base);
                if let (Some(made), Some(joining)) = (&made, old)
                    && made.bytes.len() > joining.bytes.len() / 2
                {
                    self.joining_is_worn = true;
                }
                self.patches.insert(need, made);
            }
        }
        Ok(())
    }
}

/// The edits that are in force, each with the number that it had among all.
#[derive(Clone, Debug, Default)]
struct EditLog {
    /// Newest last; of an instance at most one that moves or releases it and one that shows or hides it.
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

    /// Tells a client what it has not heard.
    fn tell(&self, session: &mut ServerSession) -> Result<(), SendError> {
        for (number, edit) in &self.entries {
            if *number > session.edits_heard {
                session.send_edit(edit)?;
            }
        }
        session.edits_heard = self.count;
        Ok(())
    }
}
