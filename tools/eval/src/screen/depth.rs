//! The input of all screen-space methods: linear depth and normals, with a guard band.

use glam::{Vec2, Vec3};
use psao_proto::message::CameraPose;
use psao_reconstruct::{AoImage, Camera, Size, Surfaces};
use rayon::prelude::*;

use super::ScreenError;

/// Linear depth and view-space normals of a view, and of a guard band of pixels around it.
///
/// View space has the eye at the origin, x to the right, y *down*, z into the view, in metres. Pixels are those of the
/// whole grid, including the guard band. (0, 0) is the top left of the guard band, (`guard`, `guard`) that of the
/// image. The centre of pixel (x, y) lies at (x + 0.5, y + 0.5). Methods read the whole grid and shade the inner
/// pixels.
///
/// ```
/// use glam::Vec3;
/// use psao_reconstruct::Size;
/// use psao_eval::screen::Screen;
///
/// // A wall 2 m away that faces the camera, 4 x 2 pixels and one of guard on each side, 90 degrees across.
/// let depth = vec![2.0; 6 * 4];
/// let screen = Screen::from_parts(Size::new(4, 2)?, 1, [1.0, 0.5], depth, vec![Vec3::NEG_Z; 24])?;
/// assert_eq!(screen.position(1, 1), Some(Vec3::new(-1.5, -0.5, 2.0)));
/// assert_eq!(screen.radius_px(0.5, 2.0).x, 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    inner: Size,
    size: Size,
    guard: u32,
    tangents: [f32; 2],
    /// Pixels per unit of slope, across and down.
    focal: Vec2,
    /// Slope per pixel: 1 over `focal`.
    slope: Vec2,
    /// Place on the grid where the view's axis meets it.
    centre: Vec2,
    depth: Vec<f32>,
    normal: Vec<Vec3>,
}

impl Screen {
    /// Largest guard band in pixels on each side.
    pub const MAX_GUARD: u32 = 4_096;

    /// Tolerance of a normal's length around 1.
    const UNIT_TOLERANCE: f32 = 1e-3;

    /// Casts a view of `scene` with the camera of `pose`.
    ///
    /// The inner pixels are those of [`cast_view`](psao_reconstruct::cast_view()) with the same pose and size. `guard`
    /// more pixels on each side continue their grid.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] when the pose is degenerate, or the guard band or the whole is too large. Also when the scene
    /// returns a depth of 0, or a normal that is not of unit length.
    pub fn new<S: Surfaces + ?Sized>(
        scene: &S,
        pose: &CameraPose,
        inner: Size,
        guard: u32,
    ) -> Result<Self, ScreenError> {
        let camera = Camera::new(pose)?;
        let size = with_guard(inner, guard)?;
        let mut depth = vec![f32::INFINITY; size.pixels()];
        let mut normal = vec![Vec3::ZERO; size.pixels()];
        let width = size.width() as usize;
        let guard_px = i64::from(guard);
        depth.par_chunks_mut(width).zip(normal.par_chunks_mut(width)).enumerate().for_each(
            |(y, (depths, normals))| {
                for x in 0..width {
                    let ray = camera.ray_around(inner, x as i64 - guard_px, y as i64 - guard_px);
                    if let Some(seen) = scene.first_hit(ray.origin, ray.direction, f32::INFINITY) {
                        depths[x] = seen.t * camera.view_direction(ray.direction).z;
                        normals[x] = camera.view_direction(seen.normal);
                    }
                }
            },
        );
        Self::from_parts(inner, guard, camera.tangents().map(|t| t as f32), depth, normal)
    }

