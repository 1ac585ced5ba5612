//! Hash buckets: eight entries of 8 B (paper, section 3.2).

use bytemuck::{Pod, Zeroable};

use crate::paper::POINTS_PER_CELL;

/// Entries of one bucket.
pub const ENTRIES_PER_BUCKET: usize = 8;
/// Largest cell index that an entry can hold: 22 bits.
pub const MAX_CELL_INDEX: u32 = (1 << 22) - 1;

const POINTS_SHIFT: u32 = 22;
const POINTS_MASK: u32 = 31;
const COUNT_SHIFT: u32 = 27;
const COUNT_MASK: u32 = 15;

/// An entry of a bucket: the raw id of a cell, and the index of the cell.
///
/// The first word is the raw id of Eq. 1. From its low end, the second has 22 bits cell index, 5 bits points in the
/// cell, 4 bits entries in use in the bucket (only in the first entry, 0 in the others), and a 0. An entry is in use
/// if its cell has points; an unused entry is all zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Entry {
    id: u32,
    word: u32,
}

impl Entry {
    /// Creates an entry in use: `points` is 1 to 7, and `cell` is at most [`MAX_CELL_INDEX`].
    pub(crate) fn new(id: u32, cell: u32, points: u8) -> Entry {
        Entry { id, word: cell | (u32::from(points) << POINTS_SHIFT) }
    }

    /// Returns the raw id of the cell (Eq. 1).
    #[must_use]
    pub fn id(self) -> u32 {
        self.id
    }

    /// Returns the index of the cell among the cells of the state.
    #[must_use]
    pub fn cell(self) -> u32 {
        self.word & MAX_CELL_INDEX
    }

    /// Returns the number of points in the cell; 0 marks an unused entry.
    #[must_use]
    pub fn points(self) -> u8 {
        ((self.word >> POINTS_SHIFT) & POINTS_MASK) as u8
    }

    /// Returns whether the entry names a cell.
    #[must_use]
    pub fn is_used(self) -> bool {
        self.points() > 0
    }

    pub(crate) fn set_points(&mut self, points: u8) {
        self.word = (self.word & !(POINTS_MASK << POINTS_SHIFT)) | (u32::from(points) << POINTS_SHIFT);
    }

    fn count(self) -> usize {
        ((self.word >> COUNT_SHIFT) & COUNT_MASK) as usize
    }

    fn set_count(&mut self, count: usize) {
        self.word = (self.word & !(COUNT_MASK << COUNT_SHIFT)) | ((count as u32) << COUNT_SHIFT);
    }
}

/// A bucket: eight entries, those in use first. On the wire it has 64 B or 16 words: the id and then the second word
/// of each entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(transparent)]
pub struct Bucket([Entry; ENTRIES_PER_BUCKET]);

/// Why a bucket was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BucketError {
    /// An unused entry has bits set, or is followed by one in use.
    #[error("entry {entry} is unused but not empty, or an entry in use follows it")]
    NotCompact {
        /// Index of the entry, 0 to 7.
        entry: usize,
    },
    /// An entry claims more than seven points.
    #[error("entry {entry} claims {points} points, a cell holds 7")]
    Points {
        /// Index of the entry, 0 to 7.
        entry: usize,
        /// Claimed number of points.
        points: u8,
    },
    /// An entry names a cell that does not exist.
    #[error("entry {entry} names cell {cell}, cells end at {capacity}")]
    Cell {
        /// Index of the entry, 0 to 7.
        entry: usize,
        /// The cell.
        cell: u32,
        /// Number of cells.
        capacity: u32,
    },
    /// The number of entries in use is wrong, or is in another entry than the first, or the top bit of an entry is
    /// set.
    #[error("entry {entry} has wrong bits above its point count")]
    Count {
        /// Index of the entry, 0 to 7.
        entry: usize,
    },
}

impl Bucket {
    /// Returns all eight entries, those in use first.
    #[must_use]
    pub fn entries(&self) -> &[Entry; ENTRIES_PER_BUCKET] {
        &self.0
    }

