//! A keyframe of any state: what a client gets that joins late, seeks or has lost its place.

use super::{Records, State, write_body};
use crate::block::{BlockCoder, Compressor};
use crate::envelope::{EncodeError, FrameKind, FrameMeta};

/// Writes the whole of `state` as a keyframe body. A client that applies it has the same state and hash,
/// stale cells included, so the deltas that follow `state` fit. `meta.kind` is taken as key.
///
/// # Errors
/// [`EncodeError::Block`] for a level that the coder does not have, or where it finds no memory.
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
