//! The stream that a server writes, of either profile.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameInfo, FrameKind, FrameMeta, StreamTime};
use psao_codec::surface::{self, EncoderSettings, Geometry};
use psao_codec::{Encoder, Layout, memory, paper};
use psao_proto::message::CameraPose;

use super::gathered::{Gathered, Needs, blocks_in_view};
use super::stats::{Lap, TraceTotals};
use super::tracing::Tracing;
use super::{FrameStats, ServerError, ServerSettings, StageMicros, StepOutput};
use crate::scene::Motion;

/// Decides what is sent, and writes it: the same for every profile.
#[derive(Debug)]
pub(super) struct Stream {
    pub(super) encoder: Encoder,
    coder: BlockCoder,
    /// Those of the last step.
    cameras: Vec<CameraPose>,
}

/// A frame to be written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<'a> {
    pub(super) index: FrameIndex,
    pub(super) time: StreamTime,
    pub(super) cameras: &'a [CameraPose],
}

/// A frame of which it is known what goes into it.
pub(super) struct Decided {
    pub(super) meta: FrameMeta,
    pub(super) stats: FrameStats,
}

impl Decided {
    /// `changed` points go into it; the time since the last lap went into finding them.
    pub(super) fn new(
        first: bool,
        frame: Frame<'_>,
        changed: u32,
        (traces, mut micros): (TraceTotals, StageMicros),
        lap: &mut Lap<'_>,
    ) -> Self {
        micros.decide = lap.micros();
        let kind = if first { FrameKind::Key } else { FrameKind::Delta };
        let meta = FrameMeta { kind, frame: frame.index, time: frame.time, changed_points: changed };
        Self { meta, stats: FrameStats { first, ..FrameStats::traced(traces, micros) } }
    }
}

impl StepOutput {
    /// A frame that was written in the time since the last lap.
    pub(super) fn new(body: Vec<u8>, info: FrameInfo, mut stats: FrameStats, lap: &mut Lap<'_>) -> Self {
        stats.micros.encode = lap.micros();
        stats.changed = info.changed_points;
        Self { body, info, stats }
    }
}

impl Stream {
    /// A stream that nothing was written of. `geometry` is that of the sets where points stay at rest.
    pub(super) fn new(
        tracing: &Tracing,
        layout: &Layout,
        geometry: Vec<Arc<Geometry>>,
        settings: &ServerSettings,
    ) -> Result<Self, ServerError> {
        let ServerSettings { threshold, geometry: source, coder, budget, .. } = *settings;
        let encoder = match layout {
            Layout::Paper(layout) => {
                let counts: Vec<u32> =
                    tracing.points.offsets().windows(2).map(|pair| pair[1] - pair[0]).collect();
                let instances = tracing.scene.instances().iter();
                let deforms: Vec<bool> =
                    instances.map(|instance| instance.motion() == Motion::Deforming).collect();
                let encoder = paper::Encoder::new(Arc::clone(layout), &counts)?;
                Encoder::Paper(Box::new(encoder.with_threshold(threshold, &deforms)))
            }
            Layout::Surface(layout) => {
                let settings = EncoderSettings { threshold, geometry: source, budget };
                Encoder::Surface(Box::new(surface::Encoder::new(Arc::clone(layout), geometry, settings)?))
            }
        };
        Ok(Self { encoder, coder, cameras: Vec::new() })
    }

    /// The last frame written; nothing before the first.
    pub(super) fn last(&self) -> Option<FrameIndex> {
        self.encoder.state().frame()
    }

    /// Bytes held.
    pub(super) fn heap_bytes(&self) -> usize {
        self.encoder.heap_bytes() + memory::list(&self.cameras)
    }

    /// Writes the frame of what was traced. The first one is a keyframe.
    pub(super) fn write(
        &mut self,
        tracing: &Tracing,
        frame: Frame<'_>,
        traced: (TraceTotals, StageMicros),
        lap: &mut Lap<'_>,
    ) -> Result<StepOutput, ServerError> {
        let first = self.last().is_none();
        let gathered = Gathered::new(tracing, frame.cameras, first, Needs::of(&self.encoder));
        self.write_gathered(gathered, first, frame, traced, lap)
    }

    /// Writes the frame of what was gathered.
    pub(super) fn write_gathered(
        &mut self,
        gathered: Gathered,
        first: bool,
        frame: Frame<'_>,
        traced: (TraceTotals, StageMicros),
        lap: &mut Lap<'_>,
    ) -> Result<StepOutput, ServerError> {
        let changed = gathered.give(&mut self.encoder)?;
        self.cameras = gathered.cameras;
        let decided = Decided::new(first, frame, changed, traced, lap);
        let EncodedFrame { body, info } = self.encoder.finish(decided.meta, self.coder)?;
        let (occupancy, postponed) = (self.encoder.occupancy(), self.encoder.postponed().copied());
        let stats = FrameStats { occupancy, postponed, ..decided.stats };
        Ok(StepOutput::new(body, info, stats, lap))
    }

    /// A keyframe of what clients hold, what the cameras of the last step see in a tracing first.
    pub(super) fn keyframe(
        &self,
        tracing: &Tracing,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        let first = blocks_in_view(tracing, &self.cameras);
        Ok(self.encoder.keyframe(frame, time, coder, &first)?)
    }
}
