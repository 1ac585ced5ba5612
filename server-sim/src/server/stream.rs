//! The stream that a server writes, of either profile.

use psao_codec::block::BlockCoder;
use psao_codec::cells::Occupancy;
use psao_codec::frame::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime, keyframe};
use psao_codec::stream::StateRef;
use psao_codec::surface::Postponed;
use psao_proto::message::CameraPose;

use super::cells::CellsStream;
use super::surface::SurfaceStream;
use super::tracing::Tracing;
use super::{FrameStats, ServerError, StepOutput};
use crate::server::stats::{Lap, StageMicros};
use crate::server::tracing::Traces;

/// Decides what is sent, and writes it.
#[derive(Debug)]
pub(super) enum Stream {
    Cells(Box<CellsStream>),
    Surface(Box<SurfaceStream>),
}

/// A frame to be written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<'a> {
    pub(super) index: FrameIndex,
    pub(super) time: StreamTime,
    pub(super) cameras: &'a [CameraPose],
}

impl Stream {
    /// The last frame written; nothing before the first.
    pub(super) fn last(&self) -> Option<FrameIndex> {
        self.state().frame()
    }

    /// What clients hold.
    pub(super) fn state(&self) -> StateRef<'_> {
        match self {
            Self::Cells(stream) => stream.encoder.state().into(),
            Self::Surface(stream) => stream.encoder.state().into(),
        }
    }

    /// How full the paper's tables are; nothing in profile `surface`, which has none.
    pub(super) fn occupancy(&self) -> Option<Occupancy> {
        match self {
            Self::Cells(stream) => Some(stream.encoder.counts()),
            Self::Surface(_) => None,
        }
    }

    /// What the last frame left for later; nothing without a byte budget.
    fn postponed(&self) -> Option<Postponed> {
        match self {
            Self::Cells(_) => None,
            Self::Surface(stream) => stream.encoder.postponed().copied(),
        }
    }

    /// Writes the frame of what was traced. The first one is a keyframe.
    pub(super) fn write(
        &mut self,
        tracing: &Tracing,
        frame: Frame<'_>,
        (traces, mut micros): (Traces, StageMicros),
        lap: &mut Lap<'_>,
    ) -> Result<StepOutput, ServerError> {
        let kind = if self.last().is_none() { FrameKind::Key } else { FrameKind::Delta };
        let changed = match self {
            Self::Cells(stream) => stream.decide(tracing),
            Self::Surface(stream) => stream.decide(tracing, frame.cameras),
        };
        micros.decide = lap.micros();
        let meta = FrameMeta { kind, frame: frame.index, time: frame.time, changed_points: changed };
        let EncodedFrame { body, info } = match self {
            Self::Cells(stream) => stream.encode(tracing, meta)?,
            Self::Surface(stream) => stream.encode(meta)?,
        };
        micros.encode = lap.micros();
        let Traces { visible, traced, rays } = traces;
        let (occupancy, postponed) = (self.occupancy(), self.postponed());
        let changed = info.changed_points;
        let stats = FrameStats { visible, traced, rays, changed, postponed, occupancy, micros };
        Ok(StepOutput { body, info, stats })
    }

    /// A keyframe of what clients hold.
    pub(super) fn keyframe(
        &self,
        tracing: &Tracing,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        let meta = |changed_points| FrameMeta { kind: FrameKind::Key, frame, time, changed_points };
        match self {
            Self::Cells(stream) => {
                let meta = meta(stream.encoder.counts().points_stored);
                Ok(keyframe(stream.encoder.state(), meta, coder)?)
            }
            Self::Surface(stream) => {
                let points = stream.encoder.state().present_points();
                stream.keyframe(tracing, meta(u32::try_from(points).unwrap_or(u32::MAX)), coder)
            }
        }
    }
}
