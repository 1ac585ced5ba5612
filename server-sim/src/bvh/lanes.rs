//! Eight numbers at a time.
//!
//! Plain multiplications and additions in a fixed order, never fused: the result has the same bits whatever the
//! width of the machine's registers.

use std::ops::{Add, Div, Mul, Neg, Sub};

use glam::Vec3;
use wide::f32x8;

/// Triangles in a block, and rays in a group: eight `f32` fill one AVX register or two SSE ones.
pub(crate) const LANES: usize = 8;

/// Eight numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lanes(f32x8);

/// Eight answers, all bits of a lane set for yes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answers(f32x8);

/// Three coordinates of eight vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lanes3 {
    pub(crate) x: Lanes,
    pub(crate) y: Lanes,
    pub(crate) z: Lanes,
}

/// The smaller number, or `b` if either is not a number: one instruction, which `f32::min` is not.
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger number, or `b` if either is not a number.
#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Lanes {
    pub(crate) const ZERO: Self = Self(f32x8::ZERO);

    #[inline(always)]
    pub(crate) fn splat(value: f32) -> Self {
        Self(f32x8::splat(value))
    }

    /// The number at `i` is `f(i)`.
    #[inline(always)]
    pub(crate) fn from_fn(f: impl FnMut(usize) -> f32) -> Self {
        Self(f32x8::new(std::array::from_fn(f)))
    }

    #[inline(always)]
    pub(crate) fn array(&self) -> &[f32; LANES] {
        self.0.as_array()
    }

    #[inline(always)]
    pub(crate) fn array_mut(&mut self) -> &mut [f32; LANES] {
        self.0.as_mut_array()
    }

    /// The smaller number of each lane; where one is not a number, either.
    #[inline(always)]
    pub(crate) fn smaller(self, other: Self) -> Self {
        Self(self.0.fast_min(other.0))
    }

    /// The larger number of each lane; where one is not a number, either.
    #[inline(always)]
    pub(crate) fn larger(self, other: Self) -> Self {
        Self(self.0.fast_max(other.0))
    }

    #[inline(always)]
    pub(crate) fn below(self, other: Self) -> Answers {
        Answers(self.0.simd_lt(other.0))
    }

    #[inline(always)]
    pub(crate) fn at_least(self, other: Self) -> Answers {
        Answers(self.0.simd_ge(other.0))
    }

    #[inline(always)]
    pub(crate) fn smallest(&self) -> f32 {
        let l = self.array();
        let [a, b, c, d] =
            [smaller(l[0], l[4]), smaller(l[1], l[5]), smaller(l[2], l[6]), smaller(l[3], l[7])];
        smaller(smaller(a, c), smaller(b, d))
    }

    /// Sum in a fixed tree.
    #[inline(always)]
    pub(crate) fn sum(&self) -> f32 {
        let l = self.array();
        ((l[0] + l[4]) + (l[2] + l[6])) + ((l[1] + l[5]) + (l[3] + l[7]))
    }

    /// One over each number; numbers next to zero give large ones of the same sign, so that nothing is infinite.
    #[inline(always)]
    pub(crate) fn inverted(self) -> Self {
        let tiny = Self::splat(1e-12);
        let signed = Self::ZERO.at_least(self).choose(-tiny, tiny);
        let small = self.larger(-self).below(tiny);
        Self::splat(1.0) / small.choose(signed, self)
    }
}

impl Answers {
    /// Bit `i` is set where the answer of lane `i` is yes.
    #[inline(always)]
    pub(crate) fn bits(self) -> u32 {
        self.0.to_bitmask()
    }

