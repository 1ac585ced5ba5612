//! The scene as it moves, and the AO of its points: what streams of any profile are made from.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::memory;
use psao_codec::quant::unorm;
use psao_codec::surface::{BLOCK_POINTS, Budget};
use psao_proto::message::CameraPose;
use rayon::prelude::*;

use super::field::{Field, FieldPart, flag, is_shown, set};
use super::places::PointPlaces;
use super::profile;
use super::ray_scheduler::{RayBudget, RayScheduler};
use super::sight::Sight;
use super::stats::{Lap, Progress, StageMicros, TraceTotals, Traces, Work};
use super::traced_frame::Thresholds;
use super::{ProgressFn, ServerMemory, ServerSettings};
use crate::ao::{Scratch, Tracer};
use crate::bvh::{BlasHit, BodyId};
use crate::points::{PointInSet, ScenePoints};
use crate::scene::{Edits, Scene, ScenePose};
use crate::shortcuts::Shortcuts;
use crate::visibility::Views;
use crate::world::{InstanceChange, SceneBvh};

/// A scene, its points, and their AO as of the last traced frame.
pub(super) struct TraceState {
    pub(super) scene: Arc<Scene>,
    pub(super) points: ScenePoints,
    pub(super) pose: ScenePose,
    /// What clients changed; in force from the next step on.
    pub(super) edits: Edits,
    pub(super) world: SceneBvh,
    pub(super) field: Field,
    /// Those of the last traced frame.
    pub(super) cameras: Vec<CameraPose>,
    tracer: Tracer,
    pub(super) scheduler: RayScheduler,
    pub(super) ray_budget: Option<RayBudget>,
    view_margin: f32,
    shortcuts: Shortcuts,
    /// Whether buried and unseen points are looked for: the stream treats them differently.
    digs: bool,
    /// Whether unseen points may be off by more than others.
    probes: bool,
    /// Whether a view chooses how fine points are.
    by_level: bool,
    pub(super) thresholds: Thresholds,
    /// Most blocks of points that clients get in a frame.
    most_arrivals: usize,
    /// Most bytes that points may remember of their rays, and how many they do.
    memory: [usize; 2],
    progress: Arc<ProgressFn>,
}

impl TraceState {
    /// A scene before its first frame. With `exact` the AO of every point is kept as it was traced as well.
    pub(super) fn new(
        scene: Arc<Scene>,
        points: ScenePoints,
        tracer: Tracer,
        settings: &ServerSettings,
        progress: Arc<ProgressFn>,
        exact: bool,
    ) -> Self {
        let pose = scene.pose(0.0);
        let ServerSettings { view_margin, shortcuts, ray_memory, ray_budget, .. } = *settings;
        let world = SceneBvh::with_shortcuts(&scene, &pose, shortcuts);
        let quality = settings.levels_by_view();
        let field = Field::new(&world, &points, exact, shortcuts, quality);
        let scheduler = RayScheduler::new(field.chunks().len(), settings.ao.rays);
        let memory = [usize::try_from(ray_memory).unwrap_or(usize::MAX), 0];
        let edits = Edits::new(scene.instances().len() as u32);
        Self {
            scene,
            points,
            pose,
            edits,
            world,
            field,
            cameras: Vec::new(),
            tracer,
            scheduler,
            ray_budget,
            view_margin,
            shortcuts,
            digs: profile::tells_points_apart(settings),
            probes: settings.unseen_threshold() > settings.threshold || quality.is_some(),
            by_level: quality.is_some(),
            most_arrivals: settings.budget.map_or(usize::MAX, most_arrivals),
            thresholds: Thresholds { usual: settings.threshold, unseen: settings.unseen_threshold() },
            memory,
            progress,
        }
    }

