//! Writes patches: deltas that bring clients that missed frames to the newest state.

use super::section::patch::Patch;
use super::section::writer::SectionWriter;
use super::{ChangeLog, PaddedIndex, State, frame_ids};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameIndex, FrameKind, FrameMeta, assemble};

/// Largest number of frames that a patch reaches back: the largest number that the range coder can code.
const MAX_BACK_FRAMES: u32 = (1 << 31) - 1;

/// Writes the body of a delta that brings every client to `state` whose last frame is `base` or a later one before
/// `meta.frame`. `meta.frame` is the frame of `state`, and `meta.kind` is taken as delta. The patch has the newest
/// value of every point that changed or arrived after `base`. It depends on nothing that was coded before.
///
/// The coder context of a client becomes fresh when it applies a patch. With `context` the patch carries the context
/// of `state`, at the same cost as in a [`super::keyframe`]; then the client can decode the updates that follow.
/// Without it, the client can decode only patches and keyframes.
///
/// Returns `None` if only a keyframe helps: `log` has not recorded `state`, it does not know what a client of frame
/// `base` missed ([`ChangeLog::changed_since`]), or there is no point yet.
///
/// # Errors
/// [`EncodeError::Block`] for a level that the coder does not have, or if it cannot allocate memory.
pub fn patch(
    state: &State,
    log: &ChangeLog,
    base: FrameIndex,
    meta: FrameMeta,
    coder: BlockCoder,
    context: bool,
) -> Result<Option<Vec<u8>>, EncodeError> {
    let back = meta.frame.0.checked_sub(base.0).filter(|back| (1..=MAX_BACK_FRAMES).contains(back));
    let followed = state.frame.is_some() && log.frame() == state.frame;
    let (Some(back), Some(missed)) = (back, log.changed_since(base).filter(|_| followed)) else {
        return Ok(None);
    };
    let mut patch = Patch { back, ..Patch::default() };
    log.arrived_since(base).for_each(|block| patch.push_arrival(block));
    for (block, mask) in missed {
        patch.points.blocks.push(block);
        patch.points.masks.push(mask);
    }
    if patch.points.blocks.is_empty() {
        // A section has at least one point: any point will do.
        let Some(block) = state.present.iter().position(|here| *here) else { return Ok(None) };
        patch.points.push(PaddedIndex::new(block, 0));
    }
    patch.bytes = patch.points.padded_indices().map(|index| state.values[index.0]).collect();
    let mut writer = SectionWriter::default();
    if context {
        writer.context(state, coder)?;
    }
    writer.patch(state, &patch, coder)?;
    let ids = frame_ids(FrameKind::Delta);
    Ok(Some(assemble(&meta, ids, state.hash, writer.sections, &writer.blocks).body))
}
