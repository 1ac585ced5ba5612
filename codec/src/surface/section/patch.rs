//! PATCH sections: the newest AO of the points that changed after a frame.
//!
//! The plain layout is the number of frames that the patch reaches back, as a varint; the number of runs of blocks that
//! arrived in these frames, as a varint, and for each run its first block and its number of blocks, two varints; then the
//! points, as in CHANGES; then the byte of each. A patch names every point of a block that arrived.

use super::changes::ChangeError;
use super::point_mask::PointMask;
use crate::surface::{BLOCK_POINTS, Layout, PaddedIndex};
use crate::wire::{Reader, varint_bytes, write_varint};

/// The points of a patch and their bytes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Patch {
    /// Number of frames from the earliest frame whose state it fits to its own.
    pub(crate) back: u32,
    /// First block and number of blocks of each run of blocks that arrived, ascending.
    pub(crate) arrivals: Vec<(u32, u32)>,
    /// The points.
    pub(crate) points: PointMask,
    /// Their bytes, in order.
    pub(crate) bytes: Vec<u8>,
}

impl Patch {
    /// Removes all points and keeps the buffers.
    pub(crate) fn clear(&mut self) {
        self.arrivals.clear();
        self.points.clear();
        self.bytes.clear();
    }

    /// Adds a block that arrived. It comes after all earlier ones.
    pub(crate) fn push_arrival(&mut self, block: u32) {
        match self.arrivals.last_mut() {
            Some((first, count)) if *first + *count == block => *count += 1,
            _ => self.arrivals.push((block, 1)),
        }
    }

    /// Adds a run of blocks that arrived, if it is not empty, comes after all earlier ones, and ends at `blocks` or before.
    pub(crate) fn push_run(&mut self, (first, count): (u32, u32), blocks: usize) -> Result<(), ChangeError> {
        let after = self.arrivals.last().map_or(0, |(first, count)| first + count);
        let fits = count > 0 && first >= after && u64::from(first) + u64::from(count) <= blocks as u64;
        if !fits {
            return Err(ChangeError::Arrivals { first, count });
        }
        self.arrivals.push((first, count));
        Ok(())
    }

    /// Adds the blocks that arrived to `present`.
    pub(crate) fn add_arrivals(&self, present: &mut [bool]) {
        for (first, count) in &self.arrivals {
            present[*first as usize..(*first + *count) as usize].fill(true);
        }
    }

    /// Checks that points exist, that their blocks are in `present`, and that the patch names all points of blocks that
    /// arrived.
    pub(crate) fn check(&self, layout: &Layout, present: &[bool]) -> Result<(), ChangeError> {
        self.points.check(layout, present)?;
        let mut named = self.points.iter();
        for block in self.arrivals.iter().flat_map(|(first, count)| *first..*first + *count) {
            let mask = named.find(|(named, _)| *named >= block).filter(|(named, _)| *named == block);
            let missing = mask.map_or(0, |(_, mask)| mask)
                ^ u64::MAX >> (BLOCK_POINTS - layout.block_len(block as usize));
            if missing != 0 {
                return Err(ChangeError::Missing { block, missing });
            }
        }
        Ok(())
    }

    /// Returns every point's padded index and byte.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (PaddedIndex, u8)> + '_ {
        self.points.padded_indices().zip(self.bytes.iter().copied())
    }

    /// Returns the length of the plain layout, for a stream of `blocks` blocks, in bytes.
    pub(crate) fn plain_bytes(&self, blocks: usize) -> usize {
        let run = |(first, count): &(u32, u32)| varint_bytes(*first) + varint_bytes(*count);
        let runs = varint_bytes(self.arrivals.len() as u32) + self.arrivals.iter().map(run).sum::<usize>();
        varint_bytes(self.back) + runs + self.points.plain_bytes(blocks) + self.bytes.len()
    }

    /// Appends the plain layout to `out`.
    pub(crate) fn write_plain(&self, blocks: usize, out: &mut Vec<u8>) {
        write_varint(out, self.back);
        write_varint(out, self.arrivals.len() as u32);
        for (first, count) in &self.arrivals {
            write_varint(out, *first);
            write_varint(out, *count);
        }
        self.points.write_plain(blocks, out);
        out.extend_from_slice(&self.bytes);
    }

    /// Reads the plain layout: `records` points of a stream of `blocks` blocks. It does not check whether the points
    /// exist.
    pub(crate) fn read_plain(&mut self, raw: &[u8], blocks: usize, records: u32) -> Result<(), ChangeError> {
        self.clear();
        let mut reader = Reader::new(raw);
        self.back = reader.varint("how far it reaches back")?;
        for _ in 0..reader.varint("the number of runs")? {
            let run = (reader.varint("a run of blocks")?, reader.varint("a run of blocks")?);
            self.push_run(run, blocks)?;
        }
        self.points.read_plain(&mut reader, blocks, records)?;
        self.bytes.extend_from_slice(reader.take("the values", records as usize)?);
        Ok(reader.end()?)
    }
}
