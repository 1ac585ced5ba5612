//! The server's end: points and AO values in, frames out to clients and to a recording.

mod builder;
mod error;
#[cfg(feature = "tokio")]
mod network;

use std::sync::Arc;
use std::time::Duration;

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameInfo, FrameKind, FrameMeta, StreamTime};
use psao_codec::surface;
use psao_codec::surface::Encoder;
use psao_proto::session::Access;
#[cfg(any(feature = "tokio", feature = "fs"))]
use psao_proto::sinks::Sinks;
use psao_proto::{Limits, SceneTable};

pub use self::builder::{InstanceId, MeshId, PublisherBuilder};
pub use self::error::PublishError;

/// Publishes the AO of points: values in, frames out to clients ([`listen`](Self::listen)) and to a file
/// ([`record`](Self::record)).
///
/// Set the values that may have changed, then [`send`](Self::send) a frame. The publisher compares them with what clients
/// hold, and sends those that differ by the threshold. A slow client or disk never makes it wait: a client that falls behind
/// gets later what it missed, and a recording has a marked gap.
///
/// The same calls give the same bytes on any machine.
#[derive(Debug)]
pub struct Publisher {
    scene: Arc<SceneTable>,
    encoder: Encoder,
    coder: BlockCoder,
    /// By instance: number in the stream's order of each point in the caller's order.
    numbers: Vec<Arc<[u32]>>,
    next: FrameIndex,
    #[cfg(any(feature = "tokio", feature = "fs"))]
    sinks: Sinks,
    #[cfg(feature = "tokio")]
    access: Access,
    #[cfg(any(feature = "tokio", feature = "fs"))]
    limits: Limits,
    #[cfg(feature = "tokio")]
    network: Option<network::Network>,
}

/// A frame that was sent.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SentFrame {
    /// Kind, number, time, hash and sections of the frame.
    pub info: FrameInfo,
    /// The frame body, as clients apply it.
    pub body: Arc<[u8]>,
}

impl Publisher {
    /// Returns a builder for a stream of this name. People see the name; it is cut to 64 bytes.
    #[must_use]
    pub fn builder(name: &str) -> PublisherBuilder {
        PublisherBuilder::new(name)
    }

    fn new(
        scene: Arc<SceneTable>,
        encoder: Encoder,
        coder: BlockCoder,
        numbers: Vec<Arc<[u32]>>,
        (access, limits): (Access, Limits),
    ) -> Self {
        // Only clients ask for the first, only clients and recordings for the second.
        #[cfg(not(feature = "tokio"))]
        drop(access);
        #[cfg(not(any(feature = "tokio", feature = "fs")))]
        let _ = limits;
        Self {
            scene,
            encoder,
            coder,
            numbers,
            next: FrameIndex(0),
            #[cfg(any(feature = "tokio", feature = "fs"))]
            sinks: Sinks::new(),
            #[cfg(feature = "tokio")]
            access,
            #[cfg(any(feature = "tokio", feature = "fs"))]
            limits,
            #[cfg(feature = "tokio")]
            network: None,
        }
    }

    /// Sets the accessibility of a point, 0 (closed) to 1 (open). `point` counts in the order in which
    /// [`PublisherBuilder::mesh`] took the points. Values outside 0 to 1 are clamped; NaN counts as 0.
    ///
    /// The value holds until it is set again. Points that were never set are as those around them predict.
    ///
    /// # Errors
    /// [`PublishError::NoPoint`].
    pub fn set_ao(
        &mut self,
        instance: InstanceId,
        point: usize,
        accessibility: f32,
    ) -> Result<(), PublishError> {
        let numbers = self.numbers.get(instance.0 as usize);
        let number = numbers.and_then(|numbers| numbers.get(point));
        let Some(number) = number else { return Err(PublishError::NoPoint { instance, point }) };
        let first = self.encoder.state().layout().points_of(instance.0).start as u32;
        self.encoder.set_ao(first + number, surface::ao_byte(accessibility));
        Ok(())
    }

    /// Sets the accessibility of all points of an instance, in the order of [`PublisherBuilder::mesh`].
    ///
    /// # Errors
    /// [`PublishError::Values`] where there are not as many values as points, and then no value is set.
    pub fn set_all(&mut self, instance: InstanceId, accessibility: &[f32]) -> Result<(), PublishError> {
        let points = self.numbers.get(instance.0 as usize).map_or(0, |numbers| numbers.len());
        if points != accessibility.len() {
            return Err(PublishError::Values { instance, points, found: accessibility.len() });
        }
        (0..).zip(accessibility).try_for_each(|(point, value)| self.set_ao(instance, point, *value))
    }

