//! Frames of a traced scene, one after the other: the server with the options of the command line.

use std::sync::{Arc, Mutex, PoisonError};

use indicatif::ProgressBar;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameInfo, StreamTime};
use psao_codec::{StateRef, surface};
use psao_proto::message::{Budget, CameraPose, Edit, Report, SceneHeader, StageId, StageTime};
use psao_proto::{Micros, SceneTable};
use psao_server::Shortcuts;
use psao_server::ao::AoSettings;
use psao_server::clock::Clock;
use psao_server::points::PointSettings;
use psao_server::scene::{EditError, Scene};
use psao_server::server::{
    Progress, ProgressFn, RayBacklog, RayBudget, Server, ServerError, ServerSettings, StageMicros,
    StepOutput, TracedFrame, TracingHalf, Work, WritingHalf,
};

use crate::args::{PointArgs, TuningArgs};
use crate::budget::message;
use crate::cache::{Folder, as_cache};
use crate::context::{Stopwatch, progress};
use crate::error::{Failure, Outcome};

/// Stages of the frame loop, in order, with their ids in reports.
pub(crate) const STAGES: [(&str, StageId); 6] = [
    ("pose", StageId::POSE),
    ("acceleration structures", StageId::BVH),
    ("place points", StageId::PLACE),
    ("trace rays", StageId::TRACE),
    ("decide", StageId::DECIDE),
    ("encode", StageId::ENCODE),
];

/// A scene being streamed.
pub(crate) struct Producer {
    timetable: Timetable,
    server: Server,
    table: Arc<SceneTable>,
    coder: BlockCoder,
    budget: Option<surface::Budget>,
}

/// The half of a producer that traces.
pub(crate) struct Front {
    timetable: Timetable,
    half: TracingHalf,
}

/// The half of a producer that writes.
pub(crate) struct Back {
    half: WritingHalf,
    coder: BlockCoder,
    budget: Option<surface::Budget>,
}

/// When frames are, and from where they are seen.
pub(crate) struct Timetable {
    scene: Arc<Scene>,
    fps: f64,
    all_visible: bool,
}

impl Timetable {
    /// Of a scene, as the options say.
    pub(crate) fn new(scene: &Arc<Scene>, points: &PointArgs) -> Self {
        Self { scene: Arc::clone(scene), fps: f64::from(points.fps), all_visible: points.all_visible }
    }

    /// Time of frame `number`, and the cameras that decide what is kept up to date: those of the clients, else the
    /// scene's own.
    pub(crate) fn frame(&self, number: u32, views: &[CameraPose]) -> (StreamTime, Vec<CameraPose>) {
        let time_s = f64::from(number) / self.fps;
        let views = match views {
            _ if self.all_visible => Vec::new(),
            [] => vec![self.scene.camera(time_s)],
            views => views.to_vec(),
        };
        (StreamTime((time_s * 1e6).round() as u64), views)
    }
}

impl Producer {
    /// Loads the scene and spreads its points. `frames_hint` is 0 when the number of frames is open.
    pub(crate) fn new(scene: &str, tuning: &TuningArgs, frames_hint: u32) -> Outcome<Self> {
        let coder = tuning.coder()?;
        let budget = tuning.budget.budget(tuning.points.fps)?;
        let scene = Arc::new(Scene::load(scene).map_err(Failure::input)?);
        let settings = ServerSettings {
            profile: tuning.profile.into(),
            coder,
            budget,
            ray_budget: tuning.ray_budget.map(ray_budget),
            ..settings(&tuning.points, &scene, frames_hint)
        };
        let cache = Folder::of(&tuning.points.cache);
        let server = Server::with_cache(scene.clone(), settings, as_cache(&cache), show_progress());
        let server = server.map_err(refused)?;
        let table = Arc::new(server.table().clone());
        let timetable = Timetable::new(&scene, &tuning.points);
        Ok(Self { timetable, server, table, coder, budget })
    }

    /// What clients are told first.
    pub(crate) fn table(&self) -> &Arc<SceneTable> {
        &self.table
    }

    /// The stream as a whole.
    pub(crate) fn info(&self) -> SceneHeader {
        self.table.header()
    }

    /// The scene that is streamed.
    pub(crate) fn scene(&self) -> &Scene {
        &self.timetable.scene
    }

    /// Changes the scene from the next frame on; says whether it changed anything.
    pub(crate) fn edit(&mut self, edit: &Edit) -> Result<bool, EditError> {
        self.server.edit(edit)
    }

