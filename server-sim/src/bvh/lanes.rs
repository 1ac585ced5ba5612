//! Eight numbers in parallel, with the widest instructions of the machine.
//!
//! Numbers are stored as [`Packed`] and computed as [`Lanes`], whose type carries the instructions. Multiplications
//! and additions have a fixed order and are never fused, so the result has the same bits with all instructions. The
//! minimum and maximum of two numbers may be either one if one of them is NaN.

use fearless_simd::prelude::*;
use fearless_simd::{Level, f32x8, mask32x8};
use glam::Vec3;

/// Triangles in a block, and rays in a group. Eight `f32` fill one AVX register or two SSE registers.
pub(crate) const LANES: usize = 8;

/// Groups of rays in a packet, one per bit of a mask.
pub(crate) const PACKET_GROUPS: usize = 32;

/// Eight numbers in registers.
pub(crate) type Lanes<S> = f32x8<S>;

/// A truth value for each of eight lanes.
pub(crate) type LaneMask<S> = mask32x8<S>;

/// A set of instructions that this machine has. Results are bit-identical with all of them.
#[derive(Clone, Copy, Debug)]
pub struct Instructions(Level);

/// Eight numbers in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Packed([f32; LANES]);

/// Three coordinates of eight vectors in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Packed3 {
    pub(crate) x: Packed,
    pub(crate) y: Packed,
    pub(crate) z: Packed,
}

/// Three coordinates of eight vectors in registers.
#[derive(Clone, Copy)]
pub(crate) struct Lanes3<S: Simd> {
    pub(crate) x: Lanes<S>,
    pub(crate) y: Lanes<S>,
    pub(crate) z: Lanes<S>,
}

/// Returns the smaller number, or `b` if either is NaN. Unlike `f32::min` this is one instruction.
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the larger number, or `b` if either is NaN. Unlike `f32::max` this is one instruction.
#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Instructions {
    /// Returns the widest set that this machine has.
    #[must_use]
    pub fn best() -> Self {
        Self(Level::new())
    }

    /// Returns all sets that this machine has, from the baseline of its architecture to the widest; for tests and
    /// measurements.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let best = Level::new();
        let mut all = Vec::new();
        #[cfg(test)]
        all.push(Level::fallback());
        all.push(Level::baseline());
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            all.extend(best.as_sse4_2().map(Level::Sse4_2));
            all.extend(best.as_avx2().map(Level::Avx2));
        }
        all.push(best);
        all.dedup_by_key(|level| format!("{level:?}"));
        all.into_iter().map(Self).collect()
    }

    /// Returns the name of the set, such as `Avx2`.
    #[must_use]
    pub fn name(self) -> String {
        let text = format!("{:?}", self.0);
        text.split('(').next().unwrap_or_default().to_owned()
    }

    #[inline(always)]
    pub(crate) fn level(self) -> Level {
        self.0
    }
}

impl Packed {
    pub(crate) const ZERO: Self = Self([0.0; LANES]);

    pub(crate) const fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    /// Creates eight numbers; the number at `i` is `f(i)`.
    #[inline(always)]
    pub(crate) fn from_fn(f: impl FnMut(usize) -> f32) -> Self {
        Self(std::array::from_fn(f))
    }

    #[inline(always)]
    pub(crate) fn array(&self) -> &[f32; LANES] {
        &self.0
    }

    #[inline(always)]
    pub(crate) fn array_mut(&mut self) -> &mut [f32; LANES] {
        &mut self.0
    }

    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self, simd: S) -> Lanes<S> {
        Lanes::simd_from(simd, self.0)
    }

    /// Returns the sum of all lanes, added in a fixed tree.
    pub(crate) fn sum(&self) -> f32 {
        let l = self.0;
        ((l[0] + l[4]) + (l[2] + l[6])) + ((l[1] + l[5]) + (l[3] + l[7]))
    }

    #[inline(always)]
    pub(crate) fn smallest(&self) -> f32 {
        let l = self.0;
        let [a, b, c, d] =
            [smaller(l[0], l[4]), smaller(l[1], l[5]), smaller(l[2], l[6]), smaller(l[3], l[7])];
        smaller(smaller(a, c), smaller(b, d))
    }

    #[inline(always)]
    pub(crate) fn largest(&self) -> f32 {
        let l = self.0;
        let [a, b, c, d] = [larger(l[0], l[4]), larger(l[1], l[5]), larger(l[2], l[6]), larger(l[3], l[7])];
        larger(larger(a, c), larger(b, d))
    }
}

impl<S: Simd> From<Lanes<S>> for Packed {
    #[inline(always)]
    fn from(lanes: Lanes<S>) -> Self {
        Self(lanes.into())
    }
}

impl Packed3 {
    pub(crate) const ZERO: Self = Self { x: Packed::ZERO, y: Packed::ZERO, z: Packed::ZERO };

    /// Creates eight vectors; the vector at `i` is `f(i)`.
    pub(crate) fn from_fn(f: impl Fn(usize) -> Vec3) -> Self {
        let axis = |axis: usize| Packed::from_fn(|i| f(i)[axis]);
        Self { x: axis(0), y: axis(1), z: axis(2) }
    }

    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self, simd: S) -> Lanes3<S> {
        Lanes3 { x: self.x.load(simd), y: self.y.load(simd), z: self.z.load(simd) }
    }

    /// Returns the vector of one lane.
    #[inline(always)]
    pub(crate) fn at(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x.0[lane], self.y.0[lane], self.z.0[lane])
    }

    /// Replaces the vector of one lane.
    pub(crate) fn set(&mut self, lane: usize, to: Vec3) {
        self.x.0[lane] = to.x;
        self.y.0[lane] = to.y;
        self.z.0[lane] = to.z;
    }
}

