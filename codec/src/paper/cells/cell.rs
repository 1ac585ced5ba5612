//! Cells: seven points (paper, section 3.2).

use bytemuck::{Pod, Zeroable};

use crate::paper::{Point, PointFormat};

/// Number of points in a cell.
pub const POINTS_PER_CELL: usize = 7;

/// A cell: seven points, empty slots last. Each point is a word in every packing; a narrow point is in the low bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(transparent)]
pub struct Cell([u32; POINTS_PER_CELL]);

impl Cell {
    /// Returns the points, in slot order; `format` is that of the layout.
    #[inline]
    pub fn points(&self, format: PointFormat) -> impl Iterator<Item = Point> + '_ {
        self.packed(format).map(move |word| format.unpack(word))
    }

    /// Returns the packed points, in slot order; `format` is that of the layout.
    #[inline]
    pub fn packed(&self, format: PointFormat) -> impl Iterator<Item = u32> + '_ {
        self.0.iter().copied().take_while(move |word| format.is_valid(*word))
    }

    /// Returns the words of the seven slots.
    #[must_use]
    pub fn words(&self) -> &[u32; POINTS_PER_CELL] {
        &self.0
    }

    pub(crate) fn from_words(words: [u32; POINTS_PER_CELL]) -> Cell {
        Cell(words)
    }

    /// Returns the exclusive or of this cell's words and `other`. It turns either into the other.
    #[inline]
    pub(crate) fn xor(&self, other: &[u32; POINTS_PER_CELL]) -> [u32; POINTS_PER_CELL] {
        std::array::from_fn(|slot| self.0[slot] ^ other[slot])
    }

    /// Returns the first slot that breaks the rule "points first, then zero words"; `None` if there is none. Points
    /// have `WIDTH` bytes.
    #[inline]
    pub(crate) fn first_fault<const WIDTH: usize>(words: &[u32; POINTS_PER_CELL]) -> Option<usize> {
        // The valid bit is the highest; no word has bits above it.
        let used = words.iter().take_while(|word| **word >> (8 * WIDTH - 1) == 1).count();
        (used..POINTS_PER_CELL).find(|slot| words[*slot] != 0)
    }
}