    /// Sends a frame, at the stream time that follows from its number and the frames a second.
    ///
    /// # Errors
    /// As [`send_at`](Self::send_at).
    pub fn send(&mut self) -> Result<SentFrame, PublishError> {
        let seconds = f64::from(self.next.0) / f64::from(self.scene.info().fps);
        self.send_at(Duration::from_secs_f64(seconds))
    }

    /// Sends a frame: the values that differ by the threshold from what clients hold. The first is a keyframe, with all
    /// points of the blocks of 64 in which one was set. `time` counts from the start of the stream.
    ///
    /// # Errors
    /// [`PublishError::Encode`], and then nothing was sent. [`PublishError::Sink`], when the frame was made but a client or the
    /// recording could not get it.
    pub fn send_at(&mut self, time: Duration) -> Result<SentFrame, PublishError> {
        let kind = if self.next == FrameIndex(0) { FrameKind::Key } else { FrameKind::Delta };
        let time = StreamTime(u64::try_from(time.as_micros()).unwrap_or(u64::MAX));
        let changed_points = self.encoder.pending_points();
        let meta = FrameMeta { kind, frame: self.next, time, changed_points };
        let EncodedFrame { body, info } = self.encoder.finish(meta, self.coder)?;
        self.next = FrameIndex(self.next.0 + 1);
        let body = Arc::<[u8]>::from(body);
        #[cfg(any(feature = "tokio", feature = "fs"))]
        {
            let (state, coder) = (self.encoder.state(), self.coder);
            let captured = self.sinks.now();
            let keyframe = || psao_codec::keyframe(state, meta, coder, &[]);
            self.sinks.frame(&info, Arc::clone(&body), state.into(), captured, keyframe)?;
        }
        Ok(SentFrame { info, body })
    }

    /// Tells clients and the recording that an edit of the scene is part of the next frame. The caller applies the edit to
    /// the scene that it traces.
    ///
    /// # Errors
    /// [`PublishError::Sink`] when the recording failed.
    #[cfg(any(feature = "tokio", feature = "fs"))]
    pub fn announce_edit(&mut self, edit: &psao_proto::message::Edit) -> Result<(), PublishError> {
        Ok(self.sinks.edit(edit)?)
    }

    /// Records the stream into a file from here on; call it before the first frame. The recording never makes
    /// [`send`](Self::send) wait, and is whole after every frame.
    ///
    /// # Errors
    /// [`PublishError::Begun`] after the first frame; [`PublishError::Record`] when the file cannot be made.
    #[cfg(feature = "fs")]
    pub fn record(&mut self, path: impl AsRef<std::path::Path>) -> Result<(), PublishError> {
        self.record_with(path, psao_proto::recording::file::RecorderOptions::default())
    }

    /// Records the stream with options, as [`record`](Self::record).
    ///
    /// # Errors
    /// As [`record`](Self::record).
    #[cfg(feature = "fs")]
    pub fn record_with(
        &mut self,
        path: impl AsRef<std::path::Path>,
        options: psao_proto::recording::file::RecorderOptions,
    ) -> Result<(), PublishError> {
        use psao_proto::recording::file::Recorder;
        if self.next != FrameIndex(0) {
            return Err(PublishError::Begun);
        }
        let recorder = Recorder::create(path.as_ref(), options.with_limits(self.limits))?;
        self.sinks = std::mem::take(&mut self.sinks).with_recorder(recorder, &self.scene)?;
        Ok(())
    }

    /// Ends the stream: tells clients why, waits up to 5 s until they have what was sent, and ends the recording.
    ///
    /// # Errors
    /// [`PublishError::Sink`]: the first failure of the recording.
    #[cfg(any(feature = "tokio", feature = "fs"))]
    pub fn finish(self, reason: &str) -> Result<(), PublishError> {
        #[cfg(feature = "tokio")]
        if let Some(network) = self.network {
            network.close(reason);
        }
        #[cfg(feature = "fs")]
        self.sinks
            .finish(&psao_proto::message::Close::new(psao_proto::message::CloseCode::STOPPED, reason))?;
        Ok(())
    }

    /// Returns the scene table: what clients are told first.
    #[must_use]
    pub fn scene(&self) -> &Arc<SceneTable> {
        &self.scene
    }

    /// Returns what clients hold after the last frame.
    #[must_use]
    pub fn state(&self) -> StateRef<'_> {
        self.encoder.state().into()
    }
}
