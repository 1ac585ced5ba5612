//! The frame loop: pose, structures, points, rays, what changed, one frame body (paper, section 3.3).
//!
//! A [`Server`] is two stages. The [`TraceStage`] moves the scene and traces its points; the [`EncodeStage`] decides what is
//! sent, and writes it. [`Server::step`] runs one after the other, `live::Pipeline` (feature `live`) runs them side by side.
//! What is traced is the same in both profiles.

#[cfg(any(test, feature = "testing"))]
mod both_profiles;
mod encode_stage;
mod field;
mod frame_time;
mod grids;
mod hit_cache;
#[cfg(feature = "live")]
pub mod live;
mod memory;
mod places;
mod profile;
mod ray_scheduler;
mod screen_area;
mod settings;
mod sight;
mod stats;
#[cfg(test)]
mod tests;
mod trace_stage;
mod trace_state;
mod traced_frame;

use std::fmt;
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameIndex, FrameInfo, StreamTime};
use psao_codec::paper::{self, PointError as CodecPointError, PoseError};
use psao_codec::surface::{Encoder as SurfaceEncoder, GeometryError};
use psao_codec::{Layout, StateHash, StateRef};
use psao_proto::message::{Budget, CameraPose};
use psao_proto::{SceneError, SceneTable};
use thiserror::Error;

#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub use both_profiles::{AoErrorStats, BothProfiles, PerProfile};
pub use encode_stage::EncodeStage;
pub use frame_time::FrameTimeController;
pub use memory::ServerMemory;
pub use ray_scheduler::{RayBacklog, RayBudget};
pub use settings::{ServerSettings, SettingsError};
pub use stats::{FrameStats, FrameTotals, Progress, StageMicros, Work};
pub use trace_stage::TraceStage;
pub use traced_frame::TracedFrame;

use crate::ao::Tracer;
use crate::clock::Clock;
use crate::points::{PointCache, ScenePoints, generate_cached};
use crate::scene::{Edits, Scene};
use crate::world::SceneBvh;
use stats::Lap;
use trace_state::TraceState;
use traced_frame::{EncoderNeeds, blocks_in_view};

/// Told how far things have come, from any thread.
pub type ProgressFn = dyn Fn(Progress) + Send + Sync;

/// Traces a scene's points and writes what changed, frame by frame.
///
/// The bytes depend on the scene, the settings and the arguments of [`Server::step`] and [`TraceStage::edit`] alone: not on the
/// clock, the number of threads or the machine.
pub struct Server {
    trace: TraceStage,
    encode: EncodeStage,
}

/// One frame.
#[derive(Clone, Debug, PartialEq)]
pub struct StepOutput {
    /// The frame body: payload of a keyframe or an update.
    pub body: Vec<u8>,
    /// What is in it.
    pub info: FrameInfo,
    /// What it took.
    pub stats: FrameStats,
    /// What it did with its byte budget, as clients are told; `None` without a budget.
    pub budget: Option<Budget>,
}

