//! Hashed numbers and smooth noise. The built-in scenes have no other randomness, so they are the same on every
//! machine.

use glam::{DVec3, IVec3};

/// Hashes a seed and a position.
fn hash(seed: u32, p: IVec3) -> u32 {
    let mut h = seed.wrapping_mul(0x9E37_79B9);
    for word in p.to_array() {
        h = (h ^ word as u32).wrapping_mul(0x85EB_CA6B);
        h = (h ^ (h >> 15)).wrapping_mul(0xC2B2_AE35);
        h ^= h >> 13;
    }
    h
}

/// Returns number `index` of a sequence of numbers between 0 and 1.
pub(super) fn uniform(seed: u32, index: i32) -> f64 {
    f64::from(hash(seed, IVec3::new(index, index >> 16, 77))) / f64::from(u32::MAX)
}

/// Returns number `index` of a sequence of numbers between `low` and `high`.
pub(super) fn between(seed: u32, index: i32, low: f64, high: f64) -> f64 {
    low + (high - low) * uniform(seed, index)
}

/// Returns smooth noise between -1 and 1 with features about 1 m across.
pub(super) fn noise(seed: u32, p: DVec3) -> f64 {
    let floor = p.floor();
    let (cell, f) = (floor.as_ivec3(), p - floor);
    let ease = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let corner =
        |x, y, z| f64::from(hash(seed, cell + IVec3::new(x, y, z))) / f64::from(u32::MAX) * 2.0 - 1.0;
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let along_x = |y, z| mix(corner(0, y, z), corner(1, y, z), ease.x);
    let plane = |z| mix(along_x(0, z), along_x(1, z), ease.y);
    mix(plane(0), plane(1), ease.z)
}

/// Returns the radius in some direction of a rock with mean radius 1, with lumps, dents and grain.
pub(super) fn rock(seed: u32, direction: DVec3, roughness: f64) -> f64 {
    let octave = |k: u32, scale: f64| noise(seed + k, direction * scale + DVec3::splat(31.7));
    let dent = octave(3, 2.3).max(0.0);
    1.0 + roughness
        * (0.55 * octave(0, 1.4) + 0.3 * octave(1, 3.1) + 0.14 * octave(2, 7.3) - 0.5 * dent * dent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_bounded_and_not_flat() {
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for i in 0..4000 {
            let p = DVec3::new(f64::from(i) * 0.013, f64::from(i) * 0.007, -f64::from(i) * 0.011);
            let (a, b) = (noise(5, p), noise(5, p + DVec3::splat(1e-4)));
            assert!((a - b).abs() < 2e-3 && a.abs() <= 1.0);
            (low, high) = (low.min(a), high.max(a));
        }
        assert!(low < -0.5 && high > 0.5);
    }

    #[test]
    fn uniform_numbers_fill_their_range() {
        let mean = (0..1000).map(|i| uniform(9, i)).sum::<f64>() / 1000.0;
        assert!((mean - 0.5).abs() < 0.03);
        assert_ne!(uniform(1, 0).to_bits(), uniform(2, 0).to_bits());
    }
}
