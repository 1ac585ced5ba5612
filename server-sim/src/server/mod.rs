//! The frame loop: pose, structures, points, rays, what changed, one frame body (paper, section 3.3).
//!
//! What is traced is the same in both profiles; a stream decides what of it is sent, and writes it.

#[cfg(any(test, feature = "testing"))]
mod both_profiles;
mod field;
mod frame_time;
mod gathered;
mod grids;
mod halves;
mod hit_cache;
mod memory;
mod ray_scheduler;
mod screen_area;
mod settings;
mod stats;
mod stream;
mod surface;
#[cfg(test)]
mod tests;
mod tracing;

use std::fmt;
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodeError, FrameIndex, FrameInfo, StreamTime};
use psao_codec::paper::{self, PointError as CodecPointError, PoseError};
use psao_codec::surface::{Encoder as SurfaceEncoder, GeometryError};
use psao_codec::{Layout, StateHash, StateRef};
use psao_proto::message::{CameraPose, Edit};
use psao_proto::{Limits, Profile, SceneError, SceneTable};
use thiserror::Error;

#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub use both_profiles::{AoErrorStats, BothProfiles, PerProfile};
pub use frame_time::FrameTimeController;
pub use halves::{TracedFrame, TracingHalf, WritingHalf};
pub use memory::ServerMemory;
pub use ray_scheduler::{RayBacklog, RayBudget};
pub use settings::{ServerSettings, SettingsError};
pub use stats::{FrameStats, Progress, StageMicros, Work};

use crate::ao::Tracer;
use crate::clock::Clock;
use crate::points::{PointCache, ScenePoints, generate_cached, order_at_rest};
use crate::scene::{EditError, Edits, Scene};
use crate::world::SceneBvh;
use stats::Lap;
use stream::{Frame, Stream};
use tracing::Tracing;

/// Told how far things have come, from any thread.
pub type ProgressFn = dyn Fn(Progress) + Send + Sync;

/// Traces a scene's points and writes what changed, frame by frame.
///
/// The bytes depend on the scene, the settings and the arguments of [`Server::step`] and [`Server::edit`] alone: not on the clock, the
/// number of threads or the machine.
pub struct Server {
    tracing: Tracing,
    table: SceneTable,
    stream: Stream,
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
            .field("scene", &self.tracing.scene.name())
            .field("points", &self.tracing.points.total())
            .field("profile", &self.table.profile())
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
        let limits = Limits::default();
        let mut geometry = Vec::new();
        let table = if settings.profile == Profile::SURFACE {
            geometry = order_at_rest(&scene, &mut points, settings.precision()?, settings.kernel);
            surface::table(&scene, &geometry, &settings, &limits)?
        } else {
            grids::table(&scene, &points, &settings, &limits)?
        };
        let tracing = Tracing::new(scene, points, tracer, &settings, progress, exact);
        let stream = Stream::new(&tracing, table.layout(), geometry, &settings)?;
        Ok(Self { tracing, table, stream })
    }

    /// Computes one frame: the points that one of `views` sees are brought up to date, and those that changed by
    /// enough are written. Without a view every point counts as seen. The first frame is a keyframe with every point
    /// of the scene, whatever the views; in profile `surface` those in view come first in it. `clock` is read between
    /// the stages.
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
        let mut lap = Lap::new(clock);
        let first = self.stream.last().is_none();
        let traced = self.tracing.advance(time, views, first, &mut lap);
        self.stream.write(&self.tracing, Frame { index, time, cameras: views }, traced, &mut lap)
    }

    /// Changes the scene from the next step on; says whether it changed anything. Any number of edits may come before a
    /// step: it sees where they end.
    ///
    /// The AO follows: of the instance itself, of what it stands near now and of what it stood near before. The first
    /// time that a static instance moves or hides, it is taken out of the structure that all static ones share.
    ///
    /// # Errors
    /// As [`Edits::apply`]; nothing has changed then.
    pub fn edit(&mut self, edit: &Edit) -> Result<bool, EditError> {
        self.tracing.edits.apply(edit)
    }

    /// Sets how many rays frames may take from the next step on: for live servers, which learn what they have time for
    /// ([`FrameTimeController`]). The bytes then depend on what was set when.
    ///
    /// # Errors
    /// [`SettingsError::RayBudget`].
    pub fn set_ray_budget(&mut self, budget: Option<RayBudget>) -> Result<(), SettingsError> {
        self.tracing.set_ray_budget(budget)
    }

    /// Bytes of memory held now, by part.
    #[must_use]
    pub fn memory(&self) -> ServerMemory {
        ServerMemory { stream: self.stream.heap_bytes(), ..self.tracing.heap_bytes() }
    }

    /// The edits in force from the next step on.
    #[must_use]
    pub fn edits(&self) -> &Edits {
        &self.tracing.edits
    }

    /// What clients are told first.
    #[must_use]
    pub fn table(&self) -> &SceneTable {
        &self.table
    }

    /// The layout of the stream's state.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        self.table.layout()
    }

    /// The scene as of the last step, edits included.
    #[must_use]
    pub fn world(&self) -> &SceneBvh {
        &self.tracing.world
    }

    /// The points.
    #[must_use]
    pub fn points(&self) -> &ScenePoints {
        &self.tracing.points
    }

    /// Hash of the state that clients hold after the last step.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        self.stream.encoder.state().hash()
    }

    /// The state that clients hold after the last step.
    #[must_use]
    pub fn state(&self) -> StateRef<'_> {
        self.stream.encoder.state()
    }

    /// The encoder of a `paper` stream; `None` for one of the other profile.
    #[must_use]
    pub fn paper(&self) -> Option<&paper::Encoder> {
        self.stream.encoder.as_paper()
    }

    /// The encoder of a `surface` stream; `None` for one of the other profile.
    #[must_use]
    pub fn surface(&self) -> Option<&SurfaceEncoder> {
        self.stream.encoder.as_surface()
    }

    /// A keyframe of the last step's state, for a client that joins or lost something. It carries the last step's
    /// frame index and the state's hash, so the updates that follow fit.
    ///
    /// # Errors
    /// [`ServerError::Encode`].
    pub fn keyframe(
        &self,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
    ) -> Result<Vec<u8>, ServerError> {
        self.stream.keyframe(&self.tracing, frame, time, coder)
    }
}
