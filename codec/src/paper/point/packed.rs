//! A point packed into a word, for any split of its bits.

use crate::paper::{BitSplit, Point, WordError};
use crate::quant::{oct, position, unorm};

/// One point of a cell: a valid flag, a position in its cell, a normal and an accessibility, in
/// `1 + 3 * POSITION + 2 * NORMAL + AO` bits, at most 32.
///
/// From the lowest bit on: accessibility, normal (first axis, then second), position (x, y, z), valid. The bits above
/// are 0. All bits of an empty slot are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Packed<const POSITION: u32, const NORMAL: u32, const AO: u32>(u32);

impl<const POSITION: u32, const NORMAL: u32, const AO: u32> Packed<POSITION, NORMAL, AO> {
    /// An empty slot.
    pub const EMPTY: Self = Self(0);
    /// Bits of the fields.
    pub const SPLIT: BitSplit = BitSplit { position: POSITION, normal: NORMAL, ao: AO };
    /// Number of bits of a point.
    pub const BITS: u32 = 1 + 3 * POSITION + 2 * NORMAL + AO;

    const NORMAL_SHIFT: u32 = AO;
    const POSITION_SHIFT: u32 = AO + 2 * NORMAL;
    const VALID: u32 = 1 << (Self::BITS - 1);

    /// Packs a point: its fraction of the cell (0 to 1 an axis, clamped), the direction of its normal (any length, see
    /// [`oct::encode_bits`]) and its accessibility byte (255 is open).
    #[must_use]
    pub fn pack(frac: [f32; 3], normal: [f32; 3], ao: u8) -> Self {
        let [x, y, z] = frac.map(|axis| u32::from(position::quantise(POSITION, axis)));
        let position = (((z << POSITION) | y) << POSITION) | x;
        let normal = u32::from(oct::encode_bits(NORMAL, normal));
        let ao = u32::from(unorm::narrow(AO, ao));
        Self(Self::VALID | (position << Self::POSITION_SHIFT) | (normal << Self::NORMAL_SHIFT) | ao)
    }

    /// Returns the point of a word. Every pattern of its bits has a meaning, see [`Packed::is_valid`].
    ///
    /// # Errors
    /// [`WordError`] for a word with a bit above the point's.
    pub fn from_bits(word: u32) -> Result<Self, WordError> {
        let bits = Self::BITS;
        if word.leading_zeros() < u32::BITS - bits {
            return Err(WordError { word, bits });
        }
        Ok(Self(word))
    }

    /// Returns the point in the low bits of a word.
    pub(crate) const fn of_word(word: u32) -> Self {
        Self(word)
    }

    /// Returns the word of this point.
    #[must_use]
    pub const fn to_bits(self) -> u32 {
        self.0
    }

    /// Returns whether this is a point and not an empty slot.
    #[must_use]
    pub const fn is_valid(self) -> bool {
        self.0 & Self::VALID != 0
    }

    /// Returns the quantised position, 0 to `2^POSITION - 1` an axis.
    #[must_use]
    pub fn position_codes(self) -> [u8; 3] {
        [0, 1, 2].map(|axis| {
            (self.0 >> (Self::POSITION_SHIFT + axis * POSITION)) as u8 & position::max_code(POSITION)
        })
    }

    /// Returns the position as a fraction of the cell edge, 0 to 1 an axis.
    #[must_use]
    pub fn frac(self) -> [f32; 3] {
        self.position_codes().map(|code| position::dequantise(POSITION, code))
    }

    /// Returns the normal, of unit length.
    #[must_use]
    pub fn normal(self) -> [f32; 3] {
        let mask = (1 << (2 * NORMAL)) - 1;
        oct::decode_bits(NORMAL, ((self.0 >> Self::NORMAL_SHIFT) & mask) as u16)
    }

    /// Returns the accessibility byte; 255 is open.
    #[must_use]
    pub const fn ao(self) -> u8 {
        unorm::widen(AO, self.0 as u8)
    }

