//! The rays of one point against one body, in groups of eight.
//!
//! The rays share their origin, so the tree is walked once for all of them, nearest first. Each node narrows down the
//! groups that go on: by the half ball of the rays, then by the rays themselves. All of these tests err on the side of tracing, so the result is the one of tracing every ray against
//! every triangle.

use glam::{Mat3, Vec3};

use super::samples::Turned;
use crate::bvh::{Blas, BlasHit, Facet, LANES, Lanes, Lanes3, Meeting, Node, Prepared, larger};

/// Groups that are traced together: bits of a mask.
pub(super) const GROUPS: usize = 32;
/// Value of a ray in `best` that has nothing left to learn: answered by any hit, or padding of the last group.
const DONE: f32 = -1.0;
/// Rays of a leaf up to which one ray against eight triangles is cheaper than eight rays against one.
const FEW_RAYS: u32 = 3;

/// Up to 256 rays of one point and the working memory to trace them; reused from point to point.
#[derive(Debug)]
pub(super) struct Bundle {
    /// Directions in the space of the body that is traced now, and one over them.
    directions: [Lanes3; GROUPS],
    inverses: [Lanes3; GROUPS],
    /// Nearest hit so far of each ray, at first the reach; [`DONE`] when there is nothing left to learn.
    best: [Lanes; GROUPS],
    radius: f32,
    /// Lanes of the last group that pad it.
    padding: usize,
    groups: usize,
    stack: Vec<Entry>,
}

/// A node to visit, the squared distance to its box and the groups that go there.
#[derive(Clone, Copy, Debug)]
struct Entry {
    near: f32,
    node: u32,
    groups: u32,
}

/// Where the rays start in the space of a body, and how they are turned into it.
pub(super) struct Start {
    /// Tangent space of the point to the space of the body.
    pub(super) turn: Mat3,
    pub(super) origin: Vec3,
}

/// One bundle against one body. With `ANY`, a hit at any distance ends
/// a ray. `accept` is asked about hits on masked triangles only.
pub(super) struct Trace<'a, const ANY: bool> {
    pub(super) bundle: &'a mut Bundle,
    pub(super) rays: &'a Turned<'a>,
    pub(super) chunk: usize,
    pub(super) start: Start,
    pub(super) blas: &'a Blas,
    pub(super) accept: &'a dyn Fn(&BlasHit) -> bool,
}

impl Default for Bundle {
    fn default() -> Self {
        Self {
            directions: [Lanes3::ZERO; GROUPS],
            inverses: [Lanes3::ZERO; GROUPS],
            best: [Lanes::ZERO; GROUPS],
            radius: 0.0,
            padding: 0,
            groups: 0,
            stack: Vec::new(),
        }
    }
}

impl Bundle {
    /// Starts a chunk of a point's rays: every ray may go `radius` far.
    pub(super) fn begin(&mut self, rays: &Turned<'_>, chunk: usize, radius: f32) {
        let groups = rays.groups(chunk).len();
        (self.groups, self.radius, self.padding) = (groups, radius, rays.padding(chunk));
        self.best[..groups].fill(Lanes::splat(radius));
        self.best[groups - 1].array_mut()[LANES - self.padding..].fill(DONE);
    }

    /// Sum over the rays of what hides them: `1 - min(hit distance, R) / R`, or with `ANY` one for every hit. Summed
    /// lane by lane, so that a point without a hit is exactly open.
    pub(super) fn hidden<const ANY: bool>(&self) -> f32 {
        let mut sum = Lanes::ZERO;
        for (group, best) in self.best[..self.groups].iter().enumerate() {
            let used = if group + 1 == self.groups { LANES - self.padding } else { LANES };
            for (sum, &t) in sum.array_mut().iter_mut().zip(&best.array()[..used]) {
                *sum += if ANY { f32::from(t == DONE) } else { 1.0 - t / self.radius };
            }
        }
        sum.sum()
    }
}

