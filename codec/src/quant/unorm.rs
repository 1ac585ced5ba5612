//! Accessibility as a byte (paper, section 3.2: 8 bits a point).

/// Quantises accessibility, 0 (closed) to 1 (open), to the nearest of 256 levels; halves round up.
///
/// Values outside are clamped; NaN becomes 0.
#[inline]
#[must_use]
pub fn quantise(ao: f32) -> u8 {
    (ao.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// The accessibility that a byte stands for, 0 to 1.
#[inline]
#[must_use]
pub fn dequantise(code: u8) -> f32 {
    f32::from(code) / 255.0
}

/// Largest |ao - dequantise(quantise(ao))| for `ao` in 0 to 1: half a step and the rounding of `f32`.
#[must_use]
pub fn max_error() -> f32 {
    0.5 / 255.0 + 2.0 * f32::EPSILON
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
}
