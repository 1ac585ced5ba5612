//! What the camera sees: the nearest surface of every pixel.
//!
//! A client draws the scene itself. Here that is one ray per pixel through whatever implements [`Surfaces`];
//! a renderer that has depth and normals already fills a [`GBuffer`] through [`GBuffer::from_fragments`].

use glam::Vec3;
use psao_proto::message::CameraPose;
use rayon::prelude::*;

use crate::Size;
use crate::camera::{Camera, CameraError, Ray};

/// A scene that can be looked at. Geometry only: nothing of ambient occlusion goes through here.
pub trait Surfaces: Sync {
    /// The nearest surface along a ray from `origin` in the unit direction `dir`, at most `tmax` metres away;
    /// `None` when there is none. `tmax` may be infinite.
    fn first_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<Surface>;
}

/// A point of a surface, as a ray meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Distance along the ray in metres, at least 0.
    pub t: f32,
    /// Where it is, in metres, world space.
    pub position: Vec3,
    /// Its unit shading normal (normal map included), world space, facing the ray's origin.
    pub normal: Vec3,
    /// Index of the instance that it belongs to, the same as in the stream's layout.
    pub instance: u32,
    /// Where it is on the mesh at rest. Profile `surface` needs it; for profile `paper` it may be left out.
    pub rest: Option<AtRest>,
}

/// A point of a surface on the mesh at rest: unskinned and unmorphed, whatever its instance does.
///
/// A renderer has both as vertex attributes that are interpolated over the triangle, without any transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtRest {
    /// Where it is, in metres, rest space of the mesh.
    pub position: Vec3,
    /// Its unit shading normal there: the normal map bends it in the tangent space at rest, and it is turned round
    /// where [`Surface::normal`] is, on the backs of faces. A zero normal counts as none given.
    pub normal: Vec3,
}

/// The nearest surface of each pixel, row by row from the top left. Background has none.
#[derive(Clone, Debug, PartialEq)]
pub struct GBuffer {
    size: Size,
    depth: Vec<f32>,
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    instance: Vec<u32>,
    /// Zero normals where a fragment does not say; `None` when none does.
    rest: Option<RestPlanes>,
}

/// Places at rest, row by row.
#[derive(Clone, Debug, PartialEq)]
struct RestPlanes {
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
}

impl RestPlanes {
    fn new(size: Size) -> Self {
        Self { position: vec![Vec3::ZERO; size.pixels()], normal: vec![Vec3::ZERO; size.pixels()] }
    }
}

/// Fragments that do not fill an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("an image of {size} pixels needs {} fragments, not {found}", size.pixels())]
pub struct FragmentCountError {
    /// The size asked for.
    pub size: Size,
    /// The number of fragments given.
    pub found: usize,
}

impl GBuffer {
    /// The instance of a background pixel: no instance has this index.
    pub const NO_INSTANCE: u32 = u32::MAX;

    /// Makes a buffer of one optional surface per pixel, row by row from the top left.
    ///
    /// # Errors
    ///
    /// [`FragmentCountError`] when there are not `size.pixels()` fragments.
    pub fn from_fragments(size: Size, fragments: Vec<Option<Surface>>) -> Result<Self, FragmentCountError> {
        if fragments.len() != size.pixels() {
            return Err(FragmentCountError { size, found: fragments.len() });
        }
        Ok(Self::gather(size, fragments))
    }

    /// Spreads fragments, one a pixel, over the planes of the buffer.
    fn gather(size: Size, fragments: Vec<Option<Surface>>) -> Self {
        let mut buffer = Self {
            size,
            depth: vec![f32::INFINITY; size.pixels()],
            position: vec![Vec3::ZERO; size.pixels()],
            normal: vec![Vec3::ZERO; size.pixels()],
            instance: vec![Self::NO_INSTANCE; size.pixels()],
            rest: None,
        };
        for (pixel, surface) in fragments.into_iter().enumerate() {
            if let Some(surface) = surface {
                buffer.depth[pixel] = surface.t;
                buffer.position[pixel] = surface.position;
                buffer.normal[pixel] = surface.normal;
                buffer.instance[pixel] = surface.instance;
                if let Some(rest) = surface.rest {
                    let planes = buffer.rest.get_or_insert_with(|| RestPlanes::new(size));
                    planes.position[pixel] = rest.position;
                    planes.normal[pixel] = rest.normal;
                }
            }
        }
        buffer
    }

    /// Width and height.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Distance from the eye along the ray in metres; infinite for background.
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// Positions in metres, world space; zero for background.
    pub fn position(&self) -> &[Vec3] {
        &self.position
    }

    /// Unit shading normals facing the eye, world space; zero for background.
    pub fn normal(&self) -> &[Vec3] {
        &self.normal
    }

    /// Instances; [`GBuffer::NO_INSTANCE`] for background.
    pub fn instance(&self) -> &[u32] {
        &self.instance
    }

