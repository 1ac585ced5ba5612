//! The scene as it moves, and the AO of its points: what streams of any profile are made from.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use psao_codec::frame::StreamTime;
use psao_codec::quant::unorm;
use psao_proto::message::CameraPose;
use rayon::prelude::*;

use super::field::{Field, Part, Placed, flag, set};
use super::stats::{Lap, Progress, StageMicros, Work};
use super::{ProgressFn, ServerSettings};
use crate::ao::{Scratch, Tracer};
use crate::bvh::{BlasHit, World};
use crate::points::ScenePoints;
use crate::scene::{Edits, Scene, ScenePose};
use crate::visibility::Views;

/// A scene, its points, and their AO as of the last step.
pub(super) struct Tracing {
    pub(super) scene: Arc<Scene>,
    pub(super) points: ScenePoints,
    pub(super) pose: ScenePose,
    /// What clients changed; in force from the next step on.
    pub(super) edits: Edits,
    pub(super) world: World,
    pub(super) field: Field,
    tracer: Tracer,
    view_margin: f32,
    exhaustive: bool,
    progress: Arc<ProgressFn>,
}

/// What a step traced.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Traces {
    pub(super) visible: u32,
    pub(super) traced: u32,
    pub(super) rays: u64,
}

impl Tracing {
    /// A scene before its first step. With `exact` the AO of every point is kept as it was traced as well.
    pub(super) fn new(
        scene: Arc<Scene>,
        points: ScenePoints,
        tracer: Tracer,
        settings: &ServerSettings,
        progress: Arc<ProgressFn>,
        exact: bool,
    ) -> Self {
        let pose = scene.pose(0.0);
        let world = World::new(&scene, &pose);
        let field = Field::new(&world, &points, exact);
        let ServerSettings { view_margin, exhaustive, .. } = *settings;
        let edits = Edits::new(scene.instances().len() as u32);
        Self { scene, points, pose, edits, world, field, tracer, view_margin, exhaustive, progress }
    }

    /// Numbers of an instance's points in the order in which they were made.
    pub(super) fn numbers(&self, instance: usize) -> &[u32] {
        self.points.sets()[self.scene.instances()[instance].rest().index()].numbers()
    }

    /// The field of view of some cameras, widened; `None` without cameras.
    pub(super) fn views(&self, cameras: &[CameraPose]) -> Option<Views> {
        Views::new(cameras, self.view_margin)
    }

    /// Moves the scene to a time and brings the AO of the points that one of the cameras sees up to date. In the first
    /// step that is every point, whatever the cameras.
    pub(super) fn advance(
        &mut self,
        time: StreamTime,
        cameras: &[CameraPose],
        first: bool,
        lap: &mut Lap<'_>,
    ) -> (Traces, StageMicros) {
        self.scene.pose_into(time.micros() as f64 * 1e-6, &mut self.pose);
        self.pose.apply(&self.edits);
        let mut micros = StageMicros { pose: lap.micros(), ..StageMicros::default() };
        self.world.update(&self.pose);
        micros.bvh = lap.micros();
        self.field.place(&self.world, &self.points, false);
        let views = if first { None } else { self.views(cameras) };
        let ao = self.tracer.settings();
        self.field.mark(&self.world, views.as_ref(), ao.bias(), ao.influence());
        micros.place = lap.micros();
        let traces = self.trace(first);
        micros.trace = lap.micros();
        (traces, micros)
    }

    /// Traces the visible points whose AO may have changed.
    fn trace(&mut self, first: bool) -> Traces {
        let total = self.points.total().into();
        let done = AtomicU64::new(0);
        let progress = |points: usize| {
            if first {
                let done = done.fetch_add(points as u64, Ordering::Relaxed) + points as u64;
                (self.progress)(Progress { work: Work::FirstFrame, done, total });
            }
        };
        let trace = Trace {
            world: &self.world,
            points: &self.points,
            tracer: &self.tracer,
            exhaustive: self.exhaustive,
        };
        let (parts, placed) = self.field.split();
        let traces: Vec<Traces> = parts
            .into_par_iter()
            .map_init(Scratch::default, |scratch, mut part| {
                let traces = trace.part(&mut part, &placed, scratch);
                progress(part.flags.len());
                traces
            })
            .collect();
        traces.iter().fold(Traces::default(), |sum, part| Traces {
            visible: sum.visible + part.visible,
            traced: sum.traced + part.traced,
            rays: sum.rays + part.rays,
        })
    }
}

/// What the parts of a field are traced with.
struct Trace<'a> {
    world: &'a World,
    points: &'a ScenePoints,
    tracer: &'a Tracer,
    exhaustive: bool,
}

impl Trace<'_> {
    /// Brings the AO of a part's visible points up to date.
    fn part(&self, part: &mut Part<'_>, placed: &Placed<'_>, scratch: &mut Scratch) -> Traces {
        let Self { world, tracer, exhaustive, .. } = *self;
        let instance = part.chunk.instance;
        let opaque = |body: u32, hit: &BlasHit| world.opaque(body, hit);
        let numbers = self.points.sets()[world.scene().instances()[instance].rest().index()].numbers();
        let base = self.points.firsts()[instance];
        let mut traces = Traces::default();
        for (index, point) in part.chunk.points.clone().enumerate() {
            let flags = &mut part.flags[index];
            if *flags & flag::VISIBLE == 0 {
                continue;
            }
            traces.visible += 1;
            if *flags & flag::FRESH != 0 && !exhaustive {
                continue;
            }
            let seat = placed.seat(world, instance, point);
            // A body that has nothing near it, then and now, sees what it saw: its points lie in its own space.
            let unchanged =
                *flags & flag::ALONE != 0 && !exhaustive && tracer.is_alone(world.bodies(), &seat, scratch);
            if !unchanged {
                let traced = tracer.trace(world.bodies(), base + numbers[point], &seat, &opaque, scratch);
                part.ao[index] = unorm::quantise(traced.ao);
                if let Some(exact) = part.exact.get_mut(index) {
                    *exact = traced.ao;
                }
                set(flags, flag::ALONE, traced.alone);
                traces.traced += 1;
                traces.rays += u64::from(traced.rays);
            }
            *flags |= flag::FRESH;
        }
        traces
    }
}
