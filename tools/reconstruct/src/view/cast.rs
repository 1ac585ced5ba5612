//! Casts one ray for each pixel of a view.

use glam::Vec3;
use psao_proto::message::CameraPose;

use super::camera::{Camera, CameraError, Ray};
use super::{GBuffer, Size, Surface};
use crate::parallel;

/// A scene into which rays can be cast. It is geometry only and knows nothing about ambient occlusion.
pub trait Surfaces: Sync {
    /// Returns the nearest surface along a ray from `origin` in the unit direction `dir`, at most `tmax` metres away;
    /// `None` when there is none. `tmax` may be infinite.
    fn first_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<Surface>;
}

/// Casts one ray through each pixel's centre into `scene`, with the camera of `pose`.
///
/// The feature `rayon` spreads rows over all cores. The result depends on the arguments alone.
///
/// # Errors
///
/// [`CameraError`] when the pose is degenerate.
pub fn cast_view<S: Surfaces + ?Sized>(
    scene: &S,
    pose: &CameraPose,
    size: Size,
) -> Result<GBuffer, CameraError> {
    let camera = Camera::new(pose)?;
    let mut fragments: Vec<Option<Surface>> = vec![None; size.pixels()];
    parallel::chunks(&mut fragments, size.width() as usize, |y, row| {
        for (pixel, x) in row.iter_mut().zip(0u32..) {
            let Ray { origin, direction } = camera.ray(size, x, y as u32);
            *pixel = scene.first_hit(origin, direction, f32::INFINITY);
        }
    });
    Ok(GBuffer::gather(size, fragments))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::analytic::{Analytic, Shape};

    fn pose() -> CameraPose {
        CameraPose {
            eye: [0.0, 1.0, 5.0],
            target: [0.0, 1.0, 0.0],
            up: [0.0, 1.0, 0.0],
            fov_y_deg: 60.0,
            aspect: 1.5,
        }
    }

    fn ball_on_floor() -> Analytic {
        Analytic(vec![
            Shape::Plane { point: Vec3::ZERO, normal: Vec3::Y },
            Shape::Sphere { centre: Vec3::new(0.0, 1.0, 0.0), radius: 1.0 },
        ])
    }

    #[test]
    fn ball_floor_and_sky_are_where_they_belong() {
        let size = Size::new(45, 31).unwrap();
        let buffer = cast_view(&ball_on_floor(), &pose(), size).unwrap();
        let at = |x: usize, y: usize| buffer.fragment(y * 45 + x);
        let ball = at(22, 15).unwrap();
        assert_eq!(ball.instance, 1);
        assert!((ball.t - 4.0).abs() < 1e-5 && (ball.normal - Vec3::Z).length() < 1e-5, "{ball:?}");
        let floor = at(22, 30).unwrap();
        assert_eq!((floor.instance, floor.normal), (0, Vec3::Y));
        assert!(floor.position.y.abs() < 1e-5);
        assert_eq!(at(0, 0), None, "sky");
        assert_eq!(buffer.depth()[0], f32::INFINITY);
        let covered = (0..size.pixels()).filter(|&p| buffer.fragment(p).is_some()).count();
        assert_eq!(buffer.covered(), covered);
        assert_eq!(buffer.fragment(size.pixels()), None, "beyond the image");
    }

    #[cfg(feature = "rayon")]
    #[test]
    fn one_thread_and_many_see_the_same() {
        let size = Size::new(64, 40).unwrap();
        let draw = || cast_view(&ball_on_floor(), &pose(), size).unwrap();
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool(1).install(draw), pool(5).install(draw));
    }

    #[test]
    fn a_degenerate_camera_is_an_error() {
        let size = Size::new(4, 4).unwrap();
        let bad = CameraPose { fov_y_deg: 180.0, ..pose() };
        assert_eq!(cast_view(&ball_on_floor(), &bad, size), Err(CameraError::FieldOfView { degrees: 180.0 }));
    }
}
