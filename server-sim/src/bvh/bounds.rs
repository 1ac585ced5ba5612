//! Axis-aligned boxes, with the tests that tracing requires.

use glam::{Mat3, Vec3};

/// An axis-aligned box in metres. The empty box has `min > max` on every axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    min: Vec3,
    max: Vec3,
}

impl Bounds {
    /// The empty box; its union with any box is that box.
    pub const EMPTY: Self = Self { min: Vec3::splat(f32::INFINITY), max: Vec3::splat(f32::NEG_INFINITY) };

    /// Creates the box between two corners; `min` is the smaller one on every axis.
    #[must_use]
    pub fn new(min: Vec3, max: Vec3) -> Self {
        Self { min, max }
    }

    /// Returns the smallest box around `points`, or the empty box without points.
    #[must_use]
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, Self::with_point)
    }

    /// Returns the smallest corner.
    #[must_use]
    pub fn min(&self) -> Vec3 {
        self.min
    }

    /// Returns the largest corner.
    #[must_use]
    pub fn max(&self) -> Vec3 {
        self.max
    }

    /// Returns whether the box is empty. A flat box is not empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !(self.min.x <= self.max.x && self.min.y <= self.max.y && self.min.z <= self.max.z)
    }

    /// Returns the box grown to hold `point`.
    #[must_use]
    pub fn with_point(self, point: Vec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// Returns the box grown to hold `other`.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Returns whether the two boxes have a point in common. The empty box has none.
    #[must_use]
    pub fn touches(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// Returns the box grown by `margin` metres on every side.
    #[must_use]
    pub fn grown(self, margin: f32) -> Self {
        Self { min: self.min - margin, max: self.max + margin }
    }

    /// Returns the extent in metres, or zero for the empty box.
    #[must_use]
    pub fn size(&self) -> Vec3 {
        if self.is_empty() { Vec3::ZERO } else { self.max - self.min }
    }

    /// Returns the squared distance in m^2 from `point` to the box: zero inside, infinite for the empty box.
    #[must_use]
    #[inline(always)]
    pub fn distance_squared(&self, point: Vec3) -> f32 {
        let out = (self.min - point).max(point - self.max).max(Vec3::ZERO);
        out.dot(out)
    }

    /// Returns a box that contains this one after `rotation` and then `translation`.
    #[must_use]
    pub fn transformed(&self, rotation: Mat3, translation: Vec3) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        let center = (self.min + self.max) * 0.5;
        let half = (self.max - self.min) * 0.5;
        let reach =
            rotation.x_axis.abs() * half.x + rotation.y_axis.abs() * half.y + rotation.z_axis.abs() * half.z;
        let middle = rotation * center + translation;
        // The products above round. A box that is slightly too small would lose hits; one that is slightly too large
        // costs nothing.
        let slack = (middle.abs() + reach + translation.abs()) * 1e-6;
        Self { min: middle - reach - slack, max: middle + reach + slack }
    }

    /// Returns the distance at which a ray enters the box, if it is between 0 and `tmax`. `inverse` is 1 / direction
    /// and may be infinite.
    #[must_use]
    #[inline(always)]
    pub(crate) fn entry(&self, origin: Vec3, inverse: Vec3, tmax: f32) -> Option<f32> {
        let near = (self.min - origin) * inverse;
        let far = (self.max - origin) * inverse;
        // A zero direction in the plane of a face gives NaN. `f32::min` and `max` drop it, so that axis never
        // rejects.
        let enter = near.x.min(far.x).max(near.y.min(far.y)).max(near.z.min(far.z)).max(0.0);
        let leave = near.x.max(far.x).min(near.y.max(far.y)).min(near.z.max(far.z));
        // Ize 2013, "Robust BVH Ray Traversal": two units in the last place keep the test conservative.
        let leave = leave * 1.000_000_5;
        (enter <= leave && enter <= tmax).then_some(enter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit_box() -> Bounds {
        Bounds::new(Vec3::ZERO, Vec3::ONE)
    }

    #[test]
    fn distance_is_zero_inside_and_euclidean_outside() {
        assert_eq!(unit_box().distance_squared(Vec3::splat(0.5)), 0.0);
        assert_eq!(unit_box().distance_squared(Vec3::new(2.0, 0.5, 0.5)), 1.0);
        assert_eq!(unit_box().distance_squared(Vec3::new(2.0, -1.0, 0.5)), 2.0);
        assert_eq!(Bounds::EMPTY.distance_squared(Vec3::ZERO), f32::INFINITY);
    }

    #[test]
    fn a_ray_in_the_plane_of_a_face_is_kept() {
        let flat = Bounds::new(Vec3::ZERO, Vec3::new(1.0, 0.0, 1.0));
        let inverse = Vec3::new(1.0, 0.0, 0.0).recip();
        assert!(flat.entry(Vec3::new(-1.0, 0.0, 0.5), inverse, 10.0).is_some());
        assert!(flat.entry(Vec3::new(-1.0, 0.1, 0.5), inverse, 10.0).is_none());
        assert!(flat.entry(Vec3::new(-1.0, 0.0, 0.5), inverse, 0.5).is_none());
    }

    proptest! {
        #[test]
        fn a_turned_box_holds_its_turned_points(
            corner in prop::array::uniform3(-50f32..50.0), size in prop::array::uniform3(0f32..9.0),
            at in prop::array::uniform3(0f32..=1.0), shift in prop::array::uniform3(-50f32..50.0), angle in 0f32..6.3,
        ) {
            let bounds = Bounds::new(corner.into(), Vec3::from(corner) + Vec3::from(size));
            let rotation = Mat3::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), angle);
            let point = Vec3::from(corner) + Vec3::from(size) * Vec3::from(at);
            let turned = bounds.transformed(rotation, shift.into());
            prop_assert_eq!(turned.distance_squared(rotation * point + Vec3::from(shift)), 0.0);
        }
    }
}
