//! Where the frames of a live stream go: to clients, and into a recording.
//!
//! Compiled with the feature `tokio` or `fs`. With `tokio` a stream can go to the clients of a `Hub`, with `fs` into a
//! recording of a `Recorder`.

use std::sync::Arc;

use psao_codec::StateRef;
use psao_codec::envelope::{EncodeError, FrameInfo};

use crate::Micros;
#[cfg(feature = "fs")]
use crate::SceneTable;
use crate::message::{Budget, Edit, Report};
#[cfg(feature = "fs")]
use crate::message::{Close, Message};
#[cfg(feature = "tokio")]
use crate::net::Hub;
#[cfg(feature = "fs")]
use crate::recording::file::{FileError, Recorder, RecordingOutcome};

/// The clients of a stream and its recording, each if there is one.
///
/// Edits that are part of a frame are given before it, its budget and its report after it. None of the methods waits for a
/// client, and none for the disk unless the recorder was asked to.
#[derive(Debug, Default)]
pub struct Sinks {
    #[cfg(feature = "tokio")]
    hub: Option<Hub>,
    #[cfg(feature = "fs")]
    recorder: Option<Recorder>,
}

/// Why a sink did not take a frame or a message.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SinkError {
    /// No keyframe or patch of the stream's state can be made.
    #[error("the stream's state cannot be sent: {0}")]
    Encode(#[from] EncodeError),
    /// The recording cannot be written.
    #[cfg(feature = "fs")]
    #[error(transparent)]
    Recording(#[from] FileError),
}

impl Sinks {
    /// Makes a set without sinks.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sends the stream to the clients of `hub` as well.
    #[cfg(feature = "tokio")]
    #[must_use]
    pub fn with_hub(mut self, hub: Hub) -> Self {
        self.hub = Some(hub);
        self
    }

    /// Records the stream as well. The scene table, with which a recording begins, is written now.
    ///
    /// # Errors
    /// As [`Recorder::scene`].
    #[cfg(feature = "fs")]
    pub fn with_recorder(mut self, mut recorder: Recorder, scene: &SceneTable) -> Result<Self, SinkError> {
        recorder.scene(scene)?;
        self.recorder = Some(recorder);
        Ok(self)
    }

    /// Returns the hub, if there is one.
    #[cfg(feature = "tokio")]
    #[must_use]
    pub fn hub(&self) -> Option<&Hub> {
        self.hub.as_ref()
    }

    /// Returns the recorder, if there is one.
    #[cfg(feature = "fs")]
    #[must_use]
    pub fn recorder(&self) -> Option<&Recorder> {
        self.recorder.as_ref()
    }

    /// Returns the time for frames that are captured now: by the hub's clock, else by the recorder's, else 0.
    #[must_use]
    pub fn now(&self) -> Micros {
        #[cfg(feature = "tokio")]
        if let Some(hub) = &self.hub {
            return hub.now();
        }
        #[cfg(feature = "fs")]
        if let Some(recorder) = &self.recorder {
            return recorder.now();
        }
        Micros(0)
    }

    /// Takes a frame. `state` is the server's after it, `captured` the time that it shows, by [`now`](Self::now). `keyframe`
    /// makes a keyframe of that state: the recording gets it in place of `body` where it wants one.
    ///
    /// # Errors
    /// [`SinkError::Encode`] when a keyframe or a patch cannot be made, [`SinkError::Recording`] as [`Recorder::body`]. The
    /// clients that need neither have the frame.
    #[cfg_attr(
        not(all(feature = "tokio", feature = "fs")),
        expect(unused_variables, reason = "the hub takes the state, the recorder the keyframe")
    )]
    pub fn frame(
        &mut self,
        info: &FrameInfo,
        body: impl Into<Arc<[u8]>>,
        state: StateRef<'_>,
        captured: Micros,
        keyframe: impl FnOnce() -> Result<Vec<u8>, EncodeError>,
    ) -> Result<(), SinkError> {
        let body: Arc<[u8]> = body.into();
        #[cfg(feature = "tokio")]
        if let Some(hub) = &self.hub {
            hub.broadcast(info, Arc::clone(&body), state, captured)?;
        }
        #[cfg(feature = "fs")]
        if let Some(recorder) = &mut self.recorder {
            recorder.body_or_keyframe(recorder.now(), info.kind, &body, || {
                keyframe().map_err(SinkError::Encode)
            })?;
        }
        Ok(())
    }

    /// Takes an edit that is part of all frames from the next one on.
    ///
    /// # Errors
    /// As [`Recorder::message`].
    pub fn edit(&mut self, edit: &Edit) -> Result<(), SinkError> {
        #[cfg(feature = "tokio")]
        if let Some(hub) = &self.hub {
            hub.edit(edit);
        }
        self.record(edit)
    }

    /// Takes what the last frame did with its byte budget.
    ///
    /// # Errors
    /// As [`Recorder::message`].
    pub fn budget(&mut self, budget: &Budget) -> Result<(), SinkError> {
        #[cfg(feature = "tokio")]
        if let Some(hub) = &self.hub {
            hub.budget(budget);
        }
        self.record(budget)
    }

    /// Takes the report of the last frame.
    ///
    /// # Errors
    /// As [`Recorder::message`].
    pub fn report(&mut self, report: &Report) -> Result<(), SinkError> {
        #[cfg(feature = "tokio")]
        if let Some(hub) = &self.hub {
            hub.report(report);
        }
        self.record(report)
    }

    /// Ends the recording with `close`; returns what became of it, if there is one. The clients are told by `Hub::close`, which
    /// waits for them.
    ///
    /// # Errors
    /// The first failure of the recording, even if it went on afterwards.
    #[cfg(feature = "fs")]
    pub fn finish(mut self, close: &Close) -> Result<Option<RecordingOutcome>, SinkError> {
        self.record(close)?;
        Ok(self.recorder.map(Recorder::finish).transpose()?)
    }

    #[cfg(feature = "fs")]
    fn record<M: Message>(&mut self, message: &M) -> Result<(), SinkError> {
        let Some(recorder) = &mut self.recorder else { return Ok(()) };
        let now = recorder.now();
        Ok(recorder.message(now, message)?)
    }

    #[cfg(not(feature = "fs"))]
    fn record<M>(&mut self, _message: &M) -> Result<(), SinkError> {
        Ok(())
    }
}
