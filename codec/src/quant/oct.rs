//! Unit vectors on an octahedron: 4 + 4 bits (paper, section 3.2; Cigolle et al. 2014, "A Survey of
//! Efficient Representations for Independent Unit Vectors").
//!
//! A unit vector is divided by the sum of its absolute values, which puts it on an octahedron; the lower half
//! (z < 0) is folded over the upper one's diagonals; what is left is a square, -1 to 1 on both axes, and each
//! axis gets 16 levels of which the first is -1 and the last is 1. The low nibble of the code is x.

use std::sync::LazyLock;

/// Bits of one axis.
pub const BITS: u32 = 4;
/// Largest code of one axis.
const MAX_CODE: f32 = 15.0;

/// Encodes the direction of `normal` with the best of the four codes around it: the one whose decoded
/// vector makes the smallest angle. Of equals the first in code order (y, then x) wins.
///
/// The length of `normal` does not matter. A vector with no direction (zero, or not finite) gets the code
/// of (0, 0, 1): callers that must not guess check first.
#[must_use]
pub fn encode(normal: [f32; 3]) -> u8 {
    let [u, v] = to_square(normal).map(|axis| (axis * 0.5 + 0.5) * MAX_CODE);
    let [low_u, low_v] = [u, v].map(|axis| axis.clamp(0.0, MAX_CODE - 1.0) as u8);
    let mut best = (f32::NEG_INFINITY, 0);
    for step in 0..4 {
        let code = join(low_u + (step & 1), low_v + (step >> 1));
        let closeness = dot(decode(code), normal);
        if closeness > best.0 {
            best = (closeness, code);
        }
    }
    if best.0 > f32::NEG_INFINITY { best.1 } else { encode_plain(normal) }
}

/// Encodes by rounding each axis to the nearest level, halves up: cheaper and worse than [`encode`].
#[must_use]
pub fn encode_plain(normal: [f32; 3]) -> u8 {
    let [u, v] = to_square(normal).map(|axis| ((axis * 0.5 + 0.5) * MAX_CODE + 0.5) as u8);
    join(u.min(15), v.min(15))
}

/// The unit vector that a code stands for.
#[inline]
#[must_use]
pub fn decode(code: u8) -> [f32; 3] {
    DIRECTIONS[usize::from(code)]
}

/// What every code stands for: a look-up costs less than the division and the square root.
static DIRECTIONS: LazyLock<[[f32; 3]; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| direction(code as u8)));

fn direction(code: u8) -> [f32; 3] {
    let [u, v] = [code & 15, code >> 4].map(|axis| f32::from(axis) / MAX_CODE * 2.0 - 1.0);
    let z = 1.0 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    let x = if u >= 0.0 { u - fold } else { u + fold };
    let y = if v >= 0.0 { v - fold } else { v + fold };
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// Largest angle between a vector and what [`encode`] and [`decode`] make of it, in degrees (the mean is
/// 5.31). It is the covering radius of the 256 codes, rounded up: no encoder can do better with this decoder.
#[must_use]
pub fn max_error_degrees() -> f32 {
    10.62
}

/// Largest angle between a vector and what [`encode_plain`] and [`decode`] make of it, in degrees (the mean
/// is 5.68).
#[must_use]
pub fn max_error_plain_degrees() -> f32 {
    15.8
}

fn join(u: u8, v: u8) -> u8 {
    (v << BITS) | u
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The point of the folded square, -1 to 1 on both axes; (0, 0) for a vector with no direction.
fn to_square([x, y, z]: [f32; 3]) -> [f32; 2] {
    let sum = x.abs() + y.abs() + z.abs();
    if !(sum > 0.0 && sum.is_finite()) {
        return [0.0, 0.0];
    }
    let [u, v] = [x / sum, y / sum];
    if z >= 0.0 {
        return [u, v];
    }
    [(1.0 - v.abs()) * sign(u), (1.0 - u.abs()) * sign(v)]
}

/// 1 or -1; both zeros count as positive, so that -0 and 0 encode alike.
fn sign(value: f32) -> f32 {
    if value >= 0.0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn angle(a: [f32; 3], b: [f32; 3]) -> f64 {
        let [a, b] = [a, b].map(|v| v.map(f64::from));
        let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let cosine = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / (length(a) * length(b));
        cosine.clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Evenly spread directions: a spiral from pole to pole, turning by the golden angle.
    fn directions(count: u32) -> impl Iterator<Item = [f32; 3]> {
        (0..count).map(move |at| {
            let z = 1.0 - (2.0 * f64::from(at) + 1.0) / f64::from(count);
            let (sin, cos) = (f64::from(at) * 2.399_963_229_728_653).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            [(radius * cos) as f32, (radius * sin) as f32, z as f32]
        })
    }

    fn brute_force(normal: [f32; 3]) -> f64 {
        (0..=255).map(|code| angle(decode(code), normal)).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_best_of_four_is_the_best_of_all() {
        for normal in directions(4_000) {
            let found = angle(decode(encode(normal)), normal);
            let best = brute_force(normal);
            assert!(found <= best + 1e-4, "{normal:?}: {found} deg, the best code makes {best} deg");
        }
    }

    #[test]
    fn errors_stay_within_what_is_stated() {
        let count = 200_000;
        let (mut best, mut plain) = (0.0, 0.0);
        for normal in directions(count) {
            let error = angle(decode(encode(normal)), normal);
            let error_plain = angle(decode(encode_plain(normal)), normal);
            assert!(error <= f64::from(max_error_degrees()), "{normal:?}: {error} deg");
            assert!(error_plain <= f64::from(max_error_plain_degrees()), "{normal:?}: {error_plain} deg");
            best += error / f64::from(count);
            plain += error_plain / f64::from(count);
        }
        assert!((5.30..5.33).contains(&best), "mean of the best of four: {best}");
        assert!((5.67..5.70).contains(&plain), "mean of plain rounding: {plain}");
    }

    #[test]
    fn every_code_survives_a_round_trip() {
        for code in 0..=255 {
            // The four corners of the square, and pairs on its rim, are one direction but for rounding.
            assert!(angle(decode(encode(decode(code))), decode(code)) < 1e-2, "code {code}");
        }
    }

    #[test]
    fn directions_that_are_none_get_a_code() {
        for none in [[0.0; 3], [-0.0; 3], [f32::NAN; 3], [f32::INFINITY, 0.0, 1.0]] {
            assert!(angle(decode(encode(none)), [0.0, 0.0, 1.0]) < 10.7, "{none:?}");
        }
    }

    proptest! {
        #[test]
        fn length_does_not_matter(at in 0_u32..1000, scale in 1e-3_f32..1e6) {
            let normal = directions(1000).nth(at as usize).unwrap();
            let (a, b) = (encode(normal), encode(normal.map(|axis| axis * scale)));
            prop_assert!((angle(decode(a), normal) - angle(decode(b), normal)).abs() < 1e-3);
        }
    }
}
