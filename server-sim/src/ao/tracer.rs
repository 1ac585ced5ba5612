//! The AO of one point, traced against all bodies near it.

use fearless_simd::{Simd, dispatch};
use glam::{Mat3, Vec3};

use super::burial::is_buried;
use super::frame::tangent_frame;
use super::ray_packet::{PacketOrigin, PacketTraversal, RayPacket};
use super::samples::SampleSets;
use super::self_hits::{SelfHitRecorder, SelfHits};
use super::settings::{AoError, AoSettings, Occlusion};
use crate::bvh::{BlasHit, BodyId, Instructions, Placement, Tlas};
use crate::points::RayKey;
use crate::world::SceneBvh;

/// Computes AO with the rays of one [`AoSettings`]. All threads share it; each has its own [`Scratch`].
#[derive(Clone, Debug)]
pub struct Tracer {
    settings: AoSettings,
    sets: SampleSets,
    instructions: Instructions,
}

/// Working memory of a thread.
#[derive(Debug, Default)]
pub struct Scratch {
    packet: RayPacket,
    near: Vec<BodyId>,
    stack: Vec<u32>,
    recorder: SelfHitRecorder,
}

/// The AO of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointAo {
    /// Accessibility in [0, 1], 1 is open.
    pub ao: f32,
    /// Whether no body but the point's own is within reach. A rigid motion of the point's body then leaves its AO
    /// unchanged.
    pub alone: bool,
    /// Number of rays that hit something.
    pub hits: u32,
    /// Number of traced rays: those that enter the bounds of a body within reach. A body with cached hits does not
    /// count.
    pub rays: u32,
}

/// The self hits of a point: unused, to be recorded, or known.
#[derive(Debug)]
pub(crate) enum SelfHitCache<'a> {
    /// No hits are known, and none are recorded.
    Off,
    /// No hits are known. The hits of this trace are stored here if another body is near.
    Empty(&'a mut Option<Box<SelfHits>>),
    /// The hits are known from an earlier frame.
    Filled(&'a SelfHits),
}

/// Origin and orientation of a point's rays, in the space of the point's own body if it has one. So the AO of a body
/// that moves alone is bit-identical.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayFrame {
    /// The body in whose space `position`, `normal` and `edge` are; `None` for world space.
    pub(crate) body: Option<BodyId>,
    pub(crate) position: Vec3,
    /// Unit normal.
    pub(crate) normal: Vec3,
    /// A direction that moves with the surface; see [`tangent_frame`].
    pub(crate) edge: Vec3,
}

/// A point among bodies. `opaque` is called for hits on masked triangles, with their body.
struct PointQuery<'a> {
    bodies: &'a Tlas,
    key: RayKey,
    ray_frame: &'a RayFrame,
    opaque: &'a dyn Fn(BodyId, &BlasHit) -> bool,
}

impl Tracer {
    /// Computes the ray sets.
    ///
    /// # Errors
    /// Returns an error for a setting out of its range.
    pub fn new(settings: AoSettings) -> Result<Self, AoError> {
        settings.validate()?;
        let sets = SampleSets::new(settings.rays, settings.seed);
        Ok(Self { settings, sets, instructions: Instructions::best() })
    }

    /// Replaces the best instructions by others, for tests and measurements. The AO stays the same.
    #[must_use]
    pub fn with_instructions(self, instructions: Instructions) -> Self {
        Self { instructions, ..self }
    }

    /// Returns the settings.
    #[must_use]
    pub fn settings(&self) -> &AoSettings {
        &self.settings
    }