    /// Bytes held, but for the stream.
    pub(super) fn heap_bytes(&self) -> ServerMemory {
        ServerMemory {
            structures: self.world.heap_bytes() + self.pose.heap_bytes(),
            points: self.points.heap_bytes() + self.field.heap_bytes() + self.scheduler.heap_bytes(),
            rays: self.tracer.heap_bytes(),
            remembered: self.memory[1],
            stream: memory::list(&self.cameras),
        }
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
    /// step that is every point, whatever the cameras, unless views choose levels.
    pub(super) fn advance(
        &mut self,
        (index, time): (FrameIndex, StreamTime),
        cameras: &[CameraPose],
        first: bool,
        lap: &mut Lap<'_>,
    ) -> Traces {
        self.cameras.clear();
        self.cameras.extend_from_slice(cameras);
        self.scene.pose_into(time.micros() as f64 * 1e-6, &mut self.pose);
        self.pose.apply(&self.edits);
        let mut micros = StageMicros { pose: lap.micros(), ..StageMicros::default() };
        self.world.update(&self.pose);
        micros.bvh = lap.micros();
        self.field.place(&self.world, &self.points, false);
        let views = if first && !self.by_level { None } else { self.views(cameras) };
        let ao = self.tracer.settings();
        self.field.mark(&self.world, &self.points, (views.as_ref(), first), ao.bias(), ao.influence());
        if self.digs {
            // In the first frame all points may be in view, but the cameras see what they see.
            let views = self.views(cameras).filter(|_| self.probes);
            let (world, points) = (&self.world, &self.points);
            let sight = Sight { world, points, views: views.as_ref(), frame: index.0, bias: ao.bias() };
            self.field.look(&sight, if first { usize::MAX } else { self.most_arrivals });
        }
        let budget = self.ray_budget.filter(|_| !first);
        let stale = self.choose(budget, cameras);
        micros.place = lap.micros();
        let chunks = self.trace(first);
        let mut traces = chunks.iter().fold(TraceTotals::default(), |sum, part| TraceTotals {
            visible: sum.visible + part.visible,
            traced: sum.traced + part.traced,
            rays: sum.rays + part.rays,
            waiting: None,
        });
        let each = chunks.iter().map(|part| (part.traced, part.rays));
        traces.waiting = budget.map(|_| self.scheduler.settle(each, &stale));
        micros.trace = lap.micros();
        Traces { index, time, first, totals: traces, micros }
    }

    /// Chooses the chunks that are traced; gives the stale points in view of each, where that matters.
    fn choose(&mut self, budget: Option<RayBudget>, cameras: &[CameraPose]) -> Vec<u32> {
        let Some(budget) = budget else {
            self.scheduler.choose_all();
            return Vec::new();
        };
        let stale = self.field.stale(self.shortcuts.contains(Shortcuts::UNTOUCHED));
        self.scheduler.choose(budget, &stale, (&self.world, &self.points, &self.field), cameras);
        stale
    }

    /// Traces the visible points whose AO may have changed, as far as they are chosen; what was done by chunk.
    fn trace(&mut self, first: bool) -> Vec<TraceTotals> {
        let total = self.points.total().into();
        let done = AtomicU64::new(0);
        let progress = |points: usize| {
            if first {
                let done = done.fetch_add(points as u64, Ordering::Relaxed) + points as u64;
                (self.progress)(Progress { work: Work::FirstFrame, done, total });
            }
        };
        let tracer = ChunkTracer {
            world: &self.world,
            points: &self.points,
            tracer: &self.tracer,
            shortcuts: self.shortcuts,
            remember: self.shortcuts.contains(Shortcuts::SELF_HITS) && self.memory[1] < self.memory[0],
            digs: self.digs,
        };
        let (parts, placed) = self.field.split();
        let scheduler = &self.scheduler;
        let traces = parts
            .into_par_iter()
            .enumerate()
            .map_init(Scratch::default, |scratch, (number, mut part)| {
                let traces = if scheduler.is_chosen(number) {
                    tracer.trace_part(&mut part, &placed, scratch)
                } else {
                    TraceTotals { visible: part.visible(), ..TraceTotals::default() }
                };
                progress(part.flags.len());
                traces
            })
            .collect();
        self.memory[1] = self.field.settle(self.memory[0]);
        traces
    }
}

/// Returns the largest number of blocks that clients get in a frame with a byte budget: those that take half of it if nothing
/// compresses them, at least one.
fn most_arrivals(budget: Budget) -> usize {
    (budget.bytes as usize / (2 * BLOCK_POINTS)).max(1)
}

/// Change of an AO byte after which it is found out again whether a point is buried. Whatever covers or uncovers a point
/// changes its AO by more.
const DIG_AGAIN: u8 = 8;

/// What the parts of a field are traced with.
struct ChunkTracer<'a> {
    world: &'a SceneBvh,
    points: &'a ScenePoints,
    tracer: &'a Tracer,
    shortcuts: Shortcuts,
    /// Whether points may remember more.
    remember: bool,
    /// Whether buried points are looked for.
    digs: bool,
}

impl ChunkTracer<'_> {
    /// Brings the AO of a part's visible points up to date; of all its points, where that is not left out.
    fn trace_part(
        &self,
        part: &mut FieldPart<'_>,
        placed: &PointPlaces<'_>,
        scratch: &mut Scratch,
    ) -> TraceTotals {
        let Self { world, tracer, shortcuts, remember, .. } = *self;
        let (untouched, alone) =
            (shortcuts.contains(Shortcuts::UNTOUCHED), shortcuts.contains(Shortcuts::ALONE));
        let instance = part.chunk.instance;
        let everywhere = !shortcuts.contains(Shortcuts::OUT_OF_VIEW) && world.is_present(instance);
        let remember = remember && !matches!(world.changes()[instance], InstanceChange::Deformed(_));
        let opaque = |body: BodyId, hit: &BlasHit| world.opaque(body, hit);
        let point_set = &self.points.sets()[world.scene().instances()[instance].rest().index()];
        let count = part.chunk.points.len();
        let mut traces = TraceTotals::default();
        for (index, point) in part.chunk.points.clone().enumerate() {
            let point = PointInSet(point as u32);
            let flags = &mut part.flags[index];
            let shown = is_shown(*flags);
            if shown {
                traces.visible += 1;
            } else if !everywhere {
                continue;
            }
            if *flags & flag::FRESH != 0 && untouched {
                continue;
            }
            let ray_frame = placed.ray_frame(world, instance, point);
            // A body that has nothing near it, then and now, sees what it saw: its points lie in its own space.
            let digs = self.digs && shown;
            let dug = part.dug[index];
            let unchanged = *flags & flag::ALONE != 0
                && alone
                && !(digs && dug == 0)
                && tracer.is_alone(world.bodies(), &ray_frame, scratch);
            if !unchanged {
                let memory = part.memory.of(index, count, remember);
                let key = self.points.ray_key(instance, point_set, point);
                let traced = tracer.trace(world.bodies(), key, &ray_frame, &opaque, memory, scratch);
                part.ao[index] = unorm::quantise(traced.ao);
                if let Some(exact) = part.exact.get_mut(index) {
                    *exact = traced.ao;
                }
                set(flags, flag::ALONE, traced.alone);
                let ao = part.ao[index].max(1);
                if digs && (dug == 0 || dug.abs_diff(ao) >= DIG_AGAIN) {
                    set(flags, flag::BURIED, tracer.is_buried(world, key, &ray_frame, &traced, scratch));
                    part.dug[index] = ao;
                }
                traces.traced += 1;
                traces.rays += u64::from(traced.rays);
            }
            *flags |= flag::FRESH;
        }
        traces
    }
}
