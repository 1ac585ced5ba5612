//! Patches: deltas that bring clients which missed frames to the newest state.

use super::section::patch::Patch;
use super::section::writer::SectionWriter;
use super::{ChangeLog, PaddedIndex, State};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameIndex, FrameKind, FrameMeta, Packing, Profile, assemble};

/// Furthest that a patch reaches back, in frames: what the range coder has numbers for.
const FURTHEST: u32 = (1 << 31) - 1;

/// Writes the body of a delta with which every client whose last frame is `base` or a later one before `meta.frame` holds
/// what `state` holds; `meta.frame` is that of `state`, `meta.kind` is taken as delta. It has the newest value of the points
/// that changed after `base` and depends on nothing that was coded before.
///
/// A client that applies it has forgotten what the coders learned. With `context` it is told what `state` knows, which takes
/// as much as in a [`super::keyframe`] and lets it read the updates that follow; without, it reads patches and keyframes
/// only.
///
/// `None` when only a keyframe helps: `change log` has not followed `state`, or does not know what a client of frame `base`
/// missed ([`ChangeLog::changed_since`]), or there is no point yet.
///
/// # Errors
/// [`EncodeError::Block`] for a level that the coder does not have, or where it finds no memory.
pub fn patch(
    state: &State,
    log: &ChangeLog,
    base: FrameIndex,
    meta: FrameMeta,
    coder: BlockCoder,
    context: bool,
) -> Result<Option<Vec<u8>>, EncodeError> {
    let back = meta.frame.0.checked_sub(base.0).filter(|back| (1..=FURTHEST).contains(back));
    let followed = state.frame.is_some() && log.frame() == state.frame;
    let (Some(back), Some(missed)) = (back, log.changed_since(base).filter(|_| followed)) else {
        return Ok(None);
    };
    let mut patch = Patch { back, ..Patch::default() };
    for (block, mask) in missed {
        patch.points.blocks.push(block);
        patch.points.masks.push(mask);
    }
    if patch.points.blocks.is_empty() {
        // A section has a point at least: any does.
        let Some(block) = state.present.iter().position(|here| *here) else { return Ok(None) };
        patch.points.push(PaddedIndex::new(block, 0));
    }
    patch.bytes = patch.points.padded_indices().map(|index| state.values[index.0]).collect();
    let mut writer = SectionWriter::default();
    if context {
        writer.context(state, coder)?;
    }
    writer.patch(state, &patch, coder)?;
    let ids = (Profile::SURFACE, Packing::LATTICE, FrameKind::Delta);
    Ok(Some(assemble(&meta, ids, state.hash, writer.sections, &writer.blocks).body))
}
