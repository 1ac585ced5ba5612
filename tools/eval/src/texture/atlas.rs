//! Where blocks of texels lie.

use std::collections::BTreeMap;

use super::Patch;

/// Texels of a block: powers of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Extent {
    /// Power of two across, 1 to 8.
    pub across: u8,
    /// Power of two down, 1 to 8.
    pub down: u8,
}

impl Extent {
    /// Texels across.
    #[must_use]
    pub fn width(self) -> u32 {
        1 << self.across
    }

    /// Texels down.
    #[must_use]
    pub fn height(self) -> u32 {
        1 << self.down
    }

    /// Texels in all.
    #[must_use]
    pub fn texels(self) -> u32 {
        self.width() * self.height()
    }
}

/// The texels of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// How many texels.
    pub extent: Extent,
}

/// The atlas would be taller than it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("what is in view needs an atlas of more than {} rows; choose a larger divisor", Atlas::MAX_ROWS)]
pub struct AtlasFullError;

/// Blocks of patches in an atlas of a fixed width that grows downwards. A block stays where it is as long as it is needed,
/// for the sake of the video coder, which sends what changes.
#[derive(Clone, Debug, Default)]
pub struct Atlas {
    blocks: BTreeMap<Patch, Block>,
    /// Free places of each extent, the last one first.
    free: BTreeMap<Extent, Vec<(u32, u32)>>,
    /// Where the next strip of each height begins: column and row.
    shelves: BTreeMap<u8, (u32, u32)>,
    rows: u32,
}

impl Atlas {
    /// Columns.
    pub const WIDTH: u32 = 1024;
    /// The most rows.
    pub const MAX_ROWS: u32 = 8192;
    /// Columns that blocks of one extent take at a time.
    const STRIP: u32 = 256;
    /// Side of what the video coder predicts at once.
    const MACROBLOCK: u32 = 16;

    /// The texels of a patch, if it has any.
    #[must_use]
    pub fn block(&self, patch: Patch) -> Option<Block> {
        self.blocks.get(&patch).copied()
    }

    /// Rows so far, whole macroblocks.
    #[must_use]
    pub fn rows(&self) -> u32 {
        self.rows.next_multiple_of(Self::MACROBLOCK)
    }

    /// Gives a patch a block of this extent, in place of the one it had.
    ///
    /// # Errors
    ///
    /// [`AtlasFullError`]; the patch then has none.
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

    /// Takes the block of a patch away.
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
