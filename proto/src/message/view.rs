//! VIEW: the camera of a client.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, finite, require};
use crate::FrameType;

/// A pinhole camera. World space, metres, Y up, right-handed; the picture's right is `(target - eye) x up`.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct CameraPose {
    /// Position of the camera.
    pub eye: [f32; 3],
    /// A point that it looks at, not the eye itself.
    pub target: [f32; 3],
    /// Up direction of the picture, of any length, not along the line of sight.
    pub up: [f32; 3],
    /// Angle between the top and the bottom of the picture, degrees, in (0, 180).
    pub fov_y_deg: f32,
    /// Width of the picture over its height, positive.
    pub aspect: f32,
}

impl CameraPose {
    /// Returns the usual up direction of a camera: +Y, and for one that looks straight up or down -Z, as on a plan.
    #[must_use]
    pub fn usual_up(eye: [f32; 3], target: [f32; 3]) -> [f32; 3] {
        // Sine of the angle to Y below which the roll of the picture would be rounding noise.
        const LEAST_SINE: f64 = 1e-6;
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(target[axis]) - f64::from(eye[axis]));
        let across = x * x + z * z;
        let along_y = across <= LEAST_SINE * LEAST_SINE * (across + y * y);
        if along_y { [0.0, 0.0, -1.0] } else { [0.0, 1.0, 0.0] }
    }

    /// Returns whether the camera is valid: all values finite, eye and target apart, `up` not along the line of sight,
    /// angle and aspect within their ranges.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        check(self).is_ok()
    }
}

fn check(pose: &CameraPose) -> Result<(), FieldError> {
    finite(&pose.eye, "eye")?;
    finite(&pose.target, "target")?;
    finite(&pose.up, "up")?;
    // Computed in f64, so that no finite camera overflows or underflows.
    let [ex, ey, ez] = pose.eye.map(f64::from);
    let [tx, ty, tz] = pose.target.map(f64::from);
    let [ux, uy, uz] = pose.up.map(f64::from);
    let (x, y, z) = (tx - ex, ty - ey, tz - ez);
    let side = [y * uz - z * uy, z * ux - x * uz, x * uy - y * ux];
    require(x != 0.0 || y != 0.0 || z != 0.0, "target", "is where the eye is")?;
    require(side.iter().any(|&v| v != 0.0), "up", "is zero or along the line of sight")?;
    require(pose.fov_y_deg > 0.0 && pose.fov_y_deg < 180.0, "fov_y_deg", "is outside (0, 180)")?;
    require(pose.aspect > 0.0 && pose.aspect.is_finite(), "aspect", "is not a positive number")
}

/// The client's camera, by which the server decides what to trace and send. A client sends it after each change, at
/// most once per frame. The newest one counts.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct View {
    /// The client's camera.
    pub camera: CameraPose,
}

impl Payload for View {
    fn check(&self) -> Result<(), FieldError> {
        check(&self.camera)
    }
}

impl Message for View {
    const KIND: FrameType = FrameType::VIEW;
    const NAME: &'static str = "VIEW";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    const POSE: CameraPose = CameraPose {
        eye: [1.0, 2.0, 3.0],
        target: [0.0, 0.5, 0.0],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 60.0,
        aspect: 2.0,
    };

    #[test]
    fn golden_bytes() {
        golden(
            &View { camera: POSE },
            "0000803f 00000040 00004040 00000000 0000003f 00000000 00000000 0000803f 00000000 00007042 00000040",
        );
    }

    #[test]
    fn a_camera_straight_above_or_below_has_an_up_direction() {
        for (eye, up) in [
            ([0.0, 5.0, 0.0], [0.0, 0.0, -1.0]),
            ([0.0, -1e-30, 0.0], [0.0, 0.0, -1.0]),
            ([1e-7, 1e3, 0.0], [0.0, 0.0, -1.0]),
            ([0.01, 5.0, 0.0], [0.0, 1.0, 0.0]),
            ([3e38, -3e38, 3e38], [0.0, 1.0, 0.0]),
        ] {
            assert_eq!(CameraPose::usual_up(eye, [0.0; 3]), up, "{eye:?}");
            assert!(CameraPose { eye, target: [0.0; 3], up, ..POSE }.is_valid(), "{eye:?}");
        }
    }

    #[test]
    fn cameras_that_make_no_picture_are_refused() {
        assert!(POSE.is_valid());
        for bad in [
            CameraPose { eye: [f32::NAN, 0.0, 0.0], ..POSE },
            CameraPose { target: [f32::INFINITY, 0.0, 0.0], ..POSE },
            CameraPose { target: POSE.eye, ..POSE },
            CameraPose { up: [0.0; 3], ..POSE },
            CameraPose { eye: [0.0, 9.0, 0.0], target: [0.0; 3], ..POSE },
            CameraPose { fov_y_deg: 180.0, ..POSE },
            CameraPose { fov_y_deg: f32::NAN, ..POSE },
            CameraPose { aspect: 0.0, ..POSE },
            CameraPose { aspect: f32::INFINITY, ..POSE },
        ] {
            assert!(!bad.is_valid(), "{bad:?}");
            assert!(View { camera: bad }.to_payload().is_err());
        }
    }
}