    /// Returns the bytes of memory held: the directions of all sets of rays.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        self.sets.heap_bytes()
    }

    /// Computes the AO at a place in the world. `normal` is unit, and `key` selects the rays. Use it for references;
    /// the server keeps its points in the spaces of their bodies.
    #[must_use]
    pub fn at(
        &self,
        world: &SceneBvh,
        key: RayKey,
        position: Vec3,
        normal: Vec3,
        scratch: &mut Scratch,
    ) -> PointAo {
        let ray_frame = RayFrame { body: None, position, normal, edge: Vec3::ZERO };
        self.trace(
            world.bodies(),
            key,
            &ray_frame,
            &|body, hit| world.opaque(body, hit),
            SelfHitCache::Off,
            scratch,
        )
    }

    /// Computes the AO of a point. `key` selects its rays, and `opaque` is called for hits on masked triangles.
    /// `self_hits` must belong to the same point, and its body must have the same shape.
    pub(crate) fn trace(
        &self,
        bodies: &Tlas,
        key: RayKey,
        ray_frame: &RayFrame,
        opaque: &dyn Fn(BodyId, &BlasHit) -> bool,
        self_hits: SelfHitCache<'_>,
        scratch: &mut Scratch,
    ) -> PointAo {
        let query = PointQuery { bodies, key, ray_frame, opaque };
        let (mut occlusion, mut hits) = (0.0, 0);
        let (alone, rays) = self.trace_all(&query, self_hits, scratch, &mut |packet| {
            hits += packet.hits();
            occlusion += match self.settings.kind {
                Occlusion::Obscurance => packet.occlusion_sum::<false>(),
                Occlusion::Binary => packet.occlusion_sum::<true>(),
            };
        });
        let ao = 1.0 - occlusion / self.settings.rays as f32;
        PointAo { ao: ao.clamp(0.0, 1.0), alone, hits, rays }
    }

    /// Returns whether a point lies inside a solid, see [`is_buried`]. `traced` is what [`Tracer::trace`] found: a point with
    /// few hits is not buried.
    pub(crate) fn is_buried(
        &self,
        world: &SceneBvh,
        key: RayKey,
        ray_frame: &RayFrame,
        traced: &PointAo,
        scratch: &mut Scratch,
    ) -> bool {
        if 2 * traced.hits <= self.settings.rays {
            return false;
        }
        let in_world = self.gather_bodies(world.bodies(), ray_frame, scratch);
        let starts = Starts::new(world.bodies(), ray_frame, self.origin(ray_frame), in_world);
        let near: Vec<(BodyId, PacketOrigin)> = scratch.near.iter().map(|&id| (id, starts.of(id))).collect();
        let directions = self.sets.of(key).directions(&Mat3::IDENTITY);
        is_buried(world, &near, &directions, self.settings.radius)
    }

    /// Traces a place in the world and returns whether it is buried.
    #[cfg(test)]
    pub(super) fn trace_and_dig(&self, world: &SceneBvh, key: RayKey, place: &RayFrame) -> bool {
        let scratch = &mut Scratch::default();
        let opaque = |body: BodyId, hit: &BlasHit| world.opaque(body, hit);
        let traced = self.trace(world.bodies(), key, place, &opaque, SelfHitCache::Off, scratch);
        self.is_buried(world, key, place, &traced, scratch)
    }

    /// Returns whether no body but its own is within reach of a point.
    pub(crate) fn is_alone(&self, bodies: &Tlas, ray_frame: &RayFrame, scratch: &mut Scratch) -> bool {
        self.gather_bodies(bodies, ray_frame, scratch);
        scratch.near.iter().all(|&body| Some(body) == ray_frame.body)
    }

    /// Collects the bodies within reach of a point. Returns the origin of its rays in world space.
    fn gather_bodies(&self, bodies: &Tlas, ray_frame: &RayFrame, scratch: &mut Scratch) -> Vec3 {
        let home = frame_placement(bodies, ray_frame);
        let origin = self.origin(ray_frame);
        let in_world = if home == Placement::IDENTITY { origin } else { home.point(origin) };
        bodies.near(in_world, self.settings.radius, &mut scratch.stack, &mut scratch.near);
        in_world
    }

    /// Returns the origin of a point's rays in the space of its frame.
    fn origin(&self, ray_frame: &RayFrame) -> Vec3 {
        ray_frame.position + ray_frame.normal * self.settings.bias()
    }

    /// Appends the result of [`Tracer::trace`] per ray: the distance of the hit, or infinity without a hit. With
    /// binary occlusion the distance of a hit is 0. Masks are ignored.
    #[cfg(any(test, feature = "testing"))]
    pub(super) fn distances(
        &self,
        bodies: &Tlas,
        key: RayKey,
        ray_frame: &RayFrame,
        scratch: &mut Scratch,
        all: &mut Vec<f32>,
    ) {
        let query = PointQuery { bodies, key, ray_frame, opaque: &|_, _| true };
        let end = all.len() + self.settings.rays as usize;
        self.trace_all(&query, SelfHitCache::Off, scratch, &mut |packet| {
            all.extend(packet.distances(self.settings.kind));
        });
        all.resize(end, f32::INFINITY);
    }

    /// Returns the origin and directions of a point's rays in world space.
    #[cfg(any(test, feature = "testing"))]
    pub(super) fn rays(&self, bodies: &Tlas, key: RayKey, ray_frame: &RayFrame) -> (Vec3, Vec<Vec3>) {
        let home = frame_placement(bodies, ray_frame);
        let mut directions = self.sets.of(key).directions(&tangent_frame(ray_frame.normal, ray_frame.edge));
        if home == Placement::IDENTITY {
            return (self.origin(ray_frame), directions);
        }
        directions.iter_mut().for_each(|direction| *direction = home.direction(*direction));
        (home.point(self.origin(ray_frame)), directions)
    }

    /// Traces the rays of a point and calls `done` with each of their packets. Returns whether no body but its own is
    /// within reach, and the number of traced rays.
    fn trace_all(
        &self,
        query: &PointQuery<'_>,
        self_hits: SelfHitCache<'_>,
        scratch: &mut Scratch,
        done: &mut dyn FnMut(&RayPacket),
    ) -> (bool, u32) {
        // The code for a point is compiled once per set of instructions.
        dispatch!(self.instructions.level(), simd => match self.settings.kind {
            Occlusion::Obscurance => self.trace_kind::<_, false>(simd, query, self_hits, scratch, done),
            Occlusion::Binary => self.trace_kind::<_, true>(simd, query, self_hits, scratch, done),
        })
    }

    #[inline(always)]
    fn trace_kind<S: Simd, const ANY: bool>(
        &self,
        simd: S,
        query: &PointQuery<'_>,
        mut self_hits: SelfHitCache<'_>,
        scratch: &mut Scratch,
        done: &mut dyn FnMut(&RayPacket),
    ) -> (bool, u32) {
        let PointQuery { bodies, key, ray_frame, opaque } = *query;
        let in_world = self.gather_bodies(bodies, ray_frame, scratch);
        let starts = Starts::new(bodies, ray_frame, self.origin(ray_frame), in_world);
        let Scratch { packet, near, recorder, .. } = scratch;
        let alone = near.iter().all(|&body| Some(body) == ray_frame.body);
        if near.is_empty() {
            return (alone, 0);
        }
        // The point's own body comes first, because it occludes most.
        near.sort_by_key(|&body| (Some(body) != ray_frame.body, body));
        let own = near.first().is_some_and(|&body| Some(body) == ray_frame.body);
        if alone || !own {
            // Recording pays off only if its own body and another one are within reach.
            self_hits = match self_hits {
                SelfHitCache::Filled(known) if own => SelfHitCache::Filled(known),
                _ => SelfHitCache::Off,
            };
        }
        let rays = self.sets.of(key);
        let mut reader =
            if let SelfHitCache::Filled(known) = &self_hits { Some(known.reader()) } else { None };
        let keep = matches!(self_hits, SelfHitCache::Empty(_));
        recorder.clear();
        let mut traced = 0;
        for chunk in 0..rays.chunks() {
            packet.begin(&rays, chunk, self.settings.radius);
            if let Some(reader) = &mut reader {
                reader.restore::<ANY>(packet);
            }
            for (place, &id) in near.iter().enumerate().skip(usize::from(reader.is_some())) {
                let blas = &bodies.list()[id.index()].blas;
                let accept = |hit: &BlasHit| opaque(id, hit);
                let start = starts.of(id);
                PacketTraversal::<S, ANY> { simd, packet, rays: &rays, chunk, start, blas, accept: &accept }
                    .run();
                if keep && place == 0 {
                    recorder.record(packet);
                }
            }
            traced += packet.traced();
            done(packet);
        }
        if let SelfHitCache::Empty(slot) = self_hits {
            *slot = Some(Box::new(recorder.self_hits()));
        }
        (alone, traced)
    }
}

