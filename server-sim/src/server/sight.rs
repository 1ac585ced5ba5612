//! Which points a picture needs: those that a camera sees, and those beside them.
//!
//! Many points in the field of view feed no pixel: they face away from the camera, or something is before them. Their AO may be
//! known less exactly. A point counts as seen when a ray from it to a camera is free, or one from a place beside it: the fit of a
//! client reaches that far. One such ray is traced for a point every few frames, so what a point was found to be is held for a
//! while.

use glam::Vec3;

use super::field::{FieldPart, flag};
use super::places::PointPlaces;
use crate::points::ScenePoints;
use crate::visibility::{BACK_COSINE, Views};
use crate::world::SceneBvh;

/// Frames for which a point counts as seen after it was last found so.
const HOLD_FRAMES: u8 = 24;
/// Frames between two probes of a point.
const PROBE_PERIOD: u32 = 2;
/// Places that are probed in turn: the point itself, four beside it at the reach of the client's fit, and four nearer ones
/// between them. In parts of the reach, along two tangents.
const PROBES: [[f32; 2]; 9] = [
    [0.0, 0.0],
    [1.0, 0.0],
    [0.0, 1.0],
    [-1.0, 0.0],
    [0.0, -1.0],
    [0.45, 0.45],
    [-0.45, 0.45],
    [-0.45, -0.45],
    [0.45, -0.45],
];

// What all probes found is known before it is forgotten.
const _: () = assert!(HOLD_FRAMES as usize >= PROBE_PERIOD as usize * PROBES.len());

/// What is known of a point that is not in the field of view.
pub(super) const OUT_OF_VIEW: u8 = u8::MAX;

/// Looks at the points of a field in one frame.
pub(super) struct Sight<'a> {
    pub(super) world: &'a SceneBvh,
    pub(super) points: &'a ScenePoints,
    /// Without cameras every point in view counts as seen.
    pub(super) views: Option<&'a Views>,
    pub(super) frame: u32,
    /// Distance of a ray's start from the surface, metres.
    pub(super) bias: f32,
}

impl Sight<'_> {
    /// Updates for how many more frames the points of a part count as seen. A point that comes into view is looked at from all
    /// places at once. It is also traced again, so that it is found out whether it is buried.
    pub(super) fn look(&self, part: &mut FieldPart<'_>, placed: &PointPlaces<'_>) {
        let set = &self.points.sets()[self.world.scene().instances()[part.chunk.instance].rest().index()];
        let first = part.chunk.first.0;
        let places = placed.in_world(self.world, part.chunk.instance, &part.chunk.points);
        for (index, (position, normal)) in places.enumerate() {
            let reach = part.level_radius(set, index);
            let left = &mut part.seen[index];
            if part.flags[index] & flag::VISIBLE == 0 {
                *left = OUT_OF_VIEW;
                continue;
            }
            let sees = |probe: [f32; 2]| self.sees(position, normal, reach, probe);
            let turn = (first + index as u32).wrapping_add(self.frame);
            let found = if *left == OUT_OF_VIEW {
                part.flags[index] &= !flag::FRESH;
                part.dug[index] = 0;
                PROBES.into_iter().any(sees)
            } else {
                turn.is_multiple_of(PROBE_PERIOD)
                    && sees(PROBES[(turn / PROBE_PERIOD) as usize % PROBES.len()])
            };
            *left = if found {
                HOLD_FRAMES
            } else if *left == OUT_OF_VIEW {
                0
            } else {
                left.saturating_sub(1)
            };
        }
    }

    /// Returns whether a camera sees one of the places at a point.
    fn sees(&self, position: Vec3, normal: Vec3, reach: f32, [u, v]: [f32; 2]) -> bool {
        let (t, b) = normal.any_orthonormal_pair();
        let place = position + (t * u + b * v) * reach + normal * self.bias;
        let Some(views) = self.views else { return true };
        views.eyes().any(|eye| {
            let to_eye = eye - place;
            let distance = to_eye.length();
            let direction = to_eye / distance.max(f32::MIN_POSITIVE);
            normal.dot(direction) > BACK_COSINE && !self.world.hides(place, direction, distance)
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use psao_proto::message::CameraPose;

    use super::*;
    use crate::scene::Scene;

    #[test]
    fn what_faces_away_or_lies_behind_something_is_not_seen() {
        let wall = |z: f32, half: f32| {
            let at = |x: f32, y: f32| Vec3::new(x * half, y * half, z);
            vec![[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0)], [at(-1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]]
        };
        // A small wall in front of a large one; both face the camera.
        let scene = Arc::new(Scene::from_triangles("walls", &[wall(0.0, 4.0), wall(1.0, 1.0)], 0.6).unwrap());
        let world = SceneBvh::new(&scene, &scene.pose(0.0));
        let settings = crate::points::PointSettings::default().with_per_m2(4.0).with_minimum(8);
        let points = crate::points::generate(&scene, &settings, &|_, _| {}).unwrap();
        let camera = |z: f32| CameraPose {
            eye: [0.0, 0.0, z],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov_y_deg: 90.0,
            aspect: 1.0,
        };
        let views = Views::new(&[camera(3.0)], 1.3).unwrap();
        let sight = Sight { world: &world, points: &points, views: Some(&views), frame: 0, bias: 0.01 };
        let seen = |x: f32, normal: Vec3, probe| sight.sees(Vec3::new(x, 0.0, 0.0), normal, 0.3, probe);
        let [here, beside @ ..] = PROBES;
        assert!(seen(3.0, Vec3::Z, here), "beside the small wall");
        assert!(!seen(0.2, Vec3::Z, here), "behind it");
        assert!(!seen(3.0, Vec3::NEG_Z, here), "from behind");
        // The shadow of the small wall on the large one ends at 1.5 m.
        let edge = |probe| seen(1.4, Vec3::Z, probe);
        assert!(!edge(here) && beside.into_iter().any(edge), "just behind its edge");
        // The backs of one-sided walls are not drawn.
        let behind = Views::new(&[camera(-3.0), camera(-4.0)], 1.3).unwrap();
        let behind = Sight { views: Some(&behind), ..sight };
        assert!(behind.sees(Vec3::new(0.0, 0.0, 2.0), Vec3::NEG_Z, 0.3, here));
    }
}
