//! Blocks of eight triangles, and the one ray-triangle formula that all code uses.
//!
//! With the origin at zero, a ray `d` is inside the triangle `a b c` if the three signed volumes `d.(b x c)`, `d.(c x
//! a)` and `d.(a x b)` have the same sign. Two triangles that share an edge compute its volume from the same two
//! products with the opposite sign, bit for bit. So no ray slips between them. All rays of one point share the three
//! cross products; [`Block::prepare`] computes them once for eight triangles.

use fearless_simd::prelude::*;
use glam::Vec3;

use super::lanes::{LANES, LaneMask, Lanes, Lanes3, Packed, Packed3, bits};

/// The corners of eight triangles. Vacant lanes hold a point at zero, which no ray hits.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    corners: [Packed3; 3],
}

/// A block relative to one origin. A ray then requires only four dot products.
pub(crate) struct BlockSetup {
    /// `b x c`, `c x a`, `a x b` of the corners relative to the origin. Their sign and that of `normal` make `plane`
    /// positive.
    volumes: [Packed3; 3],
    /// `(b - a) x (c - a)`, not normalised. The edges avoid cancellation.
    normal: Packed3,
    /// `normal . a`: the distance of the plane times the length of the normal.
    plane: Packed,
}

/// Per-lane bounds that exclude the triangles of a [`BlockSetup`] that no ray of a cone can hit.
pub(crate) struct BlockCulling {
    /// Bit per lane: whether any ray may hit the triangle.
    pub(crate) lanes: u32,
    /// Squared distance to the box of the triangle.
    near: Packed,
    /// Lengths of the three volumes' vectors and of the normal. They are infinite for a triangle seen so edge-on that
    /// rounding decides which side is hit.
    lengths: [Packed; 4],
}

/// A cone of rays: all directions within `spread` of `axis`, up to the length `reach`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayCone {
    pub(crate) axis: Vec3,
    /// Largest distance of a direction from the axis, plus at least 1e-5 for rounding; see [`SPREAD_SLACK`].
    pub(crate) spread: f32,
    /// Length of the rays, above 0.
    pub(crate) reach: f32,
}

/// Margin of the spread of rays. It covers the rounding of their directions and dot products.
pub(crate) const SPREAD_SLACK: f32 = 2e-5;

/// One triangle of a [`BlockSetup`], prepared for many rays.
pub(crate) struct TriangleSetup {
    volumes: [Vec3; 3],
    normal: Vec3,
    plane: f32,
}

/// Intersection of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Intersection {
    /// Distance along the unit direction.
    pub(crate) t: f32,
    /// Signed volumes opposite to the three corners: the barycentric weights before normalisation.
    pub(crate) volumes: [f32; 3],
}

impl Block {
    /// Returns a block of at most eight triangles.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let mut block = Self { corners: [Packed3::ZERO; 3] };
        for (lane, triangle) in triangles.iter().take(LANES).enumerate() {
            block.set(lane, triangle);
        }
        block
    }

    /// Replaces the triangle of one lane.
    pub(crate) fn set(&mut self, lane: usize, triangle: &[Vec3; 3]) {
        for (corner, &at) in self.corners.iter_mut().zip(triangle) {
            corner.set(lane, at);
        }
    }

    /// Computes what all rays from `origin` share.
    #[inline(always)]
    pub(crate) fn prepare<S: Simd>(&self, simd: S, origin: Vec3) -> BlockSetup {
        self.setup_lanes(simd, origin).in_memory()
    }

    /// Does the same as [`Block::prepare`], but keeps the result in registers.
    #[inline(always)]
    pub(crate) fn setup_lanes<S: Simd>(&self, simd: S, origin: Vec3) -> BlockSetupLanes<S> {
        let [p, q, r] = &self.corners;
        let (p, q, r) = (p.load(simd), q.load(simd), r.load(simd));
        let origin = Lanes3::splat(simd, origin);
        let corners = [p.minus(&origin), q.minus(&origin), r.minus(&origin)];
        let [a, b, c] = &corners;
        let normal = q.minus(&p).cross(&r.minus(&p));
        let plane = normal.dot(a);
        let behind = plane.simd_lt(Lanes::splat(simd, 0.0));
        let facing = |volume: Lanes3<S>| volume.negated_where(behind);
        let volumes = [facing(b.cross(c)), facing(c.cross(a)), facing(a.cross(b))];
        BlockSetupLanes {
            volumes,
            normal: normal.negated_where(behind),
            plane: behind.select(-plane, plane),
            corners,
        }
    }
}