    #[inline(always)]
    pub(crate) fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    #[inline(always)]
    pub(crate) fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    #[inline(always)]
    pub(crate) fn choose(self, yes: Lanes, no: Lanes) -> Lanes {
        Lanes(self.0.select(yes.0, no.0))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self($trait::$method(self.0, other.0))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl Neg for Lanes {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Lanes3 {
    pub(crate) const ZERO: Self = Self { x: Lanes::ZERO, y: Lanes::ZERO, z: Lanes::ZERO };

    /// The vector at `i` is `f(i)`.
    pub(crate) fn from_fn(f: impl Fn(usize) -> Vec3) -> Self {
        let axis = |axis: usize| Lanes::from_fn(|i| f(i)[axis]);
        Self { x: axis(0), y: axis(1), z: axis(2) }
    }

    #[inline(always)]
    pub(crate) fn splat(value: Vec3) -> Self {
        Self { x: Lanes::splat(value.x), y: Lanes::splat(value.y), z: Lanes::splat(value.z) }
    }

    /// The vector of one lane.
    #[inline(always)]
    pub(crate) fn at(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x.array()[lane], self.y.array()[lane], self.z.array()[lane])
    }

    /// Replaces the vector of one lane.
    pub(crate) fn set(&mut self, lane: usize, to: Vec3) {
        self.x.array_mut()[lane] = to.x;
        self.y.array_mut()[lane] = to.y;
        self.z.array_mut()[lane] = to.z;
    }

    #[inline(always)]
    pub(crate) fn minus(&self, other: &Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    #[inline(always)]
    pub(crate) fn cross(&self, other: &Self) -> Self {
        let (a, b) = (self, other);
        Self { x: a.y * b.z - a.z * b.y, y: a.z * b.x - a.x * b.z, z: a.x * b.y - a.y * b.x }
    }

    /// Dot product lane by lane, summed in the order x, y, z.
    #[inline(always)]
    pub(crate) fn dot(&self, other: &Self) -> Lanes {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Dot product of every lane with one vector, summed in the order x, y, z.
    #[inline(always)]
    pub(crate) fn dot_one(&self, other: Vec3) -> Lanes {
        self.dot(&Self::splat(other))
    }

    /// Every lane as coordinates along three axes.
    #[inline(always)]
    pub(crate) fn turned(&self, x: Vec3, y: Vec3, z: Vec3) -> Self {
        let row = |a: f32, b: f32, c: f32| self.dot_one(Vec3::new(a, b, c));
        Self { x: row(x.x, y.x, z.x), y: row(x.y, y.y, z.y), z: row(x.z, y.z, z.z) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reductions_and_masks_see_every_lane() {
        for lane in 0..LANES {
            let one = Lanes::from_fn(|i| f32::from(i == lane));
            assert_eq!((one.sum(), one.smallest()), (1.0, 0.0));
            assert_eq!((-one).smallest(), -1.0);
            assert_eq!(Lanes::ZERO.below(one).bits(), 1 << lane);
            assert_eq!(one.at_least(Lanes::splat(1.0)).bits(), 1 << lane);
        }
    }

    #[test]
    fn comparisons_with_nan_say_no() {
        let nan = Lanes::splat(f32::NAN);
        assert_eq!(nan.below(Lanes::ZERO).or(nan.at_least(Lanes::ZERO)).bits(), 0);
    }

    #[test]
    fn inverses_are_finite_and_keep_the_sign() {
        let values = [1.0, -2.0, 0.0, -0.0, 1e-30, -1e-30, 1e-13, 0.5];
        for (&value, &inverse) in values.iter().zip(Lanes::from_fn(|i| values[i]).inverted().array()) {
            assert!(inverse.is_finite() && (value == 0.0 || inverse.signum() == value.signum()));
        }
    }

    #[test]
    fn vectors_agree_with_glam() {
        let a = Lanes3::from_fn(|i| Vec3::new(i as f32, 1.5 - i as f32, 0.25 * i as f32));
        let b = Lanes3::from_fn(|i| Vec3::new(2.0, i as f32, -1.0));
        let (x, y, z) = (Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.8, 0.6, 0.0), Vec3::Z);
        for i in 0..LANES {
            assert_eq!(a.cross(&b).at(i), a.at(i).cross(b.at(i)));
            assert_eq!(a.dot(&b).array()[i], a.at(i).dot(b.at(i)));
            assert_eq!(a.minus(&b).at(i), a.at(i) - b.at(i));
            let turned = x * a.at(i).x + y * a.at(i).y + z * a.at(i).z;
            assert!((a.turned(x, y, z).at(i) - turned).length() < 1e-6);
        }
    }
}
