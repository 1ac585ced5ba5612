//! The index by which the state, the masks and the models name a point.

use super::BLOCK_POINTS;

/// Index of a point when every instance is padded to whole point blocks: 64 times its block plus its place in the block.
///
/// It differs from the point id, which counts the points of all instances without padding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PaddedIndex(pub(crate) usize);

impl PaddedIndex {
    /// Returns the index of place `place`, 0 to 63, of a block.
    #[inline]
    pub(crate) const fn new(block: usize, place: usize) -> PaddedIndex {
        PaddedIndex(block * BLOCK_POINTS + place)
    }

    /// Returns the point block.
    #[inline]
    pub(crate) const fn block(self) -> usize {
        self.0 / BLOCK_POINTS
    }

    /// Returns the bit of the point in a mask of its block.
    #[inline]
    pub(crate) const fn bit(self) -> u64 {
        1 << (self.0 % BLOCK_POINTS)
    }
}