    /// Positions on the meshes at rest, in metres, rest space; zero for background and for surfaces that do not say.
    /// `None` when no surface says.
    pub fn rest_position(&self) -> Option<&[Vec3]> {
        self.rest.as_ref().map(|planes| planes.position.as_slice())
    }

    /// Unit shading normals on the meshes at rest, rest space; zero for background and for surfaces that do not say.
    /// `None` when no surface says.
    pub fn rest_normal(&self) -> Option<&[Vec3]> {
        self.rest.as_ref().map(|planes| planes.normal.as_slice())
    }

    /// The place at rest of pixel number `pixel`; `None` for background, beyond the image, and where the surface
    /// does not say.
    #[inline]
    pub fn at_rest(&self, pixel: usize) -> Option<AtRest> {
        let planes = self.rest.as_ref()?;
        let normal = *planes.normal.get(pixel)?;
        (normal != Vec3::ZERO).then(|| AtRest { position: planes.position[pixel], normal })
    }

    /// The surface of pixel number `pixel` (row times width plus column); `None` for background and beyond
    /// the image.
    pub fn fragment(&self, pixel: usize) -> Option<Surface> {
        let instance = *self.instance.get(pixel)?;
        (instance != Self::NO_INSTANCE).then(|| Surface {
            t: self.depth[pixel],
            position: self.position[pixel],
            normal: self.normal[pixel],
            instance,
            rest: self.at_rest(pixel),
        })
    }

    /// Number of pixels that show a surface.
    pub fn covered(&self) -> usize {
        self.instance.iter().filter(|&&instance| instance != Self::NO_INSTANCE).count()
    }
}

/// Looks at `scene` through `pose`: one ray through each pixel's centre, rows spread over all cores.
///
/// The result depends on the arguments alone, not on the number of threads.
///
/// # Errors
///
/// [`CameraError`] when the pose is degenerate.
pub fn raster<S: Surfaces + ?Sized>(
    scene: &S,
    pose: &CameraPose,
    size: Size,
) -> Result<GBuffer, CameraError> {
    let camera = Camera::new(pose)?;
    let mut fragments: Vec<Option<Surface>> = vec![None; size.pixels()];
    fragments.par_chunks_mut(size.width() as usize).zip(0u32..size.height()).for_each(|(row, y)| {
        for (pixel, x) in row.iter_mut().zip(0u32..) {
            let Ray { origin, direction } = camera.ray(size, x, y);
            *pixel = scene.first_hit(origin, direction, f32::INFINITY);
        }
    });
    Ok(GBuffer::gather(size, fragments))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analytic::{Analytic, Shape};

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
        let buffer = raster(&ball_on_floor(), &pose(), size).unwrap();
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

    #[test]
    fn one_thread_and_many_see_the_same() {
        let size = Size::new(64, 40).unwrap();
        let draw = || raster(&ball_on_floor(), &pose(), size).unwrap();
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool(1).install(draw), pool(5).install(draw));
    }

    #[test]
    fn a_degenerate_camera_is_an_error() {
        let size = Size::new(4, 4).unwrap();
        let bad = CameraPose { fov_y_deg: 180.0, ..pose() };
        assert_eq!(raster(&ball_on_floor(), &bad, size), Err(CameraError::FieldOfView { degrees: 180.0 }));
    }

    #[test]
    fn fragments_must_fill_the_image() {
        let size = Size::new(3, 2).unwrap();
        assert_eq!(GBuffer::from_fragments(size, vec![None; 5]), Err(FragmentCountError { size, found: 5 }));
        let fragment = Surface { t: 2.0, position: Vec3::ONE, normal: Vec3::X, instance: 7, rest: None };
        let buffer =
            GBuffer::from_fragments(size, vec![None, Some(fragment), None, None, None, None]).unwrap();
        assert_eq!(buffer.fragment(1), Some(fragment));
        assert_eq!(buffer.covered(), 1);
        assert_eq!(
            (buffer.rest_position(), buffer.rest_normal()),
            (None, None),
            "nobody pays for what is not used"
        );
    }

    #[test]
    fn places_at_rest_are_kept_where_they_are_given() {
        let without = Surface { t: 2.0, position: Vec3::ONE, normal: Vec3::X, instance: 7, rest: None };
        let rest = AtRest { position: Vec3::new(0.5, -1.0, 2.0), normal: Vec3::NEG_Y };
        let with = Surface { rest: Some(rest), ..without };
        let fragments = vec![Some(with), None, Some(without)];
        let buffer = GBuffer::from_fragments(Size::new(3, 1).unwrap(), fragments.clone()).unwrap();
        assert_eq!((0..3).map(|pixel| buffer.fragment(pixel)).collect::<Vec<_>>(), fragments);
        assert_eq!([0, 1, 2, 3].map(|pixel| buffer.at_rest(pixel)), [Some(rest), None, None, None]);
        assert_eq!(buffer.rest_position(), Some([rest.position, Vec3::ZERO, Vec3::ZERO].as_slice()));
        assert_eq!(buffer.rest_normal(), Some([rest.normal, Vec3::ZERO, Vec3::ZERO].as_slice()));
    }
}