/// A [`BlockSetup`] in registers, with the corners that [`BlockCulling`] needs.
pub(crate) struct BlockSetupLanes<S: Simd> {
    /// Corners relative to the origin.
    corners: [Lanes3<S>; 3],
    volumes: [Lanes3<S>; 3],
    normal: Lanes3<S>,
    plane: Lanes<S>,
}

impl<S: Simd> BlockSetupLanes<S> {
    #[inline(always)]
    pub(crate) fn in_memory(&self) -> BlockSetup {
        let [u, v, w] = self.volumes;
        BlockSetup {
            volumes: [u.into(), v.into(), w.into()],
            normal: self.normal.into(),
            plane: self.plane.into(),
        }
    }

    /// Computes bounds on what rays into the half-space of `up` can hit within `reach`. They never exclude a triangle
    /// that is hit.
    #[inline(always)]
    pub(crate) fn culling(&self, up: Vec3, reach: f32) -> BlockCulling {
        let simd = self.plane.simd;
        let splat = |value: f32| Lanes::splat(simd, value);
        let [a, b, c] = &self.corners;
        let low = |a: Lanes<S>, b: Lanes<S>, c: Lanes<S>| a.min(b).min(c);
        let high = |a: Lanes<S>, b: Lanes<S>, c: Lanes<S>| a.max(b).max(c);
        let (lx, hx) = (low(a.x, b.x, c.x), high(a.x, b.x, c.x));
        let (ly, hy) = (low(a.y, b.y, c.y), high(a.y, b.y, c.y));
        let (lz, hz) = (low(a.z, b.z, c.z), high(a.z, b.z, c.z));
        let out = |low: Lanes<S>, high: Lanes<S>| low.max(-high).max(splat(0.0));
        let (x, y, z) = (out(lx, hx), out(ly, hy), out(lz, hz));
        let size = |low: Lanes<S>, high: Lanes<S>| high.max(-low);
        let size = size(lx, hx) + size(ly, hy) + size(lz, hz);
        let up = Lanes3::splat(simd, up);
        let highest = a.dot(&up).max(b.dot(&up)).max(c.dot(&up));
        // The tolerances cover the rounding of the sums beside them and of the rays' own directions.
        let far = splat(reach * reach * 1.000_01);
        let near = x * x + y * y + z * z;
        let above = highest.simd_ge(splat(-1e-5) * (splat(reach) + size));
        let slope = self.normal.dot(&self.normal);
        let near_plane = (slope * far * splat(1.01)).simd_ge(self.plane * self.plane);
        let lanes = bits(far.simd_ge(near) & above & near_plane);
        // A ray outside all three volumes crosses the plane from the other side. Within reach it can do so only if
        // the volumes' rounding, about 1e-6 of the squared size, exceeds the distance to the plane.
        let sided = self.plane.simd_ge(splat(1e-5 * reach) * (size * size));
        let length = |a: &Lanes3<S>| Packed::from(sided.select(a.length(), splat(f32::INFINITY)));
        let [u, v, w] = &self.volumes;
        BlockCulling {
            lanes,
            near: near.into(),
            lengths: [length(u), length(v), length(w), length(&self.normal)],
        }
    }
}

