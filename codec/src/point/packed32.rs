//! A point in 32 bits (paper, section 3.2).

use crate::quant::{oct, position, unorm};

/// One point of a cell: a valid flag, a position in its cell, a normal and an accessibility.
///
/// | bits | what |
/// |---|---|
/// | 31 | valid: 1 for a point, 0 for an empty slot (all of whose bits are 0) |
/// | 26 to 30 | position z ([`position`]) |
/// | 21 to 25 | position y |
/// | 16 to 20 | position x |
/// | 8 to 15 | normal ([`oct`]: x in bits 8 to 11, y in bits 12 to 15) |
/// | 0 to 7 | accessibility ([`unorm`]) |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Packed32(u32);

impl Packed32 {
    /// An empty slot.
    pub const EMPTY: Packed32 = Packed32(0);

    /// Packs a point: its fraction of the cell (0 to 1 an axis, clamped), the direction of its normal (any
    /// length; see [`oct::encode`]) and its accessibility byte (255 = open).
    #[must_use]
    pub fn pack(frac: [f32; 3], normal: [f32; 3], ao: u8) -> Packed32 {
        let [x, y, z] = frac.map(|axis| u32::from(position::quantise(axis)));
        let normal = u32::from(oct::encode(normal));
        Packed32((1 << 31) | (z << 26) | (y << 21) | (x << 16) | (normal << 8) | u32::from(ao))
    }

    /// The point of these 32 bits; every pattern means something, see [`Packed32::is_valid`].
    #[must_use]
    pub const fn from_bits(bits: u32) -> Packed32 {
        Packed32(bits)
    }

    /// The 32 bits of this point.
    #[must_use]
    pub const fn to_bits(self) -> u32 {
        self.0
    }

    /// Whether this is a point and not an empty slot.
    #[must_use]
    pub const fn is_valid(self) -> bool {
        self.0 >> 31 == 1
    }

    /// The position as quantised, 0 to 31 an axis.
    #[must_use]
    pub fn position_codes(self) -> [u8; 3] {
        [16, 21, 26].map(|shift| (self.0 >> shift) as u8 & position::MAX_CODE)
    }

    /// The position as a fraction of the cell edge, 0 to 1 an axis.
    #[must_use]
    pub fn frac(self) -> [f32; 3] {
        self.position_codes().map(position::dequantise)
    }

    /// The normal, of unit length.
    #[must_use]
    pub fn normal(self) -> [f32; 3] {
        oct::decode((self.0 >> 8) as u8)
    }

    /// The accessibility byte; 255 = open.
    #[must_use]
    pub const fn ao(self) -> u8 {
        self.0 as u8
    }

    /// The accessibility, 0 (closed) to 1 (open).
    #[must_use]
    pub fn accessibility(self) -> f32 {
        unorm::dequantise(self.ao())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bits_are_where_the_table_says() {
        // x = 1, y = 2, z = 3 of 31; the code of +x is 0x8F or 0x7F, which are equally close.
        let point = Packed32::pack([1.0 / 31.0, 2.0 / 31.0, 3.0 / 31.0], [1.0, 0.0, 0.0], 0xA5);
        let code = u32::from(oct::encode([1.0, 0.0, 0.0]));
        assert_eq!(point.to_bits(), (1 << 31) | (3 << 26) | (2 << 21) | (1 << 16) | (code << 8) | 0xA5);
        assert_eq!(code & 15, 15);
        assert!(!Packed32::EMPTY.is_valid());
    }

    proptest! {
        #[test]
        fn fields_survive_a_round_trip(
            codes in prop::array::uniform3(0_u8..32), normal in any::<u8>(), ao in any::<u8>(),
        ) {
            let frac = codes.map(position::dequantise);
            let point = Packed32::pack(frac, oct::decode(normal), ao);
            prop_assert!(point.is_valid());
            prop_assert_eq!(point.position_codes(), codes);
            prop_assert_eq!(point.frac(), frac);
            prop_assert!((0..3).all(|axis| (point.normal()[axis] - oct::decode(normal)[axis]).abs() < 1e-6));
            prop_assert_eq!(point.ao(), ao);
            prop_assert_eq!(Packed32::from_bits(point.to_bits()), point);
        }
    }
}
