//! The frame loop: pose, structures, points, rays, what changed, one frame body (paper, section 3.3).

mod field;
mod grids;
mod settings;
mod stats;
mod step;
#[cfg(test)]
mod tests;

use std::fmt;
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::cells::{Layout, PaperEncoder, PointError as CodecPointError};
use psao_codec::frame::{
    EncodeError, FrameIndex, FrameInfo, FrameKind, FrameMeta, PoseError, StreamTime, keyframe,
};
use psao_proto::message::{InstanceEntry, SceneInfo};
use psao_proto::{Limits, SceneError, SceneTable};
use thiserror::Error;

pub use settings::{ServerSettings, SettingsError};
pub use stats::{FrameStats, Progress, StageMicros, Work};

use crate::ao::Tracer;
use crate::bvh::World;
use crate::points::{PlacedPoint, ScenePoints, generate};
use crate::scene::{Motion, Scene, ScenePose};
use field::Field;

/// Told how far things have come, from any thread.
pub type ProgressFn = dyn Fn(Progress) + Send + Sync;

/// Traces a scene's points and writes what changed, frame by frame.
///
/// The bytes depend on the scene, the settings and the arguments of [`Server::step`] alone: not on the clock, the
/// number of threads or the machine.
pub struct Server {
    scene: Arc<Scene>,
    settings: ServerSettings,
    table: SceneTable,
    points: ScenePoints,
    tracer: Tracer,
    pose: ScenePose,
    world: World,
    field: Field,
    sent: Sent,
    encoder: PaperEncoder,
    progress: Arc<ProgressFn>,
}

/// What clients were sent last.
#[derive(Debug)]
struct Sent {
    /// By point id.
    ao: Vec<u8>,
    /// Position and normal of the points of deforming instances, by instance; those of others never change.
    places: Vec<Vec<(glam::Vec3, glam::Vec3)>>,
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
            .field("scene", &self.scene.name())
            .field("settings", &self.settings)
            .field("points", &self.points.total())
            .finish_non_exhaustive()
    }
}

impl Server {
    /// Spreads the points, builds the structures and lays out the tables. `progress` hears of [`Work::Points`] now and
    /// of [`Work::FirstFrame`] in the first step.
    ///
    /// # Errors
    /// Settings out of their range (before anything is allocated), or tables beyond the limits.
    pub fn new(
        scene: Arc<Scene>,
        settings: ServerSettings,
        progress: Arc<ProgressFn>,
    ) -> Result<Self, ServerError> {
        settings.validate()?;
        let tracer = Tracer::new(settings.ao).map_err(SettingsError::from)?;
        let report = |done, total| progress(Progress { work: Work::Points, done, total });
        let points = generate(&scene, &settings.points, &report).map_err(SettingsError::from)?;
        let table = grids::table(&scene, &points, &settings, &Limits::default())?;
        let counts: Vec<u32> = table.instances().iter().map(|entry| entry.points).collect();
        let encoder = PaperEncoder::new(Arc::clone(table.layout()), &counts)?;
        let pose = scene.pose(0.0);
        let world = World::new(&scene, &pose);
        let field = Field::new(&world, &points);
        let sent = Sent::new(&scene, &field, points.total());
        Ok(Self { scene, settings, table, points, tracer, pose, world, field, sent, encoder, progress })
    }

    /// What clients are told first.
    #[must_use]
    pub fn table(&self) -> &SceneTable {
        &self.table
    }

    /// The stream as a whole and its instances, as in [`Server::table`].
    #[must_use]
    pub fn info(&self) -> (&SceneInfo, &[InstanceEntry]) {
        (self.table.info(), self.table.instances())
    }

    /// The layout of the stream's state.
    #[must_use]
    pub fn layout(&self) -> &Arc<Layout> {
        self.table.layout()
    }

    /// The scene as of the last step.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The points.
    #[must_use]
    pub fn points(&self) -> &ScenePoints {
        &self.points
    }

    /// The state that clients hold after the last step.
    #[must_use]
    pub fn encoder(&self) -> &PaperEncoder {
        &self.encoder
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
        let changed_points = self.encoder.counts().points_stored;
        let meta = FrameMeta { kind: FrameKind::Key, frame, time, changed_points };
        Ok(keyframe(self.encoder.state(), meta, coder)?)
    }
}

impl Sent {
    fn new(scene: &Scene, field: &Field, points: u32) -> Self {
        let place = |point: &PlacedPoint| (point.position, point.normal);
        let places = scene.instances().iter().enumerate().map(|(index, instance)| match instance.motion() {
            Motion::Deforming => field.local(index).iter().map(place).collect(),
            Motion::Static | Motion::Rigid => Vec::new(),
        });
        Self { ao: vec![0; points as usize], places: places.collect() }
    }
}