    /// Sets how many rays the next frames may take.
    pub(crate) fn set_rays(&mut self, rays: u64) -> Outcome {
        self.server.set_ray_budget(Some(ray_budget(rays))).map_err(Failure::usage)
    }

    /// Computes frame `number`. `views` are the clients' cameras; without any, the scene's own camera decides what is
    /// kept up to date.
    pub(crate) fn step(
        &mut self,
        number: u32,
        views: &[CameraPose],
        clock: &Stopwatch,
    ) -> Outcome<(StepOutput, Produced)> {
        let (time, views) = self.timetable.frame(number, views);
        let output = self.server.step(FrameIndex(number), time, &views, clock).map_err(refused)?;
        let produced = Produced::of(&output, self.budget);
        Ok((output, produced))
    }

    /// Takes the producer apart; one whose profile does not allow that comes back whole.
    pub(crate) fn split(self) -> Result<(Front, Back), Box<Self>> {
        let Self { timetable, server, table, coder, budget } = self;
        match server.split() {
            Ok((front, back)) => Ok((Front { timetable, half: front }, Back { half: back, coder, budget })),
            Err(server) => Err(Box::new(Self { timetable, server: *server, table, coder, budget })),
        }
    }

    /// The state that clients hold after the last frame.
    pub(crate) fn state(&self) -> StateRef<'_> {
        self.server.state()
    }

    /// A keyframe of the last frame's state.
    pub(crate) fn keyframe(&self, last: &FrameInfo) -> Outcome<Vec<u8>> {
        self.server.keyframe(last.frame, last.time, self.coder).map_err(refused)
    }

    /// Block coder of the stream.
    pub(crate) const fn coder(&self) -> BlockCoder {
        self.coder
    }
}

impl Front {
    /// Changes the scene from the next traced frame on; says whether it changed anything.
    pub(crate) fn edit(&mut self, edit: &Edit) -> Result<bool, EditError> {
        self.half.edit(edit)
    }

    /// Sets how many rays the next frames may take.
    pub(crate) fn set_rays(&mut self, rays: u64) -> Outcome {
        self.half.set_ray_budget(Some(ray_budget(rays))).map_err(Failure::usage)
    }

    /// Traces frame `number`, as [`Producer::step`].
    pub(crate) fn trace(&mut self, number: u32, views: &[CameraPose], clock: &Stopwatch) -> TracedFrame {
        let (time, views) = self.timetable.frame(number, views);
        self.half.trace(FrameIndex(number), time, &views, clock)
    }
}

impl Back {
    /// Writes a traced frame.
    pub(crate) fn write(
        &mut self,
        traced: TracedFrame,
        clock: &Stopwatch,
    ) -> Outcome<(StepOutput, Produced)> {
        let output = self.half.write(traced, clock).map_err(refused)?;
        let produced = Produced::of(&output, self.budget);
        Ok((output, produced))
    }

    /// The state that clients hold after the last frame.
    pub(crate) fn state(&self) -> StateRef<'_> {
        self.half.state()
    }

    /// A keyframe of the last frame's state.
    pub(crate) fn keyframe(&self, last: &FrameInfo) -> Outcome<Vec<u8>> {
        self.half.keyframe(last.frame, last.time, self.coder).map_err(refused)
    }
}

/// So many rays a frame, and how long points wait for them at most.
fn ray_budget(rays: u64) -> RayBudget {
    RayBudget { rays, longest_age: RayBudget::LONGEST_AGE }
}

/// A server that could not be made, or did not go on.
pub(crate) fn refused(error: ServerError) -> Failure {
    match error {
        ServerError::Settings(error) => Failure::settings(error),
        error => Failure::input(error),
    }
}

/// The settings that mean the same in both profiles; profile and coder are those of [`ServerSettings::default`].
pub(crate) fn settings(points: &PointArgs, scene: &Scene, frames_hint: u32) -> ServerSettings {
    ServerSettings {
        geometry: points.geometry.into(),
        bits: points.bits,
        points: PointSettings { per_m2: points.per_m2, minimum: points.min_points, seed: points.seed },
        ao: AoSettings {
            rays: points.rays,
            radius: points.radius.unwrap_or_else(|| scene.ao_radius_m()),
            kind: points.occlusion.into(),
            seed: points.seed,
        },
        threshold: points.threshold,
        view_margin: points.view_margin,
        table_slots: points.slots_per_cell,
        kernel: points.kernel,
        fps: points.fps,
        frames_hint,
        shortcuts: if points.exhaustive { Shortcuts::NONE } else { Shortcuts::ALL },
        ..ServerSettings::default()
    }
}

