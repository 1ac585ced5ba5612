//! Quantiser of positions in a cell (paper, section 3.2: 5 bits an axis, 15 a point).
//!
//! `bits` is the number of bits of one axis, 1 to 8.

/// Returns the largest code of one axis. Code 0 is the low face of the cell, this code its high face.
#[inline]
#[must_use]
pub const fn max_code(bits: u32) -> u8 {
    ((1_u32 << bits) - 1) as u8
}

/// Quantises a fraction of the cell edge, 0 to 1, to the nearest of 2^`bits` levels; halves round up.
///
/// Values outside are clamped; NaN becomes 0.
#[inline]
#[must_use]
pub fn quantise(bits: u32, fraction: f32) -> u8 {
    // The cast turns NaN into 0. It truncates, which is the floor of a value that is not negative.
    (fraction.clamp(0.0, 1.0) * f32::from(max_code(bits)) + 0.5) as u8
}

/// Returns the fraction of the cell edge of a code. Higher bits are ignored.
#[inline]
#[must_use]
pub fn dequantise(bits: u32, code: u8) -> f32 {
    f32::from(code & max_code(bits)) / f32::from(max_code(bits))
}

/// Returns the largest |fraction - dequantise(quantise(fraction))| for a fraction in 0 to 1, in cell edges: half a
/// step and the rounding of `f32`. In space, an axis is off by at most this times the edge.
#[must_use]
pub fn max_error(bits: u32) -> f32 {
    0.5 / f32::from(max_code(bits)) + 2.0 * f32::EPSILON
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn error_stays_within_what_is_stated(bits in 1_u32..=8, fraction in 0.0_f32..=1.0) {
            let back = dequantise(bits, quantise(bits, fraction));
            prop_assert!((back - fraction).abs() <= max_error(bits));
        }
    }

    #[test]
    fn the_stated_error_is_reached_half_way_between_codes() {
        for bits in 1..=8 {
            let half_way = 0.5 / f32::from(max_code(bits));
            let error = (dequantise(bits, quantise(bits, half_way)) - half_way).abs();
            assert!(error > 0.999 * max_error(bits), "{bits} bits: {error}");
        }
    }

    #[test]
    fn codes_survive_a_round_trip() {
        for bits in 1..=8 {
            for code in 0..=max_code(bits) {
                assert_eq!(quantise(bits, dequantise(bits, code)), code);
            }
        }
    }

    #[test]
    fn what_is_outside_is_clamped() {
        for (bits, top) in [(2, 3), (5, 31), (8, 255)] {
            let codes = [-1.0, f32::NEG_INFINITY, f32::NAN, 2.0, f32::INFINITY].map(|at| quantise(bits, at));
            assert_eq!(codes, [0, 0, 0, top, top]);
        }
    }
}
