//! The trace stage: moves the scene and traces its points, frame by frame.

use std::fmt;

use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_proto::message::{CameraPose, Edit};

use super::stats::Lap;
use super::trace_state::TraceState;
use super::traced_frame::{EncoderNeeds, TracedFrame};
use super::{RayBudget, SettingsError};
use crate::clock::Clock;
use crate::points::ScenePoints;
use crate::scene::{EditError, Edits};
use crate::world::SceneBvh;

/// Moves the scene and traces its points: the first stage of a [`Server`](super::Server).
pub struct TraceStage {
    pub(super) state: TraceState,
    needs: EncoderNeeds,
    /// Whether the next frame is the stream's first.
    pub(super) first: bool,
}

impl TraceStage {
    /// Makes the stage of a stream before its first frame.
    pub(super) fn new(state: TraceState, needs: EncoderNeeds) -> Self {
        Self { state, needs, first: true }
    }

    /// Traces a frame: brings the points that one of `views` sees up to date, and returns all that the encoder needs of them.
    /// Without a view every point counts as seen; in the first frame, all points that clients get are traced. `clock`
    /// is read between the parts.
    ///
    /// Every traced frame must be encoded, in the order in which they were traced.
    pub fn trace(
        &mut self,
        index: FrameIndex,
        time: StreamTime,
        views: &[CameraPose],
        clock: &dyn Clock,
    ) -> TracedFrame {
        let mut lap = Lap::new(clock);
        let mut traced = self.trace_lap((index, time), views, &mut lap);
        // Gathering is part of deciding, of which the encode stage does the rest.
        traced.traces.micros.decide = lap.micros();
        traced
    }

    /// Traces a frame as [`trace`](Self::trace) does. The time since the last lap counts; gathering is in the next one.
    pub(super) fn trace_lap(
        &mut self,
        frame: (FrameIndex, StreamTime),
        views: &[CameraPose],
        lap: &mut Lap<'_>,
    ) -> TracedFrame {
        let first = std::mem::replace(&mut self.first, false);
        let traces = self.state.advance(frame, views, first, lap);
        TracedFrame::new(&self.state, traces, self.needs)
    }

    /// Changes the scene from the next traced frame on; returns whether it changed anything. Any number of edits may come
    /// before a frame: it sees where they end.
    ///
    /// The AO follows: of the instance itself, of what it stands near now and of what it stood near before. The first
    /// time that a static instance moves or hides, it is taken out of the structure that all static ones share.
    ///
    /// # Errors
    /// As [`Edits::apply`]; nothing has changed then.
    pub fn edit(&mut self, edit: &Edit) -> Result<bool, EditError> {
        self.state.edits.apply(edit)
    }

    /// Sets how many rays frames may take from the next one on: for live servers, which learn what they have time for
    /// ([`FrameTimeController`](super::FrameTimeController)). The bytes then depend on what was set when.
    ///
    /// # Errors
    /// [`SettingsError::RayBudget`].
    pub fn set_ray_budget(&mut self, budget: Option<RayBudget>) -> Result<(), SettingsError> {
        if budget.is_some_and(|budget| budget.rays == 0) {
            return Err(SettingsError::RayBudget);
        }
        self.state.ray_budget = budget;
        Ok(())
    }

    /// Returns the edits in force from the next frame on.
    #[must_use]
    pub fn edits(&self) -> &Edits {
        &self.state.edits
    }

    /// Returns the scene as of the last traced frame, edits included.
    #[must_use]
    pub fn world(&self) -> &SceneBvh {
        &self.state.world
    }

    /// Returns the points.
    #[must_use]
    pub fn points(&self) -> &ScenePoints {
        &self.state.points
    }
}

impl fmt::Debug for TraceStage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TraceStage")
            .field("scene", &self.state.scene.name())
            .field("points", &self.state.points.total())
            .finish_non_exhaustive()
    }
}