impl<const ANY: bool> Trace<'_, ANY> {
    /// Shortens the rays that hit something in the body.
    pub(super) fn run(mut self) {
        let nodes = self.blas.tree().nodes();
        if nodes.is_empty() {
            return;
        }
        self.turn();
        self.bundle.stack.clear();
        let all = u32::MAX >> (GROUPS - self.bundle.groups);
        self.push([self.narrow(&nodes[0], 0, all), None]);
        while let Some(Entry { node, groups, .. }) = self.bundle.stack.pop() {
            let node = &nodes[node as usize];
            if node.count > 0 {
                self.leaf(node, groups);
            } else {
                let children = &nodes[node.first as usize..node.first as usize + 2];
                let left = self.narrow(&children[0], node.first, groups);
                let right = self.narrow(&children[1], node.first + 1, groups);
                self.push([left, right]);
            }
        }
    }

    /// Turns the directions of the set into the body's space.
    #[inline(always)]
    fn turn(&mut self) {
        let Mat3 { x_axis, y_axis, z_axis: z } = self.start.turn;
        let x = x_axis * self.rays.cos + y_axis * self.rays.sin;
        let y = y_axis * self.rays.cos - x_axis * self.rays.sin;
        let bundle = &mut *self.bundle;
        let groups = self.rays.groups(self.chunk);
        for (from, (to, inverse)) in groups.iter().zip(bundle.directions.iter_mut().zip(&mut bundle.inverses))
        {
            *to = from.turned(x, y, z);
            *inverse = Lanes3 { x: to.x.inverted(), y: to.y.inverted(), z: to.z.inverted() };
        }
    }

    /// Puts what is to be visited on the stack, the nearer last.
    #[inline(always)]
    fn push(&mut self, children: [Option<Entry>; 2]) {
        let stack = &mut self.bundle.stack;
        match children {
            [Some(a), Some(b)] if a.near <= b.near => stack.extend([b, a]),
            [Some(a), Some(b)] => stack.extend([a, b]),
            [one, other] => stack.extend(one.or(other)),
        }
    }

    /// Which of the groups go on to a node; nothing when none does.
    #[inline(always)]
    fn narrow(&self, node: &Node, index: u32, groups: u32) -> Option<Entry> {
        let (origin, up, radius) = (self.start.origin, self.start.turn.z_axis, self.bundle.radius);
        let (low, high) = (node.bounds.min() - origin, node.bounds.max() - origin);
        let out = low.max(-high).max(Vec3::ZERO);
        let distance = out.dot(out);
        let highest = larger(up.x * low.x, up.x * high.x)
            + larger(up.y * low.y, up.y * high.y)
            + larger(up.z * low.z, up.z * high.z);
        let size = high.abs().max(low.abs());
        // The tolerances cover the rounding of the sums and of the rays' own directions.
        let slack = 1e-5 * (radius + size.x + size.y + size.z);
        if distance > radius * radius || highest <= -slack {
            return None;
        }
        let groups = self.crossing(low - slack, high + slack, groups);
        (groups != 0).then_some(Entry { near: distance, node: index, groups })
    }

    /// The groups of which some ray crosses the box from `low` to `high`, relative to the origin.
    #[inline(always)]
    fn crossing(&self, low: Vec3, high: Vec3, groups: u32) -> u32 {
        let mut left = groups;
        let mut kept = 0;
        while left != 0 {
            let group = left.trailing_zeros() as usize % GROUPS;
            left &= left - 1;
            kept |= u32::from(self.crossing_rays(low, high, group) != 0) << group;
        }
        kept
    }

    /// Bit per ray of a group: whether it crosses the box before its nearest hit.
    #[inline(always)]
    fn crossing_rays(&self, low: Vec3, high: Vec3, group: usize) -> u32 {
        let inverse = &self.bundle.inverses[group];
        let ends = |low: f32, high: f32, inverse: Lanes| {
            let (a, b) = (Lanes::splat(low) * inverse, Lanes::splat(high) * inverse);
            (a.smaller(b), a.larger(b))
        };
        let (x, y) = (ends(low.x, high.x, inverse.x), ends(low.y, high.y, inverse.y));
        let z = ends(low.z, high.z, inverse.z);
        let enter = x.0.larger(y.0).larger(z.0).larger(Lanes::ZERO);
        let leave = x.1.smaller(y.1).smaller(z.1).smaller(self.bundle.best[group]);
        leave.at_least(enter).bits()
    }

    /// One block of triangles.
    #[inline(always)]
    fn leaf(&mut self, node: &Node, groups: u32) {
        let block = self.blas.block(node.first);
        let prepared = block.prepare(self.start.origin);
        let within = prepared.within(self.start.turn.z_axis, self.bundle.radius);
        let lanes = within & ((1 << node.count) - 1);
        let masked = u32::from(self.blas.masked_lanes(node.first));
        if lanes & !masked != 0 {
            self.plain(&prepared, lanes & !masked, node, groups);
        }
        let mut lanes = lanes & masked;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            let triangle = self.blas.triangle_at(node.first, lane);
            let accept = self.accept;
            self.meet_masked(&prepared.facet(lane), groups, &|meeting| {
                accept(&BlasHit { meeting, triangle })
            });
        }
    }

    /// The triangles `lanes` of a block, none of them masked.
    #[inline(always)]
    fn plain(&mut self, prepared: &Prepared, lanes: u32, node: &Node, groups: u32) {
        // The eight at once include those that may be looked through: they are put out of reach.
        let shut = Lanes::from_fn(|lane| if lanes >> lane & 1 == 1 { 0.0 } else { f32::INFINITY });
        let slack = 1e-5 * self.bundle.radius;
        let low = node.bounds.min() - self.start.origin - slack;
        let high = node.bounds.max() - self.start.origin + slack;
        let mut left = groups;
        while left != 0 {
            let group = left.trailing_zeros() as usize % GROUPS;
            left &= left - 1;
            let rays = self.crossing_rays(low, high, group);
            if rays.count_ones() <= FEW_RAYS {
                self.by_ray(prepared, &shut, rays, group);
            } else {
                self.by_triangle(prepared, lanes, group);
            }
        }
    }

    /// Some rays of a group, one by one, against eight triangles at once; those that count are not `shut` at infinity.
    #[inline(always)]
    fn by_ray(&mut self, prepared: &Prepared, shut: &Lanes, mut rays: u32, group: usize) {
        let bundle = &mut *self.bundle;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize % LANES;
            rays &= rays - 1;
            let t = prepared.distances(bundle.directions[group].at(ray)).larger(*shut).smallest();
            let best = &mut bundle.best[group];
            if t < best.array()[ray] {
                best.array_mut()[ray] = if ANY { DONE } else { t };
            }
        }
    }

    /// All rays of a group against the triangles of a block, one by one.
    #[inline(always)]
    fn by_triangle(&mut self, prepared: &Prepared, mut lanes: u32, group: usize) {
        let bundle = &mut *self.bundle;
        let directions = &bundle.directions[group];
        let mut best = bundle.best[group];
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            let t = prepared.facet(lane).distances(directions);
            let nearer = if ANY { Lanes::splat(DONE) } else { t };
            best = t.below(best).choose(nearer, best);
        }
        bundle.best[group] = best;
    }

    /// One masked triangle: `opaque` decides about each hit that is nearer than what is known.
    #[inline(never)]
    fn meet_masked(&mut self, facet: &Facet, groups: u32, opaque: &dyn Fn(Meeting) -> bool) {
        let bundle = &mut *self.bundle;
        for group in (0..bundle.groups).filter(|group| groups >> group & 1 == 1) {
            let best = &mut bundle.best[group];
            for ray in 0..LANES {
                let meeting = facet.meet(bundle.directions[group].at(ray));
                let Some(meeting) = meeting.filter(|meeting| meeting.t < best.array()[ray]) else { continue };
                if opaque(meeting) {
                    best.array_mut()[ray] = if ANY { DONE } else { meeting.t };
                }
            }
        }
    }
}
