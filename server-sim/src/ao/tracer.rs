//! The AO of one point against all bodies near it.

use fearless_simd::{Simd, dispatch};
use glam::{Mat3, Vec3};

use super::frame::tangent_frame;
use super::ray_packet::{Bundle, Start, Trace};
use super::samples::SampleSets;
use super::self_hits::{Recorder, Remembered};
use super::settings::{AoError, AoSettings, Occlusion};
use crate::bvh::{BlasHit, BodyId, Instructions, Placement, Tlas};
use crate::world::SceneBvh;

/// Computes AO with the rays of one [`AoSettings`]. Shared by all threads; each has its own [`Scratch`].
#[derive(Clone, Debug)]
pub struct Tracer {
    settings: AoSettings,
    sets: SampleSets,
    instructions: Instructions,
}

/// Working memory of a thread.
#[derive(Debug, Default)]
pub struct Scratch {
    bundle: Bundle,
    near: Vec<BodyId>,
    stack: Vec<u32>,
    recorder: Recorder,
}

/// The AO of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traced {
    /// Accessibility in [0, 1], 1 is open.
    pub ao: f32,
    /// Whether no body but the point's own was within reach: then moving it rigidly changes nothing.
    pub alone: bool,
    /// Rays that had to be traced: those that come into the bounds of a body within reach, which a body whose hits are
    /// remembered is not.
    pub rays: u32,
}

/// What is known of a point's rays in its own body, and whether to keep it.
#[derive(Debug)]
pub(crate) enum Memory<'a> {
    /// Nothing is known or kept.
    None,
    /// Nothing is known; what the rays meet is put here if another body is near.
    Vacant(&'a mut Option<Box<Remembered>>),
    /// What they meet.
    Known(&'a Remembered),
}

/// Where a point sits: in the space of its own body, if it has one, so that a body that moves alone keeps its AO to
/// the bit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seat {
    /// The body whose space `position`, `normal` and `edge` are in; none for the space of the world.
    pub(crate) body: Option<BodyId>,
    pub(crate) position: Vec3,
    /// Unit.
    pub(crate) normal: Vec3,
    /// A direction that moves with the surface, see [`tangent_frame`].
    pub(crate) edge: Vec3,
}

/// A point among bodies; `opaque` is asked about hits on masked triangles, with the body.
struct Place<'a> {
    bodies: &'a Tlas,
    point: u32,
    seat: &'a Seat,
    opaque: &'a dyn Fn(BodyId, &BlasHit) -> bool,
}

impl Tracer {
    /// Computes the ray sets.
    ///
    /// # Errors
    /// A setting out of its range.
    pub fn new(settings: AoSettings) -> Result<Self, AoError> {
        settings.validate()?;
        let sets = SampleSets::new(settings.rays, settings.seed);
        Ok(Self { settings, sets, instructions: Instructions::best() })
    }

    /// The same, by other instructions than the best that there are; for tests and measurements, as the AO is the same.
    #[must_use]
    pub fn with_instructions(self, instructions: Instructions) -> Self {
        Self { instructions, ..self }
    }

    /// The settings given.
    #[must_use]
    pub fn settings(&self) -> &AoSettings {
        &self.settings
    }

