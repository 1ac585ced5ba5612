//! Points of a line, and the share that one hides of another's slice.

use glam::{Vec2, Vec3};

use crate::screen::Screen;

/// A point of a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinePoint {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    /// Slope along the sweep. Together with the depth it is the place in the plane of eye and line.
    pub(super) along: f32,
}

impl LinePoint {
    #[inline]
    pub(super) fn at(screen: &Screen, (x, y): (i32, i32), ahead: Vec2) -> Option<Self> {
        let position = screen.position(x, y)?;
        let along = position.truncate().dot(ahead) / position.z;
        Some(Self { position, normal: screen.normal(x, y), along })
    }

    /// Returns the place in the plane of the eye and the line, up to a shear that keeps lines straight.
    #[inline]
    pub(super) fn flat(&self) -> Vec2 {
        Vec2::new(self.along, 1.0) * self.position.z
    }
}

/// The half plane behind a receiver, bounded by the line to the eye.
#[derive(Debug)]
pub(super) struct HalfPlane {
    /// Position of the receiver, moved off the surface by the bias.
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    /// Unit vectors of the plane: towards the eye, and perpendicular to it away from the sweep.
    zenith: Vec3,
    side: Vec3,
    /// Projection of the normal onto the plane: its length times cosine and sine of its angle to the zenith.
    cos: f32,
    sin: f32,
    /// Angle of the tangent plane to the zenith, and the integral up to that angle.
    tangent: f32,
    full: f32,
}

impl HalfPlane {
    pub(super) fn new(point: &LinePoint, ahead: Vec2, bias: f32) -> Self {
        let zenith = -point.position.normalize();
        let behind = -ahead.extend(0.0);
        let side = (behind - zenith * behind.dot(zenith)).normalize();
        let (cos, sin) = (point.normal.dot(zenith), point.normal.dot(side));
        let tangent = (libm::atan2f(sin, cos) + std::f32::consts::FRAC_PI_2).clamp(0.0, std::f32::consts::PI);
        let position = point.position + point.normal * bias;
        let mut slice = Self { position, normal: point.normal, zenith, side, cos, sin, tangent, full: 0.0 };
        slice.full = slice.integral(tangent, libm::cosf(tangent), libm::sinf(tangent));
        slice
    }

    /// Returns the integral of `cos(t - d) sin(t) dt` from 0 to an angle to the zenith, up to a constant, times the
    /// length of the projected normal.
    #[inline]
    fn integral(&self, angle: f32, cos: f32, sin: f32) -> f32 {
        0.5 * (angle * self.sin - (cos * cos - 0.5) * self.cos - cos * sin * self.sin)
    }

    /// Returns the part of the slice between a horizon in this direction and the tangent plane, in `[0, 1]` for a
    /// normal in the plane.
    #[inline]
    pub(super) fn hidden(&self, to: Vec3) -> f32 {
        let (up, out) = (to.dot(self.zenith), to.dot(self.side).max(0.0));
        let length = (up * up + out * out).sqrt();
        if length == 0.0 {
            return 0.0;
        }
        let angle = libm::atan2f(out, up);
        if angle >= self.tangent {
            return 0.0;
        }
        (self.full - self.integral(angle, up / length, out / length)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals_are_those_of_brute_force() {
        let point = |normal: Vec3| LinePoint { position: Vec3::new(0.0, 0.0, 2.0), normal, along: 0.0 };
        for lean in [-1.2_f32, -0.5, 0.0, 0.4, 1.3] {
            // The sweep goes to the right, so points behind it are on the left.
            let normal = Vec3::new(-lean.sin(), 0.0, -lean.cos());
            let slice = HalfPlane::new(&point(normal), Vec2::X, 0.0);
            for horizon in [0.0_f32, 0.3, 0.9, 1.6, 2.4] {
                let to = Vec3::new(-horizon.sin(), 0.0, -horizon.cos());
                let steps = 20_000;
                let width = f64::from(std::f32::consts::PI - horizon) / f64::from(steps);
                let brute: f64 = (0..steps)
                    .map(|step| f64::from(horizon) + (f64::from(step) + 0.5) * width)
                    .map(|t| (t - f64::from(lean)).cos().max(0.0) * t.sin() * width)
                    .sum();
                // The slice ends at the zenith, so nothing is beyond the tangent plane on the other side.
                let found = f64::from(slice.hidden(to));
                assert!((found - brute).abs() < 1e-5, "{lean} {horizon}: {found} {brute}");
            }
        }
    }
}
