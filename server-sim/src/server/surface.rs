//! A stream of profile `surface`: points stay on the mesh at rest, and only their AO is sent.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::memory;
use psao_codec::surface::{BLOCK_POINTS, Encoder, EncoderSettings, Geometry, Layout, keyframe};
use psao_proto::message::{CameraPose, MemberEntry, SetEntry};
use psao_proto::{Limits, SceneEntries, SceneTable};

use super::field::Chunk;
use super::grids::info;
use super::nearness::Nearness;
use super::stats::Lap;
use super::stream::{Decided, Frame};
use super::tracing::{Traces, Tracing};
use super::{FrameStats, ServerError, ServerSettings, StageMicros, StepOutput};
use crate::points::ScenePoints;
use crate::scene::{InstanceId, Scene};
use crate::visibility::Overlap;

/// Encoder of the stream.
#[derive(Debug)]
pub(super) struct SurfaceStream {
    pub(super) encoder: Encoder,
    coder: BlockCoder,
    /// Those of the last step.
    cameras: Vec<CameraPose>,
}

/// The scene table of a stream whose points are in the order of `geometry`, one for every set.
pub(super) fn table(
    scene: &Scene,
    points: &ScenePoints,
    geometry: &[Arc<Geometry>],
    settings: &ServerSettings,
    limits: &Limits,
) -> Result<SceneTable, ServerError> {
    let sets: Vec<SetEntry> = geometry.iter().map(|geometry| SetEntry::from(geometry.layout())).collect();
    let member = |instance: &crate::scene::Instance| MemberEntry {
        set: instance.rest().index() as u32,
        needs: instance.needs(),
    };
    let members = scene.instances().iter().map(member).collect();
    let mut info = info(scene, points, settings)?;
    info.set_count = sets.len() as u32;
    info.geometry = settings.geometry.into();
    Ok(SceneTable::new(info, SceneEntries::Surface { sets, members }, limits)?)
}

impl SurfaceStream {
    pub(super) fn new(
        layout: &Arc<Layout>,
        geometry: Vec<Arc<Geometry>>,
        settings: &ServerSettings,
    ) -> Result<Self, ServerError> {
        let ServerSettings { threshold, geometry: source, coder, budget, .. } = *settings;
        let encoder = EncoderSettings { threshold, geometry: source, budget };
        let encoder = Encoder::new(Arc::clone(layout), geometry, encoder)?;
        Ok(Self { encoder, coder, cameras: Vec::new() })
    }

    /// Bytes held.
    pub(super) fn held(&self) -> usize {
        self.encoder.memory_bytes() + memory::list(&self.cameras)
    }

    /// Offers what was gathered; how many points the next frame sends.
    fn decide(&mut self, gathered: Gathered) -> u32 {
        let mut changed = 0;
        for (point, ao) in gathered.points {
            changed += u32::from(self.encoder.set_ao(point, ao).unwrap_or(false));
        }
        for (instance, block, weight) in gathered.weights {
            self.encoder.weigh(instance, block, weight);
        }
        self.cameras = gathered.cameras;
        changed
    }

    /// Whether points are weighed.
    pub(super) fn is_weighed(&self) -> bool {
        self.encoder.settings().budget.is_some()
    }

    /// Writes the frame of what was gathered.
    pub(super) fn write(
        &mut self,
        gathered: Gathered,
        first: bool,
        frame: Frame<'_>,
        traced: (Traces, StageMicros),
        lap: &mut Lap<'_>,
    ) -> Result<StepOutput, ServerError> {
        let changed = self.decide(gathered);
        let decided = Decided::new(first, frame, changed, traced, lap);
        let EncodedFrame { body, info } = self.encoder.finish(decided.meta, self.coder)?;
        let stats = FrameStats { postponed: self.encoder.postponed().copied(), ..decided.stats };
        Ok(StepOutput::new(body, info, stats, lap))
    }

