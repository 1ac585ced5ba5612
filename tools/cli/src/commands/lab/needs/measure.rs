//! The runs: the stream with everything left out that can be, and with each thing in turn.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use indicatif::ProgressBar;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, SectionTag, StreamTime, inspect};
use psao_codec::surface::GeometrySource;
use psao_proto::{Limits, Profile};
use psao_server::Shortcuts;
use psao_server::points::{PointCache, PointCacheError, PointKey};
use psao_server::scene::Scene;
use psao_server::server::{FrameTotals, Progress, Server, ServerMemory, ServerSettings};

use super::Args;
use super::rows::{Part, WORK};
use crate::cache::Folder;
use crate::context::{Stopwatch, progress};
use crate::error::{Failure, Outcome};
use crate::producer::{Timetable, refused, show_progress};

/// What the runs took.
pub(super) struct Measured {
    pub(super) points: u32,
    /// Points of each instance.
    pub(super) instance_points: Vec<u32>,
    /// State hash after the last frame.
    pub(super) hash: String,
    /// What the server that leaves everything out holds then.
    pub(super) memory: ServerMemory,
    /// Of the run that leaves everything out.
    pub(super) least: Figures,
    /// Milliseconds a frame of it, by round.
    pub(super) least_ms: Vec<f64>,
    /// In the order of [`WORK`].
    pub(super) work: Vec<Saved>,
    /// In the order of [`Part::ALL`].
    pub(super) parts: Vec<PartSaved>,
}

/// Sums of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Figures {
    pub(super) first_bytes: u64,
    /// Of the frames after the first, as all that follow.
    pub(super) bytes: u64,
    pub(super) later: FrameTotals,
    /// Bytes of POSES sections: in the first frame, and in later ones.
    poses: [u64; 2],
}

/// What one shortcut saves.
#[derive(Clone, Debug, Default)]
pub(super) struct Saved {
    /// More rays and traced points than with it, all frames after the first together.
    pub(super) rays: i64,
    pub(super) traced: i64,
    /// More milliseconds a frame, by round.
    pub(super) ms: Vec<f64>,
    pub(super) frames_equal: bool,
}

/// Bytes that leaving out a part of the stream saves; nothing where that cannot be measured.
#[derive(Clone, Debug, Default)]
pub(super) struct PartSaved {
    /// In the first frame, or in a keyframe.
    pub(super) once: Option<i64>,
    /// In all frames after the first together.
    pub(super) later: Option<i64>,
    /// Why there are no figures, where that is not the same for all scenes.
    pub(super) refused: Option<String>,
}

/// What all runs share.
struct Runs<'a> {
    args: &'a Args,
    scene: &'a Arc<Scene>,
    points: &'a Kept,
    bar: ProgressBar,
}

/// Points that are spread once for all runs.
struct Kept {
    folder: Option<Folder>,
    entries: Mutex<BTreeMap<String, Vec<u8>>>,
}

pub(super) fn measure(
    args: &Args,
    scene: &Arc<Scene>,
    settings: &ServerSettings,
    folder: Option<Folder>,
) -> Outcome<Measured> {
    let points = Kept { folder, entries: Mutex::default() };
    // Spreads the points, which takes a while and is shown.
    let first = Server::with_cache(Arc::clone(scene), *settings, Some(&points), show_progress());
    let first = first.map_err(refused)?;
    let (total, firsts) = (first.points().total(), first.points().offsets().to_vec());
    drop(first);
    let ways = WORK.len() + 1;
    let frames = u64::from(args.frames) * (u64::from(args.rounds) * ways as u64 + 2);
    let runs = Runs { args, scene, points: &points, bar: progress("runs", frames) };
    let mut bodies = Vec::new();
    let (least, server) = runs.run(settings, |_, body| bodies.push(body))?;
    let (hash, context) = (server.hash().to_string(), context(&server, args, settings)?);
    let memory = server.memory();
    drop(server);
    let mut least_ms = vec![runs.millis(&least)];
    let mut work = vec![Saved { frames_equal: true, ..Saved::default() }; WORK.len()];
    for round in 0..args.rounds as usize {
        if round > 0 {
            least_ms.push(runs.millis(&runs.run(settings, |_, _| {})?.0));
        }
        for turn in 0..WORK.len() {
            // Each round begins with another one.
            let number = (turn + round) % WORK.len();
            let (shortcuts, saved) = (Shortcuts::ALL - WORK[number].shortcut, &mut work[number]);
            let with = settings.with_shortcuts(shortcuts);
            let (more, _) = runs.run(&with, |frame, body| saved.frames_equal &= body == bodies[frame])?;
            saved.rays = more.later.rays as i64 - least.later.rays as i64;
            saved.traced = more.later.traced as i64 - least.later.traced as i64;
            saved.ms.push(runs.millis(&more) - least_ms[round]);
        }
    }
    let parts = Part::ALL.iter().map(|part| match part {
        Part::Geometry => runs.geometry(settings, &least),
        Part::Poses => Ok(runs.poses(settings)),
        Part::Context => Ok(PartSaved { once: Some(context), ..PartSaved::default() }),
        Part::Backs => Ok(PartSaved::default()),
    });
    let parts = parts.collect::<Outcome<_>>()?;
    runs.bar.finish_and_clear();
    let instance_points = firsts.windows(2).map(|pair| pair[1] - pair[0]).collect();
    Ok(Measured { points: total, instance_points, hash, memory, least, least_ms, work, parts })
}