    /// Bytes of memory held: the directions of all sets of rays.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.sets.held()
    }

    /// AO of a place in the world, as by a point there: `normal` is unit, `point` chooses the rays. For references; the
    /// server keeps its points in the spaces of their bodies.
    #[must_use]
    pub fn at(
        &self,
        world: &SceneBvh,
        point: u32,
        position: Vec3,
        normal: Vec3,
        scratch: &mut Scratch,
    ) -> Traced {
        let seat = Seat { body: None, position, normal, edge: Vec3::ZERO };
        self.trace(world.bodies(), point, &seat, &|body, hit| world.opaque(body, hit), Memory::None, scratch)
    }

    /// AO of point number `point` at `seat`; `opaque` is asked about hits on masked triangles, with the body. `memory` must
    /// be of the same point, and of its body in the same shape.
    pub(crate) fn trace(
        &self,
        bodies: &Tlas,
        point: u32,
        seat: &Seat,
        opaque: &dyn Fn(BodyId, &BlasHit) -> bool,
        memory: Memory<'_>,
        scratch: &mut Scratch,
    ) -> Traced {
        let place = Place { bodies, point, seat, opaque };
        let mut hidden = 0.0;
        let (alone, rays) = self.trace_all(&place, memory, scratch, &mut |bundle| {
            hidden += match self.settings.kind {
                Occlusion::Obscurance => bundle.hidden::<false>(),
                Occlusion::Binary => bundle.hidden::<true>(),
            };
        });
        let ao = 1.0 - hidden / self.settings.rays as f32;
        Traced { ao: ao.clamp(0.0, 1.0), alone, rays }
    }

    /// Whether no body but its own is within reach of the point at `seat`.
    pub(crate) fn is_alone(&self, bodies: &Tlas, seat: &Seat, scratch: &mut Scratch) -> bool {
        self.gather(bodies, seat, scratch);
        scratch.near.iter().all(|&body| Some(body) == seat.body)
    }

    /// Collects the bodies within reach of the point at `seat`; where its rays start in the world.
    fn gather(&self, bodies: &Tlas, seat: &Seat, scratch: &mut Scratch) -> Vec3 {
        let home = home_of(bodies, seat);
        let origin = self.origin(seat);
        let in_world = if home == Placement::IDENTITY { origin } else { home.point(origin) };
        bodies.near(in_world, self.settings.radius, &mut scratch.stack, &mut scratch.near);
        in_world
    }

    /// Where the rays of the point at `seat` start, in the space of the seat.
    fn origin(&self, seat: &Seat) -> Vec3 {
        seat.position + seat.normal * self.settings.bias()
    }

    /// Appends what [`Tracer::trace`] finds, ray by ray: the distance of the hit, with binary occlusion 0, or infinity.
    /// Every texel is there.
    pub(super) fn distances(
        &self,
        bodies: &Tlas,
        point: u32,
        seat: &Seat,
        scratch: &mut Scratch,
        all: &mut Vec<f32>,
    ) {
        let place = Place { bodies, point, seat, opaque: &|_, _| true };
        let end = all.len() + self.settings.rays as usize;
        self.trace_all(&place, Memory::None, scratch, &mut |bundle| {
            all.extend(bundle.distances(self.settings.kind));
        });
        all.resize(end, f32::INFINITY);
    }

    /// Origin and directions of a point's rays in the world.
    pub(super) fn rays(&self, bodies: &Tlas, point: u32, seat: &Seat) -> (Vec3, Vec<Vec3>) {
        let home = home_of(bodies, seat);
        let mut directions = self.sets.of(point).directions(&tangent_frame(seat.normal, seat.edge));
        if home == Placement::IDENTITY {
            return (self.origin(seat), directions);
        }
        directions.iter_mut().for_each(|direction| *direction = home.direction(*direction));
        (home.point(self.origin(seat)), directions)
    }

    /// Traces the rays of a place and calls `done` with every bundle of them; whether nothing but its own body is within
    /// reach, and how many rays had to be traced.
    fn trace_all(
        &self,
        place: &Place<'_>,
        memory: Memory<'_>,
        scratch: &mut Scratch,
        done: &mut dyn FnMut(&Bundle),
    ) -> (bool, u32) {
        // All of a point is compiled once for each set of instructions.
        dispatch!(self.instructions.level(), simd => match self.settings.kind {
            Occlusion::Obscurance => self.trace_kind::<_, false>(simd, place, memory, scratch, done),
            Occlusion::Binary => self.trace_kind::<_, true>(simd, place, memory, scratch, done),
        })
    }

    #[inline(always)]
    fn trace_kind<S: Simd, const ANY: bool>(
        &self,
        simd: S,
        place: &Place<'_>,
        mut memory: Memory<'_>,
        scratch: &mut Scratch,
        done: &mut dyn FnMut(&Bundle),
    ) -> (bool, u32) {
        let Place { bodies, point, seat, opaque } = *place;
        let in_world = self.gather(bodies, seat, scratch);
        let (home, origin) = (home_of(bodies, seat), self.origin(seat));
        let frame = tangent_frame(seat.normal, seat.edge);
        let Scratch { bundle, near, recorder, .. } = scratch;
        let alone = near.iter().all(|&body| Some(body) == seat.body);
        if near.is_empty() {
            return (alone, 0);
        }
        // The point's own body first: it hides the most.
        near.sort_by_key(|&body| (Some(body) != seat.body, body));
        let own = near.first().is_some_and(|&body| Some(body) == seat.body);
        if alone || !own {
            // There is nothing else, or nothing of its own, to tell apart.
            memory = match memory {
                Memory::Known(known) if own => Memory::Known(known),
                _ => Memory::None,
            };
        }
        let rays = self.sets.of(point);
        let start = |id: BodyId| {
            let body = &bodies.list()[id.index()];
            if Some(id) == seat.body || body.placement == home {
                Start { turn: frame, origin }
            } else {
                from_home(&home, &body.placement, &frame, in_world)
            }
        };
        let mut recall = if let Memory::Known(known) = &memory { Some(known.recall()) } else { None };
        let keep = matches!(memory, Memory::Vacant(_));
        recorder.clear();
        let mut traced = 0;
        for chunk in 0..rays.chunks() {
            bundle.begin(&rays, chunk, self.settings.radius);
            if let Some(recall) = &mut recall {
                recall.restore::<ANY>(bundle);
            }
            for (place, &id) in near.iter().enumerate().skip(usize::from(recall.is_some())) {
                let blas = &bodies.list()[id.index()].blas;
                let accept = |hit: &BlasHit| opaque(id, hit);
                let start = start(id);
                Trace::<S, ANY> { simd, bundle, rays: &rays, chunk, start, blas, accept: &accept }.run();
                if keep && place == 0 {
                    recorder.record(bundle);
                }
            }
            traced += bundle.traced();
            done(bundle);
        }
        if let Memory::Vacant(slot) = memory {
            *slot = Some(Box::new(recorder.remembered()));
        }
        (alone, traced)
    }
}

