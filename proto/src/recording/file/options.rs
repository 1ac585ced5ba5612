//! Options and notices of a recorder.

use std::fmt;
use std::sync::Arc;

use super::{FileError, GapTotals, KeyframeInterval};
use crate::Limits;

/// Options of a [`Recorder`](super::Recorder).
#[derive(Clone)]
pub struct RecorderOptions {
    pub(super) limits: Limits,
    pub(super) buffer_bytes: usize,
    pub(super) waits: bool,
    pub(super) keyframes: KeyframeInterval,
    pub(super) observer: Observer,
}

/// Callback for notices. It may be called on any thread.
pub(super) type Observer = Arc<dyn Fn(RecorderNotice<'_>) + Send + Sync>;

impl RecorderOptions {
    /// Default limit of the bytes that wait for the disk; see [`with_buffer_bytes`](Self::with_buffer_bytes).
    pub const BUFFER_BYTES: usize = 64 << 20;

    /// Sets the limit of the bytes that wait in memory for the disk. A longer frame is taken when no other waits.
    #[must_use]
    pub fn with_buffer_bytes(mut self, bytes: usize) -> Self {
        self.buffer_bytes = bytes;
        self
    }

    /// Makes every call wait until its frame is written, for streams without live clients. The recording then has no
    /// gaps, each failure is an error of its call, and no thread is started.
    #[must_use]
    pub fn with_backpressure(mut self) -> Self {
        self.waits = true;
        self
    }

    /// Sets when [`Recorder::wants_keyframe`](super::Recorder::wants_keyframe) asks for one.
    #[must_use]
    pub fn with_keyframes(mut self, interval: KeyframeInterval) -> Self {
        self.keyframes = interval;
        self
    }

    /// Sets the limits that recorded frames must respect.
    #[must_use]
    pub fn with_limits(mut self, limits: Limits) -> Self {
        self.limits = limits;
        self
    }

    /// Sets the callback for notices. It may be called on any thread and must not block for long.
    #[must_use]
    pub fn with_observer(mut self, observer: impl Fn(RecorderNotice<'_>) + Send + Sync + 'static) -> Self {
        self.observer = Arc::new(observer);
        self
    }
}

impl Default for RecorderOptions {
    fn default() -> Self {
        Self {
            limits: Limits::default(),
            buffer_bytes: Self::BUFFER_BYTES,
            waits: false,
            keyframes: KeyframeInterval::default(),
            observer: Arc::new(|_| {}),
        }
    }
}

impl fmt::Debug for RecorderOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RecorderOptions")
            .field("limits", &self.limits)
            .field("buffer_bytes", &self.buffer_bytes)
            .field("waits", &self.waits)
            .field("keyframes", &self.keyframes)
            .finish_non_exhaustive()
    }
}

/// Notice for the user while a recording is made.
#[derive(Debug)]
#[non_exhaustive]
pub enum RecorderNotice<'a> {
    /// The disk is too slow for the stream. Sent once.
    Behind,
    /// A write failed. Sent once; [`Recorder::finish`](super::Recorder::finish) returns the same error.
    Failed(&'a FileError),
    /// The recording was finished and has gaps.
    Incomplete(GapTotals),
}

impl fmt::Display for RecorderNotice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Behind => f.write_str(
                "the recording cannot keep up; frames are missing until it goes on with a keyframe",
            ),
            Self::Failed(error) => write!(f, "{error}; the stream goes on"),
            Self::Incomplete(GapTotals { gaps, frames, bytes }) => {
                write!(f, "{frames} frames ({bytes} bytes) are missing from the recording, in {gaps} gap(s)")
            }
        }
    }
}
