//! One frame of the loop, stage by stage.

use std::sync::atomic::{AtomicU64, Ordering};

use psao_codec::cells::{Grid, PointSample};
use psao_codec::frame::{FrameIndex, FrameKind, FrameMeta, Pose, StreamTime};
use psao_codec::quant::unorm;
use psao_proto::message::CameraPose;
use rayon::prelude::*;

use super::field::{Field, Part, Placed, flag, set};
use super::stats::{FrameStats, Progress, StageMicros, Work};
use super::{Sent, Server, ServerError, StepOutput};
use crate::ao::{Scratch, Tracer};
use crate::bvh::{BlasHit, Stir, World};
use crate::clock::Clock;
use crate::delta::{ao_changed, place_changed};
use crate::visibility::Views;

/// What tracing did, added up.
#[derive(Clone, Copy, Debug, Default)]
struct Traces {
    visible: u32,
    traced: u32,
    rays: u64,
}

impl Server {
    /// Computes one frame: the points that one of `views` sees are brought up to date, and those that changed by
    /// enough are written. Without a view every point counts as seen. The first frame is a keyframe with every point
    /// of the scene, whatever the views. `clock` is read between the stages.
    ///
    /// # Errors
    /// A frame index that does not grow, or a scene whose geometry is not finite at that time.
    pub fn step(
        &mut self,
        frame: FrameIndex,
        time: StreamTime,
        views: &[CameraPose],
        clock: &dyn Clock,
    ) -> Result<StepOutput, ServerError> {
        let mut lap = Lap::new(clock);
        let first = self.encoder.state().frame().is_none();
        self.scene.pose_into(time.micros() as f64 * 1e-6, &mut self.pose);
        let mut micros = StageMicros { pose: lap.micros(), ..StageMicros::default() };
        self.world.update(&self.pose);
        micros.bvh = lap.micros();
        self.field.place(&self.world, &self.points, false);
        let views = if first { None } else { Views::new(views, self.settings.view_margin) };
        let ao = &self.settings.ao;
        self.field.mark(&self.world, views.as_ref(), ao.bias(), ao.influence());
        micros.place = lap.micros();
        let traces = self.trace(first);
        micros.trace = lap.micros();
        let changed = self.decide();
        micros.decide = lap.micros();
        let count = changed.len() as u32;
        let encoded = self.encode(frame, time, first, &changed)?;
        micros.encode = lap.micros();
        let Traces { visible, traced, rays } = traces;
        let occupancy = self.encoder.counts();
        let stats = FrameStats { visible, traced, rays, changed: count, occupancy, micros };
        Ok(StepOutput { body: encoded.body, info: encoded.info, stats })
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
        let (world, tracer, exhaustive) = (&self.world, &self.tracer, self.settings.exhaustive);
        let (parts, placed) = self.field.split();
        let traces: Vec<Traces> = parts
            .into_par_iter()
            .map_init(Scratch::default, |scratch, mut part| {
                let traces = trace_part(&mut part, &placed, world, tracer, exhaustive, scratch);
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

    /// The points to send, ascending, as they are now.
    fn decide(&mut self) -> Vec<(u32, PointSample)> {
        let (sent, threshold, layout) = (&self.sent, self.settings.threshold, self.table.layout());
        let (parts, placed) = self.field.split();
        let changed: Vec<Vec<(u32, PointSample)>> = parts
            .into_par_iter()
            .map(|part| {
                decide_part(&part, &placed, sent, &layout.instances()[part.chunk.instance].grid, threshold)
            })
            .collect();
        changed.concat()
    }

    /// Puts the changed points and poses into the stream.
    fn encode(
        &mut self,
        frame: FrameIndex,
        time: StreamTime,
        first: bool,
        changed: &[(u32, PointSample)],
    ) -> Result<psao_codec::frame::EncodedFrame, ServerError> {
        for (instance, at) in self.pose.instances().iter().enumerate() {
            if first || self.world.stirs()[instance] != Stir::Still {
                let (translation, rotation) =
                    (at.frame().translation.to_array(), at.frame().rotation.to_array());
                self.encoder.set_pose(instance as u32, Pose { translation, rotation })?;
            }
        }
        for (point, sample) in changed {
            self.encoder.put(*point, sample)?;
        }
        self.sent.remember(&mut self.field, changed);
        self.encoder.retry_homeless();
        let kind = if first { FrameKind::Key } else { FrameKind::Delta };
        let meta = FrameMeta { kind, frame, time, changed_points: changed.len() as u32 };
        Ok(self.encoder.finish(meta, self.settings.coder)?)
    }
}

/// Brings the AO of a part's visible points up to date.
fn trace_part(
    part: &mut Part<'_>,
    placed: &Placed<'_>,
    world: &World,
    tracer: &Tracer,
    exhaustive: bool,
    scratch: &mut Scratch,
) -> Traces {
    let instance = part.chunk.instance;
    let opaque = |body: u32, hit: &BlasHit| world.opaque(body, hit);
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
            let traced = tracer.trace(world.bodies(), part.first + index as u32, &seat, &opaque, scratch);
            part.ao[index] = unorm::quantise(traced.ao);
            set(flags, flag::ALONE, traced.alone);
            traces.traced += 1;
            traces.rays += u64::from(traced.rays);
        }
        *flags |= flag::FRESH;
    }
    traces
}

/// The visible points of a part that were never sent, or differ by enough from what was.
fn decide_part(
    part: &Part<'_>,
    placed: &Placed<'_>,
    sent: &Sent,
    grid: &Grid,
    threshold: u8,
) -> Vec<(u32, PointSample)> {
    let instance = part.chunk.instance;
    let local = placed.local(instance);
    let places = &sent.places[instance];
    let mut changed = Vec::new();
    for (index, point) in part.chunk.points.clone().enumerate() {
        let flags = part.flags[index];
        if flags & flag::VISIBLE == 0 {
            continue;
        }
        let id = part.first + index as u32;
        let (at, ao) = (&local[point], part.ao[index]);
        let moved =
            || places.get(point).is_some_and(|&sent| place_changed(grid, (at.position, at.normal), sent));
        if flags & flag::SENT == 0 || ao_changed(ao, sent.ao[id as usize], threshold) || moved() {
            changed
                .push((id, PointSample { local: at.position.to_array(), normal: at.normal.to_array(), ao }));
        }
    }
    changed
}

impl Sent {
    /// Notes what is being sent.
    fn remember(&mut self, field: &mut Field, changed: &[(u32, PointSample)]) {
        for (point, sample) in changed {
            self.ao[*point as usize] = sample.ao;
            let (instance, index) = field.mark_sent(*point);
            if let Some(place) = self.places[instance].get_mut(index) {
                *place = (sample.local.into(), sample.normal.into());
            }
        }
    }
}

/// Reads a clock between stages.
struct Lap<'a> {
    clock: &'a dyn Clock,
    last: u64,
}

impl<'a> Lap<'a> {
    fn new(clock: &'a dyn Clock) -> Self {
        Self { clock, last: clock.micros() }
    }

    /// Microseconds since the last call.
    fn micros(&mut self) -> u64 {
        let now = self.clock.micros();
        let lap = now.saturating_sub(self.last);
        self.last = now;
        lap
    }
}
