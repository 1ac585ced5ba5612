//! The client's end: a live server or a recording in, state and events out.

mod error;
#[cfg(feature = "fs")]
mod file;
#[cfg(feature = "tokio")]
mod live;

use std::sync::Arc;

use psao_codec::envelope::{FrameIndex, FrameInfo};
use psao_codec::{ChangeLog, State, StateHash};
use psao_proto::message::{Budget, Close, Edit, Gap, Report};
use psao_proto::recording::{Damage, PlayerError, Repaired};
use psao_proto::{FollowError, SceneTable};

pub use self::error::SubscribeError;

/// What happened to a stream.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// The scene table is whole: the instances and settings of the stream are known.
    Scene(Arc<SceneTable>),
    /// A frame was applied. The state is that of this frame until the next event is taken.
    Frame(FrameInfo),
    /// The state after a frame would not have been the server's. The frame was not applied, and nothing is until the next
    /// keyframe, which a live subscriber asks for.
    HashMismatch {
        /// The frame.
        frame: FrameIndex,
        /// The server's hash of the state after it.
        expected: StateHash,
        /// The hash that the state would have had.
        found: StateHash,
    },
    /// A frame could not be applied for another reason. The state stays as it was until the next keyframe, which a live subscriber asks for.
    Unusable(FollowError),
    /// All later frames are of the scene as changed by this edit.
    Edit(Edit),
    /// What a frame cost the server.
    Report(Report),
    /// What a frame left for later ones.
    Budget(Budget),
    /// The recorder did not write some frames.
    Gap(Gap),
    /// A stretch of the recording was damaged, and repaired in memory. Such events come before all others.
    Repaired(Repaired),
    /// A stretch of the recording could not be read.
    Damage(Damage),
    /// A message of the recording makes no sense: a faulty program wrote it.
    BadMessage(PlayerError),
    /// The server ended the stream.
    Closed(Close),
}

/// A point whose AO changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ChangedPoint {
    /// The instance.
    pub instance: u32,
    /// The point, as an index into [`surface::State::values`](psao_codec::surface::State::values) of the instance.
    pub point: u32,
}

/// Follows a stream: a live server ([`connect`](Self::connect)) or a recording ([`open`](Self::open)).
///
/// It holds the newest state. [`next_event`](Self::next_event) waits for what comes next. [`poll`](Self::poll) does not wait: it
/// is for programs with a frame loop of their own, which call it until it returns `None`.
#[derive(Debug)]
pub struct Subscriber {
    source: Source,
    changes: Option<ChangeLog>,
}

#[derive(Debug)]
enum Source {
    #[cfg(feature = "tokio")]
    Live(Box<live::Live>),
    #[cfg(feature = "fs")]
    File(Box<file::File>),
}

impl Subscriber {
    /// Opens a recording and plays nothing yet. Damage is repaired in memory as far as the recording can.
    ///
    /// # Errors
    /// [`SubscribeError::Read`], [`SubscribeError::Recording`].
    #[cfg(feature = "fs")]
    pub fn open(path: impl AsRef<std::path::Path>) -> Result<Self, SubscribeError> {
        Ok(Self::of(Source::File(Box::new(file::File::open(path.as_ref())?))))
    }

    /// Connects to a server at `host:port` or `unix:PATH`, without credentials.
    ///
    /// # Errors
    /// As [`connect_with`](Self::connect_with).
    #[cfg(feature = "tokio")]
    pub fn connect(address: &str) -> Result<Self, SubscribeError> {
        Self::connect_with(
            address,
            &psao_proto::net::ConnectOptions::default(),
            psao_proto::Limits::default(),
        )
    }

    /// Connects to a server at `host:port`, `tls:host:port` or `unix:PATH`.
    ///
    /// # Errors
    /// [`SubscribeError::Address`], [`SubscribeError::Network`], [`SubscribeError::Runtime`].
    #[cfg(feature = "tokio")]
    pub fn connect_with(
        address: &str,
        options: &psao_proto::net::ConnectOptions,
        limits: psao_proto::Limits,
    ) -> Result<Self, SubscribeError> {
        Ok(Self::of(Source::Live(Box::new(live::Live::connect(address, options, limits)?))))
    }

    fn of(source: Source) -> Self {
        Self { source, changes: None }
    }

