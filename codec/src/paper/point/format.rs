//! The packing of a stream, chosen when it starts.

use crate::envelope::Packing;
use crate::paper::{Packed16, Packed24, Packed32, Point};
use crate::quant::{oct, position, unorm};

/// The packing of all points of a stream. It is part of the [`Layout`](crate::paper::Layout).
///
/// A packed point is a word. The bits above those of the point are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum PointFormat {
    /// [`Packed32`], the paper's.
    #[default]
    Bits32,
    /// [`Packed24`].
    Bits24,
    /// [`Packed16`].
    Bits16,
}

/// Split of the bits of a point. One more bit tells that the word is a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BitSplit {
    /// Bits of one axis of the position.
    pub position: u32,
    /// Bits of one of the two axes of the normal.
    pub normal: u32,
    /// Bits of the accessibility.
    pub ao: u32,
}

/// The word is not a point of the packing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{word:#010x} has bits above the {bits} of a point: is it of a wider packing?")]
pub struct WordError {
    /// The word.
    pub word: u32,
    /// Bits of a point.
    pub bits: u32,
}

impl PointFormat {
    /// All packings, widest first.
    pub const ALL: [PointFormat; 3] = [PointFormat::Bits32, PointFormat::Bits24, PointFormat::Bits16];

    /// Returns the packing with points of `bits` bits; `None` unless `bits` is 32, 24 or 16.
    #[must_use]
    pub fn from_bits(bits: u8) -> Option<PointFormat> {
        PointFormat::ALL.into_iter().find(|format| format.bits() == u32::from(bits))
    }

    /// Returns the packing of an id in a frame header; `None` if it is unknown.
    #[must_use]
    pub fn from_packing(packing: Packing) -> Option<PointFormat> {
        PointFormat::ALL.into_iter().find(|format| format.packing() == packing)
    }

    /// Returns its id in frame headers.
    #[must_use]
    pub const fn packing(self) -> Packing {
        match self {
            PointFormat::Bits32 => Packing::BITS_32,
            PointFormat::Bits24 => Packing::BITS_24,
            PointFormat::Bits16 => Packing::BITS_16,
        }
    }

    /// Returns the number of bits of a point: 32, 24 or 16.
    #[must_use]
    pub const fn bits(self) -> u32 {
        match self {
            PointFormat::Bits32 => Packed32::BITS,
            PointFormat::Bits24 => Packed24::BITS,
            PointFormat::Bits16 => Packed16::BITS,
        }
    }

    /// Returns the number of bytes of a point on the wire: 4, 3 or 2.
    #[inline]
    #[must_use]
    pub const fn bytes(self) -> usize {
        self.bits() as usize / 8
    }

    /// Returns the split of the bits.
    #[must_use]
    pub const fn split(self) -> BitSplit {
        match self {
            PointFormat::Bits32 => Packed32::SPLIT,
            PointFormat::Bits24 => Packed24::SPLIT,
            PointFormat::Bits16 => Packed16::SPLIT,
        }
    }

    /// Packs a point, see [`Packed::pack`](super::Packed::pack).
    #[must_use]
    pub fn pack(self, frac: [f32; 3], normal: [f32; 3], ao: u8) -> u32 {
        match self {
            PointFormat::Bits32 => Packed32::pack(frac, normal, ao).to_bits(),
            PointFormat::Bits24 => Packed24::pack(frac, normal, ao).to_bits(),
            PointFormat::Bits16 => Packed16::pack(frac, normal, ao).to_bits(),
        }
    }

    /// Returns whether a word is a point and not an empty slot.
    #[inline]
    #[must_use]
    pub const fn is_valid(self, word: u32) -> bool {
        word >> (self.bits() - 1) & 1 == 1
    }

    /// Returns the point in the low bits of a word. Every pattern of them has a meaning, see
    /// [`PointFormat::is_valid`].
    #[inline]
    #[must_use]
    pub fn unpack(self, word: u32) -> Point {
        match self {
            PointFormat::Bits32 => Packed32::of_word(word).unpack(),
            PointFormat::Bits24 => Packed24::of_word(word).unpack(),
            PointFormat::Bits16 => Packed16::of_word(word).unpack(),
        }
    }

    /// Returns the accessibility byte of clients when `ao` was packed. It is off by at most
    /// [`PointFormat::max_ao_error`].
    #[inline]
    #[must_use]
    pub const fn held_ao(self, ao: u8) -> u8 {
        let bits = self.split().ao;
        unorm::widen(bits, unorm::narrow(bits, ao))
    }

    /// Returns the largest error of one axis of a position inside its grid, in cell edges.
    #[must_use]
    pub fn max_position_error(self) -> f32 {
        position::max_error(self.split().position)
    }

    /// Returns the largest error of a normal, degrees.
    #[must_use]
    pub fn max_normal_error_degrees(self) -> f32 {
        oct::max_error_degrees(self.split().normal)
    }

    /// Returns the largest error of an accessibility byte, 255ths.
    #[must_use]
    pub const fn max_ao_error(self) -> u8 {
        unorm::max_narrow_error(self.split().ao)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_and_widths_name_one_packing_each() {
        for format in PointFormat::ALL {
            assert_eq!(PointFormat::from_bits(format.bits() as u8), Some(format));
            assert_eq!(PointFormat::from_packing(format.packing()), Some(format));
            assert_eq!(format.bytes() * 8, format.bits() as usize);
        }
        assert_eq!([0, 8, 31, 64].map(PointFormat::from_bits), [None; 4]);
        assert_eq!([0, 4, 255].map(|id| PointFormat::from_packing(Packing(id))), [None; 3]);
    }

    #[test]
    fn a_client_holds_what_unpacking_gives() {
        for format in PointFormat::ALL {
            for ao in 0..=255 {
                let word = format.pack([0.5; 3], [0.0, 0.0, 1.0], ao);
                let held = format.unpack(word).ao;
                assert!(format.is_valid(word) && held == format.held_ao(ao));
                assert!(held.abs_diff(ao) <= format.max_ao_error());
                assert_eq!(format.held_ao(held), held);
            }
            assert_eq!([0, 255].map(|ao| format.held_ao(ao)), [0, 255]);
        }
        assert_eq!(PointFormat::Bits32.max_ao_error(), 0);
    }
}