    /// Makes a screen of an image of `inner` pixels, and `guard` more on each side.
    ///
    /// `tangents` are those of the half angles of view of the *inner* image, across and down. `depth` holds metres
    /// along the view's axis, infinite for sky. `normal` holds unit normals in view space; those of sky do not matter.
    /// Both are row by row from the top left of the guard band.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] names the part that does not fit, and the first invalid pixel.
    pub fn from_parts(
        inner: Size,
        guard: u32,
        tangents: [f32; 2],
        depth: Vec<f32>,
        mut normal: Vec<Vec3>,
    ) -> Result<Self, ScreenError> {
        let size = with_guard(inner, guard)?;
        if !tangents.iter().all(|t| t.is_finite() && *t > 0.0) {
            return Err(ScreenError::Tangents { tangents });
        }
        for (what, found) in [("depths", depth.len()), ("normals", normal.len())] {
            if found != size.pixels() {
                return Err(ScreenError::Count { what, size, found });
            }
        }
        for (pixel, (&depth, normal)) in depth.iter().zip(&mut normal).enumerate() {
            let (x, y) = (pixel as u32 % size.width(), pixel as u32 / size.width());
            if depth.is_nan() || depth <= 0.0 {
                return Err(ScreenError::Depth { x, y, depth });
            }
            if depth == f32::INFINITY {
                *normal = Vec3::ZERO;
                continue;
            }
            let length = normal.length();
            if length.is_nan() || (length - 1.0).abs() > Self::UNIT_TOLERANCE {
                return Err(ScreenError::Normal { x, y, length });
            }
        }
        let half = Vec2::new(inner.width() as f32, inner.height() as f32) * 0.5;
        let focal = half / Vec2::from(tangents);
        let (slope, centre) = (1.0 / focal, half + guard as f32);
        Ok(Self { inner, size, guard, tangents, focal, slope, centre, depth, normal })
    }

    /// Returns the size of the image without guard band, which methods shade.
    pub fn inner(&self) -> Size {
        self.inner
    }

    /// Returns the size of the grid, including the guard band.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Returns the pixels of the guard band on each side.
    pub fn guard(&self) -> u32 {
        self.guard
    }

    /// Returns the tangents of the half angles of view of the inner image, across and down.
    pub fn tangents(&self) -> [f32; 2] {
        self.tangents
    }

    /// Returns the depths of the grid in metres along the view's axis, row by row; infinite for sky.
    pub fn depths(&self) -> &[f32] {
        &self.depth
    }

    /// Returns the unit normals of the grid in view space, row by row; zero for sky.
    pub fn normals(&self) -> &[Vec3] {
        &self.normal
    }

    /// Returns the depth of pixel (`x`, `y`) of the grid in metres; infinite for sky and beyond the grid.
    #[inline]
    pub fn depth(&self, x: i32, y: i32) -> f32 {
        self.index(x, y).map_or(f32::INFINITY, |index| self.depth[index])
    }

    /// Returns the unit normal of pixel (`x`, `y`) of the grid in view space; zero for sky and beyond the grid.
    #[inline]
    pub fn normal(&self, x: i32, y: i32) -> Vec3 {
        self.index(x, y).map_or(Vec3::ZERO, |index| self.normal[index])
    }

    /// Returns whether the pixel with these (whole) numbers of column and row is on the grid.
    #[inline]
    pub(crate) fn covers(&self, pixel: Vec2) -> bool {
        pixel.cmpge(Vec2::ZERO).all()
            && pixel.cmplt(Vec2::new(self.size.width() as f32, self.size.height() as f32)).all()
    }

    /// Returns the position of the surface at pixel (`x`, `y`) of the grid, in metres, view space; `None` for sky and
    /// beyond the grid.
    #[inline]
    pub fn position(&self, x: i32, y: i32) -> Option<Vec3> {
        let depth = self.depth(x, y);
        (depth < f32::INFINITY).then(|| self.unproject(Vec2::new(x as f32 + 0.5, y as f32 + 0.5), depth))
    }

    /// Returns the point of view space at `depth` metres that projects to the place `at` of the grid, in pixels.
    #[inline]
    pub fn unproject(&self, at: Vec2, depth: f32) -> Vec3 {
        ((at - self.centre) * self.slope * depth).extend(depth)
    }

