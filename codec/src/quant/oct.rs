//! Unit vectors on an octahedron (paper, section 3.2: 4 + 4 bits; Cigolle et al. 2014, "A Survey of
//! Efficient Representations for Independent Unit Vectors").
//!
//! A unit vector is divided by the sum of its absolute values, which puts it on an octahedron. The lower half (z < 0)
//! is folded over the diagonals of the upper half. The result is a square, -1 to 1 on both axes. Each axis gets
//! 2^`bits` levels, of which the first is -1 and the last is 1. The low bits of the code are x.
//!
//! Two bits an axis are an exception: they have three levels, -1, 0 and 1. With four levels, all directions along the
//! axes would be off by 26.6 or 54.7 degrees. Code 3 of an axis is not written; it decodes as 2.
//!
//! `bits` is the number of bits of one axis, 2 to 8. [`encode`], [`encode_plain`] and [`decode`] use the paper's 4.

use std::sync::LazyLock;

/// Bits of one axis in the paper.
pub const BITS: u32 = 4;

/// Encodes with 4 + 4 bits, see [`encode_bits`].
#[must_use]
pub fn encode(normal: [f32; 3]) -> u8 {
    encode_bits(BITS, normal) as u8
}

/// Encodes the direction of `normal` with the best of the four codes around it: the one whose decoded vector makes the
/// smallest angle. Of equal codes, the first in code order (y, then x) wins.
///
/// The length of `normal` does not matter. A vector without a direction (zero, or not finite) gets the code of (0, 0,
/// 1). A caller that must not guess checks first.
#[inline]
#[must_use]
pub fn encode_bits(bits: u32, normal: [f32; 3]) -> u16 {
    let top = max_code(bits);
    let [u, v] = to_square(normal).map(|axis| (axis * 0.5 + 0.5) * top);
    let [low_u, low_v] = [u, v].map(|axis| axis.clamp(0.0, top - 1.0) as u16);
    let mut best = (f32::NEG_INFINITY, 0);
    for step in 0..4 {
        let code = join(bits, low_u + (step & 1), low_v + (step >> 1));
        let closeness = dot(decode_bits(bits, code), normal);
        if closeness > best.0 {
            best = (closeness, code);
        }
    }
    if best.0 > f32::NEG_INFINITY { best.1 } else { round_axes(bits, normal) }
}

/// Encodes with 4 + 4 bits by rounding each axis to the nearest level, halves up. This is cheaper and less exact than
/// [`encode`].
#[must_use]
pub fn encode_plain(normal: [f32; 3]) -> u8 {
    round_axes(BITS, normal) as u8
}

fn round_axes(bits: u32, normal: [f32; 3]) -> u16 {
    let top = max_code(bits);
    let [u, v] = to_square(normal).map(|axis| (((axis * 0.5 + 0.5) * top + 0.5) as u16).min(top as u16));
    join(bits, u, v)
}

/// Returns the unit vector of a code of 4 + 4 bits.
#[inline]
#[must_use]
pub fn decode(code: u8) -> [f32; 3] {
    FOUR[usize::from(code)]
}

/// Returns the unit vector of a code of 2 times `bits` bits. Higher bits are ignored.
#[inline]
#[must_use]
pub fn decode_bits(bits: u32, code: u16) -> [f32; 3] {
    match bits {
        2 => TWO[usize::from(code) & 0xF],
        3 => THREE[usize::from(code) & 0x3F],
        4 => FOUR[usize::from(code) & 0xFF],
        _ => direction(bits, code),
    }
}

/// The direction of every code, for the widths that packings use. A look-up costs less than the division and the
/// square root.
static TWO: LazyLock<[[f32; 3]; 16]> =
    LazyLock::new(|| std::array::from_fn(|code| direction(2, code as u16)));
static THREE: LazyLock<[[f32; 3]; 64]> =
    LazyLock::new(|| std::array::from_fn(|code| direction(3, code as u16)));
static FOUR: LazyLock<[[f32; 3]; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| direction(4, code as u16)));

