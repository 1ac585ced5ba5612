//! A point in 16 bits.

use crate::paper::Packed;

/// A point in 16 bits: cell records of 18 B instead of 32.
///
/// | bits | what |
/// |---|---|
/// | 15 | valid: 1 for a point, 0 for an empty slot (all of whose bits are 0) |
/// | 13 to 14 | position z ([`position`](crate::quant::position)) |
/// | 11 to 12 | position y |
/// | 9 to 10 | position x |
/// | 7 to 8 | normal, second axis ([`oct`](crate::quant::oct)): three levels, so code 3 counts as 2 |
/// | 5 to 6 | normal, first axis |
/// | 0 to 4 | accessibility ([`unorm`](crate::quant::unorm)) |
///
/// This split is the best of those tried. PSNR in dB and, below it, mean error in 255ths against 512 rays a pixel,
/// with 512 points per m²:
///
/// | bits of position, normal, accessibility | `colonnade` | `asteroids` | the paper's `arcade` |
/// |---|---|---|---|
/// | 3x5, 4+4, 8 (32 bits) | 24.02 <br> 4.99 | 33.51 <br> 0.61 | 28.57 <br> 2.80 |
/// | **3x2, 2+2 of three levels, 5** | 23.34 <br> 5.00 | 32.20 <br> 0.71 | 28.21 <br> 3.24 |
/// | 3x2, 2+2 of four levels, 5 | 22.68 <br> 5.98 | 32.47 <br> 0.71 | 28.03 <br> 3.28 |
/// | 3x2, 3+2, 4 | 22.98 <br> 6.06 | 32.28 <br> 0.77 | 27.87 <br> 3.66 |
/// | 3x2, 3+3, 3 | 23.23 <br> 6.37 | 32.30 <br> 0.82 | 27.29 <br> 4.65 |
///
/// With three levels an axis the normals are the six directions along the axes, which are exact where things are built
/// at right angles. The worst error is 54.7 degrees, between three of them. It still lets all points of a flat surface
/// count. Eq. 3 asks for less than 84.2 degrees between the normals of point and fragment. A point's normal fulfils
/// that if it is less than 56.7 degrees off the surface's.
pub type Packed16 = Packed<2, 2, 5>;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::paper::point::packed::tests::{check, check_ends, fields};

    #[test]
    fn bits_are_where_the_table_says() {
        let point = Packed16::pack([1.0 / 3.0, 2.0 / 3.0, 1.0], [0.0, 1.0, 0.0], 255);
        assert_eq!(point.to_bits(), (1 << 15) | (3 << 13) | (2 << 11) | (1 << 9) | (2 << 7) | (1 << 5) | 31);
        assert_eq!(Packed16::pack([0.0; 3], [0.0, 0.0, 1.0], 100).to_bits() & 31, 12);
        assert_eq!((point.position_codes(), point.ao()), ([1, 2, 3], 255));
    }

    #[test]
    fn directions_along_the_axes_are_exact() {
        for axis in 0..6 {
            let mut normal = [0.0; 3];
            normal[axis / 2] = if axis % 2 == 0 { 1.0 } else { -1.0 };
            assert_eq!(Packed16::pack([0.0; 3], normal, 0).normal(), normal);
        }
    }

    #[test]
    fn codes_that_no_encoder_writes_decode_to_what_is_beside_them() {
        for (code, like) in [(0b1111, 0b1010), (0b1101, 0b1001), (0b0011, 0b0010)] {
            let [found, expected] = [code, like].map(|code| Packed16::of_word(1 << 15 | code << 5).normal());
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn ends_are_clamped_and_words_checked() {
        check_ends::<2, 2, 5>(16);
    }

    proptest! {
        #[test]
        fn fields_stay_within_their_stated_errors((frac, normal, ao) in fields()) {
            check::<2, 2, 5>(frac, normal, ao)?;
        }
    }
}
