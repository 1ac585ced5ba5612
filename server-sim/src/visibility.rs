//! Coarse visibility: which points are inside an extended field of view (paper, section 3.3).

use glam::Vec3;
use psao_codec::surface::PICTURE_ROWS;
use psao_proto::message::CameraPose;

/// Cosine between a normal and the direction to an eye below which a point counts as seen from behind. A surface bends between
/// a point and its neighbours.
pub(crate) const BACK_COSINE: f32 = -0.25;

/// A camera's widened field of view. A point is in view if it is in front of the eye and within the angles, at any
/// distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    eye: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    /// Half-angle tangents after widening.
    tangents: [f32; 2],
    /// Size of a pixel at one metre, in metres: that of a picture of [`PICTURE_ROWS`] rows.
    pixel: f32,
    /// Lengths of the side planes' normals, for distances to these planes.
    lengths: [f32; 2],
}

/// Position of a ball relative to a [`View`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overlap {
    /// No point of the ball is in the view.
    Outside,
    /// Some points of the ball may be in the view.
    Partly,
    /// The whole ball is in the view.
    Inside,
}

impl View {
    /// Returns the view of a camera with its half-angle tangents multiplied by `margin`. Returns `None` for a pose
    /// that [`CameraPose::is_valid`] rejects, or for a margin that is not a positive number.
    #[must_use]
    pub fn new(camera: &CameraPose, margin: f32) -> Option<Self> {
        if !(camera.is_valid() && margin > 0.0 && margin.is_finite()) {
            return None;
        }
        let eye = Vec3::from(camera.eye);
        let forward = (Vec3::from(camera.target) - eye).try_normalize()?;
        let right = forward.cross(camera.up.into()).try_normalize()?;
        let tangent = libm::tanf(camera.fov_y_deg.to_radians() * 0.5);
        let half = tangent * margin;
        let pixel = 2.0 * tangent / PICTURE_ROWS;
        let tangents = [half * camera.aspect, half];
        let lengths = tangents.map(|tangent| (1.0 + tangent * tangent).sqrt());
        let view = Self { eye, right, up: right.cross(forward), forward, tangents, pixel, lengths };
        lengths.iter().all(|length| length.is_finite()).then_some(view)
    }

    /// Returns whether a point of the world is in the view.
    #[must_use]
    #[inline]
    pub fn sees(&self, point: Vec3) -> bool {
        let to = point - self.eye;
        let depth = self.forward.dot(to);
        depth > 0.0
            && self.right.dot(to).abs() <= self.tangents[0] * depth
            && self.up.dot(to).abs() <= self.tangents[1] * depth
    }

    /// Returns the size of a pixel at a place, metres; infinity for a surface that turns its back.
    fn pixel_on(&self, place: Vec3, normal: Vec3) -> f32 {
        let to_eye = self.eye - place;
        let distance = to_eye.length();
        let cosine = normal.dot(to_eye) / distance.max(f32::MIN_POSITIVE);
        if cosine < BACK_COSINE {
            return f32::INFINITY;
        }
        self.pixel * distance
    }

    /// Returns the position of a ball (metres) relative to the view. Close to a boundary it is [`Overlap::Partly`].
    #[must_use]
    pub fn overlap(&self, center: Vec3, radius: f32) -> Overlap {
        let to = center - self.eye;
        let depth = self.forward.dot(to);
        let sides = [self.right.dot(to).abs(), self.up.dot(to).abs()];
        // Signed distance to the nearest side plane, positive inside.
        let inside =
            (0..2).map(|i| (self.tangents[i] * depth - sides[i]) / self.lengths[i]).fold(depth, f32::min);
        let slack = radius + 1e-4 * (to.length() + radius);
        if inside < -slack {
            Overlap::Outside
        } else if inside > slack {
            Overlap::Inside
        } else {
            Overlap::Partly
        }
    }
}

/// Several views. A point is visible if one of them contains it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Views(Vec<View>);

impl Views {
    /// Returns the views of some cameras, or `None` without cameras, when everything is visible. Invalid cameras see
    /// nothing, but count.
    pub(crate) fn new(cameras: &[CameraPose], margin: f32) -> Option<Self> {
        (!cameras.is_empty())
            .then(|| Self(cameras.iter().filter_map(|camera| View::new(camera, margin)).collect()))
    }

    #[inline]
    pub(crate) fn see(&self, point: Vec3) -> bool {
        self.0.iter().any(|view| view.sees(point))
    }

    /// Returns the eyes of the cameras.
    pub(crate) fn eyes(&self) -> impl Iterator<Item = Vec3> {
        self.0.iter().map(|view| view.eye)
    }

    /// Returns the size of a pixel at a place, for the view that sees it best, metres. It is infinite where no view sees the place, or all see its back.
    pub(crate) fn pixel(&self, place: Vec3, normal: Vec3) -> f32 {
        let views = self.0.iter().filter(|view| view.sees(place));
        views.map(|view| view.pixel_on(place, normal)).fold(f32::INFINITY, f32::min)
    }

    pub(crate) fn overlap(&self, center: Vec3, radius: f32) -> Overlap {
        let each = self.0.iter().map(|view| view.overlap(center, radius));
        each.fold(Overlap::Outside, |sum, one| match (sum, one) {
            (Overlap::Inside, _) | (_, Overlap::Inside) => Overlap::Inside,
            (Overlap::Outside, Overlap::Outside) => Overlap::Outside,
            _ => Overlap::Partly,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera(fov_y_deg: f32, aspect: f32) -> CameraPose {
        CameraPose { eye: [1.0, 2.0, 3.0], target: [1.0, 2.0, -7.0], up: [0.0, 1.0, 0.0], fov_y_deg, aspect }
    }

    #[test]
    fn sees_up_to_the_widened_edges_at_any_distance() {
        let view = View::new(&camera(90.0, 2.0), 1.3).unwrap();
        let at =
            |x: f32, y: f32, depth: f32| view.sees(Vec3::new(1.0 + x * depth, 2.0 + y * depth, 3.0 - depth));
        for depth in [1e-3, 1.0, 1e5] {
            assert!(at(0.0, 0.0, depth) && at(2.59, 0.0, depth) && at(0.0, -1.29, depth));
            assert!(!at(2.61, 0.0, depth) && !at(0.0, 1.31, depth) && !at(-2.59, 1.31, depth));
        }
        assert!(!at(0.0, 0.0, -1.0));
    }

    #[test]
    fn cameras_that_make_no_picture_see_nothing() {
        assert_eq!(View::new(&camera(f32::NAN, 1.0), 1.3), None);
        assert_eq!(View::new(&camera(60.0, 1.0), f32::INFINITY), None);
        let views = Views::new(&[camera(-1.0, 1.0)], 1.3).unwrap();
        assert!(!views.see(Vec3::new(1.0, 2.0, 0.0)));
        assert!(Views::new(&[], 1.3).is_none());
    }

    proptest! {
        #[test]
        fn balls_are_judged_like_their_points(
            center in prop::array::uniform3(-20f32..20.0), radius in 0f32..5.0, offset in prop::array::uniform3(-1f32..1.0),
            fov in 10f32..150.0, aspect in 0.3f32..3.0,
        ) {
            let view = View::new(&camera(fov, aspect), 1.3).unwrap();
            let (center, offset) = (Vec3::from(center), Vec3::from(offset).clamp_length_max(1.0));
            match view.overlap(center, radius) {
                Overlap::Outside => prop_assert!(!view.sees(center + offset * radius)),
                Overlap::Inside => prop_assert!(view.sees(center + offset * radius)),
                Overlap::Partly => {}
            }
        }
    }
}