impl<S: Simd> From<Lanes3<S>> for Packed3 {
    #[inline(always)]
    fn from(lanes: Lanes3<S>) -> Self {
        Self { x: lanes.x.into(), y: lanes.y.into(), z: lanes.z.into() }
    }
}

impl<S: Simd> Lanes3<S> {
    #[inline(always)]
    pub(crate) fn splat(simd: S, value: Vec3) -> Self {
        let lanes = |value: f32| Lanes::splat(simd, value);
        Self { x: lanes(value.x), y: lanes(value.y), z: lanes(value.z) }
    }

    #[inline(always)]
    pub(crate) fn minus(&self, other: &Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    /// Returns the same vectors, negated in the lanes in which `answers` is true.
    #[inline(always)]
    pub(crate) fn negated_where(&self, answers: LaneMask<S>) -> Self {
        Self {
            x: answers.select(-self.x, self.x),
            y: answers.select(-self.y, self.y),
            z: answers.select(-self.z, self.z),
        }
    }

    #[inline(always)]
    pub(crate) fn cross(&self, other: &Self) -> Self {
        let (a, b) = (self, other);
        Self { x: a.y * b.z - a.z * b.y, y: a.z * b.x - a.x * b.z, z: a.x * b.y - a.y * b.x }
    }

    /// Returns the dot product of each lane, summed in the order x, y, z.
    #[inline(always)]
    pub(crate) fn dot(&self, other: &Self) -> Lanes<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub(crate) fn length(&self) -> Lanes<S> {
        self.dot(self).sqrt()
    }

    /// Rotates every vector `v`: returns `x * v.x + y * v.y + z * v.z`.
    #[inline(always)]
    pub(crate) fn rotated(&self, x: Vec3, y: Vec3, z: Vec3) -> Self {
        let simd = self.x.simd;
        let row = |a: f32, b: f32, c: f32| self.dot(&Self::splat(simd, Vec3::new(a, b, c)));
        Self { x: row(x.x, y.x, z.x), y: row(x.y, y.y, z.y), z: row(x.z, y.z, z.z) }
    }
}

/// Returns a bitmask; bit `i` is set if lane `i` is true.
#[inline(always)]
pub(crate) fn bits<S: Simd>(answers: LaneMask<S>) -> u32 {
    answers.to_bitmask() as u32
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;

    use super::*;

    /// Runs a check with every set of instructions.
    macro_rules! at_every_level {
        ($simd:ident => $check:expr) => {
            for instructions in Instructions::all() {
                dispatch!(instructions.level(), $simd => $check);
            }
        };
    }

    #[test]
    fn sets_of_instructions_have_names_of_their_own() {
        let mut names: Vec<String> = Instructions::all().into_iter().map(Instructions::name).collect();
        assert!(names.contains(&Instructions::best().name()) && names.len() >= 2);
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all);
    }

    #[test]
    fn reductions_and_masks_see_every_lane() {
        for lane in 0..LANES {
            let one = Packed::from_fn(|i| f32::from(i == lane));
            assert_eq!((one.sum(), one.largest()), (1.0, 1.0));
            at_every_level!(simd => {
                let lanes = one.load(simd);
                assert_eq!(bits(Lanes::splat(simd, 0.0).simd_lt(lanes)), 1 << lane);
                assert_eq!(bits(lanes.simd_ge(Lanes::splat(simd, 1.0))), 1 << lane);
                assert_eq!(Packed::from(-lanes).sum(), -1.0);
            });
        }
    }

    #[test]
    fn comparisons_with_nan_say_no() {
        at_every_level!(simd => {
            let (nan, zero) = (Lanes::splat(simd, f32::NAN), Lanes::splat(simd, 0.0));
            assert_eq!(bits(nan.simd_lt(zero) | nan.simd_ge(zero) | zero.simd_lt(nan) | zero.simd_ge(nan)), 0);
        });
    }

    #[test]
    fn vectors_agree_with_glam() {
        let a = Packed3::from_fn(|i| Vec3::new(i as f32, 1.5 - i as f32, 0.25 * i as f32));
        let b = Packed3::from_fn(|i| Vec3::new(2.0, i as f32, -1.0));
        let (x, y, z) = (Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.8, 0.6, 0.0), Vec3::Z);
        at_every_level!(simd => for i in 0..LANES {
            let (l, m) = (a.load(simd), b.load(simd));
            assert_eq!(Packed3::from(l.cross(&m)).at(i), a.at(i).cross(b.at(i)));
            assert_eq!(l.dot(&m)[i], a.at(i).dot(b.at(i)));
            assert_eq!(l.length()[i], a.at(i).length());
            assert_eq!(Packed3::from(l.minus(&m)).at(i), a.at(i) - b.at(i));
            let about = l.negated_where(l.x.simd_lt(Lanes::splat(simd, 2.5)));
            assert_eq!(Packed3::from(about).at(i), if i < 3 { -a.at(i) } else { a.at(i) });
            let turned = x * a.at(i).x + y * a.at(i).y + z * a.at(i).z;
            assert!((Packed3::from(l.rotated(x, y, z)).at(i) - turned).length() < 1e-6);
        });
    }
}
