//! The places of blocks in the atlas.

use std::collections::BTreeMap;

use super::Patch;

/// Size of a block in texels: powers of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Extent {
    /// Power of two across, 1 to 8.
    pub across: u8,
    /// Power of two down, 1 to 8.
    pub down: u8,
}

impl Extent {
    /// Returns the texels across.
    #[must_use]
    pub fn width(self) -> u32 {
        1 << self.across
    }

    /// Returns the texels down.
    #[must_use]
    pub fn height(self) -> u32 {
        1 << self.down
    }

    /// Returns the number of texels.
    #[must_use]
    pub fn texels(self) -> u32 {
        self.width() * self.height()
    }
}

/// The block of texels of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Size in texels.
    pub extent: Extent,
}

/// The atlas would be higher than its limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the patches in view need an atlas of more than {} rows; choose a larger divisor", Atlas::MAX_ROWS)]
pub struct AtlasFullError;

/// Blocks of patches in an atlas of a fixed width that grows downwards.
///
/// A block keeps its place as long as it is needed, because the video coder sends what changes.
#[derive(Clone, Debug, Default)]
pub struct Atlas {
    blocks: BTreeMap<Patch, Block>,
    /// Free places of each extent; the last one is used first.
    free: BTreeMap<Extent, Vec<(u32, u32)>>,
    /// Column and row of the next strip of each height.
    shelves: BTreeMap<u8, (u32, u32)>,
    rows: u32,
}

impl Atlas {
    /// Number of columns.
    pub const WIDTH: u32 = 1024;
    /// Largest number of rows.
    pub const MAX_ROWS: u32 = 8192;
    /// Columns of a strip, which is cut into blocks of one extent.
    const STRIP: u32 = 256;
    /// Side of the video coder's macroblocks in texels.
    const MACROBLOCK: u32 = 16;

    /// Returns the block of a patch, if it has one.
    #[must_use]
    pub fn block(&self, patch: Patch) -> Option<Block> {
        self.blocks.get(&patch).copied()
    }

    /// Returns the number of rows so far, rounded up to whole macroblocks.
    #[must_use]
    pub fn rows(&self) -> u32 {
        self.rows.next_multiple_of(Self::MACROBLOCK)
    }

    /// Gives a patch a block of this extent in place of its previous one.
    ///
    /// # Errors
    ///
    /// [`AtlasFullError`]; the patch then has no block.
    pub fn place(&mut self, patch: Patch, extent: Extent) -> Result<Block, AtlasFullError> {
        self.release(patch);
        if self.free.get(&extent).is_none_or(Vec::is_empty) {
            self.strip(extent)?;
        }
        let (x, y) = self.free.get_mut(&extent).and_then(Vec::pop).ok_or(AtlasFullError)?;
        let block = Block { x, y, extent };
        self.blocks.insert(patch, block);
        Ok(block)
    }

    /// Frees the block of a patch.
    pub fn release(&mut self, patch: Patch) {
        if let Some(block) = self.blocks.remove(&patch) {
            self.free.entry(block.extent).or_default().push((block.x, block.y));
        }
    }

    /// Cuts a strip into blocks.
    fn strip(&mut self, extent: Extent) -> Result<(), AtlasFullError> {
        let height = extent.height();
        let (mut x, mut y) = self.shelves.get(&extent.down).copied().unwrap_or((Self::WIDTH, 0));
        if x >= Self::WIDTH {
            (x, y) = (0, self.rows.next_multiple_of(height.min(Self::MACROBLOCK)));
            if y + height > Self::MAX_ROWS {
                return Err(AtlasFullError);
            }
            self.rows = y + height;
        }
        self.shelves.insert(extent.down, (x + Self::STRIP, y));
        let blocks = (0..Self::STRIP / extent.width()).rev().map(|index| (x + index * extent.width(), y));
        self.free.entry(extent).or_default().extend(blocks);
        Ok(())
    }
}
