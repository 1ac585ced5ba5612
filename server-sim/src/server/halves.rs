//! The server in two halves that work side by side: one traces a frame while the other writes the one before.

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_proto::message::{CameraPose, Edit};

use super::gathered::{Gathered, Needs};
use super::stats::{Lap, TraceTotals};
use super::stream::{Frame, Stream};
use super::tracing::Tracing;
use super::{FrameStats, RayBudget, Server, ServerError, SettingsError, StageMicros, StepOutput};
use crate::clock::Clock;
use crate::scene::EditError;

/// Moves the scene and traces its points.
pub struct TracingHalf {
    tracing: Tracing,
    /// What the encoder asks for.
    needs: Needs,
    /// Whether no frame was traced yet.
    first: bool,
}

/// Decides what of a traced frame is sent, and writes it.
pub struct WritingHalf {
    stream: Stream,
}

/// A frame that was traced and is to be written: in the order in which frames were traced, none left out.
#[derive(Debug)]
pub struct TracedFrame {
    index: FrameIndex,
    time: StreamTime,
    first: bool,
    gathered: Gathered,
    traces: TraceTotals,
    micros: StageMicros,
}

impl Server {
    /// Takes the server apart. What the halves write is what [`Server::step`] would.
    ///
    /// # Errors
    /// Gives back a server of profile `paper`, which is stepped as a whole.
    pub fn split(self) -> Result<(TracingHalf, WritingHalf), Box<Self>> {
        if self.stream.encoder.needs_places() {
            return Err(Box::new(self));
        }
        let Self { tracing, stream, .. } = self;
        let (needs, first) = (Needs::of(&stream.encoder), stream.last().is_none());
        Ok((TracingHalf { tracing, needs, first }, WritingHalf { stream }))
    }
}

impl TracingHalf {
    /// The first half of [`Server::step`].
    pub fn trace(
        &mut self,
        index: FrameIndex,
        time: StreamTime,
        views: &[CameraPose],
        clock: &dyn Clock,
    ) -> TracedFrame {
        let first = std::mem::replace(&mut self.first, false);
        let (traces, micros) = self.tracing.advance(time, views, first, &mut Lap::new(clock));
        let gathered = Gathered::new(&self.tracing, views, first, self.needs);
        TracedFrame { index, time, first, gathered, traces, micros }
    }

    /// As [`Server::edit`]: changes the scene from the next traced frame on.
    ///
    /// # Errors
    /// As [`Server::edit`].
    pub fn edit(&mut self, edit: &Edit) -> Result<bool, EditError> {
        self.tracing.edits.apply(edit)
    }

    /// As [`Server::set_ray_budget`].
    ///
    /// # Errors
    /// As [`Server::set_ray_budget`].
    pub fn set_ray_budget(&mut self, budget: Option<RayBudget>) -> Result<(), SettingsError> {
        self.tracing.set_ray_budget(budget)
    }
}

impl WritingHalf {
    /// The second half of [`Server::step`].
    ///
    /// # Errors
    /// As [`Server::step`].
    pub fn write(&mut self, traced: TracedFrame, clock: &dyn Clock) -> Result<StepOutput, ServerError> {
        let TracedFrame { index, time, first, gathered, traces, micros } = traced;
        let frame = Frame { index, time, cameras: &[] };
        self.stream.write_gathered(gathered, first, frame, (traces, micros), &mut Lap::new(clock))
    }

    /// The state that clients hold after the last frame written.
    #[must_use]
    pub fn state(&self) -> StateRef<'_> {
        self.stream.encoder.state()
    }

    /// As [`Server::keyframe`], of the last frame written; its blocks are in the order of the layout.
    ///
    /// # Errors
    /// As [`Server::keyframe`].
    pub fn keyframe(
        &self,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        Ok(self.stream.encoder.keyframe(frame, time, coder, &[])?)
    }
}

impl TracedFrame {
    /// What it took so far: nothing is known of what will be sent.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        FrameStats { first: self.first, ..FrameStats::traced(self.traces, self.micros) }
    }
}

impl std::fmt::Debug for TracingHalf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TracingHalf").field("scene", &self.tracing.scene.name()).finish_non_exhaustive()
    }
}

impl std::fmt::Debug for WritingHalf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("WritingHalf")
            .field("frame", &self.stream.encoder.state().frame())
            .finish_non_exhaustive()
    }
}