    /// Waits for the next event and returns it; `None` at the end of a recording, and after [`Event::Closed`].
    ///
    /// A recording plays as fast as it can be read.
    ///
    /// # Errors
    /// [`SubscribeError::Network`]. The state stays readable.
    pub fn next_event(&mut self) -> Result<Option<Event>, SubscribeError> {
        let event = match &mut self.source {
            #[cfg(feature = "tokio")]
            Source::Live(live) => live.next_event()?,
            #[cfg(feature = "fs")]
            Source::File(file) => file.next_event(),
        };
        Ok(self.note(event))
    }

    /// Returns the next event if it has come already; `None` otherwise.
    ///
    /// Events of a recording come at the pace at which they were recorded, counted from the first call.
    ///
    /// # Errors
    /// As [`next_event`](Self::next_event).
    pub fn poll(&mut self) -> Result<Option<Event>, SubscribeError> {
        let event = match &mut self.source {
            #[cfg(feature = "tokio")]
            Source::Live(live) => live.poll()?,
            #[cfg(feature = "fs")]
            Source::File(file) => file.poll(),
        };
        Ok(self.note(event))
    }

    /// Returns whether the stream is over: a recording was played to its end, or the server closed the stream. No event
    /// follows.
    #[must_use]
    pub fn is_over(&self) -> bool {
        match &self.source {
            #[cfg(feature = "tokio")]
            Source::Live(live) => live.is_over(),
            #[cfg(feature = "fs")]
            Source::File(file) => file.is_over(),
        }
    }

    /// Returns the state after the last frame applied; `None` before the scene is known.
    #[must_use]
    pub fn state(&self) -> Option<&State> {
        match &self.source {
            #[cfg(feature = "tokio")]
            Source::Live(live) => live.state(),
            #[cfg(feature = "fs")]
            Source::File(file) => file.state(),
        }
    }

    /// Starts to keep track of which points change, for [`changed_since`](Self::changed_since). It costs 5 bytes a point,
    /// and one pass over the points for each frame.
    pub fn track_changes(&mut self) {
        self.changes = self.state().map(ChangeLog::new).or(Some(ChangeLog::default()));
    }

    /// Returns the points whose AO changed after frame `base`, by ascending instance and point.
    ///
    /// `None` when that is not known, and every point may have changed: after a keyframe, before
    /// [`track_changes`](Self::track_changes) was called, in profile `paper`.
    #[must_use]
    pub fn changed_since(&self, base: FrameIndex) -> Option<impl Iterator<Item = ChangedPoint> + '_> {
        let layout = self.state()?.as_surface()?.layout();
        let blocks = self.changes.as_ref()?.changed_since(base)?;
        Some(blocks.flat_map(move |(block, mask)| {
            let (instance, points) = layout.points_of_block(block as usize).unwrap_or_default();
            let changed = move |bit: &u32| mask >> bit & 1 == 1;
            (0..64).filter(changed).map(move |bit| ChangedPoint { instance, point: points.start + bit })
        }))
    }

    /// Sends the server the camera that the client draws with, so that the points in view are kept up to date. Without effect
    /// on a recording.
    ///
    /// # Errors
    /// [`SubscribeError::Send`] for a camera that makes no picture.
    #[cfg(feature = "tokio")]
    pub fn set_view(&mut self, camera: &psao_proto::message::CameraPose) -> Result<(), SubscribeError> {
        match &mut self.source {
            Source::Live(live) => live.set_view(camera),
            #[cfg(feature = "fs")]
            Source::File(_) => Ok(()),
        }
    }

    /// Asks the server to change the scene. Every client gets [`Event::Edit`] when the change is part of a frame.
    ///
    /// # Errors
    /// [`SubscribeError::Send`] for an edit that makes no sense, [`SubscribeError::NotLive`] for a recording.
    #[cfg(feature = "tokio")]
    pub fn edit(&mut self, edit: &Edit) -> Result<(), SubscribeError> {
        match &mut self.source {
            Source::Live(live) => live.edit(edit),
            #[cfg(feature = "fs")]
            Source::File(_) => Err(SubscribeError::NotLive),
        }
    }

    /// Notes what an event changed.
    fn note(&mut self, event: Option<Event>) -> Option<Event> {
        if let (Some(Event::Frame(_)), Some(changes)) = (&event, &mut self.changes) {
            let state = match &self.source {
                #[cfg(feature = "tokio")]
                Source::Live(live) => live.state(),
                #[cfg(feature = "fs")]
                Source::File(file) => file.state(),
            };
            if let Some(state) = state {
                changes.record(state);
            }
        }
        event
    }
}
