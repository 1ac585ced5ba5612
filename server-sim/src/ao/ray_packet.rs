//! Traces the rays of one point against one body, in groups of eight.
//!
//! The rays share their origin, so one traversal of the tree serves all of them, nearest nodes first. Each node
//! reduces the groups that continue: first by the hemisphere of the rays, then by the cone around each group. In a
//! leaf, each group's cone selects the triangles that the group may hit, and its rays are tested against those only.
//! All of these tests are conservative, so the result equals that of testing every ray against every triangle.

use fearless_simd::prelude::*;
use glam::{Mat3, Vec3};

use super::samples::PointRays;
use crate::bvh::{
    Blas, BlasHit, BlockCulling, BlockSetup, Child, Intersection, LANES, Lanes, Lanes3, Node, PACKET_GROUPS,
    Packed, Packed3, RayCone, TriangleSetup, WideNode, bits,
};

/// Value in `best` of a finished ray: with `ANY` a ray that hit something, or padding of the last group.
const RAY_DONE: f32 = -1.0;
/// Largest number of groups for which a slab test of their rays against a node pays off.
const SLAB_TEST_MAX_GROUPS: u32 = 4;
/// Largest number of rays in a leaf for which testing one ray against eight triangles is cheaper than eight rays
/// against one triangle.
const SINGLE_RAY_MAX_RAYS: u32 = 3;

/// Up to 256 rays of one point, with the working memory to trace them. It is reused from point to point.
#[derive(Debug)]
pub(super) struct RayPacket {
    /// Directions in the space of the current body, and their reciprocals.
    directions: [Packed3; PACKET_GROUPS],
    inverses: [Packed3; PACKET_GROUPS],
    /// Axes of the groups' cones in the same space, one group per lane.
    axes: [Packed3; PACKET_GROUPS / LANES],
    /// Distance to the nearest hit so far of each ray, initially the radius; [`RAY_DONE`] for a finished ray.
    best: [Packed; PACKET_GROUPS],
    /// Largest `best` of each group.
    reach: [Packed; PACKET_GROUPS / LANES],
    /// Bit per group: whether it has unfinished rays.
    active: u32,
    radius: f32,
    /// Bit per ray, by group: whether it entered the bounds of a body.
    entered: [u8; PACKET_GROUPS],
    /// Number of padding lanes in the last group.
    padding: usize,
    groups: usize,
    stack: Vec<StackEntry>,
}

/// How far a ray of a packet reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum RayReach {
    /// The ray has no hit so far.
    Unbounded,
    /// The ray has a hit at an irrelevant distance.
    Hit,
    /// The ray has a hit at this distance.
    At(f32),
}

/// A child to visit, the squared distance to its box, and the groups that visit it.
#[derive(Clone, Copy, Debug)]
struct StackEntry {
    near: f32,
    child: Child,
    groups: u32,
}

/// Eight boxes relative to the origin of the rays.
struct BoxSetup {
    /// Bit per lane: whether any ray may hit something in the box.
    lanes: u32,
    /// Squared distance from the origin to the box.
    distance: Packed,
    /// Centre and radius of the sphere around the box, and the length of a tangent from the origin to it. The length
    /// is far below zero if the origin is inside the sphere.
    center: Packed3,
    ball: Packed,
    tangent: Packed,
    /// Corners, with a margin for rounding.
    low: Packed3,
    high: Packed3,
}

/// Origin of the rays in the space of a body, and their rotation to it.
pub(super) struct PacketOrigin {
    /// Rotation from the tangent space of the point to the space of the body.
    pub(super) rotation: Mat3,
    pub(super) origin: Vec3,
}

/// The traversal of one body by one packet. With `ANY`, a hit at any distance finishes a ray. `accept` is called for
/// hits on masked triangles only.
pub(super) struct PacketTraversal<'a, S: Simd, const ANY: bool> {
    pub(super) simd: S,
    pub(super) packet: &'a mut RayPacket,
    pub(super) rays: &'a PointRays<'a>,
    pub(super) chunk: usize,
    pub(super) start: PacketOrigin,
    pub(super) blas: &'a Blas,
    pub(super) accept: &'a dyn Fn(&BlasHit) -> bool,
}

impl Default for RayPacket {
    fn default() -> Self {
        Self {
            directions: [Packed3::ZERO; PACKET_GROUPS],
            inverses: [Packed3::ZERO; PACKET_GROUPS],
            axes: [Packed3::ZERO; PACKET_GROUPS / LANES],
            best: [Packed::ZERO; PACKET_GROUPS],
            reach: [Packed::ZERO; PACKET_GROUPS / LANES],
            active: 0,
            radius: 0.0,
            entered: [0; PACKET_GROUPS],
            padding: 0,
            groups: 0,
            stack: Vec::new(),
        }
    }
}