impl Runs<'_> {
    /// Runs the clip with a new server; `see` receives each frame.
    fn run(
        &self,
        settings: &ServerSettings,
        mut see: impl FnMut(usize, Vec<u8>),
    ) -> Outcome<(Figures, Server)> {
        let silent = Arc::new(|_: Progress| {});
        let server = Server::with_cache(Arc::clone(self.scene), *settings, Some(self.points), silent);
        let mut server = server.map_err(refused)?;
        let clock = Stopwatch::start();
        let timetable = Timetable::new(self.scene, &self.args.points);
        let mut sum = Figures::default();
        for number in 0..self.args.frames {
            let (time, views) = timetable.frame(number, &[]);
            let output = server.step(FrameIndex(number), time, &views, &clock).map_err(refused)?;
            let bytes = output.body.len() as u64;
            let poses = output.info.section(SectionTag::POSES).map_or(0, |poses| poses.wire_bytes.into());
            sum.poses[usize::from(number > 0)] += poses;
            if number == 0 {
                sum.first_bytes = bytes;
            } else {
                sum.bytes += bytes;
                sum.later.add(&output.stats);
            }
            see(number as usize, output.body);
            self.bar.inc(1);
        }
        Ok((sum, server))
    }

    /// Returns the milliseconds of a frame after the first.
    fn millis(&self, figures: &Figures) -> f64 {
        figures.later.micros.total() as f64 / 1e3 / f64::from(self.args.frames - 1)
    }

    /// Measures what sending the points takes; `least` is the stream that was asked for.
    fn geometry(&self, settings: &ServerSettings, least: &Figures) -> Outcome<PartSaved> {
        let shared = settings.geometry == GeometrySource::Shared;
        let geometry = if shared { GeometrySource::Sent } else { GeometrySource::Shared };
        let (other, _) = self.run(&settings.with_geometry(geometry), |_, _| {})?;
        let [sent, shared] = if shared { [&other, least] } else { [least, &other] };
        Ok(PartSaved {
            once: Some(sent.first_bytes as i64 - shared.first_bytes as i64),
            later: Some(sent.bytes as i64 - shared.bytes as i64),
            refused: None,
        })
    }

    /// Measures what poses take in the profile that has them.
    fn poses(&self, settings: &ServerSettings) -> PartSaved {
        let coder = BlockCoder::Zstd { level: 15 };
        let paper =
            settings.with_profile(Profile::PAPER).with_geometry(GeometrySource::Sent).with_coder(coder);
        match self.run(&paper, |_, _| {}) {
            Ok((Figures { poses: [once, later], .. }, _)) => {
                PartSaved { once: Some(once as i64), later: Some(later as i64), refused: None }
            }
            // Points that do not fit the paper's tables must not hide the other figures.
            Err(failure) => PartSaved { refused: Some(failure.to_string()), ..PartSaved::default() },
        }
    }
}

/// Bytes of what a client that joins after the last frame is sent besides values.
fn context(server: &Server, args: &Args, settings: &ServerSettings) -> Outcome<i64> {
    let (frame, time) = (FrameIndex(args.frames - 1), StreamTime(0));
    let body = server.keyframe(frame, time, settings.coder).map_err(refused)?;
    let info = inspect(&body, &Limits::default().codec).map_err(Failure::input)?;
    Ok(info.section(SectionTag::CONTEXT).map_or(0, |context| context.wire_bytes.into()))
}

impl PointCache for Kept {
    fn load(&self, key: &PointKey) -> Option<Vec<u8>> {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = entries.get(&key.to_string()) {
            return Some(bytes.clone());
        }
        let bytes = self.folder.as_ref()?.load(key)?;
        entries.insert(key.to_string(), bytes.clone());
        Some(bytes)
    }

    fn store(&self, key: &PointKey, bytes: &[u8]) {
        if let Some(folder) = &self.folder {
            folder.store(key, bytes);
        }
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.insert(key.to_string(), bytes.to_vec());
    }

    fn refused(&self, key: &PointKey, reason: &PointCacheError) {
        if let Some(folder) = &self.folder {
            folder.refused(key, reason);
        }
    }
}
