//! Writes frame bodies: collects records, compresses the sections, and writes the header before them.

use super::rules::record_bytes;
use super::{Bucket, Cell, POINTS_PER_CELL, PointFormat, Pose};
use crate::block::{BlockCoder, Compressor};
use crate::envelope::{
    EncodeError, EncodedFrame, FrameIds, FrameKind, FrameMeta, Profile, SectionInfo, SectionTag, assemble,
};
use crate::wire::{push_narrow_words, push_words};
use crate::{StateHash, memory};

/// The records of one frame, section by section, before compression.
#[derive(Debug)]
pub(crate) struct Records {
    format: PointFormat,
    poses: Vec<u8>,
    buckets: Vec<u8>,
    cells: Vec<u8>,
}

impl Records {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.poses) + memory::list(&self.buckets) + memory::list(&self.cells)
    }

    /// Creates an empty list of records for points in this format.
    pub(crate) fn new(format: PointFormat) -> Records {
        Records { format, poses: Vec::new(), buckets: Vec::new(), cells: Vec::new() }
    }

    pub(crate) fn clear(&mut self) {
        self.poses.clear();
        self.buckets.clear();
        self.cells.clear();
    }

    pub(crate) fn push_pose(&mut self, instance: u32, pose: Pose) {
        push_words(&mut self.poses, &[instance]);
        push_words(&mut self.poses, &pose.to_words());
    }

    pub(crate) fn push_bucket(&mut self, offset: u32, bucket: &Bucket) {
        push_words(&mut self.buckets, &[offset]);
        push_words(&mut self.buckets, &bucket.to_words());
    }

    /// Adds a cell. `changes` is the exclusive or of the new cell and the cell sent last.
    pub(crate) fn push_cell(&mut self, offset: u32, changes: &[u32; POINTS_PER_CELL]) {
        push_words(&mut self.cells, &[offset]);
        push_narrow_words(&mut self.cells, changes, self.format.bytes());
    }

    /// Adds everything of a state that is not empty, in index order.
    pub(crate) fn push_all(
        &mut self,
        poses: impl Iterator<Item = Pose>,
        buckets: impl Iterator<Item = Bucket>,
        cells: impl Iterator<Item = Cell>,
    ) {
        for (instance, pose) in (0_u32..).zip(poses) {
            if pose.to_words() != Pose::IDENTITY.to_words() {
                self.push_pose(instance, pose);
            }
        }
        for (offset, bucket) in (0_u32..).zip(buckets) {
            if bucket != Bucket::default() {
                self.push_bucket(offset, &bucket);
            }
        }
        for (offset, cell) in (0_u32..).zip(cells) {
            if cell != Cell::default() {
                self.push_cell(offset, cell.words());
            }
        }
    }

    fn sections(&self) -> [(SectionTag, &[u8]); 3] {
        [
            (SectionTag::POSES, &self.poses),
            (SectionTag::BUCKETS, &self.buckets),
            (SectionTag::CELLS, &self.cells),
        ]
    }
}

/// Writes a body of `kind`, whatever `meta.kind` is, with these records. `hash` is that of the state after the frame.
pub(crate) fn write_body(
    meta: &FrameMeta,
    kind: FrameKind,
    hash: StateHash,
    records: &Records,
    compressor: &mut Compressor,
    coder: BlockCoder,
) -> Result<EncodedFrame, EncodeError> {
    let mut blocks = Vec::new();
    let mut sections = Vec::new();
    for (tag, raw) in records.sections() {
        let Some(record_bytes) = record_bytes(tag, records.format).filter(|_| !raw.is_empty()) else {
            continue;
        };
        let start = blocks.len();
        let coder = compressor
            .compress(raw, coder, &mut blocks)
            .map_err(|source| EncodeError::Block { section: tag, source })?;
        // A layout has at most 2^22 cells and `Limits::max_buckets` buckets: the lengths fit 32 bits.
        let raw_bytes = raw.len() as u32;
        let wire_bytes = (blocks.len() - start) as u32;
        sections.push(SectionInfo { tag, coder, records: raw_bytes / record_bytes, raw_bytes, wire_bytes });
    }
    let packing = records.format.packing();
    let ids = FrameIds { profile: Profile::PAPER, packing, kind };
    Ok(assemble(meta, ids, hash, sections, &blocks))
}
