//! A stream of profile `paper`: points by their place in cells, sent again when AO or place changed by enough.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameKind, FrameMeta};
use psao_codec::memory;
use psao_codec::paper::{self, Grid, Layout, PointFormat, PointSample, Pose};
use rayon::prelude::*;

use super::field::{Chunk, Placed};
use super::tracing::Tracing;
use super::{ServerError, ServerSettings};
use crate::bvh::Stir;
use crate::delta::{ResendAo, place_changed};
use crate::scene::Motion;

/// Encoder of the stream, and what it was given last.
///
/// The encoder knows a point by its number in the order in which points were made, whatever order they are kept in:
/// so the bytes are the same.
#[derive(Debug)]
pub(super) struct CellsStream {
    pub(super) encoder: paper::Encoder,
    pub(super) sent: Sent,
    layout: Arc<Layout>,
    threshold: u8,
    coder: BlockCoder,
    /// What the next frame sends, by ascending id.
    changed: Vec<(u32, PointSample)>,
}

/// What clients were sent last.
#[derive(Debug)]
pub(super) struct Sent {
    /// By id of the encoder: the byte that clients hold once the point is packed; nothing where it was never sent.
    ao: Vec<Option<u8>>,
    /// Position and normal of the points of deforming instances, by instance and number; those of others never change.
    places: Vec<Vec<(glam::Vec3, glam::Vec3)>>,
}

impl CellsStream {
    pub(super) fn new(
        tracing: &Tracing,
        layout: &Arc<Layout>,
        settings: &ServerSettings,
    ) -> Result<Self, ServerError> {
        let counts: Vec<u32> = tracing.points.firsts().windows(2).map(|pair| pair[1] - pair[0]).collect();
        Ok(Self {
            encoder: paper::Encoder::new(Arc::clone(layout), &counts)?,
            sent: Sent::new(tracing),
            layout: Arc::clone(layout),
            threshold: settings.threshold,
            coder: settings.coder,
            changed: Vec::new(),
        })
    }

    /// Bytes held.
    pub(super) fn held(&self) -> usize {
        let Sent { ao, places } = &self.sent;
        let places = memory::list(places) + places.iter().map(memory::list).sum::<usize>();
        self.encoder.memory_bytes() + memory::list(ao) + places + memory::list(&self.changed)
    }

    /// Finds the visible points that were never sent, or differ by enough from what was; how many they are.
    pub(super) fn decide(&mut self, tracing: &Tracing) -> u32 {
        let field = &tracing.field;
        let placed = field.placed();
        let decide = |chunk: &Chunk| self.decide_chunk(tracing, chunk, &placed);
        let changed: Vec<Vec<(u32, PointSample)>> = field.chunks().par_iter().map(decide).collect();
        self.changed = changed.concat();
        self.changed.sort_unstable_by_key(|(id, _)| *id);
        self.changed.len() as u32
    }

    fn decide_chunk(&self, tracing: &Tracing, chunk: &Chunk, placed: &Placed<'_>) -> Vec<(u32, PointSample)> {
        let instance = chunk.instance;
        let (local, places) = (placed.local(instance), &self.sent.places[instance]);
        let grid: &Grid = &self.layout.instances()[instance].grid;
        let numbers = tracing.numbers(instance);
        let resend = ResendAo { threshold: self.threshold, format: self.layout.format() };
        let mut changed = Vec::new();
        for (place, _, ao) in tracing.field.visible(chunk) {
            let (at, number) = (&local[place], numbers[place]);
            let id = tracing.points.firsts()[instance] + number;
            let moved = || {
                let sent = places.get(number as usize);
                sent.is_some_and(|&sent| place_changed(grid, (at.position, at.normal), sent))
            };
            let sent = self.sent.ao[id as usize];
            if sent.is_none_or(|sent| resend.is_due(ao, sent)) || moved() {
                let (local, normal) = (at.position.to_array(), at.normal.to_array());
                changed.push((id, PointSample { local, normal, ao }));
            }
        }
        changed
    }

    /// Writes what [`CellsStream::decide`] found, and the poses that changed.
    pub(super) fn encode(&mut self, tracing: &Tracing, meta: FrameMeta) -> Result<EncodedFrame, ServerError> {
        for (instance, at) in tracing.pose.instances().iter().enumerate() {
            if meta.kind == FrameKind::Key || tracing.world.stirs()[instance] != Stir::Still {
                let (translation, rotation) =
                    (at.frame().translation.to_array(), at.frame().rotation.to_array());
                self.encoder.set_pose(instance as u32, Pose { translation, rotation })?;
            }
        }
        for (point, sample) in &self.changed {
            self.encoder.put(*point, sample)?;
        }
        self.sent.remember(tracing.points.firsts(), &self.changed, self.layout.format());
        self.encoder.retry_unplaced();
        Ok(self.encoder.finish(meta, self.coder)?)
    }
}

impl Sent {
    fn new(tracing: &Tracing) -> Self {
        let places = tracing.scene.instances().iter().enumerate().map(|(index, instance)| {
            let deforms = instance.motion() == Motion::Deforming;
            let count = if deforms { tracing.numbers(index).len() } else { 0 };
            // Compared with only where the point was sent, and known then.
            vec![(glam::Vec3::ZERO, glam::Vec3::ZERO); count]
        });
        Self { ao: vec![None; tracing.points.total() as usize], places: places.collect() }
    }

    /// AO byte of a point as last sent, by id of the encoder.
    pub(super) fn ao(&self, id: u32) -> Option<u8> {
        self.ao[id as usize]
    }

    /// Place of a point as last sent; nothing for instances whose points stay where they are.
    #[cfg(test)]
    pub(super) fn place(&self, instance: usize, number: usize) -> Option<(glam::Vec3, glam::Vec3)> {
        self.places[instance].get(number).copied()
    }

    /// Notes what is being sent.
    fn remember(&mut self, firsts: &[u32], changed: &[(u32, PointSample)], format: PointFormat) {
        for (point, sample) in changed {
            self.ao[*point as usize] = Some(format.held_ao(sample.ao));
            let instance = firsts.partition_point(|first| first <= point) - 1;
            let number = (point - firsts[instance]) as usize;
            if let Some(place) = self.places[instance].get_mut(number) {
                *place = (sample.local.into(), sample.normal.into());
            }
        }
    }
}