/// Returns the placement of the space of a ray frame.
fn frame_placement(bodies: &Tlas, ray_frame: &RayFrame) -> Placement {
    let body = ray_frame.body.and_then(|id| bodies.list().get(id.index()));
    body.map_or(Placement::IDENTITY, |body| body.placement)
}

/// Where the rays of a point start, in the space of each body.
struct Starts<'a> {
    bodies: &'a Tlas,
    body: Option<BodyId>,
    /// Placement of the space of the ray frame.
    home: Placement,
    frame: Mat3,
    origin: Vec3,
    in_world: Vec3,
}

impl<'a> Starts<'a> {
    /// `origin` is in the space of the ray frame, `in_world` the same place in the world.
    #[inline(always)]
    fn new(bodies: &'a Tlas, ray_frame: &RayFrame, origin: Vec3, in_world: Vec3) -> Self {
        let frame = tangent_frame(ray_frame.normal, ray_frame.edge);
        let home = frame_placement(bodies, ray_frame);
        Self { bodies, body: ray_frame.body, home, frame, origin, in_world }
    }

    #[inline(always)]
    fn of(&self, id: BodyId) -> PacketOrigin {
        let body = &self.bodies.list()[id.index()];
        if Some(id) == self.body || body.placement == self.home {
            PacketOrigin { rotation: self.frame, origin: self.origin }
        } else {
            packet_origin(&self.home, &body.placement, &self.frame, self.in_world)
        }
    }
}