/// Shows the two things that take a while before the second frame.
pub(crate) fn show_progress() -> Arc<ProgressFn> {
    let bars = Bars::default();
    Arc::new(move |state| bars.show(state))
}

impl Clock for Stopwatch {
    fn micros(&self) -> u64 {
        Self::micros(self)
    }
}

/// The bars of the two things that take a while before the second frame.
#[derive(Default)]
struct Bars(Mutex<Option<(Work, ProgressBar)>>);

impl Bars {
    fn show(&self, state: Progress) {
        let mut current = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if current.as_ref().is_none_or(|(work, _)| *work != state.work) {
            let name = match state.work {
                Work::Points => "points",
                Work::FirstFrame => "first frame",
            };
            *current = Some((state.work, progress(name, state.total)));
        }
        if let Some((_, bar)) = current.as_ref() {
            // Threads report in any order.
            bar.set_position(bar.position().max(state.done));
            if state.done >= state.total {
                bar.finish_and_clear();
            }
        }
    }
}

/// Microseconds of a frame by stage, in the order of [`STAGES`].
pub(crate) const fn micros(times: &StageMicros) -> [u64; STAGES.len()] {
    [times.pose, times.bvh, times.place, times.trace, times.decide, times.encode]
}

/// What one frame took, or the sum over several.
#[derive(Clone, Debug, Default)]
pub(crate) struct Produced {
    pub(crate) visible: u64,
    pub(crate) traced: u64,
    pub(crate) rays: u64,
    pub(crate) changed: u64,
    pub(crate) cells: u64,
    pub(crate) stored: u64,
    pub(crate) bucket_full: u64,
    pub(crate) cell_full: u64,
    pub(crate) no_cell: u64,
    pub(crate) outside_grid: u64,
    pub(crate) id_collisions: u64,
    /// What was done with the byte budget, where there is one; of a sum, in the newest frame.
    pub(crate) budget: Option<Budget>,
    /// Points that waited for rays, and frames that the oldest waited; of a sum, all points and the longest wait.
    pub(crate) waiting: RayBacklog,
    /// By stage, in the order of [`STAGES`].
    pub(crate) micros: [u64; STAGES.len()],
}

impl Produced {
    fn of(output: &StepOutput, budget: Option<surface::Budget>) -> Self {
        let stats = &output.stats;
        let (tables, times) = (stats.occupancy.unwrap_or_default(), &stats.micros);
        Self {
            visible: stats.visible.into(),
            traced: stats.traced.into(),
            rays: stats.rays,
            changed: stats.changed.into(),
            cells: tables.cells.into(),
            stored: tables.points_stored.into(),
            bucket_full: tables.bucket_full.into(),
            cell_full: tables.cell_full.into(),
            no_cell: tables.no_cell.into(),
            outside_grid: tables.outside_grid.into(),
            id_collisions: tables.id_collisions.into(),
            budget: budget
                .zip(stats.postponed)
                .map(|(budget, postponed)| message(output.info.frame, budget, postponed)),
            waiting: stats.waiting.unwrap_or_default(),
            micros: micros(times),
        }
    }

    /// Adds a frame to a sum; how the tables are filled is that of the newest.
    pub(crate) fn add(&mut self, frame: &Self) {
        let sums = Self {
            visible: self.visible + frame.visible,
            traced: self.traced + frame.traced,
            rays: self.rays + frame.rays,
            changed: self.changed + frame.changed,
            waiting: RayBacklog {
                points: self.waiting.points.saturating_add(frame.waiting.points),
                oldest: self.waiting.oldest.max(frame.waiting.oldest),
            },
            micros: std::array::from_fn(|stage| self.micros[stage] + frame.micros[stage]),
            ..frame.clone()
        };
        *self = sums;
    }

    /// The frame's REPORT; without `timings` it is the same in every run.
    pub(crate) fn report(&self, frame: FrameIndex, timings: bool) -> Report {
        let narrow = |value: u64| u32::try_from(value).unwrap_or(u32::MAX);
        let times =
            STAGES.iter().zip(self.micros).map(|((_, stage), micros)| StageTime::new(*stage, Micros(micros)));
        Report {
            frame,
            rays: self.rays,
            visible: narrow(self.visible),
            traced: narrow(self.traced),
            changed: narrow(self.changed),
            cells: narrow(self.cells),
            stored: narrow(self.stored),
            bucket_full: narrow(self.bucket_full),
            cell_full: narrow(self.cell_full),
            no_cell: narrow(self.no_cell),
            outside_grid: narrow(self.outside_grid),
            id_collisions: narrow(self.id_collisions),
            stages: if timings { times.collect() } else { Vec::new() },
        }
    }
}
