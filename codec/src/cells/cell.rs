//! Cells: seven points of 32 bits (paper, section 3.2).

use crate::point::Packed32;

/// Points of one cell.
pub const POINTS_PER_CELL: usize = 7;

/// A cell: seven points, empty slots last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cell([u32; POINTS_PER_CELL]);

impl Cell {
    /// The points, in slot order.
    #[inline]
    pub fn points(&self) -> impl Iterator<Item = Packed32> + '_ {
        self.0.iter().map(|word| Packed32::from_bits(*word)).take_while(|point| point.is_valid())
    }

    /// The seven slots as they are stored.
    #[must_use]
    pub fn words(&self) -> &[u32; POINTS_PER_CELL] {
        &self.0
    }

    pub(crate) fn from_words(words: [u32; POINTS_PER_CELL]) -> Cell {
        Cell(words)
    }

    /// What turns this cell into `other`, and `other` into this: their words, combined by exclusive or.
    #[inline]
    pub(crate) fn xor(&self, other: &[u32; POINTS_PER_CELL]) -> [u32; POINTS_PER_CELL] {
        std::array::from_fn(|slot| self.0[slot] ^ other[slot])
    }

    /// The first slot that breaks the rule "points first, then words of zero"; `None` when none does.
    pub(crate) fn first_fault(words: &[u32; POINTS_PER_CELL]) -> Option<usize> {
        let used = words.iter().take_while(|word| Packed32::from_bits(**word).is_valid()).count();
        (used..POINTS_PER_CELL).find(|slot| words[*slot] != 0)
    }
}