/// Returns the origin of the rays in the space of another body.
fn packet_origin(home: &Placement, body: &Placement, frame: &Mat3, in_world: Vec3) -> PacketOrigin {
    PacketOrigin {
        rotation: body.rotation.transpose() * (home.rotation * *frame),
        origin: body.local_point(in_world),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;

    use super::*;
    use crate::bvh::{Blas, BlasInstance, Effort, LANES, reference};

    fn body(triangles: &[[Vec3; 3]], placement: Placement) -> BlasInstance {
        BlasInstance::new(Arc::new(Blas::build(triangles, Effort::Best)), placement)
    }

    fn tracer(rays: u32, kind: Occlusion) -> Tracer {
        Tracer::new(AoSettings { rays, kind, ..AoSettings::default() }).unwrap()
    }

    fn trace(tracer: &Tracer, bodies: &Tlas, key: u32, ray_frame: &RayFrame) -> PointAo {
        tracer.trace(bodies, RayKey(key), ray_frame, &|_, _| true, SelfHitCache::Off, &mut Scratch::default())
    }

    fn floor(half: f32) -> Vec<[Vec3; 3]> {
        let at = |x: f32, z: f32| Vec3::new(x * half, 0.0, z * half);
        vec![[at(-1.0, -1.0), at(1.0, 1.0), at(1.0, -1.0)], [at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)]]
    }

    fn on_floor(body: u32) -> RayFrame {
        let body = Some(BodyId::new(body));
        RayFrame { body, position: Vec3::new(0.1, 0.0, 0.2), normal: Vec3::Y, edge: Vec3::X }
    }

    /// Computes the AO by testing each ray against every triangle of every body.
    fn reference_ao(
        tracer: &Tracer,
        bodies: &[(Vec<[Vec3; 3]>, Placement)],
        point: u32,
        ray_frame: &RayFrame,
    ) -> f32 {
        let home = ray_frame.body.and_then(|id| bodies.get(id.index()));
        let home = home.map_or(Placement::IDENTITY, |(_, placement)| *placement);
        let frame = tangent_frame(ray_frame.normal, ray_frame.edge);
        let settings = tracer.settings();
        let origin = home.point(ray_frame.position + ray_frame.normal * settings.bias());
        let rays = tracer.sets.of(RayKey(point));
        let mut sum = 0.0;
        for ray in 0..rays.set.rays() {
            let Vec3 { x, y, z } = rays.set.groups[ray / LANES].at(ray % LANES);
            let turned = Vec3::new(x * rays.cos - y * rays.sin, x * rays.sin + y * rays.cos, z);
            let direction = home.rotation * (frame * turned);
            let hits = bodies.iter().filter_map(|(triangles, placement)| {
                let (from, along) = (placement.local_point(origin), placement.local_direction(direction));
                reference::nearest(triangles, from, along, settings.radius).map(|hit| hit.intersection.t)
            });
            let nearest = hits.fold(settings.radius, f32::min);
            sum += match settings.kind {
                Occlusion::Obscurance => nearest / settings.radius,
                Occlusion::Binary => f32::from(nearest >= settings.radius),
            };
        }
        sum / rays.set.rays() as f32
    }

    #[test]
    fn an_open_plane_is_exactly_open() {
        for kind in [Occlusion::Obscurance, Occlusion::Binary] {
            for rays in [1, 7, 192] {
                let bodies = Tlas::new(vec![body(&floor(50.0), Placement::IDENTITY)]);
                let traced = trace(&tracer(rays, kind), &bodies, 3, &on_floor(0));
                assert_eq!((traced.ao, traced.alone), (1.0, true));
            }
        }
    }

    #[test]
    fn inside_a_closed_box_every_ray_hits() {
        let bodies = Tlas::new(vec![body(&reference::cube(0.2), Placement::IDENTITY)]);
        let ray_frame = RayFrame { position: Vec3::new(0.02, -0.2, 0.05), ..on_floor(0) };
        for point in 0..50 {
            assert_eq!(trace(&tracer(192, Occlusion::Binary), &bodies, point, &ray_frame).ao, 0.0);
            let ao = trace(&tracer(192, Occlusion::Obscurance), &bodies, point, &ray_frame).ao;
            assert!(ao > 0.3 && ao < 0.9, "{ao}");
        }
    }

    #[test]
    fn a_wall_hides_its_form_factor() {
        // A half-plane wall at distance d, seen from the floor: with cosine weights, half of the rays reach a wall of
        // infinite length and height. A radius of a thousand distances approximates infinity.
        let wall = [Vec3::new(-1.0, 0.0, -1e4), Vec3::new(-1.0, 2e4, 0.0), Vec3::new(-1.0, 0.0, 1e4)];
        let bodies = Tlas::new(vec![body(&[wall], Placement::IDENTITY)]);
        let settings = AoSettings { rays: 4096, radius: 1000.0, kind: Occlusion::Binary, seed: 5 };
        let tracer = Tracer::new(settings).unwrap();
        // Compensate for the bias of the origin (16 m), so that the rays start at the foot of the wall.
        let position = Vec3::new(0.0, -settings.bias(), 0.0);
        let ray_frame = RayFrame { body: None, position, normal: Vec3::Y, edge: Vec3::X };
        let mean = (0..40).map(|point| trace(&tracer, &bodies, point, &ray_frame).ao).sum::<f32>() / 40.0;
        assert!((mean - 0.5).abs() < 0.003, "{mean}");
    }

    #[test]
    fn more_rays_come_closer_to_the_truth() {
        let mut triangles = floor(3.0);
        triangles.extend(reference::cube(0.15).iter().map(|t| t.map(|c| c + Vec3::new(0.35, 0.15, 0.1))));
        let bodies = Tlas::new(vec![body(&triangles, Placement::IDENTITY)]);
        let ray_frame = on_floor(0);
        let truth = trace(&tracer(65_536, Occlusion::Obscurance), &bodies, 0, &ray_frame).ao;
        assert!(truth < 0.99);
        let error = |rays: u32| {
            let tracer = tracer(rays, Occlusion::Obscurance);
            let square = |point| (trace(&tracer, &bodies, point, &ray_frame).ao - truth).powi(2);
            ((0..64).map(square).sum::<f32>() / 64.0).sqrt()
        };
        let (few, many) = (error(16), error(512));
        assert!(many < few / 3.0, "{few} {many}");
        assert!(many < 0.004, "{many}");
    }

    #[test]
    fn the_ao_of_a_body_that_moves_alone_is_bit_identical() {
        let tracer = tracer(192, Occlusion::Obscurance);
        let mut triangles = reference::cube(0.2);
        triangles.extend(floor(0.5).iter().map(|t| t.map(|c| c - Vec3::Y * 0.2)));
        let ray_frame = RayFrame { position: Vec3::new(0.3, -0.2, 0.0), edge: Vec3::Z, ..on_floor(0) };
        let still = trace(&tracer, &Tlas::new(vec![body(&triangles, Placement::IDENTITY)]), 9, &ray_frame);
        assert!(still.ao < 1.0);
        for step in 1..20 {
            let rotation = Mat3::from_rotation_y(0.3 * step as f32) * Mat3::from_rotation_x(0.1);
            let placement = Placement { rotation, translation: Vec3::splat(step as f32) };
            assert_eq!(trace(&tracer, &Tlas::new(vec![body(&triangles, placement)]), 9, &ray_frame), still);
        }
    }

    #[test]
    fn refused_texels_let_rays_through() {
        let mut triangles = floor(2.0);
        triangles.push([[0.3, 0.1, 0.0], [0.3, 0.3, 0.1], [0.3, 0.3, -0.1]].map(Vec3::from));
        let plain = Tlas::new(vec![body(&triangles, Placement::IDENTITY)]);
        triangles.extend(floor(2.0).iter().map(|t| t.map(|c| c + Vec3::Y * 0.3)));
        let whole = Tlas::new(vec![body(&triangles, Placement::IDENTITY)]);
        // One leaf has masked and unmasked triangles.
        let blas = Blas::build(&triangles, Effort::Best).with_masks(|triangle| triangle >= 3);
        let bodies = Tlas::new(vec![BlasInstance::new(Arc::new(blas), Placement::IDENTITY)]);
        // Few rays are tested one by one in a leaf, many in groups.
        for rays in [3, 64] {
            for kind in [Occlusion::Obscurance, Occlusion::Binary] {
                let tracer = tracer(rays, kind);
                let mut scratch = Scratch::default();
                let shut = tracer.trace(
                    &bodies,
                    RayKey(1),
                    &on_floor(0),
                    &|_, _| true,
                    SelfHitCache::Off,
                    &mut scratch,
                );
                let open = tracer.trace(
                    &bodies,
                    RayKey(1),
                    &on_floor(0),
                    &|_, _| false,
                    SelfHitCache::Off,
                    &mut scratch,
                );
                assert!(shut.ao < 0.8 && open.ao > shut.ao);
                assert_eq!(open, trace(&tracer, &plain, 1, &on_floor(0)));
                assert_eq!(shut, trace(&tracer, &whole, 1, &on_floor(0)));
            }
        }
    }

    #[test]
    fn nothing_within_reach_costs_no_ray() {
        let bodies = Tlas::new(vec![body(
            &floor(1.0),
            Placement { translation: Vec3::Y * 9.0, ..Placement::IDENTITY },
        )]);
        let ray_frame = RayFrame { body: None, ..on_floor(0) };
        assert_eq!(
            trace(&tracer(192, Occlusion::Obscurance), &bodies, 0, &ray_frame),
            PointAo { ao: 1.0, alone: true, hits: 0, rays: 0 }
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]
        #[test]
        fn packets_see_what_single_rays_see(
            triangle_soups in prop::collection::vec(crate::bvh::triangle_soup(), 1..4), point in any::<u32>(),
            angles in prop::array::uniform4(0f32..6.3), home in prop::option::of(0u32..4),
            normal in prop::array::uniform3(-1f32..1.0), position in prop::array::uniform3(-1f32..1.0),
            rays in prop_oneof![Just(1u32), Just(20), Just(192)], binary in any::<bool>(), radius in 0.05f32..3.0,
        ) {
            let kind = if binary { Occlusion::Binary } else { Occlusion::Obscurance };
            let tracer = Tracer::new(AoSettings { rays, radius, kind, seed: 2 }).unwrap();
            let list: Vec<_> = triangle_soups.into_iter().zip(angles).map(|(triangles, angle)| {
                let rotation = Mat3::from_axis_angle(Vec3::new(0.6, 0.8, 0.0), angle);
                (triangles, Placement { rotation, translation: Vec3::Z * angle * 0.2 })
            }).collect();
            let home = home.filter(|&home| (home as usize) < list.len()).map(BodyId::new);
            let normal = Vec3::from(normal).normalize_or(Vec3::X);
            let ray_frame = RayFrame { body: home, position: position.into(), normal, edge: Vec3::new(0.3, 0.4, 0.5) };
            let bodies = Tlas::new(list.iter().map(|(t, p)| body(t, *p)).collect());
            let fast = trace(&tracer, &bodies, point, &ray_frame).ao;
            let mut distances = Vec::new();
            tracer.distances(&bodies, RayKey(point), &ray_frame, &mut Scratch::default(), &mut distances);
            for instructions in Instructions::all() {
                let other = tracer.clone().with_instructions(instructions);
                prop_assert_eq!(trace(&other, &bodies, point, &ray_frame).ao.to_bits(), fast.to_bits());
                let mut found = Vec::new();
                other.distances(&bodies, RayKey(point), &ray_frame, &mut Scratch::default(), &mut found);
                prop_assert_eq!(&found, &distances);
            }
            let (origin, directions) = tracer.rays(&bodies, RayKey(point), &ray_frame);
            prop_assert_eq!((distances.len(), directions.len()), (rays as usize, rays as usize));
            prop_assert!((origin - frame_placement(&bodies, &ray_frame).point(tracer.origin(&ray_frame))).length() < 1e-5);
            let slow = reference_ao(&tracer, &list, point, &ray_frame);
            // The reference rounds directions in another order: a ray that grazes an edge may go either way.
            prop_assert!((fast - slow).abs() <= 1e-4 + 1.01 / rays as f32 * f32::from(rays > 1), "{} {}", fast, slow);
        }
    }
}
