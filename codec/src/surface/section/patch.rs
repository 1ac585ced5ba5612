//! PATCH sections: the newest AO of the points that changed after a frame.
//!
//! The plain layout is the number of frames that the patch reaches back, as a varint; then the points, as in CHANGES;
//! then the byte of each.

use super::changes::ChangeError;
use super::point_mask::PointMask;
use crate::surface::PaddedIndex;
use crate::wire::{Reader, varint_bytes, write_varint};

/// The points of a patch and their bytes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Patch {
    /// Number of frames from the earliest frame whose state it fits to its own.
    pub(crate) back: u32,
    /// The points.
    pub(crate) points: PointMask,
    /// Their bytes, in order.
    pub(crate) bytes: Vec<u8>,
}

impl Patch {
    /// Removes all points and keeps the buffers.
    pub(crate) fn clear(&mut self) {
        self.points.clear();
        self.bytes.clear();
    }

    /// Returns every point's padded index and byte.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (PaddedIndex, u8)> + '_ {
        self.points.padded_indices().zip(self.bytes.iter().copied())
    }

    /// Returns the length of the plain layout, for a stream of `blocks` blocks, in bytes.
    pub(crate) fn plain_bytes(&self, blocks: usize) -> usize {
        varint_bytes(self.back) + self.points.plain_bytes(blocks) + self.bytes.len()
    }

    /// Appends the plain layout to `out`.
    pub(crate) fn write_plain(&self, blocks: usize, out: &mut Vec<u8>) {
        write_varint(out, self.back);
        self.points.write_plain(blocks, out);
        out.extend_from_slice(&self.bytes);
    }

    /// Reads the plain layout: `records` points of a stream of `blocks` blocks. It does not check whether the points
    /// exist.
    pub(crate) fn read_plain(&mut self, raw: &[u8], blocks: usize, records: u32) -> Result<(), ChangeError> {
        self.clear();
        let mut reader = Reader::new(raw);
        self.back = reader.varint("how far it reaches back")?;
        self.points.read_plain(&mut reader, blocks, records)?;
        self.bytes.extend_from_slice(reader.take("the values", records as usize)?);
        Ok(reader.end()?)
    }
}
