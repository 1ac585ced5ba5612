//! VALUES sections: AO of point blocks that arrive for the first time, or again with a keyframe.
//!
//! The plain layout is the number of runs of blocks as a varint; for each run its first block and its number of
//! blocks, two varints; then one byte a point, run after run.

use crate::surface::{BLOCK_POINTS, Layout};
use crate::wire::{Reader, WireError, varint_bytes, write_varint};

/// Blocks and the bytes of their points.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Values {
    /// First block and number of blocks of each run.
    pub(crate) runs: Vec<(u32, u32)>,
    /// Bytes of the points of all runs, in order.
    pub(crate) bytes: Vec<u8>,
}

/// What clients have of the points, while values are being written or read.
pub(crate) struct ClientValues<'a> {
    /// AO bytes, by padded index.
    pub(crate) bytes: &'a mut [u8],
    /// By block: whether its values were received.
    pub(crate) present: &'a mut [bool],
}

/// Why values were refused. An offset counts bytes of the plain layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueError {
    /// The section ends inside a field.
    #[error("it ends inside {field}, which starts at its byte {offset}")]
    Ends {
        /// The field.
        field: &'static str,
        /// Start of the field.
        offset: usize,
    },
    /// A run is empty, has blocks outside the layout, or has a block that was already received.
    #[error("{count} blocks from {first} on: an empty run, not part of the stream, or already received")]
    Run {
        /// First block.
        first: u32,
        /// Number of blocks.
        count: u32,
    },
    /// The number of points differs from the section table.
    #[error("{found} points, the section table says {expected}")]
    Count {
        /// Number by the section table.
        expected: u32,
        /// Number in the section.
        found: usize,
    },
}

impl Values {
    pub(crate) fn clear(&mut self) {
        self.runs.clear();
        self.bytes.clear();
    }

    /// Adds a block. It comes after all earlier ones.
    pub(crate) fn push(&mut self, block: usize, bytes: &[u8]) {
        match self.runs.last_mut() {
            Some((first, count)) if (*first + *count) as usize == block => *count += 1,
            _ => self.runs.push((block as u32, 1)),
        }
        self.bytes.extend_from_slice(bytes);
    }

    /// Returns every block, in order.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|(first, count)| *first as usize..(*first + *count) as usize)
    }

    /// Copies the bytes to their places among those of all padded indices.
    pub(crate) fn scatter(&self, layout: &Layout, values: &mut [u8]) {
        let mut rest = self.bytes.as_slice();
        for block in self.blocks() {
            let first = block * BLOCK_POINTS;
            let (bytes, after) = rest.split_at(layout.block_len(block));
            values[first..first + bytes.len()].copy_from_slice(bytes);
            rest = after;
        }
    }

    /// Returns the length of the plain layout in bytes.
    pub(crate) fn plain_bytes(&self) -> usize {
        let run = |(first, count): &(u32, u32)| varint_bytes(*first) + varint_bytes(*count);
        let runs: usize = self.runs.iter().map(run).sum();
        varint_bytes(self.runs.len() as u32) + runs + self.bytes.len()
    }

    /// Appends the plain layout to `out`.
    pub(crate) fn write_plain(&self, out: &mut Vec<u8>) {
        write_varint(out, self.runs.len() as u32);
        for (first, count) in &self.runs {
            write_varint(out, *first);
            write_varint(out, *count);
        }
        out.extend_from_slice(&self.bytes);
    }

    /// Reads the plain layout: `records` points of blocks that `present` does not have yet. It adds these blocks to
    /// `present`.
    pub(crate) fn read_plain(
        &mut self,
        raw: &[u8],
        layout: &Layout,
        present: &mut [bool],
        records: u32,
    ) -> Result<(), ValueError> {
        self.clear();
        let mut reader = Reader::new(raw);
        let field = "a run of blocks";
        let mut arrivals = ArrivalCheck::new(layout, present, records);
        for _ in 0..reader.varint(field)? {
            let run = (reader.varint(field)?, reader.varint(field)?);
            arrivals.add(run)?;
            self.runs.push(run);
        }
        arrivals.end()?;
        let found = reader.remaining();
        if found != records as usize {
            return Err(ValueError::Count { expected: records, found });
        }
        let bytes = reader.take("the values", found)?;
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }
}

impl From<WireError> for ValueError {
    fn from(WireError { field, offset, .. }: WireError) -> ValueError {
        ValueError::Ends { field, offset }
    }
}

/// Checks runs of blocks one after the other.
pub(crate) struct ArrivalCheck<'a> {
    layout: &'a Layout,
    present: &'a mut [bool],
    expected: u32,
    points: usize,
}

impl<'a> ArrivalCheck<'a> {
    pub(crate) fn new(layout: &'a Layout, present: &'a mut [bool], expected: u32) -> ArrivalCheck<'a> {
        ArrivalCheck { layout, present, expected, points: 0 }
    }

    pub(crate) fn add(&mut self, (first, count): (u32, u32)) -> Result<(), ValueError> {
        let end = first as usize + count as usize;
        if count == 0 || end > self.present.len() {
            return Err(ValueError::Run { first, count });
        }
        for block in first as usize..end {
            if std::mem::replace(&mut self.present[block], true) {
                return Err(ValueError::Run { first, count });
            }
            self.points += self.layout.block_len(block);
        }
        // Checked after every run, so that a list of runs is never longer than its number of points.
        if self.points > self.expected as usize { self.end() } else { Ok(()) }
    }

    pub(crate) fn end(&self) -> Result<(), ValueError> {
        let (expected, found) = (self.expected, self.points);
        if found == expected as usize { Ok(()) } else { Err(ValueError::Count { expected, found }) }
    }
}
