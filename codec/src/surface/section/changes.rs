//! CHANGES sections: which points a frame changes, and by how much.
//!
//! A change is a number of *quanta*. The client adds `level * quantum` to its AO byte and keeps the result within 1 to
//! 255; [`REMOVAL`] leaves the point without a value. The plain layout is
//!
//! | bytes | field |
//! |---|---|
//! | 1 | quantum, 1 to 255 |
//! | (blocks + 7) / 8 | one bit a block of 64 points, lowest first: whether a point in it changes |
//! | 8 for each such block | one bit a point, lowest first |
//! | 1 or 2 for each such point | the level as a varint: 0, -1, 1, -2 .. as 0, 1, 2, 3 ..; never 0 |

use super::point_mask::PointMask;
use crate::memory;
use crate::surface::{NO_VALUE, PaddedIndex};
use crate::wire::{Reader, WireError, WireErrorKind, write_varint};

/// The changes of one frame, in the order of the points.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Changes {
    /// Difference of one level in a byte.
    pub(crate) quantum: u8,
    /// The points that change.
    pub(crate) points: PointMask,
    /// Their levels, point by point.
    pub(crate) levels: Vec<i16>,
}

/// Largest absolute level: with a quantum of 1, from one end of the range to the other.
pub(crate) const MAX_LEVEL: i16 = 255;
/// The level that takes a point's value away.
pub(crate) const REMOVAL: i16 = -MAX_LEVEL;

/// Returns the byte of a point after a change.
#[inline]
pub(crate) fn changed_value(value: u8, level: i16, quantum: u8) -> u8 {
    let (level, quantum) = (i32::from(level), i32::from(quantum));
    match value {
        _ if level == i32::from(REMOVAL) => NO_VALUE,
        // The smallest level gives the smallest value, so that every value is within half a quantum of some level.
        NO_VALUE => (1 + (level - 1) * quantum).clamp(1, 255) as u8,
        _ => (i32::from(value) + level * quantum).clamp(1, 255) as u8,
    }
}

/// Why changes were refused. An offset counts bytes of the plain layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ChangeError {
    /// The section ends inside a field.
    #[error("it ends inside {field}, which starts at its byte {offset}")]
    Ends {
        /// The field.
        field: &'static str,
        /// Start of the field.
        offset: usize,
    },
    /// Bytes remain after the section.
    #[error("{extra} B remain after its byte {offset}")]
    Trailing {
        /// Start of these bytes.
        offset: usize,
        /// Their number.
        extra: usize,
    },
    /// The quantum is 0.
    #[error("its quantum is 0")]
    Quantum,
    /// A block is not part of the layout, or its values have not been received yet.
    #[error("block {block} is not part of the stream, or its values have not been received yet")]
    Absent {
        /// Number of the block.
        block: u32,
    },
    /// A block is named without a change in it, or with points that it does not have.
    #[error("block {block} names the points {mask:#018x}: none, or some that it does not have")]
    Mask {
        /// Number of the block.
        block: u32,
        /// Its points, one bit each.
        mask: u64,
    },
    /// A run of blocks that arrived is empty, not part of the layout, or not after the one before.
    #[error("{count} blocks from {first} on: an empty run, not part of the stream, or out of order")]
    Arrivals {
        /// First block.
        first: u32,
        /// Number of blocks.
        count: u32,
    },
    /// A patch does not name all points of a block that arrived.
    #[error("block {block} arrives without its points {missing:#018x}")]
    Missing {
        /// Number of the block.
        block: u32,
        /// The points that are not named, one bit each.
        missing: u64,
    },
    /// The level is zero, out of range, has no effect because the value is already 1 or 255, or is negative where the
    /// point has no value.
    #[error("the point of padded index {padded_index} cannot change by {level} quanta")]
    Level {
        /// Padded index of the point: 64 times its block plus its place there.
        padded_index: u32,
        /// The level.
        level: i32,
    },
    /// A level is outside -255 to 255.
    #[error("the level at its byte {offset} is {found} when folded; at most 510 is possible")]
    LevelRange {
        /// Start of the level.
        offset: usize,
        /// Found, folded: 0, -1, 1, -2 .. as 0, 1, 2, 3 ..
        found: u32,
    },
    /// The number of changed points differs from the section table.
    #[error("{found} points change, the section table says {expected}")]
    Count {
        /// Number by the section table.
        expected: u32,
        /// Number in the section.
        found: usize,
    },
}