impl RayPacket {
    /// Starts a chunk of a point's rays, each of length `radius`.
    pub(super) fn begin(&mut self, rays: &PointRays<'_>, chunk: usize, radius: f32) {
        let groups = rays.groups(chunk).len();
        (self.groups, self.radius, self.padding) = (groups, radius, rays.padding(chunk));
        self.best[..groups].fill(Packed::splat(radius));
        self.best[groups - 1].array_mut()[LANES - self.padding..].fill(RAY_DONE);
        self.reach.fill(Packed::splat(radius));
        self.active = u32::MAX >> (PACKET_GROUPS - groups);
        self.entered[..groups].fill(0);
    }

    /// Returns the number of groups in use.
    pub(super) fn groups(&self) -> usize {
        self.groups
    }

    /// Returns how far each ray reaches, group by group.
    pub(super) fn reaches(&self) -> impl Iterator<Item = impl Iterator<Item = RayReach> + '_> + '_ {
        (0..self.groups).map(|group| {
            self.best[group].array()[..self.used(group)].iter().map(|&t| match t {
                RAY_DONE => RayReach::Hit,
                t if t < self.radius => RayReach::At(t),
                _ => RayReach::Unbounded,
            })
        })
    }

    /// Sets how far some rays of a group reach.
    pub(super) fn set(&mut self, group: usize, reaches: impl Iterator<Item = (usize, RayReach)>) {
        let mut best = self.best[group];
        for (ray, reach) in reaches {
            best.array_mut()[ray] = match reach {
                RayReach::Unbounded => self.radius,
                RayReach::Hit => RAY_DONE,
                RayReach::At(t) => t,
            };
        }
        self.update_group(group, best);
    }

    /// Returns the number of rays that entered the bounds of some body before their nearest hit so far.
    pub(super) fn traced(&self) -> u32 {
        self.entered[..self.groups].iter().map(|rays| rays.count_ones()).sum()
    }

    /// Returns the number of lanes of a group that hold a ray.
    fn used(&self, group: usize) -> usize {
        if group + 1 == self.groups { LANES - self.padding } else { LANES }
    }

    /// Returns the sum of the rays' occlusion: `1 - min(hit distance, R) / R`, or with `ANY` one for every hit. Sums
    /// lane by lane, so that a point without a hit is exactly open.
    pub(super) fn occlusion_sum<const ANY: bool>(&self) -> f32 {
        let mut sum = Packed::ZERO;
        for (group, best) in self.best[..self.groups].iter().enumerate() {
            for (sum, &t) in sum.array_mut().iter_mut().zip(&best.array()[..self.used(group)]) {
                *sum += if ANY { f32::from(t == RAY_DONE) } else { 1.0 - t / self.radius };
            }
        }
        sum.sum()
    }

    /// Returns the number of rays that hit something.
    pub(super) fn hits(&self) -> u32 {
        let groups = self.best[..self.groups].iter().enumerate();
        let hit = |t: &&f32| **t < self.radius;
        groups.map(|(group, best)| best.array()[..self.used(group)].iter().filter(hit).count() as u32).sum()
    }

    /// Returns the distance of each ray's hit, 0 with binary occlusion, or infinity for none.
    #[cfg(any(test, feature = "testing"))]
    pub(super) fn distances(&self, kind: super::settings::Occlusion) -> impl Iterator<Item = f32> {
        let all = self.best[..self.groups].iter().flat_map(Packed::array);
        let distance = move |&t: &f32| match t {
            t if t >= self.radius => f32::INFINITY,
            _ if kind == super::settings::Occlusion::Binary => 0.0,
            t => t,
        };
        all.take(self.groups * LANES - self.padding).map(distance)
    }

    /// Updates the nearest hits of a group, and what depends on them.
    #[inline(always)]
    fn update_group(&mut self, group: usize, best: Packed) {
        self.best[group] = best;
        let reach = best.largest();
        self.reach[group / LANES].array_mut()[group % LANES] = reach;
        self.active &= !(u32::from(reach < 0.0) << group);
    }
}