impl BlockCulling {
    /// Returns a bit per lane: whether some ray of a cone may hit the triangle. It is set for every triangle that is
    /// hit.
    #[inline(always)]
    pub(crate) fn lanes_met<S: Simd>(&self, simd: S, prepared: &BlockSetup, cone: &RayCone) -> u32 {
        let axis = Lanes3::splat(simd, cone.axis);
        let spread = Lanes::splat(simd, cone.spread);
        let reach = Lanes::splat(simd, cone.reach);
        let most =
            |vectors: &Packed3, length: &Packed| vectors.load(simd).dot(&axis) + spread * length.load(simd);
        let [u, v, w] = &prepared.volumes;
        let [lu, lv, lw, ln] = &self.lengths;
        let inside = most(u, lu).min(most(v, lv)).min(most(w, lw)).simd_ge(Lanes::splat(simd, 0.0));
        let plane = (reach * most(&prepared.normal, ln)).simd_ge(prepared.plane.load(simd));
        let near = (reach * reach * Lanes::splat(simd, 1.000_01)).simd_ge(self.near.load(simd));
        bits(inside & plane & near) & self.lanes
    }
}

impl BlockSetup {
    /// Returns the triangle of one lane, for use with many rays.
    #[inline(always)]
    pub(crate) fn triangle(&self, lane: usize) -> TriangleSetup {
        let [u, v, w] = &self.volumes;
        TriangleSetup {
            volumes: [u.at(lane), v.at(lane), w.at(lane)],
            normal: self.normal.at(lane),
            plane: self.plane.array()[lane],
        }
    }

    /// Returns the smallest distance below `best` to any of the eight triangles along one unit direction.
    #[inline(always)]
    pub(crate) fn nearest<S: Simd>(&self, simd: S, direction: Vec3, best: f32) -> Option<f32> {
        let t = self.distances(simd, direction);
        (bits(t.simd_lt(Lanes::splat(simd, best))) != 0).then(|| Packed::from(t).smallest())
    }

    /// Returns the distance to each of the eight triangles along one unit direction, or infinity for a miss.
    #[inline(always)]
    pub(crate) fn distances<S: Simd>(&self, simd: S, direction: Vec3) -> Lanes<S> {
        let along = Lanes3::splat(simd, direction);
        let [u, v, w] = &self.volumes;
        let (u, v, w) = (u.load(simd).dot(&along), v.load(simd).dot(&along), w.load(simd).dot(&along));
        let t = self.plane.load(simd) / self.normal.load(simd).dot(&along);
        let (zero, none) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, f32::INFINITY));
        (inside(u, v, w) & zero.simd_lt(t)).select(t, none)
    }
}

/// Returns whether three volumes agree in sign.
#[inline(always)]
fn inside<S: Simd>(u: Lanes<S>, v: Lanes<S>, w: Lanes<S>) -> LaneMask<S> {
    let zero = Lanes::splat(u.simd, 0.0);
    u.min(v).min(w).simd_ge(zero) | zero.simd_ge(u.max(v).max(w))
}

impl TriangleSetup {
    /// Shortens those of eight rays that hit the triangle nearer than `best`: to the hit, or to `hit` if given.
    /// Returns `None` if no ray is inside the triangle.
    #[inline(always)]
    pub(crate) fn shorten<S: Simd>(
        &self,
        directions: &Lanes3<S>,
        best: Lanes<S>,
        hit: Option<f32>,
    ) -> Option<Lanes<S>> {
        let simd = best.simd;
        let along = |vector: Vec3| directions.dot(&Lanes3::splat(simd, vector));
        let [u, v, w] = self.volumes;
        let inside = inside(along(u), along(v), along(w));
        if bits(inside) == 0 {
            return None;
        }
        // A triangle without area gives 0 / 0, and every comparison with NaN is false.
        let t = Lanes::splat(simd, self.plane) / along(self.normal);
        let met = inside & Lanes::splat(simd, 0.0).simd_lt(t) & t.simd_lt(best);
        Some(met.select(hit.map_or(t, |hit| Lanes::splat(simd, hit)), best))
    }

    /// Intersects one unit direction with the triangle. The bits equal those of [`TriangleSetup::shorten`].
    #[inline(always)]
    pub(crate) fn intersect(&self, direction: Vec3) -> Option<Intersection> {
        let along = |n: Vec3| direction.x * n.x + direction.y * n.y + direction.z * n.z;
        let volumes = [along(self.volumes[0]), along(self.volumes[1]), along(self.volumes[2])];
        let t = self.plane / along(self.normal);
        let inside = volumes.iter().all(|&v| v >= 0.0) || volumes.iter().all(|&v| v <= 0.0);
        (inside && t > 0.0 && t < f32::INFINITY).then_some(Intersection { t, volumes })
    }
}

