//! Rigid frames, and the split of a transform into a rigid part and a stretch of the local geometry.
//!
//! All computations use doubles and plain component arithmetic, so that every machine computes the same bits.

use glam::{DAffine3, DMat3, DQuat, DVec3, Mat3, Quat, Vec3};

/// A proper rigid transform (rotation and translation) from an instance's local space to the world, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidFrame {
    /// Unit quaternion.
    pub rotation: Quat,
    /// World position of the local origin, metres.
    pub translation: Vec3,
}

impl RigidFrame {
    /// The frame of a local space that equals the world.
    pub const IDENTITY: Self = Self { rotation: Quat::IDENTITY, translation: Vec3::ZERO };

    /// Returns the rotation as a matrix. Compute it once to transform many points.
    #[must_use]
    pub fn matrix(&self) -> Mat3 {
        Mat3::from_quat(self.rotation)
    }

    /// Transforms a local point to the world.
    #[must_use]
    pub fn point(&self, local: Vec3) -> Vec3 {
        self.matrix() * local + self.translation
    }

    /// Transforms a local direction to the world.
    #[must_use]
    pub fn vector(&self, local: Vec3) -> Vec3 {
        self.matrix() * local
    }

    /// Transforms a world point to local space.
    #[must_use]
    pub fn inverse_point(&self, world: Vec3) -> Vec3 {
        self.matrix().transpose() * (world - self.translation)
    }

    /// Transforms a world direction to local space.
    #[must_use]
    pub fn inverse_vector(&self, world: Vec3) -> Vec3 {
        self.matrix().transpose() * world
    }

    /// Returns the frame of a proper rotation and an origin.
    pub(crate) fn new(rotation: DMat3, origin: DVec3) -> Self {
        Self::unit(DQuat::from_mat3(&rotation), origin.as_vec3())
    }

