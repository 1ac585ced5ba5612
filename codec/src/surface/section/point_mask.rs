//! A set of points of a stream, by point block: those that a frame changes.
//!
//! In a plain layout it has (blocks + 7) / 8 bytes, one bit a block of 64 points, lowest first. Then follow 8 bytes
//! for each block whose bit is set, one bit a point, lowest first.
//!
//! Blocks are `u64` words and not `bitvec` slices: the coders scan, shift and count whole blocks for every frame, and
//! words are also what the wire has.

use super::changes::ChangeError;
use crate::memory;
use crate::surface::{BLOCK_POINTS, Layout, PaddedIndex};
use crate::wire::Reader;

/// Points of some blocks, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct PointMask {
    /// The blocks with a point, ascending.
    pub(crate) blocks: Vec<u32>,
    /// The points of each of these blocks, one bit each; never 0.
    pub(crate) masks: Vec<u64>,
}

impl PointMask {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.blocks) + memory::list(&self.masks)
    }

    /// Removes all points and keeps the buffers.
    pub(crate) fn clear(&mut self) {
        self.blocks.clear();
        self.masks.clear();
    }

    /// Adds a point. `index` is above that of the point before.
    pub(crate) fn push(&mut self, index: PaddedIndex) {
        let block = index.block() as u32;
        if self.blocks.last() != Some(&block) {
            self.blocks.push(block);
            self.masks.push(0);
        }
        if let Some(mask) = self.masks.last_mut() {
            *mask |= index.bit();
        }
    }

    /// Returns every block with its points.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = (u32, u64)> + '_ {
        self.blocks.iter().copied().zip(self.masks.iter().copied())
    }

    /// Returns the padded indices of the points.
    #[inline]
    pub(crate) fn padded_indices(&self) -> impl Iterator<Item = PaddedIndex> + '_ {
        self.iter().flat_map(|(block, mask)| {
            SetBits(mask).map(move |bit| PaddedIndex::new(block as usize, bit as usize))
        })
    }

    /// Returns the length of the plain layout, for a stream of `blocks` blocks, in bytes.
    pub(crate) fn plain_bytes(&self, blocks: usize) -> usize {
        blocks.div_ceil(8) + 8 * self.masks.len()
    }

    /// Appends the plain layout to `out`.
    pub(crate) fn write_plain(&self, blocks: usize, out: &mut Vec<u8>) {
        let bitmap = out.len();
        out.resize(bitmap + blocks.div_ceil(8), 0);
        for block in &self.blocks {
            out[bitmap + *block as usize / 8] |= 1 << (block % 8);
        }
        for mask in &self.masks {
            out.extend_from_slice(&mask.to_le_bytes());
        }
    }

    /// Reads the plain layout: `records` points of a stream of `blocks` blocks. It does not check whether the points
    /// exist.
    pub(crate) fn read_plain(
        &mut self,
        reader: &mut Reader<'_>,
        blocks: usize,
        records: u32,
    ) -> Result<(), ChangeError> {
        self.clear();
        let bitmap = reader.take("the bitmap of blocks", blocks.div_ceil(8))?;
        for (at, byte) in bitmap.iter().enumerate() {
            self.blocks.extend(SetBits(u64::from(*byte)).map(|bit| at as u32 * 8 + bit));
        }
        let masks = reader.take("the bitmaps of points", 8 * self.blocks.len())?;
        let mut found = 0;
        for (mask, block) in masks.chunks_exact(8).zip(&self.blocks) {
            let mask = mask.iter().rev().fold(0, |mask, byte| mask << 8 | u64::from(*byte));
            if mask == 0 {
                return Err(ChangeError::Mask { block: *block, mask });
            }
            found += mask.count_ones() as usize;
            self.masks.push(mask);
        }
        if found == records as usize { Ok(()) } else { Err(ChangeError::Count { expected: records, found }) }
    }

    /// Checks that the points exist and their blocks are in `present`.
    pub(crate) fn check(&self, layout: &Layout, present: &[bool]) -> Result<(), ChangeError> {
        for (block, mask) in self.iter() {
            if !present.get(block as usize).is_some_and(|here| *here) {
                return Err(ChangeError::Absent { block });
            }
            let points = layout.block_len(block as usize);
            if points < BLOCK_POINTS && mask >> points != 0 {
                return Err(ChangeError::Mask { block, mask });
            }
        }
        Ok(())
    }
}

/// Iterates over the numbers of the set bits, ascending.
pub(crate) struct SetBits(pub(crate) u64);

impl Iterator for SetBits {
    type Item = u32;

    #[inline]
    fn next(&mut self) -> Option<u32> {
        let bit = self.0.trailing_zeros();
        (self.0 != 0).then(|| {
            self.0 &= self.0 - 1;
            bit
        })
    }
}
