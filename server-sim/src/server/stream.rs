//! The stream that a server writes, of either profile.

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameInfo, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::keyframe;
use psao_proto::message::CameraPose;

use super::cells::CellsStream;
use super::surface::{Gathered, SurfaceStream};
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
        (traces, mut micros): (Traces, StageMicros),
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

    /// Bytes held.
    pub(super) fn held(&self) -> usize {
        match self {
            Self::Cells(stream) => stream.held(),
            Self::Surface(stream) => stream.held(),
        }
    }

    /// Writes the frame of what was traced. The first one is a keyframe.
    pub(super) fn write(
        &mut self,
        tracing: &Tracing,
        frame: Frame<'_>,
        traced: (Traces, StageMicros),
        lap: &mut Lap<'_>,
    ) -> Result<StepOutput, ServerError> {
        let first = self.last().is_none();
        match self {
            Self::Cells(stream) => {
                let changed = stream.decide(tracing);
                let decided = Decided::new(first, frame, changed, traced, lap);
                let EncodedFrame { body, info } = stream.encode(tracing, decided.meta)?;
                let stats = FrameStats { occupancy: Some(stream.encoder.counts()), ..decided.stats };
                Ok(StepOutput::new(body, info, stats, lap))
            }
            Self::Surface(stream) => {
                let gathered = Gathered::new(tracing, frame.cameras, first, stream.is_weighed());
                stream.write(gathered, first, frame, traced, lap)
            }
        }
    }

    /// A keyframe of what clients hold.
    pub(super) fn keyframe(
        &self,
        tracing: &Tracing,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        match self {
            Self::Cells(stream) => {
                let changed_points = stream.encoder.counts().points_stored;
                let meta = FrameMeta { kind: FrameKind::Key, frame, time, changed_points };
                Ok(keyframe(stream.encoder.state(), meta, coder)?)
            }
            Self::Surface(stream) => stream.keyframe(&stream.in_view(tracing), frame, time, coder),
        }
    }
}