    /// Blocks that the cameras of the last step see in a tracing, the nearest first.
    pub(super) fn in_view(&self, tracing: &Tracing) -> Vec<(u32, u32)> {
        let blocks = |chunk: usize| {
            let Chunk { instance, points, .. } = &tracing.field.chunks()[chunk];
            let blocks = points.start / BLOCK_POINTS..points.end.div_ceil(BLOCK_POINTS);
            let instance = *instance as u32;
            blocks.map(move |block| (instance, block as u32))
        };
        in_view(tracing, &self.cameras).into_iter().flat_map(blocks).collect()
    }

    /// A keyframe of what clients hold, some blocks first.
    pub(super) fn keyframe(
        &self,
        blocks_first: &[(u32, u32)],
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        let changed_points = u32::try_from(self.encoder.state().present_points()).unwrap_or(u32::MAX);
        let meta = FrameMeta { kind: FrameKind::Key, frame, time, changed_points };
        Ok(keyframe(self.encoder.state(), meta, coder, blocks_first)?)
    }
}

/// What a stream takes from the points of a frame; with it, the next frame can be traced while this one is written.
#[derive(Debug)]
pub(super) struct Gathered {
    /// Points in view and their AO.
    points: Vec<(u32, u8)>,
    /// Instance, block and how large its points are on the screen; only with a byte budget.
    weights: Vec<(u32, usize, u16)>,
    cameras: Vec<CameraPose>,
}

impl Gathered {
    /// What is in view. In the first frame the order is that in which clients need it: what `cameras` see first, the
    /// nearest to the first of them before all.
    pub(super) fn new(tracing: &Tracing, cameras: &[CameraPose], first: bool, weighed: bool) -> Self {
        let chunks = tracing.field.chunks();
        let order = if first { in_view_first(tracing, cameras) } else { (0..chunks.len()).collect() };
        let seen = |chunk: usize| tracing.field.visible(&chunks[chunk]).map(|(_, point, ao)| (point, ao));
        let points = order.into_iter().flat_map(seen).collect();
        let weights = if weighed { weights(tracing, cameras) } else { Vec::new() };
        Self { points, weights, cameras: cameras.to_vec() }
    }
}

/// Weight of every block: how large its points are on the screen.
fn weights(tracing: &Tracing, cameras: &[CameraPose]) -> Vec<(u32, usize, u16)> {
    let near = Nearness::new(cameras);
    let mut weights = Vec::new();
    for Chunk { instance, points, .. } in tracing.field.chunks() {
        let at = tracing.world.placement(InstanceId(*instance as u32));
        let local = tracing.field.placed().local(*instance);
        let set = &tracing.points.sets()[tracing.scene.instances()[*instance].rest().index()];
        for first in points.clone().step_by(BLOCK_POINTS) {
            let last = points.end.min(first + BLOCK_POINTS) - 1;
            let middle = at.point(local[usize::midpoint(first, last)].position);
            weights.push((*instance as u32, first / BLOCK_POINTS, near.weight(middle, set.radius())));
        }
    }
    weights
}

/// Numbers of all chunks: those in view first, then the others in their order.
pub(super) fn in_view_first(tracing: &Tracing, cameras: &[CameraPose]) -> Vec<usize> {
    let mut order = in_view(tracing, cameras);
    let mut waiting = vec![true; tracing.field.chunks().len()];
    order.iter().for_each(|&chunk| waiting[chunk] = false);
    order.extend((0..waiting.len()).filter(|&chunk| waiting[chunk]));
    order
}

/// Numbers of the chunks that some camera sees, by their distance from the first camera.
fn in_view(tracing: &Tracing, cameras: &[CameraPose]) -> Vec<usize> {
    let (Some(views), [camera, ..]) = (tracing.views(cameras), cameras) else { return Vec::new() };
    let eye = camera.eye.into();
    let seen = |(number, chunk): (usize, &Chunk)| {
        let bounds = tracing.field.bounds(&tracing.world, chunk);
        let middle = (bounds.min() + bounds.max()) * 0.5;
        let outside = views.overlap(middle, bounds.size().length() * 0.5) == Overlap::Outside;
        (!outside).then(|| (bounds.distance_squared(eye), number))
    };
    let mut order: Vec<(f32, usize)> = tracing.field.chunks().iter().enumerate().filter_map(seen).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().map(|(_, number)| number).collect()
}
