//! Eight triangles side by side, and the one ray-triangle formula that every path uses.
//!
//! With the origin at zero, a ray `d` is inside the triangle `a b c` when the three signed volumes `d.(b x c)`,
//! `d.(c x a)` and `d.(a x b)` have the same sign. Two triangles that share an edge compute its volume from the same
//! two products with the opposite sign, to the bit, so no ray slips between them. All rays of one point share the
//! three cross products; [`Block::prepare`] computes them once for eight triangles at a time.

use glam::Vec3;

use super::lanes::{LANES, Lanes, Lanes3};

/// The corners of eight triangles. Vacant lanes hold a point at zero, which no ray hits.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    corners: [Lanes3; 3],
}

/// A block as seen from one origin: what is left for a ray are four dot products.
pub(crate) struct Prepared {
    /// Corners less the origin.
    corners: [Lanes3; 3],
    /// `b x c`, `c x a`, `a x b` of the corners less the origin.
    volumes: [Lanes3; 3],
    /// `(b - a) x (c - a)`, not normalised; from the edges, where nothing cancels.
    normal: Lanes3,
    /// `normal . a`: signed distance of the plane times the length of the normal.
    plane: Lanes,
}

/// One triangle of a [`Prepared`] block, ready to meet many rays.
pub(crate) struct Facet {
    volumes: [Vec3; 3],
    normal: Vec3,
    plane: f32,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Meeting {
    /// Distance along the unit direction.
    pub(crate) t: f32,
    /// Signed volumes opposite to the three corners: the barycentric weights before normalisation.
    pub(crate) volumes: [f32; 3],
}

impl Block {
    /// A block of at most eight triangles.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let mut block = Self { corners: [Lanes3::ZERO; 3] };
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

    /// The corners less the origin, and all that rays from there share.
    #[inline(always)]
    pub(crate) fn prepare(&self, origin: Vec3) -> Prepared {
        let [p, q, r] = &self.corners;
        let origin = Lanes3::splat(origin);
        let corners = [p.minus(&origin), q.minus(&origin), r.minus(&origin)];
        let [a, b, c] = &corners;
        let normal = q.minus(p).cross(&r.minus(p));
        Prepared { volumes: [b.cross(c), c.cross(a), a.cross(b)], plane: normal.dot(a), normal, corners }
    }
}

impl Prepared {
    /// Bit per lane: whether rays into the half-space of `up`, at most `reach` long, may meet the triangle.
    /// Never says no to a triangle that is met.
    #[inline(always)]
    pub(crate) fn within(&self, up: Vec3, reach: f32) -> u32 {
        let [a, b, c] = &self.corners;
        let low = |a: Lanes, b: Lanes, c: Lanes| a.smaller(b).smaller(c);
        let high = |a: Lanes, b: Lanes, c: Lanes| a.larger(b).larger(c);
        let (lx, hx) = (low(a.x, b.x, c.x), high(a.x, b.x, c.x));
        let (ly, hy) = (low(a.y, b.y, c.y), high(a.y, b.y, c.y));
        let (lz, hz) = (low(a.z, b.z, c.z), high(a.z, b.z, c.z));
        let out = |low: Lanes, high: Lanes| low.larger(-high).larger(Lanes::ZERO);
        let (x, y, z) = (out(lx, hx), out(ly, hy), out(lz, hz));
        let size = |low: Lanes, high: Lanes| high.larger(-low);
        let extent = Lanes::splat(reach) + size(lx, hx) + size(ly, hy) + size(lz, hz);
        let highest = a.dot_one(up).larger(b.dot_one(up)).larger(c.dot_one(up));
        // The tolerances cover the rounding of the sums they stand beside and of the rays' own directions.
        let far = Lanes::splat(reach * reach * 1.000_01);
        let near_box = far.at_least(x * x + y * y + z * z);
        let above = highest.at_least(Lanes::splat(-1e-5) * extent);
        let slope = self.normal.dot(&self.normal);
        let near_plane = (slope * far * Lanes::splat(1.01)).at_least(self.plane * self.plane);
        near_box.and(above).and(near_plane).bits()
    }

    /// The triangle of one lane, for many rays.
    #[inline(always)]
    pub(crate) fn facet(&self, lane: usize) -> Facet {
        let [u, v, w] = &self.volumes;
        Facet {
            volumes: [u.at(lane), v.at(lane), w.at(lane)],
            normal: self.normal.at(lane),
            plane: self.plane.array()[lane],
        }
    }

    /// Distance to each of the eight triangles along one unit direction, or infinity where it is missed.
    #[inline(always)]
    pub(crate) fn distances(&self, direction: Vec3) -> Lanes {
        let [u, v, w] = &self.volumes;
        let (u, v, w) = (u.dot_one(direction), v.dot_one(direction), w.dot_one(direction));
        meetings([u, v, w], self.plane / self.normal.dot_one(direction))
    }
}

/// The distances where the three volumes agree in sign, else infinity.
#[inline(always)]
fn meetings([u, v, w]: [Lanes; 3], t: Lanes) -> Lanes {
    let front = u.smaller(v).smaller(w).at_least(Lanes::ZERO);
    let back = Lanes::ZERO.at_least(u.larger(v).larger(w));
    // A triangle without area gives 0 / 0 for `t`, and every comparison with NaN says no.
    front.or(back).and(Lanes::ZERO.below(t)).choose(t, Lanes::splat(f32::INFINITY))
}

impl Facet {
    /// Distance to the triangle along each of eight unit directions, or infinity where it is missed.
    #[inline(always)]
    pub(crate) fn distances(&self, directions: &Lanes3) -> Lanes {
        let [u, v, w] = &self.volumes;
        let (u, v, w) = (directions.dot_one(*u), directions.dot_one(*v), directions.dot_one(*w));
        meetings([u, v, w], Lanes::splat(self.plane) / directions.dot_one(self.normal))
    }