fn direction(bits: u32, code: u16) -> [f32; 3] {
    let (mask, top) = ((1_u16 << bits) - 1, max_code(bits));
    let [u, v] = [code & mask, (code >> bits) & mask].map(|axis| f32::from(axis).min(top) / top * 2.0 - 1.0);
    let z = 1.0 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    let x = if u >= 0.0 { u - fold } else { u + fold };
    let y = if v >= 0.0 { v - fold } else { v + fold };
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// Returns the largest angle in degrees between a vector and its decoded code of [`encode_bits`]. It is the covering
/// radius of the codes, rounded up, so no encoder can do better with this decoder. The means are 31.9, 11.3, 5.32,
/// 2.58, 1.27, 0.63 and 0.31 for 2 to 8 bits.
#[must_use]
pub fn max_error_degrees(bits: u32) -> f32 {
    match bits {
        0..=2 => 54.74,
        3 => 22.01,
        4 => 10.62,
        5 => 5.22,
        6 => 2.58,
        7 => 1.28,
        _ => 0.64,
    }
}

/// Returns the largest angle in degrees between a vector and its decoded code of [`encode_plain`] (the mean is 5.68).
#[must_use]
pub fn max_error_plain_degrees() -> f32 {
    15.8
}

/// Returns the largest code of one axis.
fn max_code(bits: u32) -> f32 {
    if bits == 2 { 2.0 } else { ((1_u32 << bits) - 1) as f32 }
}

fn join(bits: u32, u: u16, v: u16) -> u16 {
    (v << bits) | u
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the point of the folded square, -1 to 1 on both axes; (0, 0) for a vector without a direction.
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

/// Returns 1 or -1. Both zeros count as positive, so that -0 and 0 encode alike.
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

    /// Returns evenly distributed directions: a spiral from pole to pole that turns by the golden angle.
    fn directions(count: u32) -> impl Iterator<Item = [f32; 3]> {
        (0..count).map(move |at| {
            let z = 1.0 - (2.0 * f64::from(at) + 1.0) / f64::from(count);
            let (sin, cos) = (f64::from(at) * 2.399_963_229_728_653).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            [(radius * cos) as f32, (radius * sin) as f32, z as f32]
        })
    }

    /// Returns the smallest angle between `normal` and any code.
    fn brute_force(bits: u32, normal: [f32; 3]) -> f64 {
        let codes = 0..1_u32 << (2 * bits);
        codes.map(|code| angle(decode_bits(bits, code as u16), normal)).fold(f64::INFINITY, f64::min)
    }

    fn error(bits: u32, normal: [f32; 3]) -> f64 {
        angle(decode_bits(bits, encode_bits(bits, normal)), normal)
    }

    #[test]
    fn the_best_of_four_is_the_best_of_all() {
        for bits in 2..=5 {
            for normal in directions(2_000) {
                let (found, best) = (error(bits, normal), brute_force(bits, normal));
                assert!(found <= best + 1e-4, "{bits} bits, {normal:?}: {found} deg, the best is {best} deg");
            }
        }
    }

    #[test]
    fn errors_stay_within_what_is_stated() {
        let count = 100_000;
        for (bits, mean) in
            [(2, 31.90), (3, 11.32), (4, 5.317), (5, 2.578), (6, 1.269), (7, 0.630), (8, 0.314)]
        {
            let stated = f64::from(max_error_degrees(bits));
            let (mut worst, mut sum) = (0.0_f64, 0.0);
            for normal in directions(count) {
                let error = error(bits, normal);
                assert!(error <= stated, "{bits} bits, {normal:?}: {error} deg");
                worst = worst.max(error);
                sum += error / f64::from(count);
            }
            assert!(worst > 0.97 * stated, "{bits} bits: {worst} deg, {stated} deg are stated");
            assert!((sum - mean).abs() < 0.002 * mean, "mean of the best of four: {sum}");
        }
    }

    #[test]
    fn plain_rounding_stays_within_what_is_stated() {
        let count = 200_000;
        let mut mean = 0.0;
        for normal in directions(count) {
            let error = angle(decode(encode_plain(normal)), normal);
            assert!(error <= f64::from(max_error_plain_degrees()), "{normal:?}: {error} deg");
            mean += error / f64::from(count);
        }
        assert!((5.67..5.70).contains(&mean), "mean of plain rounding: {mean}");
    }

    #[test]
    fn every_code_survives_a_round_trip() {
        // Two bits: codes with an axis of 3 are the same directions again.
        for bits in 2..=8 {
            for code in 0..=((1_u32 << (2 * bits)) - 1) as u16 {
                // The four corners of the square, and pairs on its rim, are one direction but for rounding.
                let direction = decode_bits(bits, code);
                assert!(error(bits, direction) < 4e-2, "{bits} bits, code {code}");
            }
        }
    }

    #[test]
    fn the_byte_of_the_paper_is_the_code_of_four_bits() {
        for code in 0..=255 {
            assert_eq!(decode(code), decode_bits(4, u16::from(code)));
            assert_eq!(decode(code), direction(4, u16::from(code)));
        }
        for normal in directions(1_000) {
            assert_eq!(u16::from(encode(normal)), encode_bits(4, normal));
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
