//! Frame bodies that are made once and go to many clients.

use std::sync::Arc;

use psao_codec::envelope::{FrameInfo, FrameKind};

use crate::{FrameIndex, Micros, StateHash};

/// A frame body and what a session needs to know of it. Cloning it copies no bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SharedBody {
    /// Whether it is a keyframe.
    pub kind: FrameKind,
    /// Number of its frame.
    pub frame: FrameIndex,
    /// Hash of the state after it.
    pub hash: StateHash,
    /// When the scene was as the frame has it, by the clock that the sessions are told.
    pub captured: Micros,
    /// The body.
    pub bytes: Arc<[u8]>,
}

impl SharedBody {
    /// Creates a body with the header `info`.
    #[must_use]
    pub fn new(info: &FrameInfo, bytes: impl Into<Arc<[u8]>>, captured: Micros) -> Self {
        Self { kind: info.kind, frame: info.frame, hash: info.hash, captured, bytes: bytes.into() }
    }
}
