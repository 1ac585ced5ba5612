//! Cameras and the rays of their pixels.

use glam::{DVec3, Vec3};
use psao_proto::message::CameraPose;

use super::Size;

/// A checked camera: an orthonormal frame at the eye and the tangents of its half angles.
///
/// Space is right-handed with Y up, by convention of the stream. `up` of the pose may have any direction that is not
/// parallel to the view. The frame is in f64, so that rays differ by their direction and not by rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: Vec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    half_width: f64,
    half_height: f64,
}

/// The ray of one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start in metres, world space.
    pub origin: Vec3,
    /// Direction, of unit length to f32 rounding.
    pub direction: Vec3,
}

/// A camera pose from which no rays can be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A field is NaN or infinite.
    #[error("the camera's {field} is not finite; give finite metres and degrees")]
    NotFinite {
        /// Name of the field of [`CameraPose`].
        field: &'static str,
    },
    /// Eye and target are the same point, so the view has no direction.
    #[error("the camera's eye and target are the same point ({0}, {1}, {2}); move one of them", at[0], at[1], at[2])]
    EyeIsTarget {
        /// The point, in metres.
        at: [f32; 3],
    },
    /// `up` is zero, or parallel to the view within [`Camera::MIN_UP_SINE`].
    #[error("the camera's up vector is zero or parallel to the view; choose another up vector")]
    UpParallel,
    /// The vertical field of view is not between 0 and 180 degrees.
    #[error("the camera's vertical field of view is {degrees} degrees; it must be above 0 and below 180")]
    FieldOfView {
        /// The value given, in degrees.
        degrees: f32,
    },
    /// The aspect (width over height) is not above 0.
    #[error("the camera's aspect is {aspect}; width over height must be above 0")]
    Aspect {
        /// The value given.
        aspect: f32,
    },
}

impl Camera {
    /// Smallest sine of the angle between `up` and the view. Below it, the roll of a camera is rounding noise.
    pub const MIN_UP_SINE: f64 = 1e-6;

    /// Checks a pose and computes its frame.
    ///
    /// # Errors
    ///
    /// [`CameraError`] when a field is not finite, eye and target coincide, or `up` is parallel to the view. Also when
    /// the field of view is not in `(0, 180)` degrees, or the aspect is not positive.
    pub fn new(pose: &CameraPose) -> Result<Self, CameraError> {
        check_finite(pose)?;
        if !(pose.fov_y_deg > 0.0 && pose.fov_y_deg < 180.0) {
            return Err(CameraError::FieldOfView { degrees: pose.fov_y_deg });
        }
        if pose.aspect <= 0.0 {
            return Err(CameraError::Aspect { aspect: pose.aspect });
        }
        let eye = Vec3::from(pose.eye);
        let view = Vec3::from(pose.target).as_dvec3() - eye.as_dvec3();
        let Some(forward) = view.try_normalize() else {
            return Err(CameraError::EyeIsTarget { at: pose.eye });
        };
        let Some(wanted_up) = Vec3::from(pose.up).as_dvec3().try_normalize() else {
            return Err(CameraError::UpParallel);
        };
        let side = forward.cross(wanted_up);
        if side.length() < Self::MIN_UP_SINE {
            return Err(CameraError::UpParallel);
        }
        let right = side.normalize();
        let half_height = libm::tan(f64::from(pose.fov_y_deg).to_radians() * 0.5);
        Ok(Self {
            eye,
            right,
            up: right.cross(forward),
            forward,
            half_width: half_height * f64::from(pose.aspect),
            half_height,
        })
    }

    /// Returns the ray through the centre of pixel (`x`, `y`) of an image of `size`; (0, 0) is the top left.
    ///
    /// The image spans the camera's whole field of view: its pixels are square when the camera's aspect is
    /// [`Size::aspect`].
    pub fn ray(&self, size: Size, x: u32, y: u32) -> Ray {
        self.ray_around(size, i64::from(x), i64::from(y))
    }

    /// Returns the ray of a pixel as [`Camera::ray`] does, also beside the image: (-1, 0) is left of the top left
    /// pixel.
    pub fn ray_around(&self, size: Size, x: i64, y: i64) -> Ray {
        let across = (x as f64 + 0.5) / f64::from(size.width()) * 2.0 - 1.0;
        let down = (y as f64 + 0.5) / f64::from(size.height()) * 2.0 - 1.0;
        let direction =
            self.forward + self.right * (across * self.half_width) - self.up * (down * self.half_height);
        Ray { origin: self.eye, direction: direction.normalize().as_vec3() }
    }

    /// Returns `direction` in view space: x to the right, y *down* as rows of an image go, z into the view.
    pub fn view_direction(&self, direction: Vec3) -> Vec3 {
        let direction = direction.as_dvec3();
        DVec3::new(direction.dot(self.right), -direction.dot(self.up), direction.dot(self.forward)).as_vec3()
    }

    /// Returns the tangents of the half angles of view, across and down.
    pub fn tangents(&self) -> [f64; 2] {
        [self.half_width, self.half_height]
    }

    /// Returns the position of the camera in metres, world space.
    pub fn eye(&self) -> Vec3 {
        self.eye
    }
}