impl Changes {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        self.points.heap_bytes() + memory::list(&self.levels)
    }

    /// Removes all changes and keeps the buffers.
    pub(crate) fn clear(&mut self) {
        self.points.clear();
        self.levels.clear();
    }

    /// Adds a change. `index` is above that of the change before.
    pub(crate) fn push(&mut self, index: PaddedIndex, level: i16) {
        self.points.push(index);
        self.levels.push(level);
    }

    /// Returns every change with its padded index.
    #[inline]
    pub(crate) fn iter(&self) -> impl Iterator<Item = (PaddedIndex, i16)> + '_ {
        self.points.padded_indices().zip(self.levels.iter().copied())
    }

    /// Returns the length of the plain layout, for a stream of `blocks` blocks, in bytes.
    pub(crate) fn plain_bytes(&self, blocks: usize) -> usize {
        let long = self.levels.iter().filter(|level| fold(**level) > 127).count();
        1 + self.points.plain_bytes(blocks) + self.levels.len() + long
    }

    /// Appends the plain layout to `out`.
    pub(crate) fn write_plain(&self, blocks: usize, out: &mut Vec<u8>) {
        out.push(self.quantum);
        self.points.write_plain(blocks, out);
        for level in &self.levels {
            write_varint(out, fold(*level));
        }
    }

    /// Reads the plain layout: `records` changes of a stream of `blocks` blocks. It does not check whether the changes
    /// fit a state.
    pub(crate) fn read_plain(&mut self, raw: &[u8], blocks: usize, records: u32) -> Result<(), ChangeError> {
        self.clear();
        let mut reader = Reader::new(raw);
        self.quantum = reader.take("the quantum", 1)?[0];
        if self.quantum == 0 {
            return Err(ChangeError::Quantum);
        }
        self.points.read_plain(&mut reader, blocks, records)?;
        for _ in 0..records {
            self.levels.push(level(&mut reader)?);
        }
        Ok(reader.end()?)
    }
}

impl From<WireError> for ChangeError {
    fn from(WireError { field, offset, kind }: WireError) -> ChangeError {
        match kind {
            WireErrorKind::Ends { .. } | WireErrorKind::Varint(_) => ChangeError::Ends { field, offset },
            WireErrorKind::Trailing { extra } => ChangeError::Trailing { offset, extra },
        }
    }
}

/// Folds a signed level into a number: 0, -1, 1, -2 .. become 0, 1, 2, 3 ..
fn fold(level: i16) -> u32 {
    ((i32::from(level) << 1) ^ (i32::from(level) >> 31)) as u32
}

/// Reads the next level.
fn level(reader: &mut Reader<'_>) -> Result<i16, ChangeError> {
    let (field, offset) = ("a level", reader.offset());
    match reader.varint(field)? {
        folded if folded <= fold(MAX_LEVEL) => Ok(((folded >> 1) as i32 ^ -((folded & 1) as i32)) as i16),
        found => Err(ChangeError::LevelRange { offset, found }),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn changes() -> impl Strategy<Value = Changes> {
        let some = prop::collection::btree_map(0_usize..700, prop_oneof![-255_i16..0, 1_i16..256], 1..80);
        (some, 1_u8..=255).prop_map(|(some, quantum)| {
            let mut changes = Changes { quantum, ..Changes::default() };
            some.into_iter().for_each(|(index, level)| changes.push(PaddedIndex(index), level));
            changes
        })
    }

    proptest! {
        #[test]
        fn plain_changes_survive_and_no_prefix_does(changes in changes()) {
            let mut raw = Vec::new();
            changes.write_plain(11, &mut raw);
            prop_assert_eq!(raw.len(), changes.plain_bytes(11));
            let records = changes.levels.len() as u32;
            let mut found = Changes::default();
            prop_assert_eq!(found.read_plain(&raw, 11, records), Ok(()));
            prop_assert_eq!(&found, &changes);
            prop_assert_eq!(found.iter().count(), changes.levels.len());
            for end in 0..raw.len() {
                prop_assert!(found.read_plain(&raw[..end], 11, records).is_err());
            }
            raw.push(0);
            let trailing = matches!(found.read_plain(&raw, 11, records), Err(ChangeError::Trailing { .. }));
            prop_assert!(trailing);
            let count = matches!(found.read_plain(&raw, 11, records + 1), Err(ChangeError::Count { .. }));
            prop_assert!(count);
        }

        #[test]
        fn noise_is_read_or_refused(noise in prop::collection::vec(any::<u8>(), 0..100), records in 0_u32..50) {
            let mut found = Changes::default();
            if found.read_plain(&noise, 11, records).is_ok() {
                prop_assert_eq!(found.levels.len(), records as usize);
                prop_assert_eq!(found.plain_bytes(11), noise.len());
            }
        }
    }
}
