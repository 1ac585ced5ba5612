//! Noise that differs from pixel to pixel and is the same on every machine.

use glam::Vec2;

use super::Screen;
use super::depth::Pixel;
use crate::reference::{fraction, mix};

/// Returns random bits of a pixel. They do not depend on the guard band.
pub(crate) fn bits(screen: &Screen, pixel: &Pixel, seed: u64) -> u64 {
    let guard = screen.guard() as i32;
    let place = ((pixel.y - guard) as u64) << 32 | (pixel.x - guard) as u64;
    mix(seed ^ mix(place))
}

/// Returns the `index`-th pair of numbers in `[0, 1)` of a pixel with these bits.
#[inline]
pub(crate) fn pair(bits: u64, index: usize) -> Vec2 {
    let bits = mix(bits.wrapping_add(index as u64));
    Vec2::new(unit(bits as u32), unit((bits >> 32) as u32))
}

/// Returns a length in `[0, 1)` for the `index`-th of a set of points. The lengths are a low-discrepancy sequence, so
/// any set has even ones.
pub(crate) fn length(index: u32) -> f32 {
    // Multiples of the golden ratio, in units of 2^-32.
    unit(index.wrapping_mul(0x9E37_79B9).wrapping_add(0x8000_0000))
}

/// Returns 24 of the bits as a number in `[0, 1)`, which f32 holds exactly.
#[inline]
fn unit(bits: u32) -> f32 {
    fraction(bits & 0xFFFF_FF00) as f32
}

/// Table of unit vectors over the whole turn.
#[derive(Debug)]
pub(crate) struct DirectionTable(Vec<Vec2>);

impl DirectionTable {
    const POINTS: usize = 4_096;

    /// The size of the table in bytes.
    pub(crate) const BYTES: usize = Self::POINTS * size_of::<Vec2>();

    pub(crate) fn new() -> Self {
        let angle = |point: usize| point as f64 / Self::POINTS as f64 * std::f64::consts::TAU;
        let at = |point| Vec2::new(libm::cos(angle(point)) as f32, libm::sin(angle(point)) as f32);
        Self((0..Self::POINTS).map(at).collect())
    }

    /// Returns the unit vector at `turns` of a turn, from x towards y; `turns` is at least 0.
    #[inline]
    pub(crate) fn at(&self, turns: f32) -> Vec2 {
        self.0[(turns * Self::POINTS as f32) as usize % Self::POINTS]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_compass_turns_once_and_its_vectors_are_unit() {
        let compass = DirectionTable::new();
        assert_eq!([0.0, 1.0, 7.0].map(|turns| compass.at(turns)), [Vec2::X; 3]);
        assert!((compass.at(0.25) - Vec2::Y).length() < 1e-6);
        for index in 0..1_000 {
            let turns = index as f32 / 250.0;
            let (sin, cos) = (f64::from(turns) * std::f64::consts::TAU).sin_cos();
            let apart = compass.at(turns) - Vec2::new(cos as f32, sin as f32);
            assert!(apart.length() < std::f32::consts::TAU / 4_096.0 + 1e-6, "{apart}");
            assert!((compass.at(turns).length() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn numbers_fill_the_unit_square_evenly() {
        let mut boxes = [0_u32; 16];
        for index in 0..16_000 {
            let at = pair(mix(index / 8), index as usize % 8);
            assert!((0.0..1.0).contains(&at.x) && (0.0..1.0).contains(&at.y), "{at}");
            boxes[(at.y * 4.0) as usize * 4 + (at.x * 4.0) as usize] += 1;
        }
        assert!(boxes.iter().all(|n| (870..1_130).contains(n)), "{boxes:?}");
        assert!(unit(u32::MAX) < 1.0);
    }
}