    /// Returns the accessibility, 0 (closed) to 1 (open).
    #[must_use]
    pub fn accessibility(self) -> f32 {
        unorm::dequantise(self.ao())
    }

    /// Returns all fields.
    #[inline]
    #[must_use]
    pub fn unpack(self) -> Point {
        Point { frac: self.frac(), normal: self.normal(), ao: self.ao() }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the angle between two vectors, degrees.
    fn angle(a: [f32; 3], b: [f32; 3]) -> f64 {
        let [a, b] = [a, b].map(|v| v.map(f64::from));
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        (dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()).clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Checks what every packing promises of every point.
    pub(in crate::paper::point) fn check<const P: u32, const N: u32, const A: u32>(
        frac: [f32; 3],
        normal: [f32; 3],
        ao: u8,
    ) -> Result<(), TestCaseError> {
        let point = Packed::<P, N, A>::pack(frac, normal, ao);
        prop_assert!(point.is_valid());
        prop_assert_eq!(Packed::from_bits(point.to_bits()), Ok(point));
        let back = point.unpack();
        for (back, frac) in back.frac.iter().zip(frac) {
            prop_assert!((back - frac).abs() <= position::max_error(P), "{} became {}", frac, back);
        }
        let off = angle(back.normal, normal);
        prop_assert!(off <= f64::from(oct::max_error_degrees(N)), "{:?}: {} degrees", back, off);
        prop_assert!(back.ao.abs_diff(ao) <= unorm::max_narrow_error(A), "{:?}", back);
        prop_assert_eq!(back.accessibility(), point.accessibility());
        // A point that was packed before stays as it is, except for normals with two codes.
        let again = Packed::<P, N, A>::pack(back.frac, back.normal, back.ao).unpack();
        prop_assert_eq!((again.frac, again.ao), (back.frac, back.ao));
        prop_assert!(angle(again.normal, back.normal) < 4e-2);
        Ok(())
    }

    /// Fractions of a cell, a direction, a byte.
    pub(in crate::paper::point) fn fields() -> impl Strategy<Value = ([f32; 3], [f32; 3], u8)> {
        let direction = prop::array::uniform3(-1.0_f32..=1.0)
            .prop_filter("a direction", |v| v.iter().map(|axis| axis.abs()).sum::<f32>() > 1e-3);
        (prop::array::uniform3(0.0_f32..=1.0), direction, any::<u8>())
    }

    /// Checks what every packing promises of its extremes, and of words that are not its own.
    pub(in crate::paper::point) fn check_ends<const P: u32, const N: u32, const A: u32>(bits: u32) {
        type Point<const P: u32, const N: u32, const A: u32> = Packed<P, N, A>;
        assert_eq!(Point::<P, N, A>::BITS, bits);
        let top = u32::MAX >> (32 - bits);
        let outside = Packed::<P, N, A>::pack([2.0, f32::INFINITY, 1e9], [0.0, 0.0, 1.0], 255);
        assert_eq!(outside.frac(), [1.0; 3], "clamped, not wrapped");
        assert_eq!(outside.ao(), 255);
        let inside = Packed::<P, N, A>::pack([-2.0, f32::NAN, 0.0], [0.0, 0.0, 1.0], 0);
        assert_eq!((inside.frac(), inside.ao()), ([0.0; 3], 0));
        assert!(!Packed::<P, N, A>::EMPTY.is_valid());
        assert!(Packed::<P, N, A>::from_bits(top).is_ok_and(Packed::is_valid));
        assert!(Packed::<P, N, A>::from_bits(top >> 1).is_ok_and(|point| !point.is_valid()));
        for word in (bits..32).map(|bit| 1 << bit) {
            assert_eq!(Packed::<P, N, A>::from_bits(word), Err(WordError { word, bits }));
        }
    }
}