/// Placement of the space that a seat is in.
fn home_of(bodies: &Tlas, seat: &Seat) -> Placement {
    let body = seat.body.and_then(|id| bodies.list().get(id.index()));
    body.map_or(Placement::IDENTITY, |body| body.placement)
}

/// The start of the rays in the space of another body.
fn from_home(home: &Placement, body: &Placement, frame: &Mat3, in_world: Vec3) -> Start {
    Start { turn: body.rotation.transpose() * (home.rotation * *frame), origin: body.local_point(in_world) }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;

    use super::*;
    use crate::bvh::{Blas, BlasInstance, Effort, LANES, naive};

    fn body(triangles: &[[Vec3; 3]], placement: Placement) -> BlasInstance {
        BlasInstance::new(Arc::new(Blas::build(triangles, Effort::Best)), placement)
    }

    fn tracer(rays: u32, kind: Occlusion) -> Tracer {
        Tracer::new(AoSettings { rays, kind, ..AoSettings::default() }).unwrap()
    }

    fn trace(tracer: &Tracer, bodies: &Tlas, point: u32, seat: &Seat) -> Traced {
        tracer.trace(bodies, point, seat, &|_, _| true, Memory::None, &mut Scratch::default())
    }

    fn floor(half: f32) -> Vec<[Vec3; 3]> {
        let at = |x: f32, z: f32| Vec3::new(x * half, 0.0, z * half);
        vec![[at(-1.0, -1.0), at(1.0, 1.0), at(1.0, -1.0)], [at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)]]
    }

    fn on_floor(body: u32) -> Seat {
        let body = Some(BodyId::new(body));
        Seat { body, position: Vec3::new(0.1, 0.0, 0.2), normal: Vec3::Y, edge: Vec3::X }
    }

    /// The slow, obvious twin: each ray alone against every triangle of every body.
    fn naive_ao(tracer: &Tracer, bodies: &[(Vec<[Vec3; 3]>, Placement)], point: u32, seat: &Seat) -> f32 {
        let home = seat.body.and_then(|id| bodies.get(id.index()));
        let home = home.map_or(Placement::IDENTITY, |(_, placement)| *placement);
        let frame = tangent_frame(seat.normal, seat.edge);
        let settings = tracer.settings();
        let origin = home.point(seat.position + seat.normal * settings.bias());
        let rays = tracer.sets.of(point);
        let mut sum = 0.0;
        for ray in 0..rays.set.rays() {
            let Vec3 { x, y, z } = rays.set.groups[ray / LANES].at(ray % LANES);
            let turned = Vec3::new(x * rays.cos - y * rays.sin, x * rays.sin + y * rays.cos, z);
            let direction = home.rotation * (frame * turned);
            let hits = bodies.iter().filter_map(|(triangles, placement)| {
                let (from, along) = (placement.local_point(origin), placement.local_direction(direction));
                naive::nearest(triangles, from, along, settings.radius).map(|hit| hit.intersection.t)
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
        let bodies = Tlas::new(vec![body(&naive::cube(0.2), Placement::IDENTITY)]);
        let seat = Seat { position: Vec3::new(0.02, -0.2, 0.05), ..on_floor(0) };
        for point in 0..50 {
            assert_eq!(trace(&tracer(192, Occlusion::Binary), &bodies, point, &seat).ao, 0.0);
            let ao = trace(&tracer(192, Occlusion::Obscurance), &bodies, point, &seat).ao;
            assert!(ao > 0.3 && ao < 0.9, "{ao}");
        }
    }

    #[test]
    fn a_wall_hides_its_form_factor() {
        // A half-plane wall at distance d, seen from the floor: with cosine weights, the share of rays that reach a
        // wall of infinite length and height is 1/2. A radius of a thousand distances stands in for infinity.
        let wall = [Vec3::new(-1.0, 0.0, -1e4), Vec3::new(-1.0, 2e4, 0.0), Vec3::new(-1.0, 0.0, 1e4)];
        let bodies = Tlas::new(vec![body(&[wall], Placement::IDENTITY)]);
        let settings = AoSettings { rays: 4096, radius: 1000.0, kind: Occlusion::Binary, seed: 5 };
        let tracer = Tracer::new(settings).unwrap();
        // The lifted origin (16 m) shares the direction space: put it at the wall's height zero.
        let position = Vec3::new(0.0, -settings.bias(), 0.0);
        let seat = Seat { body: None, position, normal: Vec3::Y, edge: Vec3::X };
        let mean = (0..40).map(|point| trace(&tracer, &bodies, point, &seat).ao).sum::<f32>() / 40.0;
        assert!((mean - 0.5).abs() < 0.003, "{mean}");
    }

    #[test]
    fn more_rays_come_closer_to_the_truth() {
        let mut triangles = floor(3.0);
        triangles.extend(naive::cube(0.15).iter().map(|t| t.map(|c| c + Vec3::new(0.35, 0.15, 0.1))));
        let bodies = Tlas::new(vec![body(&triangles, Placement::IDENTITY)]);
        let seat = on_floor(0);
        let truth = trace(&tracer(65_536, Occlusion::Obscurance), &bodies, 0, &seat).ao;
        assert!(truth < 0.99);
        let error = |rays: u32| {
            let tracer = tracer(rays, Occlusion::Obscurance);
            let square = |point| (trace(&tracer, &bodies, point, &seat).ao - truth).powi(2);
            ((0..64).map(square).sum::<f32>() / 64.0).sqrt()
        };
        let (few, many) = (error(16), error(512));
        assert!(many < few / 3.0, "{few} {many}");
        assert!(many < 0.004, "{many}");
    }

    #[test]
    fn a_body_that_moves_alone_keeps_its_ao_to_the_bit() {
        let tracer = tracer(192, Occlusion::Obscurance);
        let mut triangles = naive::cube(0.2);
        triangles.extend(floor(0.5).iter().map(|t| t.map(|c| c - Vec3::Y * 0.2)));
        let seat = Seat { position: Vec3::new(0.3, -0.2, 0.0), edge: Vec3::Z, ..on_floor(0) };
        let still = trace(&tracer, &Tlas::new(vec![body(&triangles, Placement::IDENTITY)]), 9, &seat);
        assert!(still.ao < 1.0);
        for step in 1..20 {
            let rotation = Mat3::from_rotation_y(0.3 * step as f32) * Mat3::from_rotation_x(0.1);
            let placement = Placement { rotation, translation: Vec3::splat(step as f32) };
            assert_eq!(trace(&tracer, &Tlas::new(vec![body(&triangles, placement)]), 9, &seat), still);
        }
    }

    #[test]
    fn refused_texels_let_rays_through() {
        let mut triangles = floor(2.0);
        triangles.push([[0.3, 0.1, 0.0], [0.3, 0.3, 0.1], [0.3, 0.3, -0.1]].map(Vec3::from));
        let plain = Tlas::new(vec![body(&triangles, Placement::IDENTITY)]);
        triangles.extend(floor(2.0).iter().map(|t| t.map(|c| c + Vec3::Y * 0.3)));
        let whole = Tlas::new(vec![body(&triangles, Placement::IDENTITY)]);
        // Masked and plain triangles in one leaf.
        let blas = Blas::build(&triangles, Effort::Best).with_masks(|triangle| triangle >= 3);
        let bodies = Tlas::new(vec![BlasInstance::new(Arc::new(blas), Placement::IDENTITY)]);
        // Few rays meet a leaf one by one, many in groups.
        for rays in [3, 64] {
            for kind in [Occlusion::Obscurance, Occlusion::Binary] {
                let tracer = tracer(rays, kind);
                let mut scratch = Scratch::default();
                let shut = tracer.trace(&bodies, 1, &on_floor(0), &|_, _| true, Memory::None, &mut scratch);
                let open = tracer.trace(&bodies, 1, &on_floor(0), &|_, _| false, Memory::None, &mut scratch);
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
        let seat = Seat { body: None, ..on_floor(0) };
        assert_eq!(
            trace(&tracer(192, Occlusion::Obscurance), &bodies, 0, &seat),
            Traced { ao: 1.0, alone: true, rays: 0 }
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]
        #[test]
        fn bundles_see_what_single_rays_see(
            soups in prop::collection::vec(crate::bvh::soup(), 1..4), point in any::<u32>(),
            angles in prop::array::uniform4(0f32..6.3), home in prop::option::of(0u32..4),
            normal in prop::array::uniform3(-1f32..1.0), position in prop::array::uniform3(-1f32..1.0),
            rays in prop_oneof![Just(1u32), Just(20), Just(192)], binary in any::<bool>(), radius in 0.05f32..3.0,
        ) {
            let kind = if binary { Occlusion::Binary } else { Occlusion::Obscurance };
            let tracer = Tracer::new(AoSettings { rays, radius, kind, seed: 2 }).unwrap();
            let list: Vec<_> = soups.into_iter().zip(angles).map(|(triangles, angle)| {
                let rotation = Mat3::from_axis_angle(Vec3::new(0.6, 0.8, 0.0), angle);
                (triangles, Placement { rotation, translation: Vec3::Z * angle * 0.2 })
            }).collect();
            let home = home.filter(|&home| (home as usize) < list.len()).map(BodyId::new);
            let normal = Vec3::from(normal).normalize_or(Vec3::X);
            let seat = Seat { body: home, position: position.into(), normal, edge: Vec3::new(0.3, 0.4, 0.5) };
            let bodies = Tlas::new(list.iter().map(|(t, p)| body(t, *p)).collect());
            let fast = trace(&tracer, &bodies, point, &seat).ao;
            let mut distances = Vec::new();
            tracer.distances(&bodies, point, &seat, &mut Scratch::default(), &mut distances);
            for instructions in Instructions::all() {
                let other = tracer.clone().with_instructions(instructions);
                prop_assert_eq!(trace(&other, &bodies, point, &seat).ao.to_bits(), fast.to_bits());
                let mut found = Vec::new();
                other.distances(&bodies, point, &seat, &mut Scratch::default(), &mut found);
                prop_assert_eq!(&found, &distances);
            }
            let (origin, directions) = tracer.rays(&bodies, point, &seat);
            prop_assert_eq!((distances.len(), directions.len()), (rays as usize, rays as usize));
            prop_assert!((origin - home_of(&bodies, &seat).point(tracer.origin(&seat))).length() < 1e-5);
            let slow = naive_ao(&tracer, &list, point, &seat);
            // The twin rounds its directions in another order: a ray that grazes an edge may fall either way.
            prop_assert!((fast - slow).abs() <= 1e-4 + 1.01 / rays as f32 * f32::from(rays > 1), "{} {}", fast, slow);
        }
    }
}
