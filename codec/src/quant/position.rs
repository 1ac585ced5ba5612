//! Position in a cell: 5 bits an axis (paper, section 3.2: 15 bits a point).

/// Bits of one axis.
pub const BITS: u32 = 5;
/// Largest code of one axis. Code 0 is the cell's low face, this code its high face.
pub const MAX_CODE: u8 = (1 << BITS) - 1;

/// Quantises a fraction of the cell edge, 0 to 1, to the nearest of 32 levels; halves round up.
///
/// Values outside are clamped; NaN becomes 0.
#[inline]
#[must_use]
pub fn quantise(fraction: f32) -> u8 {
    // The cast makes 0 of NaN, and truncates, which is the floor of what is not negative.
    (fraction.clamp(0.0, 1.0) * f32::from(MAX_CODE) + 0.5) as u8
}

/// The fraction of the cell edge that a code stands for; codes above 31 use their low 5 bits.
#[inline]
#[must_use]
pub fn dequantise(code: u8) -> f32 {
    f32::from(code & MAX_CODE) / f32::from(MAX_CODE)
}

/// Largest |fraction - dequantise(quantise(fraction))| for a fraction in 0 to 1: half a step and the
/// rounding of `f32`, in cell edges. In space, an axis is off by at most this times the edge.
#[must_use]
pub fn max_error() -> f32 {
    0.5 / f32::from(MAX_CODE) + 2.0 * f32::EPSILON
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn error_stays_within_what_is_stated(fraction in 0.0_f32..=1.0) {
            prop_assert!((dequantise(quantise(fraction)) - fraction).abs() <= max_error());
        }
    }

    #[test]
    fn codes_survive_a_round_trip() {
        for code in 0..=MAX_CODE {
            assert_eq!(quantise(dequantise(code)), code);
        }
    }

    #[test]
    fn what_is_outside_is_clamped() {
        let codes = [-1.0, f32::NEG_INFINITY, f32::NAN, 2.0, f32::INFINITY].map(quantise);
        assert_eq!(codes, [0, 0, 0, 31, 31]);
    }
}
