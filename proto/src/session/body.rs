//! Frame bodies that are encoded once and sent to many clients.

use std::sync::Arc;

use psao_codec::envelope::{FrameInfo, FrameKind};

use crate::{FrameIndex, Micros, StateHash};

/// A frame body and the facts that a session needs. Cloning it copies no bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SharedBody {
    /// Whether it is a keyframe.
    pub kind: FrameKind,
    /// Number of its frame.
    pub frame: FrameIndex,
    /// Hash of the state after it.
    pub hash: StateHash,
    /// Capture time of the scene, by the clock of the sessions.
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