    /// Returns the place on the grid, in pixels, to which a point of view space projects; its z must be above 0.
    #[inline]
    pub fn project(&self, point: Vec3) -> Vec2 {
        point.truncate() / point.z * self.focal + self.centre
    }

    /// Returns the slope per pixel, across and down. It is the size of a pixel at 1 m, in metres.
    pub fn slope(&self) -> Vec2 {
        self.slope
    }

    /// Returns the length in pixels, across and down, of `radius` metres perpendicular to the view's axis at `depth`
    /// metres. Infinite depth gives 0.
    #[inline]
    pub fn radius_px(&self, radius: f32, depth: f32) -> Vec2 {
        self.focal * (radius / depth)
    }

    /// Returns an image of the values of `shade` at each inner pixel that shows a surface; sky is 1. Rows are spread
    /// over all threads.
    pub(crate) fn each_inner(&self, shade: impl Fn(Pixel) -> f32 + Sync) -> Vec<f32> {
        let mut values = vec![1.0_f32; self.inner.pixels()];
        let guard = self.guard as i32;
        values.par_chunks_mut(self.inner.width() as usize).enumerate().for_each(|(row, values)| {
            let y = row as i32 + guard;
            for (value, x) in values.iter_mut().zip(guard..) {
                if let Some(position) = self.position(x, y) {
                    *value = shade(Pixel { x, y, position, normal: self.normal(x, y) });
                }
            }
        });
        values
    }

    /// Makes an image of computed values, clamped to `[0, 1]` because of rounding.
    pub(crate) fn image(&self, mut values: Vec<f32>) -> Result<AoImage, ScreenError> {
        for value in &mut values {
            *value = value.clamp(0.0, 1.0);
        }
        Ok(AoImage::new(self.inner, values)?)
    }

    /// Returns the index in the buffers of pixel (`x`, `y`) of the grid.
    #[inline]
    fn index(&self, x: i32, y: i32) -> Option<usize> {
        let inside = (x as u32) < self.size.width() && (y as u32) < self.size.height();
        inside.then(|| y as usize * self.size.width() as usize + x as usize)
    }
}

/// An inner pixel that shows a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pixel {
    /// Column on the grid.
    pub(crate) x: i32,
    /// Row on the grid.
    pub(crate) y: i32,
    /// Position of the surface in metres, view space.
    pub(crate) position: Vec3,
    /// Its unit normal, view space.
    pub(crate) normal: Vec3,
}

