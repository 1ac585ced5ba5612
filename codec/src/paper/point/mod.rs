//! A point in memory, and its packings into 32, 24 and 16 bits.

mod format;
mod packed;
mod packed16;
mod packed24;
mod packed32;

pub use format::{BitSplit, PointFormat, WordError};
pub use packed::Packed;
pub use packed16::Packed16;
pub use packed24::Packed24;
pub use packed32::Packed32;

use crate::quant::unorm;

/// An unpacked point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Position as a fraction of the cell edge, 0 to 1 an axis.
    pub frac: [f32; 3],
    /// Normal, of unit length.
    pub normal: [f32; 3],
    /// Accessibility byte; 255 is open.
    pub ao: u8,
}

impl Point {
    /// Returns the accessibility, 0 (closed) to 1 (open).
    #[inline]
    #[must_use]
    pub fn accessibility(&self) -> f32 {
        unorm::dequantise(self.ao)
    }
}