    pub(crate) fn entries_mut(&mut self) -> &mut [Entry; ENTRIES_PER_BUCKET] {
        &mut self.0
    }

    /// Returns the 16 words of the bucket, as on the wire.
    #[must_use]
    pub fn to_words(&self) -> [u32; 2 * ENTRIES_PER_BUCKET] {
        bytemuck::must_cast(*self)
    }

    pub(crate) fn from_words(words: &[u32; 2 * ENTRIES_PER_BUCKET]) -> Bucket {
        bytemuck::must_cast(*words)
    }

    /// Moves the entries in use to the front (paper, section 3.4) and writes their number into the first.
    ///
    /// The last entry in use fills each hole, which moves as few entries as possible.
    pub(crate) fn compact(&mut self) {
        let mut end = ENTRIES_PER_BUCKET;
        let mut at = 0;
        while at < end {
            self.0[at].set_count(0);
            if self.0[at].is_used() {
                at += 1;
            } else {
                end -= 1;
                self.0[at] = std::mem::take(&mut self.0[end]);
            }
        }
        self.0[0].set_count(at);
    }

    /// Checks that this is a result of [`Bucket::compact`] with cells below `capacity`.
    pub(crate) fn check(&self, capacity: u32) -> Result<(), BucketError> {
        let used = self.0.iter().take_while(|entry| entry.is_used()).count();
        for (at, entry) in self.0.iter().enumerate() {
            if at >= used {
                if *entry != Entry::default() {
                    return Err(BucketError::NotCompact { entry: at });
                }
                continue;
            }
            if usize::from(entry.points()) > POINTS_PER_CELL {
                return Err(BucketError::Points { entry: at, points: entry.points() });
            }
            if entry.cell() >= capacity {
                return Err(BucketError::Cell { entry: at, cell: entry.cell(), capacity });
            }
            let count = if at == 0 { used } else { 0 };
            if entry.count() != count || entry.word >> 31 != 0 {
                return Err(BucketError::Count { entry: at });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_where_the_text_says() {
        let mut bucket = Bucket::default();
        bucket.entries_mut()[2] = Entry::new(0xDEAD_BEEF, 0x2A_AAAA, 5);
        bucket.entries_mut()[6] = Entry::new(7, 1, 7);
        bucket.compact();
        // The last entry in use fills the first hole, and so on.
        let mut expected = [0; 16];
        expected[0] = 7;
        expected[1] = (2 << 27) | (7 << 22) | 1;
        expected[2] = 0xDEAD_BEEF;
        expected[3] = (5 << 22) | 0x2A_AAAA;
        assert_eq!(bucket.to_words(), expected);
        assert_eq!(Bucket::from_words(&expected), bucket);
        assert_eq!(bucket.check(0x2A_AAAB), Ok(()));
        assert_eq!(
            bucket.check(0x2A_AAAA),
            Err(BucketError::Cell { entry: 1, cell: 0x2A_AAAA, capacity: 0x2A_AAAA })
        );
    }

    #[test]
    fn every_flipped_bit_above_the_index_is_seen() {
        let mut bucket = Bucket::default();
        for (at, entry) in (1_u32..).zip(&mut bucket.entries_mut()[..3]) {
            *entry = Entry::new(at, at, 7);
        }
        bucket.compact();
        assert_eq!(bucket.check(16), Ok(()));
        // 7 points with one bit fewer, 1 to 7, is a sound bucket again: that is for the hash to see.
        for (word, bit) in (0..8).flat_map(|entry| (25..32).map(move |bit| (2 * entry + 1, bit))) {
            let mut words = bucket.to_words();
            words[word] ^= 1 << bit;
            assert!(Bucket::from_words(&words).check(16).is_err(), "word {word}, bit {bit}");
        }
        for word in 6..16 {
            let mut words = bucket.to_words();
            words[word] ^= 1;
            let expected = Err(BucketError::NotCompact { entry: word / 2 });
            assert_eq!(Bucket::from_words(&words).check(16), expected, "word {word}");
        }
    }
}