    /// Where one unit direction meets the triangle; the same bits as [`Facet::distances`].
    #[inline(always)]
    pub(crate) fn meet(&self, direction: Vec3) -> Option<Meeting> {
        let along = |n: Vec3| direction.x * n.x + direction.y * n.y + direction.z * n.z;
        let volumes = [along(self.volumes[0]), along(self.volumes[1]), along(self.volumes[2])];
        let t = self.plane / along(self.normal);
        let inside = volumes.iter().all(|&v| v >= 0.0) || volumes.iter().all(|&v| v <= 0.0);
        (inside && t > 0.0 && t < f32::INFINITY).then_some(Meeting { t, volumes })
    }
}

impl Meeting {
    /// Weights of the three corners, summing to 1. A ray that touches an edge-on triangle gets its first corner.
    pub(crate) fn barycentric(&self) -> [f32; 3] {
        let sum = self.volumes[0] + self.volumes[1] + self.volumes[2];
        if sum == 0.0 { [1.0, 0.0, 0.0] } else { self.volumes.map(|v| v / sum) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(range: f32) -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-range..range).prop_map(Vec3::from)
    }

    fn meet(triangle: [Vec3; 3], origin: Vec3, direction: Vec3) -> Option<Meeting> {
        Block::new(&[triangle]).prepare(origin).facet(0).meet(direction)
    }

    #[test]
    fn hits_both_sides_and_reports_the_point() {
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for side in [1.0, -1.0] {
            let hit = meet(triangle, Vec3::new(0.25, 0.5, 2.0 * side), Vec3::NEG_Z * side).unwrap();
            assert_eq!(hit.t, 2.0);
            assert_eq!(hit.barycentric(), [0.25, 0.25, 0.5]);
        }
        assert_eq!(meet(triangle, Vec3::new(0.25, 0.5, 2.0), Vec3::Z), None);
        assert_eq!(meet(triangle, Vec3::new(0.75, 0.5, 2.0), Vec3::NEG_Z), None);
    }

    #[test]
    fn triangles_without_area_are_never_hit() {
        let point = [Vec3::ONE; 3];
        let line = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
        assert_eq!(meet(point, Vec3::ZERO, Vec3::ONE.normalize()), None);
        assert_eq!(meet(line, Vec3::new(0.5, 0.0, 1.0), Vec3::NEG_Z), None);
        assert_eq!(meet([Vec3::ZERO; 3], Vec3::ZERO, Vec3::X), None);
    }

    proptest! {
        #[test]
        fn lanes_and_single_rays_agree_to_the_bit(
            triangle in prop::array::uniform3(vector(1.0)), origin in vector(1.5),
            directions in prop::collection::vec(vector(1.0), LANES),
        ) {
            let directions: Vec<Vec3> = directions.into_iter().map(Vec3::normalize_or_zero).collect();
            let facet = Block::new(&[triangle]).prepare(origin).facet(0);
            let by_ray = facet.distances(&Lanes3::from_fn(|i| directions[i]));
            for (i, &t) in by_ray.array().iter().enumerate() {
                let single = facet.meet(directions[i]).map_or(f32::INFINITY, |hit| hit.t);
                prop_assert_eq!(t.to_bits(), single.to_bits());
                let by_triangle = Block::new(&[triangle; 5]).prepare(origin).distances(directions[i]);
                prop_assert_eq!(by_triangle.array()[4].to_bits(), single.to_bits());
                prop_assert_eq!(by_triangle.array()[7], f32::INFINITY);
            }
        }

        #[test]
        fn no_ray_slips_between_two_triangles_that_share_an_edge(
            corners in prop::array::uniform2(vector(1.0)), origin in vector(1.0), at in 0f32..=1.0, split in 0.2f32..0.8,
        ) {
            // A flat quad around the shared edge; a ray aimed at a point of that edge must hit one of the two.
            let [p, q] = corners;
            let side = (q - p).cross(Vec3::new(0.3, 0.5, 0.8));
            prop_assume!(side.length() > 0.1 && (p - q).length() > 0.1);
            let (left, right) = (p.lerp(q, split) + side, p.lerp(q, 1.0 - split) - side);
            let target = p.lerp(q, 0.01 + 0.98 * at);
            let normal = side.cross(q - p).normalize_or_zero();
            prop_assume!((target - origin).length() > 0.05 && normal.dot(target - origin).abs() > 0.02);
            let direction = (target - origin).normalize();
            prop_assert!(
                meet([p, q, left], origin, direction).is_some() || meet([q, p, right], origin, direction).is_some()
            );
        }

        #[test]
        fn what_is_met_is_never_culled(
            triangle in prop::array::uniform3(vector(1.0)), origin in vector(1.0), up in vector(1.0),
            direction in vector(1.0), reach in 0.1f32..1.5,
        ) {
            let (up, direction) = (up.normalize_or_zero(), direction.normalize_or_zero());
            prop_assume!(up.dot(direction) >= 0.0);
            let prepared = Block::new(&[triangle]).prepare(origin);
            if let Some(hit) = prepared.facet(0).meet(direction) && hit.t <= reach {
                prop_assert_eq!(prepared.within(up, reach) & 1, 1);
            }
        }
    }
}
