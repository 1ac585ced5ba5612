//! The encode stage: decides what of a traced frame is sent, and writes it.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::{Encoder, StateRef};
use psao_proto::SceneTable;
use psao_proto::message::Budget;

use super::stats::Lap;
use super::traced_frame::TracedFrame;
use super::{FrameStats, ServerError, StepOutput};
use crate::clock::Clock;

/// Decides what of a traced frame is sent, and writes it: the second stage of a [`Server`](super::Server).
#[derive(Debug)]
pub struct EncodeStage {
    pub(super) encoder: Encoder,
    table: Arc<SceneTable>,
    coder: BlockCoder,
}

impl EncodeStage {
    /// Makes the stage of a stream of which nothing was written.
    pub(super) fn new(encoder: Encoder, table: SceneTable, coder: BlockCoder) -> Self {
        Self { encoder, table: Arc::new(table), coder }
    }

    /// Writes a traced frame. The first one is a keyframe. `clock` is read between the parts.
    ///
    /// # Errors
    /// A frame index that does not grow, or a scene whose geometry is not finite at that time.
    pub fn encode(&mut self, traced: TracedFrame, clock: &dyn Clock) -> Result<StepOutput, ServerError> {
        self.encode_lap(traced, &mut Lap::new(clock))
    }

    /// As [`encode`](Self::encode); the time since the last lap counts.
    pub(super) fn encode_lap(
        &mut self,
        traced: TracedFrame,
        lap: &mut Lap<'_>,
    ) -> Result<StepOutput, ServerError> {
        let (mut stats, traces) = (traced.stats(), traced.traces);
        let changed_points = traced.give(&mut self.encoder)?;
        stats.micros.decide += lap.micros();
        let kind = if stats.first { FrameKind::Key } else { FrameKind::Delta };
        let (frame, time) = (traces.index, traces.time);
        let meta = FrameMeta { kind, frame, time, changed_points };
        let EncodedFrame { body, info } = self.encoder.finish(meta, self.coder)?;
        stats.micros.encode = lap.micros();
        let (occupancy, postponed) = (self.encoder.occupancy(), self.encoder.postponed().copied());
        let stats = FrameStats { changed: info.changed_points, occupancy, postponed, ..stats };
        let budget = self.encoder.as_surface().and_then(|encoder| encoder.settings().budget);
        let budget = budget.zip(postponed).map(|(budget, left)| Budget::of_frame(info.frame, budget, left));
        Ok(StepOutput { body, info, stats, budget })
    }

    /// Makes a keyframe of the last frame's state, for a client that joins or lost something. It carries the last frame's index
    /// and the state's hash, so the updates that follow fit. Its blocks are in the order of the layout.
    ///
    /// # Errors
    /// [`EncodeError`] when a count is over its limit.
    pub fn keyframe(
        &self,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, EncodeError> {
        self.encoder.keyframe(frame, time, coder, &[])
    }

    /// Returns the state that clients hold after the last frame.
    #[must_use]
    pub fn state(&self) -> StateRef<'_> {
        self.encoder.state()
    }

    /// Returns what clients are told first.
    #[must_use]
    pub fn table(&self) -> &Arc<SceneTable> {
        &self.table
    }

    /// Returns the block coder of the stream.
    #[must_use]
    pub fn coder(&self) -> BlockCoder {
        self.coder
    }
}
