//! Points that lie inside a solid, where no one can see them.
//!
//! A floor goes on under a block that stands on it. Points there are dark, and a client that blends them darkens the
//! visible floor around the block. Their rays meet the backs of the block's faces.

use glam::Vec3;

use super::ray_packet::PacketOrigin;
use crate::bvh::{BlasHit, BodyId};
use crate::world::SceneBvh;

/// Number of a point's rays that are looked at.
const BURIAL_RAYS: usize = 16;

/// Returns whether a point lies inside a solid: more than half of 16 of its rays meet the backs of one-sided faces within
/// `reach` metres. `near` are the bodies within reach, each with the start of the rays in its space. `directions` are all rays
/// of the point in the space of its normal; of fewer than 16, all are looked at.
///
/// Rays start in the space of each body, as those that are traced do. So the answer is the same after a rigid motion of the
/// point's own body. Of a front and a back at the same distance the back counts, whatever order the structures have.
pub(super) fn is_buried(
    world: &SceneBvh,
    near: &[(BodyId, PacketOrigin)],
    directions: &[Vec3],
    reach: f32,
) -> bool {
    let count = BURIAL_RAYS.min(directions.len());
    let (mut backs, mut others) = (0, 0);
    for ray in 0..count {
        if meets_back(world, near, directions[ray * directions.len() / count], reach) {
            backs += 1;
        } else {
            others += 1;
        }
        // The answer is known before all rays are.
        if 2 * backs > count {
            return true;
        }
        if 2 * others >= count {
            return false;
        }
    }
    false
}

/// Returns whether a ray meets the back of a one-sided face within `tmax` metres and before anything else.
fn meets_back(world: &SceneBvh, near: &[(BodyId, PacketOrigin)], direction: Vec3, tmax: f32) -> bool {
    let mut limit = tmax;
    let mut found = false;
    for (body, start) in near {
        let along = start.rotation * direction;
        let is_back = |hit: &BlasHit| world.opaque(*body, hit) && world.is_back(*body, hit.triangle, along);
        let blas = &world.bodies().list()[body.index()].blas;
        if let Some(hit) = blas.nearest(start.origin, along, limit, false, is_back) {
            (limit, found) = (hit.intersection.t, true);
        }
    }
    let before = |(body, start): &(BodyId, PacketOrigin)| {
        let along = start.rotation * direction;
        let is_other = |hit: &BlasHit| world.opaque(*body, hit) && !world.is_back(*body, hit.triangle, along);
        let blas = &world.bodies().list()[body.index()].blas;
        blas.nearest(start.origin, along, limit, true, is_other).is_some()
    };
    found && !near.iter().any(before)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::ao::{AoSettings, RayFrame, Tracer};
    use crate::points::RayKey;
    use crate::scene::Scene;

    /// Returns the triangles of a box with its fronts outside.
    fn block(low: Vec3, high: Vec3) -> Vec<[Vec3; 3]> {
        let mut triangles = Vec::new();
        for axis in 0..3 {
            for (side, at) in [(-1.0, low[axis]), (1.0, high[axis])] {
                let corner = |u: f32, v: f32| {
                    let mut place = Vec3::ZERO;
                    place[axis] = at;
                    let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
                    place[b] = low[b] + (high[b] - low[b]) * u;
                    place[c] = low[c] + (high[c] - low[c]) * v;
                    place
                };
                let [p, q, r, s] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
                if side > 0.0 {
                    triangles.extend([[p, q, r], [p, r, s]]);
                } else {
                    triangles.extend([[p, r, q], [p, s, r]]);
                }
            }
        }
        triangles
    }

    #[test]
    fn floor_under_a_block_is_buried_and_floor_beside_it_is_not() {
        let floor = block(Vec3::new(-2.0, -0.1, -2.0), Vec3::new(2.0, 0.0, 2.0));
        let stone = block(Vec3::new(-0.3, 0.0, -0.3), Vec3::new(0.3, 0.4, 0.3));
        let scene = Arc::new(Scene::from_triangles("block on floor", &[floor, stone], 0.6).unwrap());
        let world = SceneBvh::new(&scene, &scene.pose(0.0));
        let tracer = Tracer::new(AoSettings::default().with_rays(64)).unwrap();
        let buried = |x: f32| {
            let place = RayFrame { body: None, position: Vec3::X * x, normal: Vec3::Y, edge: Vec3::ZERO };
            tracer.trace_and_dig(&world, RayKey(3), &place)
        };
        for (x, wanted) in
            [(0.0, true), (0.28, true), (-0.29, true), (0.32, false), (0.6, false), (1.9, false)]
        {
            assert_eq!(buried(x), wanted, "{x}");
        }
    }
}
