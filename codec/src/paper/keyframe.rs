//! Writes keyframes of any state, for clients that join late, seek, or lost their place.

use super::{Records, State, write_body};
use crate::block::{BlockCoder, Compressor};
use crate::envelope::{EncodeError, FrameKind, FrameMeta};

/// Writes the whole of `state` as a keyframe body, including stale cells. A client that applies it has the same state
/// and hash, so the deltas that follow `state` fit. `meta.kind` is taken as key.
///
/// # Errors
/// [`EncodeError::Block`] for a level that the coder does not have, or if it cannot allocate memory.
pub fn keyframe(state: &State, meta: FrameMeta, coder: BlockCoder) -> Result<Vec<u8>, EncodeError> {
    let mut records = Records::new(state.layout().format());
    records.push_all(
        state.poses().iter().copied(),
        state.buckets().iter().copied(),
        state.cells().iter().copied(),
    );
    let mut compressor = Compressor::new();
    Ok(write_body(&meta, FrameKind::Key, state.hash(), &records, &mut compressor, coder)?.body)
}
