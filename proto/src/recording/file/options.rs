//! What a recorder is behind, and what it tells.

use std::fmt;
use std::sync::Arc;

use super::{FileError, GapTotals};
use crate::Limits;

/// How a [`Recorder`](super::Recorder) works.
#[derive(Clone)]
pub struct RecorderOptions {
    pub(super) limits: Limits,
    pub(super) buffer_bytes: usize,
    pub(super) waits: bool,
    pub(super) observer: Observer,
}

/// What is called with notices, on whatever thread they come up.
pub(super) type Observer = Arc<dyn Fn(RecorderNotice<'_>) + Send + Sync>;

impl RecorderOptions {
    /// Bytes that wait for the disk at most, unless [`with_buffer_bytes`](Self::with_buffer_bytes) says otherwise.
    pub const BUFFER_BYTES: usize = 64 << 20;

    /// Sets the bytes that wait in memory for the disk at most. A frame that is longer waits alone.
    #[must_use]
    pub fn with_buffer_bytes(mut self, bytes: usize) -> Self {
        self.buffer_bytes = bytes;
        self
    }

    /// Makes every call wait until its frame is written: for streams that nobody follows. There are no gaps then, the
    /// first failure is an error of the call, and no thread is started.
    #[must_use]
    pub fn with_backpressure(mut self) -> Self {
        self.waits = true;
        self
    }

    /// Sets the limits that recorded frames are held to.
    #[must_use]
    pub fn with_limits(mut self, limits: Limits) -> Self {
        self.limits = limits;
        self
    }

    /// Sets what is called with notices, at once and on whatever thread they come up. It must not block for long.
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
            .finish_non_exhaustive()
    }
}

/// Something worth a line to a person while a recording is made.
#[derive(Debug)]
#[non_exhaustive]
pub enum RecorderNotice<'a> {
    /// The disk is too slow for the stream, for the first time.
    Behind,
    /// A write failed, for the first time. [`Recorder::finish`](super::Recorder::finish) returns this error.
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
