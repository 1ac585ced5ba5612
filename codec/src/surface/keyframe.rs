//! Writes keyframes: the blocks of a state in parcels, the most urgent first.

use std::sync::Arc;

use bitvec::slice::BitSlice;
use bitvec::vec::BitVec;

use super::section::geometry::Sets;
use super::section::values::{ClientValues, Values};
use super::section::writer::{FrameModels, SectionWriter};
use super::{Geometry, Layout, State, frame_ids};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameKind, FrameMeta, assemble};

/// Smallest number of blocks of a parcel: a section costs some ten bytes.
const MIN_PARCEL_BLOCKS: usize = 64;
/// Largest number of parcels, each of up to two sections: a frame has at most 255 sections.
const MAX_PARCELS: usize = 100;

/// Writes blocks in the given order, each parcel after the geometry of its sets.
pub(super) struct ParcelWriter<'a> {
    pub(super) layout: &'a Layout,
    /// Geometry of the sets that the stream carries.
    pub(super) geometry: &'a [Option<Arc<Geometry>>],
    /// By set: whether clients have it. It is updated.
    pub(super) sent: &'a mut BitSlice,
    /// Bytes of all padded indices, and whether blocks were received, as clients have them. Both are updated.
    pub(super) bytes: &'a mut [u8],
    pub(super) present: &'a mut [bool],
}

impl ParcelWriter<'_> {
    /// Writes `blocks`. `target` returns the byte and the threshold of a padded index, and `quantum` is the step between
    /// bytes that are not as predicted.
    pub(super) fn write(
        &mut self,
        writer: &mut SectionWriter,
        blocks: &[u32],
        (target, quantum): (impl Fn(usize) -> (u8, u8), u8),
        coder: BlockCoder,
    ) -> Result<(), EncodeError> {
        if blocks.is_empty() {
            return Ok(());
        }
        let mut models = FrameModels::new();
        let size = MIN_PARCEL_BLOCKS.max(blocks.len().div_ceil(MAX_PARCELS));
        for parcel in blocks.chunks(size) {
            let sets = self.sets(parcel);
            writer.geometry(self.layout, &sets, &mut models, coder)?;
            let mut arriving = Values { quantum, ..Values::default() };
            for block in parcel {
                let block = *block as usize;
                let first = block * super::BLOCK_POINTS;
                arriving.push(block);
                for (byte, threshold) in (first..first + self.layout.block_len(block)).map(&target) {
                    arriving.bytes.push(byte);
                    arriving.thresholds.push(threshold);
                }
            }
            let clients = ClientValues { geometry: self.geometry, bytes: self.bytes, present: self.present };
            writer.values(self.layout, clients, &arriving, &mut models, coder)?;
        }
        Ok(())
    }

    /// Returns the sets that a parcel needs and clients do not have, in the order of need.
    fn sets(&mut self, parcel: &[u32]) -> Sets {
        let mut sets = Sets::new();
        for block in parcel {
            let set = self.layout.members()[self.layout.owner(*block as usize)].set;
            let at = set as usize;
            if let Some(geometry) = self.geometry[at].as_ref().filter(|_| !self.sent[at]) {
                self.sent.set(at, true);
                sets.push((set, Arc::clone(geometry)));
            }
        }
        sets
    }
}

/// Writes the whole of `state` as a keyframe body. A client that applies it has the same state and hash, so the deltas
/// that follow `state` fit. `meta.kind` is taken as key.
///
/// `first` names the blocks that go first, as (instance, block of the instance): those in view, so that a client can
/// show them before the rest arrives ([`super::preview`]).
///
/// # Errors
/// [`EncodeError::Block`] for a level that the coder does not have, or if it cannot allocate memory.
pub fn keyframe(
    state: &State,
    meta: FrameMeta,
    coder: BlockCoder,
    first: &[(u32, u32)],
) -> Result<Vec<u8>, EncodeError> {
    let layout = &state.layout;
    let named = first.iter().filter_map(|(instance, block)| {
        layout.blocks_of(*instance).nth(*block as usize).map(|block| block as u32)
    });
    let mut wanted = state.present.clone();
    let order: Vec<u32> = named
        .chain(0..layout.blocks() as u32)
        .filter(|block| std::mem::replace(&mut wanted[*block as usize], false))
        .collect();
    let mut writer = SectionWriter::default();
    ParcelWriter {
        layout,
        geometry: &state.geometry,
        sent: &mut BitVec::<usize>::repeat(false, state.geometry.len()),
        bytes: &mut vec![0; state.values.len()],
        present: &mut vec![false; state.present.len()],
    }
    .write(&mut writer, &order, (|index| (state.values[index], 1), 1), coder)?;
    writer.context(state, coder)?;
    let ids = frame_ids(FrameKind::Key);
    Ok(assemble(&meta, ids, state.hash, writer.sections, &writer.blocks).body)
}