impl Intersection {
    /// Returns the weights of the three corners, which sum to 1. For a ray that touches an edge-on triangle the first
    /// corner has all of the weight.
    pub(crate) fn barycentric(&self) -> [f32; 3] {
        let sum = self.volumes[0] + self.volumes[1] + self.volumes[2];
        if sum == 0.0 { [1.0, 0.0, 0.0] } else { self.volumes.map(|v| v / sum) }
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;

    use super::*;
    use crate::bvh::{Bounds, Instructions};

    fn vector(range: f32) -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-range..range).prop_map(Vec3::from)
    }

    fn prepare(triangles: &[[Vec3; 3]], origin: Vec3) -> BlockSetup {
        dispatch!(Level::baseline(), simd => Block::new(triangles).prepare(simd, origin))
    }

    fn intersect(triangle: [Vec3; 3], origin: Vec3, direction: Vec3) -> Option<Intersection> {
        prepare(&[triangle], origin).triangle(0).intersect(direction)
    }

    /// Returns the distances to one triangle along eight directions: eight rays against one triangle, and each ray
    /// against a block.
    #[inline(always)]
    fn distances<S: Simd>(simd: S, triangle: [Vec3; 3], origin: Vec3, directions: &[Vec3]) -> [Packed; 2] {
        let setup = Block::new(&[triangle]).prepare(simd, origin).triangle(0);
        let along = Packed3::from_fn(|i| directions[i]).load(simd);
        let none = Lanes::splat(simd, f32::INFINITY);
        let by_ray = setup.shorten(&along, none, None).unwrap_or(none);
        let block = Block::new(&[triangle; 5]).prepare(simd, origin);
        let by_triangle = Packed::from_fn(|i| {
            let all = block.distances(simd, directions[i]);
            assert_eq!(all[7], f32::INFINITY);
            all[4]
        });
        [by_ray.into(), by_triangle]
    }

    #[test]
    fn hits_both_sides_and_reports_the_point() {
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for side in [1.0, -1.0] {
            let hit = intersect(triangle, Vec3::new(0.25, 0.5, 2.0 * side), Vec3::NEG_Z * side).unwrap();
            assert_eq!(hit.t, 2.0);
            assert_eq!(hit.barycentric(), [0.25, 0.25, 0.5]);
        }
        assert_eq!(intersect(triangle, Vec3::new(0.25, 0.5, 2.0), Vec3::Z), None);
        assert_eq!(intersect(triangle, Vec3::new(0.75, 0.5, 2.0), Vec3::NEG_Z), None);
    }

    #[test]
    fn triangles_without_area_are_never_hit() {
        let point = [Vec3::ONE; 3];
        let line = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
        assert_eq!(intersect(point, Vec3::ZERO, Vec3::ONE.normalize()), None);
        assert_eq!(intersect(line, Vec3::new(0.5, 0.0, 1.0), Vec3::NEG_Z), None);
        assert_eq!(intersect([Vec3::ZERO; 3], Vec3::ZERO, Vec3::X), None);
    }

    proptest! {
        #[test]
        fn lanes_and_single_rays_are_bit_identical(
            triangle in prop::array::uniform3(vector(1.0)), origin in vector(1.5),
            directions in prop::collection::vec(vector(1.0), LANES),
        ) {
            let directions: Vec<Vec3> = directions.into_iter().map(Vec3::normalize_or_zero).collect();
            for instructions in Instructions::all() {
                let both = dispatch!(instructions.level(), simd => distances(simd, triangle, origin, &directions));
                for (i, &direction) in directions.iter().enumerate() {
                    let single = intersect(triangle, origin, direction).map_or(f32::INFINITY, |hit| hit.t);
                    prop_assert_eq!(both.map(|by| by.array()[i].to_bits()), [single.to_bits(); 2]);
                }
            }
        }

        #[test]
        fn no_ray_slips_between_two_triangles_that_share_an_edge(
            corners in prop::array::uniform2(vector(1.0)), origin in vector(1.0), at in 0f32..=1.0, split in 0.2f32..0.8,
        ) {
            // A flat quad around the shared edge. A ray aimed at a point of that edge must hit one of the two
            // triangles.
            let [p, q] = corners;
            let side = (q - p).cross(Vec3::new(0.3, 0.5, 0.8));
            prop_assume!(side.length() > 0.1 && (p - q).length() > 0.1);
            let (left, right) = (p.lerp(q, split) + side, p.lerp(q, 1.0 - split) - side);
            let target = p.lerp(q, 0.01 + 0.98 * at);
            let normal = side.cross(q - p).normalize_or_zero();
            prop_assume!((target - origin).length() > 0.05 && normal.dot(target - origin).abs() > 0.02);
            let direction = (target - origin).normalize();
            prop_assert!(
                intersect([p, q, left], origin, direction).is_some() || intersect([q, p, right], origin, direction).is_some()
            );
        }

        #[test]
        fn what_is_met_is_never_culled(
            triangle in prop::array::uniform3(vector(1.0)), origin in vector(1.5), up in vector(1.0),
            direction in vector(1.0), reach in 0.1f32..1.5, off in vector(1.0), turn in 0f32..0.6,
            // At 1 and nearly 1 the origin is in the triangle's plane, so that the view is edge-on.
            flat in prop_oneof![Just(0f32), Just(1.0), 0.999_99f32..1.0], aimed in any::<bool>(), at in 0f32..1.0,
        ) {
            let [a, b, c] = triangle;
            let level = a + (b - a) * origin.x + (c - a) * origin.y;
            let origin = origin.lerp(level, flat);
            let target = a.lerp(b, at).lerp(c, direction.x.abs());
            let direction = if aimed { target - origin } else { direction }.normalize_or_zero();
            let up = up.normalize_or_zero();
            prop_assume!(up.dot(direction) >= 0.0 && direction != Vec3::ZERO);
            let Some(hit) = intersect(triangle, origin, direction).filter(|hit| hit.t <= reach) else { return Ok(()) };
            // In an edge-on view, rounding alone may place the hit nearer than the triangle's box.
            let away = Bounds::around(triangle).distance_squared(origin);
            prop_assume!(away <= reach * reach);
            let axis = (direction + off * turn).normalize_or(direction);
            let spread = axis.distance(direction) + SPREAD_SLACK;
            for instructions in Instructions::all() {
                // Also test a ray that ends exactly at the triangle.
                for most in [reach, if away > hit.t * hit.t { reach } else { hit.t }] {
                    let cone = RayCone { axis, spread, reach: most };
                    let lanes = dispatch!(instructions.level(), simd => {
                        let lanes = Block::new(&[triangle]).setup_lanes(simd, origin);
                        lanes.culling(up, reach).lanes_met(simd, &lanes.in_memory(), &cone)
                    });
                    prop_assert_eq!(lanes & 1, 1);
                }
            }
        }
    }

    #[test]
    fn cones_that_miss_a_triangle_are_culled() {
        let triangle = [Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.2, 0.0, 1.0), Vec3::new(0.0, 0.2, 1.0)];
        let by = |axis: Vec3, spread: f32, reach: f32| {
            let cone = RayCone { axis: axis.normalize(), spread, reach };
            dispatch!(Level::new(), simd => {
                let lanes = Block::new(&[triangle]).setup_lanes(simd, Vec3::ZERO);
                lanes.culling(Vec3::Z, 2.0).lanes_met(simd, &lanes.in_memory(), &cone)
            }) & 1
        };
        assert_eq!(by(Vec3::Z, 0.1, 2.0), 1);
        // Three misses: beside it, in front of it, and so oblique that its plane is too far.
        assert_eq!(by(Vec3::new(-0.5, 0.0, 1.0), 0.1, 2.0), 0);
        assert_eq!(by(Vec3::Z, 0.1, 0.9), 0);
        assert_eq!(by(Vec3::new(0.9, 0.1, 0.2), 0.1, 1.9), 0);
    }
}