    /// Returns the frame of a rotation scaled to unit length, with the sign that makes `w` non-negative.
    pub(crate) fn unit(q: DQuat, translation: Vec3) -> Self {
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        let scale = sign / (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
        let component = |v: f64| (v * scale) as f32;
        Self {
            rotation: Quat::from_xyzw(component(q.x), component(q.y), component(q.z), component(q.w)),
            translation,
        }
    }

    /// Returns the inverse for transforming world transforms to local space. It is exact for the rounded components.
    pub(crate) fn inverse(&self) -> DAffine3 {
        let q = self.rotation;
        let q = DQuat::from_xyzw(q.x.into(), q.y.into(), q.z.into(), q.w.into());
        let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
        let unit = DQuat::from_xyzw(q.x / norm, q.y / norm, q.z / norm, q.w / norm);
        let back = DMat3::from_quat(unit).transpose();
        DAffine3 { matrix3: back, translation: -(back * self.translation.as_dvec3()) }
    }
}

/// Returns the proper rotation of the polar decomposition of `linear`: `linear = rotation * stretch`. The stretch has
/// the sign of the determinant.
///
/// A matrix that flattens one axis still has a rotation: that axis is replaced by one perpendicular to the other two.
/// Returns `None` if two or more axes are flattened or the result is singular.
pub(crate) fn rotation_of(linear: DMat3) -> Option<DMat3> {
    let full = restore_flat_axis(linear)?;
    let mut q = full;
    for _ in 0..40 {
        let next = (q + q.inverse().transpose()) * 0.5;
        let change = columns(next - q).iter().map(|c| c.length_squared()).fold(0.0, f64::max);
        q = next;
        if change < 1e-28 {
            break;
        }
    }
    let finite = columns(q).iter().all(|c| c.is_finite());
    finite.then(|| if q.determinant() < 0.0 { q * -1.0 } else { q })
}

/// Returns an invertible matrix in which a perpendicular column replaces a flattened one.
fn restore_flat_axis(linear: DMat3) -> Option<DMat3> {
    let mut axes = columns(linear);
    let longest = axes.iter().map(|a| a.length()).fold(0.0, f64::max);
    if !longest.is_finite() || longest < 1e-30 {
        return None;
    }
    if let Some(flat) = (0..3).find(|&i| axes[i].length() < longest * 1e-7) {
        let across = axes[(flat + 1) % 3].cross(axes[(flat + 2) % 3]);
        axes[flat] = across.try_normalize()? * longest;
    }
    let full = DMat3::from_cols(axes[0], axes[1], axes[2]);
    (full.determinant().abs() > 1e-12 * longest * longest * longest).then_some(full)
}

/// Returns the three columns.
pub(crate) fn columns(m: DMat3) -> [DVec3; 3] {
    [m.x_axis, m.y_axis, m.z_axis]
}

/// Returns whether two linear maps agree within `tolerance` relative to the larger one.
pub(crate) fn nearly_equal(a: DMat3, b: DMat3, tolerance: f64) -> bool {
    let size = columns(a).iter().chain(&columns(b)).map(|c| c.length()).fold(0.0, f64::max);
    columns(a - b).iter().all(|c| c.length() <= tolerance * size)
}

/// Removes rounding noise from a stretch: one that is diagonal, uniform or the identity within a millionth becomes
/// exactly so.
pub(crate) fn snapped(stretch: DMat3) -> DMat3 {
    let diagonal = DVec3::new(stretch.x_axis.x, stretch.y_axis.y, stretch.z_axis.z);
    let mean = (diagonal.x + diagonal.y + diagonal.z) / 3.0;
    let candidates = [mean.round(), mean].map(|s| DMat3::from_diagonal(DVec3::splat(s)));
    for candidate in candidates.into_iter().chain([DMat3::from_diagonal(diagonal)]) {
        if nearly_equal(stretch, candidate, 1e-6) {
            return candidate;
        }
    }
    stretch
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn() -> DMat3 {
        DMat3::from_quat(DQuat::from_xyzw(0.1, 0.5, -0.3, 0.8).normalize())
    }

    #[test]
    fn splits_into_a_proper_rotation_and_a_stretch() {
        for scale in [DVec3::ONE, DVec3::new(2.0, 0.5, 3.0), DVec3::new(-1.0, 2.0, 2.0), DVec3::splat(-0.02)]
        {
            let whole = turn() * DMat3::from_diagonal(scale);
            let rotation = rotation_of(whole).unwrap();
            assert!(nearly_equal(rotation.transpose() * rotation, DMat3::IDENTITY, 1e-12));
            assert!(rotation.determinant() > 0.0);
            let stretch = rotation.transpose() * whole;
            assert!(nearly_equal(stretch, stretch.transpose(), 1e-12), "a polar stretch is symmetric");
            assert_eq!(stretch.determinant() < 0.0, scale.x * scale.y * scale.z < 0.0);
        }
    }

    #[test]
    fn flattened_axis_has_a_frame_but_a_line_has_none() {
        let flat = turn() * DMat3::from_diagonal(DVec3::new(2.0, 0.0, 2.0));
        let rotation = rotation_of(flat).unwrap();
        assert!(nearly_equal(rotation * (rotation.transpose() * flat), flat, 1e-12));
        assert_eq!(rotation_of(turn() * DMat3::from_diagonal(DVec3::new(2.0, 0.0, 0.0))), None);
        assert_eq!(rotation_of(DMat3::ZERO), None);
        let skewed = DMat3::from_cols(DVec3::X, DVec3::X + DVec3::Y, DVec3::X - DVec3::Y);
        assert_eq!(rotation_of(skewed), None, "singular without a flat axis");
    }

    #[test]
    fn frame_and_its_inverse_cancel() {
        let frame = RigidFrame::new(turn(), DVec3::new(3.0, -2.0, 7.5));
        let p = Vec3::new(0.3, 0.4, -0.5);
        assert!((frame.inverse_point(frame.point(p)) - p).length() < 1e-5);
        assert!((frame.inverse_vector(frame.vector(p)) - p).length() < 1e-6);
        let back = frame.inverse().transform_point3(frame.point(p).as_dvec3());
        assert!((back.as_vec3() - p).length() < 1e-5);
    }

    #[test]
    fn snapping_removes_only_noise() {
        let noisy = DMat3::from_diagonal(DVec3::new(1.0, 1.0 + 1e-8, 1.0 - 1e-8));
        assert_eq!(snapped(noisy), DMat3::IDENTITY);
        let real = DMat3::from_diagonal(DVec3::new(1.0, 1.001, 1.0));
        assert_eq!(snapped(real), real);
    }
}
