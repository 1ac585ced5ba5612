//! A stream of profile `surface`: points stay on the mesh at rest, and only their AO is sent.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::frame::{EncodedFrame, FrameMeta};
use psao_codec::surface::{BLOCK_POINTS, Encoder, EncoderSettings, Geometry, Layout, keyframe};
use psao_proto::message::{CameraPose, MemberEntry, SetEntry};
use psao_proto::{Limits, SceneEntries, SceneTable};

use super::field::Chunk;
use super::grids::info;
use super::nearness::Nearness;
use super::tracing::Tracing;
use super::{ServerError, ServerSettings};
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

    /// Offers the AO of every visible point; how many of them the next frame sends. Before the first frame the order is
    /// that in which clients need them: what `cameras` see first, the nearest to the first of them before all.
    pub(super) fn decide(&mut self, tracing: &Tracing, cameras: &[CameraPose]) -> u32 {
        self.cameras.clear();
        self.cameras.extend_from_slice(cameras);
        let chunks = tracing.field.chunks();
        let order = if self.encoder.state().frame().is_none() {
            in_view_first(tracing, cameras)
        } else {
            (0..chunks.len()).collect()
        };
        let mut changed = 0;
        for chunk in order {
            for (_, point, ao) in tracing.field.visible(&chunks[chunk]) {
                changed += u32::from(self.encoder.offer(point, ao).unwrap_or(false));
            }
        }
        if self.encoder.settings().budget.is_some() {
            self.weigh(tracing, cameras);
        }
        changed
    }

    /// Weighs every block by how large its points are on the screen.
    fn weigh(&mut self, tracing: &Tracing, cameras: &[CameraPose]) {
        let near = Nearness::new(cameras);
        for Chunk { instance, points, .. } in tracing.field.chunks() {
            let at = tracing.world.placement(InstanceId(*instance as u32));
            let local = tracing.field.placed().local(*instance);
            let set = &tracing.points.sets()[tracing.scene.instances()[*instance].rest().index()];
            for first in points.clone().step_by(BLOCK_POINTS) {
                let last = points.end.min(first + BLOCK_POINTS) - 1;
                let middle = at.point(local[usize::midpoint(first, last)].position);
                self.encoder.weigh(*instance as u32, first / BLOCK_POINTS, near.weight(middle, set.radius()));
            }
        }
    }

    /// A keyframe of what clients hold, what the cameras of the last step saw first.
    pub(super) fn keyframe(
        &self,
        tracing: &Tracing,
        meta: FrameMeta,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        let blocks = |chunk: usize| {
            let Chunk { instance, points, .. } = &tracing.field.chunks()[chunk];
            let blocks = points.start / BLOCK_POINTS..points.end.div_ceil(BLOCK_POINTS);
            let instance = *instance as u32;
            blocks.map(move |block| (instance, block as u32))
        };
        let first: Vec<(u32, u32)> = in_view(tracing, &self.cameras).into_iter().flat_map(blocks).collect();
        Ok(keyframe(self.encoder.state(), meta, coder, &first)?)
    }

    /// Writes what clients need to be sent.
    pub(super) fn encode(&mut self, meta: FrameMeta) -> Result<EncodedFrame, ServerError> {
        Ok(self.encoder.finish(meta, self.coder)?)
    }
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