impl<S: Simd, const ANY: bool> PacketTraversal<'_, S, ANY> {
    /// Traces the packet through the body and shortens the rays that hit something.
    #[inline(always)]
    pub(super) fn run(mut self) {
        let (nodes, wide_nodes) = (self.blas.tree().nodes(), self.blas.wide_nodes());
        if wide_nodes.is_empty() || self.packet.active == 0 {
            return;
        }
        self.rotate_directions();
        self.enter(&nodes[0]);
        self.packet.stack.clear();
        self.packet.stack.push(StackEntry { near: 0.0, child: Child::Inner(0), groups: self.packet.active });
        while let Some(StackEntry { child, groups, .. }) = self.packet.stack.pop() {
            let groups = groups & self.packet.active;
            match child {
                _ if groups == 0 => {}
                Child::Leaf(node) => self.leaf(&nodes[node as usize], groups),
                Child::Inner(wide) => self.visit(&wide_nodes[wide as usize], groups),
                Child::Vacant => {}
            }
        }
    }

    /// Rotates the directions of the set to the body's space.
    #[inline(always)]
    fn rotate_directions(&mut self) {
        let simd = self.simd;
        let [x, y, z] = self.rays.axes(&self.start.rotation);
        let packet = &mut *self.packet;
        let both = packet.directions.iter_mut().zip(&mut packet.inverses);
        for (from, (to, inverse)) in self.rays.groups(self.chunk).iter().zip(both) {
            let turned = from.load(simd).rotated(x, y, z);
            *to = turned.into();
            *inverse = Lanes3 { x: inverted(turned.x), y: inverted(turned.y), z: inverted(turned.z) }.into();
        }
        for (from, to) in self.rays.cones(self.chunk).iter().zip(&mut packet.axes) {
            *to = from.axes.load(simd).rotated(x, y, z).into();
        }
    }

    /// Records which rays enter the body's bounds.
    #[inline(always)]
    fn enter(&mut self, root: &Node) {
        let (low, high) = (root.bounds.min() - self.start.origin, root.bounds.max() - self.start.origin);
        let (low, high) = (Lanes3::splat(self.simd, low), Lanes3::splat(self.simd, high));
        let mut groups = self.packet.active;
        while groups != 0 {
            let group = groups.trailing_zeros() as usize % PACKET_GROUPS;
            groups &= groups - 1;
            self.packet.entered[group] |= self.crossing_rays(&low, &high, group) as u8;
        }
    }

    /// Pushes the children that some of the groups visit, the nearest last.
    #[inline(always)]
    fn visit(&mut self, wide: &WideNode, groups: u32) {
        let boxes = self.boxes(wide);
        let first = self.packet.stack.len();
        let mut left = boxes.lanes;
        while left != 0 {
            let lane = left.trailing_zeros() as usize % LANES;
            left &= left - 1;
            let few = |groups: u32| groups.count_ones() <= SLAB_TEST_MAX_GROUPS;
            let mut groups =
                if few(groups) { groups } else { self.groups_touching_box(&boxes, lane, groups) };
            if few(groups) {
                groups = self.groups_crossing_box(boxes.low.at(lane), boxes.high.at(lane), groups);
            }
            if groups == 0 {
                continue;
            }
            let stack = &mut self.packet.stack;
            let entry = StackEntry { near: boxes.distance.array()[lane], child: wide.children[lane], groups };
            let mut at = stack.len();
            stack.push(entry);
            while at > first && stack[at - 1].near < entry.near {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at] = entry;
        }
    }

    /// Computes the properties of all eight boxes of a node at once.
    #[inline(always)]
    fn boxes(&self, wide: &WideNode) -> BoxSetup {
        let simd = self.simd;
        let splat = |value: f32| Lanes::splat(simd, value);
        let (radius, zero) = (splat(self.packet.radius), splat(0.0));
        let origin = Lanes3::splat(simd, self.start.origin);
        let up = Lanes3::splat(simd, self.start.rotation.z_axis);
        let (low, high) = (wide.low.load(simd).minus(&origin), wide.high.load(simd).minus(&origin));
        let out = |low: Lanes<S>, high: Lanes<S>| low.max(-high).max(zero);
        let out = Lanes3 { x: out(low.x, high.x), y: out(low.y, high.y), z: out(low.z, high.z) };
        let distance = out.dot(&out);
        let highest = (up.x * low.x).max(up.x * high.x)
            + (up.y * low.y).max(up.y * high.y)
            + (up.z * low.z).max(up.z * high.z);
        let size = |low: Lanes<S>, high: Lanes<S>| high.abs().max(low.abs());
        // The tolerances cover the rounding of the sums and of the rays' own directions.
        let slack = splat(1e-5) * (radius + size(low.x, high.x) + size(low.y, high.y) + size(low.z, high.z));
        let lanes = bits((radius * radius).simd_ge(distance) & highest.simd_ge(-slack));
        let half = |low: Lanes<S>, high: Lanes<S>| (high - low) * splat(0.5);
        let half = Lanes3 { x: half(low.x, high.x), y: half(low.y, high.y), z: half(low.z, high.z) };
        let center = Lanes3 { x: low.x + half.x, y: low.y + half.y, z: low.z + half.z };
        // Enlarge by more than the rounding of the difference below.
        let ball = half.dot(&half) * splat(1.000_1);
        let beyond = center.dot(&center) - ball;
        let apart = zero.simd_lt(beyond);
        let margin = Lanes3 { x: slack, y: slack, z: slack };
        BoxSetup {
            lanes,
            distance: distance.into(),
            center: center.into(),
            ball: (ball.sqrt() + slack).into(),
            tangent: apart.select(beyond.max(zero).sqrt() - slack, splat(-1e30)).into(),
            low: low.minus(&margin).into(),
            high: Packed3::from(Lanes3 { x: high.x + slack, y: high.y + slack, z: high.z + slack }),
        }
    }

    /// Returns the groups whose cones touch the sphere around a box and whose rays reach the box.
    #[inline(always)]
    fn groups_touching_box(&self, boxes: &BoxSetup, lane: usize, groups: u32) -> u32 {
        let simd = self.simd;
        let splat = |value: f32| Lanes::splat(simd, value);
        let center = Lanes3::splat(simd, boxes.center.at(lane));
        let (ball, tangent) = (splat(boxes.ball.array()[lane]), splat(boxes.tangent.array()[lane]));
        let distance = splat(boxes.distance.array()[lane] * 0.999_99);
        let mut kept = 0;
        for (eight, cones) in self.rays.cones(self.chunk).iter().enumerate() {
            let reach = self.packet.reach[eight].load(simd);
            // The angle between axis and centre is at most the cone's half angle plus the sphere's. Both sides are
            // multiplied by the distance of the centre.
            let along = self.packet.axes[eight].load(simd).dot(&center);
            let touched = (along + cones.sin.load(simd) * ball).simd_ge(cones.cos.load(simd) * tangent)
                & (reach * reach).simd_ge(distance);
            kept |= bits(touched) << (eight * LANES);
        }
        kept & groups
    }

    /// Returns the groups with a ray that crosses the box from `low` to `high`, relative to the origin.
    #[inline(always)]
    fn groups_crossing_box(&self, low: Vec3, high: Vec3, groups: u32) -> u32 {
        let (low, high) = (Lanes3::splat(self.simd, low), Lanes3::splat(self.simd, high));
        let mut left = groups;
        let mut kept = 0;
        while left != 0 {
            let group = left.trailing_zeros() as usize % PACKET_GROUPS;
            left &= left - 1;
            kept |= u32::from(self.crossing_rays(&low, &high, group) != 0) << group;
        }
        kept
    }

    /// Returns a bit per ray of a group: whether it crosses the box before its nearest hit.
    #[inline(always)]
    fn crossing_rays(&self, low: &Lanes3<S>, high: &Lanes3<S>, group: usize) -> u32 {
        let simd = self.simd;
        let inverse = self.packet.inverses[group].load(simd);
        let ends = |low: Lanes<S>, high: Lanes<S>, inverse: Lanes<S>| {
            let (a, b) = (low * inverse, high * inverse);
            (a.min(b), a.max(b))
        };
        let (x, y) = (ends(low.x, high.x, inverse.x), ends(low.y, high.y, inverse.y));
        let z = ends(low.z, high.z, inverse.z);
        let enter = x.0.max(y.0).max(z.0).max(Lanes::splat(simd, 0.0));
        let leave = x.1.min(y.1).min(z.1).min(self.packet.best[group].load(simd));
        bits(leave.simd_ge(enter))
    }

    /// Intersects the groups with the block of triangles of a leaf.
    #[inline(always)]
    fn leaf(&mut self, node: &Node, groups: u32) {
        let simd = self.simd;
        let slack = 1e-5 * self.packet.radius;
        let low = Lanes3::splat(simd, node.bounds.min() - self.start.origin - slack);
        let high = Lanes3::splat(simd, node.bounds.max() - self.start.origin + slack);
        let masked = u32::from(self.blas.masked_lanes(node.first));
        let mut rays_of = [0; PACKET_GROUPS];
        let (mut few, mut many) = (0, 0);
        let mut left = groups;
        while left != 0 {
            let group = left.trailing_zeros() as usize % PACKET_GROUPS;
            left &= left - 1;
            let rays = self.crossing_rays(&low, &high, group);
            rays_of[group] = rays as u8;
            let is_many = masked != 0 || rays.count_ones() > SINGLE_RAY_MAX_RAYS;
            many |= u32::from(is_many && rays != 0) << group;
            few |= u32::from(!is_many && rays != 0) << group;
        }
        if few | many == 0 {
            return;
        }
        let lanes = self.blas.block(node.first).setup_lanes(simd, self.start.origin);
        let prepared = lanes.in_memory();
        while few != 0 {
            let group = few.trailing_zeros() as usize % PACKET_GROUPS;
            few &= few - 1;
            self.intersect_by_ray(&prepared, rays_of[group].into(), group);
        }
        if many != 0 {
            let culling = lanes.culling(self.start.rotation.z_axis, self.packet.radius);
            self.intersect_groups(node, &prepared, &culling, masked, many);
        }
    }

    /// Intersects groups with many rays that cross a leaf.
    #[inline(always)]
    fn intersect_groups(
        &mut self,
        node: &Node,
        prepared: &BlockSetup,
        culling: &BlockCulling,
        masked: u32,
        mut left: u32,
    ) {
        let used = (1 << node.count) - 1;
        while left != 0 {
            let group = left.trailing_zeros() as usize % PACKET_GROUPS;
            left &= left - 1;
            let lanes = culling.lanes_met(self.simd, prepared, &self.cone(group)) & used;
            if lanes & !masked != 0 {
                self.intersect_by_triangle(prepared, lanes & !masked, group);
            }
            let mut lanes = lanes & masked;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize % LANES;
                lanes &= lanes - 1;
                let triangle = self.blas.triangle_at(node.first, lane);
                let accept = self.accept;
                self.intersect_masked(&prepared.triangle(lane), group, &|intersection| {
                    accept(&BlasHit { intersection, triangle })
                });
            }
        }
    }

    /// Returns the cone of a group and the reach of its rays.
    #[inline(always)]
    fn cone(&self, group: usize) -> RayCone {
        let (eight, lane) = (group / LANES, group % LANES);
        RayCone {
            axis: self.packet.axes[eight].at(lane),
            spread: self.rays.cones(self.chunk)[eight].spread.array()[lane],
            reach: self.packet.reach[eight].array()[lane],
        }
    }

    /// Intersects some rays of a group, one by one, with the eight triangles of a block at once.
    #[inline(always)]
    fn intersect_by_ray(&mut self, prepared: &BlockSetup, mut rays: u32, group: usize) {
        let mut best = self.packet.best[group];
        let mut changed = false;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize % LANES;
            rays &= rays - 1;
            let direction = self.packet.directions[group].at(ray);
            let known = &mut best.array_mut()[ray];
            if let Some(t) = prepared.nearest(self.simd, direction, *known) {
                *known = if ANY { RAY_DONE } else { t };
                changed = true;
            }
        }
        if changed {
            self.packet.update_group(group, best);
        }
    }

    /// Intersects all rays of a group with the unmasked triangles `lanes` of a block, one by one.
    #[inline(always)]
    fn intersect_by_triangle(&mut self, prepared: &BlockSetup, mut lanes: u32, group: usize) {
        let simd = self.simd;
        let directions = self.packet.directions[group].load(simd);
        let mut best = self.packet.best[group].load(simd);
        let mut changed = false;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            if let Some(shorter) = prepared.triangle(lane).shorten(&directions, best, ANY.then_some(RAY_DONE))
            {
                (best, changed) = (shorter, true);
            }
        }
        if changed {
            self.packet.update_group(group, best.into());
        }
    }

    /// Intersects a group with one masked triangle. `opaque` decides about each hit that is nearer than the nearest
    /// so far.
    #[inline(never)]
    fn intersect_masked(
        &mut self,
        triangle: &TriangleSetup,
        group: usize,
        opaque: &dyn Fn(Intersection) -> bool,
    ) {
        let mut best = self.packet.best[group];
        for ray in 0..LANES {
            let intersection = triangle.intersect(self.packet.directions[group].at(ray));
            let Some(intersection) = intersection.filter(|intersection| intersection.t < best.array()[ray])
            else {
                continue;
            };
            if opaque(intersection) {
                best.array_mut()[ray] = if ANY { RAY_DONE } else { intersection.t };
            }
        }
        self.packet.update_group(group, best);
    }
}

/// Returns the reciprocals. Numbers near zero give large results of the same sign, so that nothing is infinite.
#[inline(always)]
fn inverted<S: Simd>(numbers: Lanes<S>) -> Lanes<S> {
    let tiny = Lanes::splat(numbers.simd, 1e-12);
    Lanes::splat(numbers.simd, 1.0) / numbers.abs().max(tiny).copysign(numbers)
}
