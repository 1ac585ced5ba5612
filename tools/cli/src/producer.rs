//! From the options of the command line to the settings of a server, and the timetable of its frames.

use std::sync::{Arc, Mutex, PoisonError};

use indicatif::ProgressBar;
use psao_codec::envelope::StreamTime;
use psao_proto::message::CameraPose;
use psao_server::Shortcuts;
use psao_server::ao::AoSettings;
use psao_server::clock::Clock;
use psao_server::points::PointSettings;
use psao_server::scene::Scene;
use psao_server::server::{Progress, ProgressFn, RayBudget, Server, ServerError, ServerSettings, Work};

use crate::args::{PointArgs, TuningArgs};
use crate::cache::{Folder, as_cache};
use crate::context::{Stopwatch, progress};
use crate::error::{Failure, Outcome};

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

    /// Returns the scene.
    pub(crate) fn scene(&self) -> &Scene {
        &self.scene
    }
}

/// Loads the scene and spreads its points. `frames_hint` is 0 when the number of frames is open.
pub(crate) fn open(scene: &str, tuning: &TuningArgs, frames_hint: u32) -> Outcome<(Server, Timetable)> {
    let (coder, budget) = (tuning.coder()?, tuning.budget.budget(tuning.points.fps)?);
    let scene = Arc::new(Scene::load(scene).map_err(Failure::input)?);
    let settings = settings(&tuning.points, &scene, frames_hint)
        .with_profile(tuning.profile.into())
        .with_coder(coder)
        .with_budget(budget)
        .with_ray_budget(tuning.ray_budget.map(RayBudget::new));
    let cache = Folder::of(&tuning.points.cache);
    let server = Server::with_cache(Arc::clone(&scene), settings, as_cache(&cache), show_progress());
    Ok((server.map_err(refused)?, Timetable::new(&scene, &tuning.points)))
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
    ServerSettings::default()
        .with_geometry(points.geometry.into())
        .with_bits(points.bits)
        .with_points(
            PointSettings::default()
                .with_per_m2(points.per_m2)
                .with_minimum(points.min_points)
                .with_seed(points.seed),
        )
        .with_ao(
            AoSettings::default()
                .with_rays(points.rays)
                .with_radius(points.radius.unwrap_or_else(|| scene.ao_radius_m()))
                .with_kind(points.occlusion.into())
                .with_seed(points.seed),
        )
        .with_threshold(points.threshold)
        .with_unseen_threshold(points.unseen_threshold)
        .with_quality(points.quality)
        .with_view_margin(points.view_margin)
        .with_table_slots(points.slots_per_cell)
        .with_kernel(points.kernel)
        .with_fps(points.fps)
        .with_frames_hint(frames_hint)
        .with_shortcuts(if points.exhaustive { Shortcuts::NONE } else { Shortcuts::ALL })
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
