//! Quantiser of accessibility. It is a byte where it is computed and compared (paper, section 3.2: 8 bits a point),
//! and fewer bits in packings without room for a byte.

/// Quantises accessibility, 0 (closed) to 1 (open), to the nearest of 256 levels; halves round up.
///
/// Values outside are clamped; NaN becomes 0.
#[inline]
#[must_use]
pub fn quantise(ao: f32) -> u8 {
    (ao.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Returns the accessibility of a byte, 0 to 1.
#[inline]
#[must_use]
pub fn dequantise(code: u8) -> f32 {
    f32::from(code) / 255.0
}

/// Returns the largest |ao - dequantise(quantise(ao))| for `ao` in 0 to 1: half a step and the rounding of `f32`.
#[must_use]
pub fn max_error() -> f32 {
    0.5 / 255.0 + 2.0 * f32::EPSILON
}

/// Returns the code of `bits` bits (1 to 8) whose level is nearest to a byte; halves round up. 0 and 255 become the
/// first and the last code.
#[inline]
#[must_use]
pub const fn narrow(bits: u32, byte: u8) -> u8 {
    if bits == 8 {
        return byte;
    }
    let max = (1_u32 << bits) - 1;
    ((byte as u32 * 2 * max + 255) / 510) as u8
}

/// Returns the byte nearest to the level of a code of `bits` bits (1 to 8): `code * 255 / (2^bits - 1)`, halves up.
/// Higher bits are ignored.
#[inline]
#[must_use]
pub const fn widen(bits: u32, code: u8) -> u8 {
    if bits == 8 {
        return code;
    }
    let max = (1_u32 << bits) - 1;
    (((code as u32 & max) * 510 + max) / (2 * max)) as u8
}

/// Returns the largest difference between a byte and its value after [`narrow`] and [`widen`]: half a step, in 255ths.
#[must_use]
pub const fn max_narrow_error(bits: u32) -> u8 {
    (255 / (2 * ((1_u32 << bits) - 1))) as u8
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn error_stays_within_what_is_stated(ao in 0.0_f32..=1.0) {
            prop_assert!((dequantise(quantise(ao)) - ao).abs() <= max_error());
        }
    }

    #[test]
    fn codes_survive_a_round_trip_and_the_rest_is_clamped() {
        for code in 0..=255 {
            assert_eq!(quantise(dequantise(code)), code);
        }
        assert_eq!([-0.5, f32::NAN, 1.5, f32::INFINITY].map(quantise), [0, 0, 255, 255]);
    }

    #[test]
    fn narrowed_bytes_are_off_by_what_is_stated_and_no_less() {
        for bits in 1..=8 {
            let error = |byte: u8| widen(bits, narrow(bits, byte)).abs_diff(byte);
            assert_eq!((0..=255).map(error).max(), Some(max_narrow_error(bits)), "{bits} bits");
            let nearest =
                |byte: u8| (0..1_u16 << bits).map(|code| widen(bits, code as u8).abs_diff(byte)).min();
            assert!((0..=255).all(|byte| nearest(byte) == Some(error(byte))), "{bits} bits: not the nearest");
        }
    }

    #[test]
    fn narrow_codes_survive_a_round_trip_and_reach_both_ends() {
        for bits in 1..=8 {
            let top = ((1_u16 << bits) - 1) as u8;
            assert!((0..=top).all(|code| narrow(bits, widen(bits, code)) == code), "{bits} bits");
            assert_eq!((widen(bits, 0), widen(bits, top)), (0, 255));
            assert_eq!((narrow(bits, 0), narrow(bits, 255)), (0, top));
        }
    }
}
