//! A point in 32 bits (paper, section 3.2).

use crate::paper::Packed;

/// A point in 32 bits, split as in the paper.
///
/// | bits | what |
/// |---|---|
/// | 31 | valid: 1 for a point, 0 for an empty slot (all of whose bits are 0) |
/// | 26 to 30 | position z ([`position`](crate::quant::position)) |
/// | 21 to 25 | position y |
/// | 16 to 20 | position x |
/// | 12 to 15 | normal, second axis ([`oct`](crate::quant::oct)) |
/// | 8 to 11 | normal, first axis |
/// | 0 to 7 | accessibility ([`unorm`](crate::quant::unorm)) |
pub type Packed32 = Packed<5, 4, 8>;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::paper::point::packed::tests::{check, check_ends, fields};
    use crate::quant::oct;

    #[test]
    fn bits_are_where_the_table_says() {
        // x = 1, y = 2, z = 3 of 31; the code of +x is 0x8F or 0x7F, which are equally close.
        let point = Packed32::pack([1.0 / 31.0, 2.0 / 31.0, 3.0 / 31.0], [1.0, 0.0, 0.0], 0xA5);
        let code = u32::from(oct::encode([1.0, 0.0, 0.0]));
        assert_eq!(point.to_bits(), (1 << 31) | (3 << 26) | (2 << 21) | (1 << 16) | (code << 8) | 0xA5);
        assert_eq!(code & 15, 15);
        assert_eq!((point.position_codes(), point.ao()), ([1, 2, 3], 0xA5));
    }

    #[test]
    fn ends_are_clamped_and_words_checked() {
        check_ends::<5, 4, 8>(32);
    }

    proptest! {
        #[test]
        fn fields_stay_within_their_stated_errors((frac, normal, ao) in fields()) {
            check::<5, 4, 8>(frac, normal, ao)?;
        }
    }
}