/// Why a server could not be made or a frame not written.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ServerError {
    /// A setting is out of its range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The scene's tables make no layout.
    #[error("the scene's tables: {0}")]
    Table(#[from] SceneError),
    /// The scene's name does not fit its message.
    #[error("the scene's path has {length} bytes, at most 512 fit: open it by a shorter one")]
    Source {
        /// Bytes of the path.
        length: usize,
    },
    /// More buckets than can be counted.
    #[error("the scene needs more than 2^32 buckets: lower the density of points or the table slots")]
    Buckets,
    /// A time that is not a number.
    #[error("frame {frame} has no time: {time_s} s")]
    Time {
        /// Which frame.
        frame: FrameIndex,
        /// As given.
        time_s: f64,
    },
    /// A point that the codec refuses: its geometry is not finite.
    #[error("{0}")]
    Point(#[from] CodecPointError),
    /// Points that do not make the stream's geometry.
    #[error("{0}")]
    Geometry(#[from] GeometryError),
    /// A pose that the codec refuses.
    #[error("{0}")]
    Pose(#[from] PoseError),
    /// The frame could not be written.
    #[error("{0}")]
    Encode(#[from] EncodeError),
}

impl fmt::Debug for Server {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Server")
            .field("scene", &self.trace.state.scene.name())
            .field("points", &self.points().total())
            .field("profile", &self.table().profile())
            .finish_non_exhaustive()
    }
}

impl Server {
    /// Spreads the points, builds the structures and lays out the stream. `progress` hears of [`Work::Points`] now and
    /// of [`Work::FirstFrame`] in the first step.
    ///
    /// # Errors
    /// Settings out of their range (before anything is allocated), or tables beyond the limits.
    pub fn new(
        scene: Arc<Scene>,
        settings: ServerSettings,
        progress: Arc<ProgressFn>,
    ) -> Result<Self, ServerError> {
        Self::with_cache(scene, settings, None, progress)
    }

    /// As [`Server::new`], with points that are kept between runs; frames are the same.
    ///
    /// # Errors
    /// As [`Server::new`].
    pub fn with_cache(
        scene: Arc<Scene>,
        settings: ServerSettings,
        cache: Option<&dyn PointCache>,
        progress: Arc<ProgressFn>,
    ) -> Result<Self, ServerError> {
        Self::build(scene, settings, cache, progress, false)
    }

    /// As [`Server::with_cache`]; with `exact` the AO of points is kept as it was traced, besides what is sent.
    fn build(
        scene: Arc<Scene>,
        settings: ServerSettings,
        cache: Option<&dyn PointCache>,
        progress: Arc<ProgressFn>,
        exact: bool,
    ) -> Result<Self, ServerError> {
        settings.validate()?;
        let tracer = Tracer::new(settings.ao).map_err(SettingsError::from)?;
        let report = |done, total| progress(Progress { work: Work::Points, done, total });
        let mut points =
            generate_cached(&scene, &settings.points, cache, &report).map_err(SettingsError::from)?;
        let encode = profile::encode_stage(&scene, &mut points, &settings)?;
        let state = TraceState::new(scene, points, tracer, &settings, progress, exact);
        Ok(Self { trace: TraceStage::new(state, EncoderNeeds::of(&encode.encoder)), encode })
    }

    /// Computes one frame: the points that one of `views` sees are brought up to date, and those that changed by
    /// enough are written. Without a view every point counts as seen. The first frame is a keyframe. In profile
    /// `paper`, and with a quality of 0, it has every point of the scene, whatever the views; else the coarsest points of the
    /// whole scene, and those that a view asks for. What is in view comes first. `clock` is read between the stages.
    ///
    /// # Errors
    /// A frame index that does not grow, or a scene whose geometry is not finite at that time.
    pub fn step(
        &mut self,
        index: FrameIndex,
        time: StreamTime,
        views: &[CameraPose],
        clock: &dyn Clock,
    ) -> Result<StepOutput, ServerError> {
        // A first frame that could not be written is traced again as a whole.
        self.trace.first = self.state().frame().is_none();
        let mut lap = Lap::new(clock);
        let traced = self.trace.trace_lap((index, time), views, &mut lap);
        self.encode.encode_lap(traced, &mut lap)
    }

    /// Takes the server apart, so that the stages run side by side: one traces a frame while the other encodes the one
    /// before. What the stages write is what [`Server::step`] would.
    #[must_use]
    pub fn into_stages(self) -> (TraceStage, EncodeStage) {
        (self.trace, self.encode)
    }

    /// Returns the trace stage, to edit the scene and to set how many rays there are.
    pub fn trace_stage(&mut self) -> &mut TraceStage {
        &mut self.trace
    }

    /// Bytes of memory held now, by part.
    #[must_use]
    pub fn memory(&self) -> ServerMemory {
        let traced = self.trace.state.heap_bytes();
        ServerMemory { stream: traced.stream + self.encode.encoder.heap_bytes(), ..traced }
    }

    /// The edits in force from the next step on.
    #[must_use]
    pub fn edits(&self) -> &Edits {
        self.trace.edits()
    }

    /// What clients are told first.
    #[must_use]
    pub fn table(&self) -> &Arc<SceneTable> {
        self.encode.table()
    }

    /// The block coder of the stream.
    #[must_use]
    pub fn coder(&self) -> BlockCoder {
        self.encode.coder()
    }

    /// The layout of the stream's state.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        self.table().layout()
    }

    /// The scene as of the last step, edits included.
    #[must_use]
    pub fn world(&self) -> &SceneBvh {
        self.trace.world()
    }

    /// The points.
    #[must_use]
    pub fn points(&self) -> &ScenePoints {
        self.trace.points()
    }

    /// Hash of the state that clients hold after the last step.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        self.encode.encoder.state().hash()
    }

    /// The state that clients hold after the last step.
    #[must_use]
    pub fn state(&self) -> StateRef<'_> {
        self.encode.encoder.state()
    }

    /// The encoder of a `paper` stream; `None` for one of the other profile.
    #[must_use]
    pub fn paper(&self) -> Option<&paper::Encoder> {
        self.encode.encoder.as_paper()
    }

    /// The encoder of a `surface` stream; `None` for one of the other profile.
    #[must_use]
    pub fn surface(&self) -> Option<&SurfaceEncoder> {
        self.encode.encoder.as_surface()
    }

    /// A keyframe of the last step's state, for a client that joins or lost something. It carries the last step's
    /// frame index and the state's hash, so the updates that follow fit. What the last step's views see comes first.
    ///
    /// # Errors
    /// [`ServerError::Encode`].
    pub fn keyframe(
        &self,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        let state = &self.trace.state;
        let first = blocks_in_view(state, &state.cameras);
        Ok(self.encode.encoder.keyframe(frame, time, coder, &first)?)
    }
}