/// Returns the size of an image with its guard band.
fn with_guard(inner: Size, guard: u32) -> Result<Size, ScreenError> {
    if guard > Screen::MAX_GUARD {
        return Err(ScreenError::Guard { guard });
    }
    Ok(Size::new(inner.width() + 2 * guard, inner.height() + 2 * guard)?)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use psao_reconstruct::{CameraError, cast_view};
    use psao_server::scene::Scene;
    use psao_server::world::SceneBvh;

    use super::*;
    use crate::adapter::SceneView;

    fn size(width: u32, height: u32) -> Size {
        Size::new(width, height).unwrap()
    }

    fn wall(inner: Size, guard: u32) -> Result<Screen, ScreenError> {
        let pixels = ((inner.width() + 2 * guard) * (inner.height() + 2 * guard)) as usize;
        Screen::from_parts(inner, guard, [1.0, 0.5], vec![2.0; pixels], vec![Vec3::NEG_Z; pixels])
    }

    #[test]
    fn inner_pixels_are_those_of_the_view_whatever_the_guard() {
        let scene = Arc::new(Scene::load("colonnade").unwrap());
        let world = SceneBvh::new(&scene, &scene.pose(0.0));
        let view = SceneView::new(&world);
        let (pose, inner) = (scene.camera(0.0), size(32, 18));
        let plain = cast_view(&view, &pose, inner).unwrap();
        let camera = Camera::new(&pose).unwrap();
        let bare = Screen::new(&view, &pose, inner, 0).unwrap();
        let guarded = Screen::new(&view, &pose, inner, 5).unwrap();
        assert_eq!((guarded.size(), guarded.inner(), guarded.guard()), (size(42, 28), inner, 5));
        let mut surfaces = 0;
        for y in 0..18 {
            for x in 0..32 {
                assert_eq!(bare.depth(x, y), guarded.depth(x + 5, y + 5));
                assert_eq!(bare.normal(x, y), guarded.normal(x + 5, y + 5));
                match plain.fragment((y * 32 + x) as usize) {
                    None => assert_eq!(bare.position(x, y), None),
                    Some(fragment) => {
                        surfaces += 1;
                        let position = bare.position(x, y).unwrap();
                        let want = camera.view_direction(fragment.position - camera.eye());
                        assert!((position - want).length() < 1e-4 * want.length(), "{position} {want}");
                        assert_eq!(bare.normal(x, y), camera.view_direction(fragment.normal));
                        let moved = guarded.position(x + 5, y + 5).unwrap();
                        assert!((position - moved).length() < 1e-5 * want.length());
                    }
                }
            }
        }
        assert!(surfaces > 400, "{surfaces}");
    }

    #[test]
    fn places_go_to_the_screen_and_back() {
        let screen = wall(size(8, 4), 3).unwrap();
        assert_eq!(screen.position(7, 5), Some(Vec3::new(0.25, 0.25, 2.0)));
        for (x, y) in [(0, 0), (13, 9), (5, 2)] {
            let position = screen.position(x, y).unwrap();
            let at = screen.project(position);
            assert!((at - Vec2::new(x as f32 + 0.5, y as f32 + 0.5)).length() < 1e-4, "{at}");
        }
        assert_eq!(screen.radius_px(0.5, 2.0), Vec2::new(1.0, 1.0));
        assert_eq!(screen.radius_px(0.5, f32::INFINITY), Vec2::ZERO);
        for (x, y) in [(-1, 0), (0, -1), (14, 0), (0, 10), (i32::MIN, i32::MAX)] {
            assert_eq!((screen.position(x, y), screen.normal(x, y)), (None, Vec3::ZERO));
        }
    }

    #[test]
    fn only_what_is_there_is_shaded_and_with_its_place() {
        let mut depth = vec![2.0; 30];
        depth[2 * 6 + 3] = f32::INFINITY;
        let screen = Screen::from_parts(size(4, 3), 1, [1.0, 1.0], depth, vec![Vec3::NEG_Z; 30]).unwrap();
        let values = screen.each_inner(|pixel| {
            assert_eq!(Some(pixel.position), screen.position(pixel.x, pixel.y));
            (pixel.y * 10 + pixel.x) as f32
        });
        assert_eq!(values, [11., 12., 13., 14., 21., 22., 1., 24., 31., 32., 33., 34.]);
    }

    #[test]
    fn sizes_and_guards_have_limits() {
        assert_eq!(wall(size(1, 1), 0).unwrap().size(), size(1, 1));
        assert_eq!(wall(size(1, 1), 40).unwrap().size(), size(81, 81));
        let scene = Arc::new(Scene::from_triangles("floor", &[crate::shapes::floor(4.0)], 0.6).unwrap());
        let world = SceneBvh::new(&scene, &scene.pose(0.0));
        let new = |inner, guard| Screen::new(&SceneView::new(&world), &scene.camera(0.0), inner, guard);
        let wide = Screen::MAX_GUARD + 1;
        assert_eq!(new(size(1, 1), wide), Err(ScreenError::Guard { guard: wide }));
        assert_eq!(new(size(1, 1), u32::MAX), Err(ScreenError::Guard { guard: u32::MAX }));
        let huge = new(size(Size::MAX_SIDE, 1), 1);
        assert!(matches!(huge, Err(ScreenError::Size(_))), "{huge:?}");
        let pose = CameraPose { fov_y_deg: 0.0, ..scene.camera(0.0) };
        let refused = Screen::new(&SceneView::new(&world), &pose, size(2, 2), 0);
        assert_eq!(refused, Err(ScreenError::Camera(CameraError::FieldOfView { degrees: 0.0 })));
    }

    #[test]
    fn projected_depths_are_refused_where_they_show_and_fine_once_linear() {
        const NEAR: f32 = 0.1;
        let metres = [2.0, f32::INFINITY, 0.5, 8.0, 3.0, f32::INFINITY];
        let make = |depths: [f32; 6]| {
            Screen::from_parts(size(3, 2), 0, [1.0, 1.0], depths.into(), vec![Vec3::NEG_Z; 6])
        };
        let linear = make(metres).unwrap();
        // A far plane at infinity, reversed: 1 is near, and the sky is 0.
        let reversed = metres.map(|metres| NEAR / metres);
        assert_eq!(make(reversed), Err(ScreenError::Depth { x: 1, y: 0, depth: 0.0 }));
        let back = make(reversed.map(|depth| NEAR / depth)).unwrap();
        assert!((0..3).all(|x| (back.depth(x, 0) - linear.depth(x, 0)).abs() < 1e-6
            || back.depth(x, 0) == linear.depth(x, 0)));
        // Not reversed, the sky is 1. Depths up to a metre cannot be distinguished from metres, the near plane can.
        let normalised = metres.map(|metres| 1.0 - NEAR / metres);
        assert_eq!(make(normalised.map(|depth| NEAR / (1.0 - depth))).unwrap().position(1, 0), None);
        let at_near = [NEAR; 6].map(|metres| 1.0 - NEAR / metres);
        assert_eq!(make(at_near), Err(ScreenError::Depth { x: 0, y: 0, depth: 0.0 }));
    }

    #[test]
    fn what_is_no_depth_or_normal_is_refused_with_its_place() {
        let make = |depth: f32, normal: Vec3| {
            let (mut depths, mut normals) = (vec![1.0; 6], vec![Vec3::NEG_Z; 6]);
            (depths[4], normals[4]) = (depth, normal);
            Screen::from_parts(size(3, 2), 0, [1.0, 1.0], depths, normals)
        };
        // Reversed and normalised depths have zeros at the sky; right-handed views have negative depths.
        for depth in [0.0, -0.0, -3.0, f32::NEG_INFINITY, f32::NAN] {
            let found = make(depth, Vec3::NEG_Z);
            assert!(matches!(found, Err(ScreenError::Depth { x: 1, y: 1, .. })), "{found:?}");
        }
        for normal in [Vec3::ZERO, Vec3::ONE, Vec3::NAN, Vec3::INFINITY] {
            let found = make(1.0, normal);
            assert!(matches!(found, Err(ScreenError::Normal { x: 1, y: 1, .. })), "{found:?}");
        }
        let sky = make(f32::INFINITY, Vec3::NAN).unwrap();
        assert_eq!((sky.position(1, 1), sky.normal(1, 1)), (None, Vec3::ZERO));
        let from = |count: (usize, usize), tangents| {
            let (depths, normals) = (vec![1.0; count.0], vec![Vec3::X; count.1]);
            Screen::from_parts(size(3, 2), 0, tangents, depths, normals)
        };
        for count in [(5, 6), (6, 7), (0, 6)] {
            assert!(matches!(from(count, [1.0; 2]), Err(ScreenError::Count { .. })));
        }
        for tangents in [[0.0, 1.0], [1.0, -1.0], [f32::INFINITY, 1.0], [1.0, f32::NAN]] {
            assert!(matches!(from((6, 6), tangents), Err(ScreenError::Tangents { .. })));
        }
    }
}