fn check_finite(pose: &CameraPose) -> Result<(), CameraError> {
    let fields = [
        ("eye", pose.eye.iter().all(|v| v.is_finite())),
        ("target", pose.target.iter().all(|v| v.is_finite())),
        ("up", pose.up.iter().all(|v| v.is_finite())),
        ("fov_y_deg", pose.fov_y_deg.is_finite()),
        ("aspect", pose.aspect.is_finite()),
    ];
    match fields.iter().find(|(_, finite)| !finite) {
        Some(&(field, _)) => Err(CameraError::NotFinite { field }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pose() -> CameraPose {
        CameraPose {
            eye: [0.0, 0.0, 5.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov_y_deg: 90.0,
            aspect: 2.0,
        }
    }

    #[test]
    fn centre_and_corners() {
        let camera = Camera::new(&pose()).unwrap();
        let centre = camera.ray(Size::new(1, 1).unwrap(), 0, 0);
        assert_eq!(centre, Ray { origin: Vec3::new(0.0, 0.0, 5.0), direction: Vec3::NEG_Z });
        // Two by two pixels: centres at half of the half-angle tangents (2 across, 1 down).
        let top_left = camera.ray(Size::new(2, 2).unwrap(), 0, 0).direction;
        let want = Vec3::new(-1.0, 0.5, -1.0).normalize();
        assert!((top_left - want).length() < 1e-6, "{top_left}");
        let bottom_right = camera.ray(Size::new(2, 2).unwrap(), 1, 1).direction;
        assert!((bottom_right - Vec3::new(1.0, -0.5, -1.0).normalize()).length() < 1e-6);
    }

    #[test]
    fn pixels_beside_the_image_continue_its_grid() {
        let camera = Camera::new(&pose()).unwrap();
        let size = Size::new(4, 2).unwrap();
        let view = |x, y| camera.view_direction(camera.ray_around(size, x, y).direction);
        for (x, y) in [(-3, 0), (0, 0), (3, 1), (6, -2), (2, 7)] {
            // 90 degrees down and an aspect of 2: pixels are one unit of the plane at distance 1.
            let want = Vec3::new(x as f32 + 0.5 - 2.0, y as f32 + 0.5 - 1.0, 1.0).normalize();
            assert!((view(x, y) - want).length() < 1e-6, "{x} {y}: {}", view(x, y));
        }
        assert_eq!(camera.ray(size, 3, 1), camera.ray_around(size, 3, 1));
        let [across, down] = camera.tangents();
        assert!((across - 2.0).abs() < 1e-12 && (down - 1.0).abs() < 1e-12);
    }

    #[test]
    fn up_need_not_be_square_to_the_view() {
        let size = Size::new(3, 3).unwrap();
        let square = Camera::new(&pose()).unwrap();
        let tilted = Camera::new(&CameraPose { up: [0.0, 3.0, 100.0], ..pose() }).unwrap();
        for (x, y) in [(0, 0), (2, 0), (1, 2)] {
            let apart = square.ray(size, x, y).direction - tilted.ray(size, x, y).direction;
            assert!(apart.length() < 1e-6, "{apart}");
        }
    }

    #[test]
    fn degenerate_cameras_are_typed_errors() {
        let p = pose();
        let new = |p: CameraPose| Camera::new(&p).unwrap_err();
        assert_eq!(new(CameraPose { target: p.eye, ..p }), CameraError::EyeIsTarget { at: p.eye });
        assert_eq!(new(CameraPose { up: [0.0, 0.0, -2.0], ..p }), CameraError::UpParallel);
        assert_eq!(new(CameraPose { up: [0.0; 3], ..p }), CameraError::UpParallel);
        assert_eq!(new(CameraPose { up: [0.0, 1e-8, 1.0], ..p }), CameraError::UpParallel);
        for degrees in [0.0, -1.0, 180.0, 720.0] {
            assert_eq!(new(CameraPose { fov_y_deg: degrees, ..p }), CameraError::FieldOfView { degrees });
        }
        for aspect in [0.0, -0.0, -1.5] {
            assert_eq!(new(CameraPose { aspect, ..p }), CameraError::Aspect { aspect });
        }
        let nan = f32::NAN;
        let field = |p: CameraPose| match Camera::new(&p) {
            Err(CameraError::NotFinite { field }) => field,
            other => panic!("{other:?}"),
        };
        assert_eq!(field(CameraPose { eye: [0.0, nan, 0.0], ..p }), "eye");
        assert_eq!(field(CameraPose { target: [f32::INFINITY, 0.0, 0.0], ..p }), "target");
        assert_eq!(field(CameraPose { up: [nan; 3], ..p }), "up");
        assert_eq!(field(CameraPose { fov_y_deg: nan, ..p }), "fov_y_deg");
        assert_eq!(field(CameraPose { aspect: f32::INFINITY, ..p }), "aspect");
    }

    #[test]
    fn tiny_and_huge_distances_still_have_a_direction() {
        for scale in [1e-30_f32, 1e-3, 1e4, 1e30] {
            let camera = Camera::new(&CameraPose { eye: [0.0, 0.0, 5.0 * scale], ..pose() }).unwrap();
            let ray = camera.ray(Size::new(1, 1).unwrap(), 0, 0);
            assert!((ray.direction - Vec3::NEG_Z).length() < 1e-6, "scale {scale}: {}", ray.direction);
        }
    }

    proptest! {
        #[test]
        fn every_accepted_camera_gives_unit_rays(
            eye in prop::array::uniform3(-1e4_f32..1e4),
            target in prop::array::uniform3(-1e4_f32..1e4),
            up in prop::array::uniform3(-1.0_f32..1.0),
            fov_y_deg in 0.01_f32..179.99,
            aspect in 0.01_f32..100.0,
        ) {
            if let Ok(camera) = Camera::new(&CameraPose { eye, target, up, fov_y_deg, aspect }) {
                let size = Size::new(7, 5).unwrap();
                for (x, y) in [(0, 0), (6, 4), (3, 2)] {
                    let length = camera.ray(size, x, y).direction.length();
                    prop_assert!((length - 1.0).abs() < 1e-6, "{length}");
                }
                let centre = camera.ray(size, 3, 2).direction.as_dvec3();
                prop_assert!(centre.dot(camera.forward) > 0.999_999);
            }
        }
    }
}
