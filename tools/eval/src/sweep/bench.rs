//! Measures one setting or one method.

use psao_codec::State;
use psao_reconstruct::reconstruct::{self, Reconstruction, SurfaceReconstructor};
use psao_reconstruct::{AoImage, GBuffer, ReconstructError};
use psao_server::clock::Clock;
use psao_server::server::StageMicros;

use super::run::{Clip, Run};
use super::{
    ErrorFigures, MemoryFigures, PictureFigures, Record, RecordKind, Setting, Spread, StageTime,
    StreamFigures, SweepError, View,
};
use crate::metric::{Comparison, Lpips, PerceptualFigures};
use crate::screen::ScreenMethod;

/// Numbers of runs for times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunCounts {
    /// Runs that count, at least 1, of the whole clip and of each picture.
    pub repeats: u32,
    /// Runs of each picture before those that count.
    pub warm_up: u32,
}

/// The pictures, references and clock that all measurements share.
pub struct Bench<'a> {
    /// Name of the scene.
    pub scene: &'a str,
    /// Pictures and references, in the order of their times.
    pub views: &'a [View],
    /// Numbers of runs.
    pub runs: RunCounts,
    /// Network for LPIPS.
    pub network: Option<&'a Lpips>,
    /// Clock for times.
    pub clock: &'a dyn Clock,
}

/// A record and its first picture.
pub struct Sample {
    /// The record.
    pub record: Record,
    /// The first picture.
    pub picture: AoImage,
}

impl Bench<'_> {
    /// Traces, encodes, decodes, reconstructs and compares a stream.
    ///
    /// A picture is drawn with the newest frame that began by its time, and with the geometry of its own time. `key`
    /// goes into the record.
    ///
    /// # Errors
    ///
    /// [`SweepError`] when the server refuses the setting, or the client refuses a frame.
    pub fn stream(&self, key: &str, clip: &Clip<'_>, setting: &Setting) -> Result<Sample, SweepError> {
        let mut run = Run::new(clip, setting, self.clock)?;
        let mut drawn = PictureSeries::default();
        for frame in 0..run.frames {
            run.frame(frame)?;
            for view in self.views.iter().filter(|view| run.frame_at(view.time_s) == frame) {
                drawn.client.surface.set_camera(&view.camera, setting.quality);
                self.draw(&run.state, view, &mut drawn)?;
            }
        }
        let state_bytes = run.keyframe_bytes()?;
        let server_bytes = run.server.memory().total() as u64;
        let (hash, mut took, bytes, points) = (run.state.hash(), run.took, run.bytes, run.points);
        for number in 1..self.runs.repeats {
            let mut again = Run::new(clip, setting, self.clock)?;
            (0..again.frames).try_for_each(|frame| again.frame(frame))?;
            if again.state.hash() != hash || again.bytes != bytes {
                return Err(SweepError::Repeat { run: number + 1 });
            }
            took.add(again.took);
        }
        let decode = Spread::of_micros(&took.decode);
        let client = [("apply", decode), ("reconstruct", Spread::of_micros(&drawn.micros))];
        let server = (0..).zip(StageMicros::NAMES).map(|(stage, name)| (name, took.server_stage(stage)));
        let stages = server
            .map(|(name, ms)| StageTime { side: "server".to_owned(), name: name.to_owned(), ms })
            .chain(client.map(|(name, ms)| StageTime {
                side: "client".to_owned(),
                name: name.to_owned(),
                ms,
            }));
        let seconds = f64::from(bytes.frames.saturating_sub(1)) / f64::from(setting.fps);
        let mbit_s = |bytes: u64| bytes as f64 * 8.0 / 1e6 / seconds;
        let later: Vec<u64> = took.server.iter().map(StageMicros::total).collect();
        let figures = StreamFigures {
            frames: bytes.frames,
            points,
            scene_table_bytes: bytes.table,
            first_state_bytes: bytes.first,
            later_bytes: bytes.later.wire,
            changed_points: bytes.changed,
            paper_mbit_s: mbit_s(bytes.later.paper),
            wire_mbit_s: mbit_s(bytes.later.wire),
            first_frame_ms: took.first as f64 / 1e3,
            server_ms: Spread::of_micros(&later),
        };
        let summary = setting.summary();
        let picture_ms =
            drawn.micros.iter().map(|micros| decode.median + *micros as f64 / 1e3).collect::<Vec<_>>();
        drawn
            .sample(Record {
                key: key.to_owned(),
                scene: self.scene.to_owned(),
                kind: RecordKind::Stream,
                name: summary.profile.clone(),
                label: summary.to_string(),
                setting: Some(summary),
                picture_ms: Spread::of(picture_ms),
                stages: stages.collect(),
                stream: Some(figures),
                memory: MemoryFigures {
                    picture_bytes: buffer_bytes(self.views),
                    state_bytes: Some(state_bytes),
                    largest_frame_bytes: Some(bytes.largest),
                    working_bytes: None,
                    server_bytes: Some(server_bytes),
                },
                ..empty()
            })
            .ok_or(SweepError::NoPictures { seconds: clip.seconds })
    }

    /// Runs a screen-space method over every picture. `key` goes into the record.
    ///
    /// # Errors
    ///
    /// [`SweepError`] when the method refuses its settings or a picture.
    pub fn method(&self, key: &str, method: &dyn ScreenMethod) -> Result<Sample, SweepError> {
        let mut drawn = PictureSeries::default();
        let mut stages: Vec<(&'static str, Vec<u64>)> = Vec::new();
        let mut working = 0;
        for view in self.views {
            let mut image = None;
            for run in 0..self.runs.warm_up + self.runs.repeats.max(1) {
                let shaded = method.shade(&view.screen, self.clock)?;
                if run >= self.runs.warm_up {
                    drawn.micros.push(shaded.micros());
                    for (stage, micros) in &shaded.stages {
                        match stages.iter_mut().find(|(name, _)| name == stage) {
                            Some((_, samples)) => samples.push(*micros),
                            None => stages.push((stage, vec![*micros])),
                        }
                    }
                }
                working = working.max(shaded.bytes);
                image = Some(shaded.image);
            }
            if let Some(image) = image {
                self.compare(view, image, 0.0, &mut drawn)?;
            }
        }
        let picture_ms = Spread::of_micros(&drawn.micros);
        let screen = self.views.iter().map(|view| view.screen.size().pixels() * (4 + 12)).max();
        let stage = |(name, samples): &(&'static str, Vec<u64>)| StageTime {
            side: "client".to_owned(),
            name: (*name).to_owned(),
            ms: Spread::of_micros(samples),
        };
        drawn
            .sample(Record {
                key: key.to_owned(),
                scene: self.scene.to_owned(),
                kind: RecordKind::Screen,
                name: method.name().to_owned(),
                label: method.label(),
                picture_ms,
                stages: stages.iter().map(stage).collect(),
                memory: MemoryFigures {
                    picture_bytes: screen.unwrap_or(0) as u64,
                    working_bytes: Some(working as u64),
                    ..MemoryFigures::default()
                },
                ..empty()
            })
            .ok_or(SweepError::NoPictures { seconds: 0.0 })
    }

    /// Draws a picture of a stream once for each timed run. The first run, which makes the indices, is not timed.
    fn draw(&self, state: &State, view: &View, drawn: &mut PictureSeries) -> Result<(), SweepError> {
        let mut found = drawn.client.draw(state, &view.buffer)?;
        for run in 0..self.runs.warm_up + self.runs.repeats.max(1) {
            let start = self.clock.micros();
            found = drawn.client.draw(state, &view.buffer)?;
            if run >= self.runs.warm_up {
                drawn.micros.push(self.clock.micros().saturating_sub(start));
            }
        }
        let unsupported = found.statistics.unsupported_share();
        self.compare(view, found.image, unsupported, drawn)
    }

    pub(super) fn compare(
        &self,
        view: &View,
        image: AoImage,
        unsupported: f64,
        drawn: &mut PictureSeries,
    ) -> Result<(), SweepError> {
        let error = Comparison::new(&view.truth, &image).map_err(crate::metric::MetricError::from)?;
        let perceived = PerceptualFigures::new(&view.truth, &image, self.network)?;
        let error = ErrorFigures::new(&error, &perceived);
        drawn.pictures.push(PictureFigures { time_s: view.time_s, unsupported, error });
        drawn.first.get_or_insert(image);
        Ok(())
    }
}

/// Returns an empty record.
pub(super) fn empty() -> Record {
    Record {
        key: String::new(),
        scene: String::new(),
        kind: RecordKind::Stream,
        name: String::new(),
        label: String::new(),
        setting: None,
        error: ErrorFigures::default(),
        pictures: Vec::new(),
        picture_ms: Spread::default(),
        stages: Vec::new(),
        stream: None,
        memory: MemoryFigures::default(),
    }
}

/// Returns the bytes of the largest G-buffer: depth, position, normal, instance, and the place at rest if it is known.
pub(super) fn buffer_bytes(views: &[View]) -> u64 {
    let bytes = |view: &View| {
        let at_rest = if view.buffer.rest_position().is_some() { 24 } else { 0 };
        (view.buffer.size().pixels() * (4 + 12 + 12 + 4 + at_rest)) as u64
    };
    views.iter().map(bytes).max().unwrap_or(0)
}

/// Reconstructs streams of either profile.
#[derive(Default)]
struct ProfileReconstructor {
    surface: SurfaceReconstructor,
}

impl ProfileReconstructor {
    fn draw(&mut self, state: &State, buffer: &GBuffer) -> Result<Reconstruction, ReconstructError> {
        match state {
            State::Paper(state) => reconstruct::cells(state, buffer),
            State::Surface(state) => self.surface.reconstruct(state, buffer),
        }
    }
}

/// Figures and times of the pictures so far.
#[derive(Default)]
pub(super) struct PictureSeries {
    client: ProfileReconstructor,
    pictures: Vec<PictureFigures>,
    /// Microseconds of each run of each picture.
    pub(super) micros: Vec<u64>,
    first: Option<AoImage>,
}

impl PictureSeries {
    pub(super) fn sample(self, mut record: Record) -> Option<Sample> {
        let errors: Vec<ErrorFigures> = self.pictures.iter().map(|picture| picture.error).collect();
        record.error = ErrorFigures::pooled(&errors)?;
        record.pictures = self.pictures;
        Some(Sample { record, picture: self.first? })
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::Arc;

    use glam::Vec3;
    use psao_codec::envelope::FrameInfo;
    use psao_reconstruct::Size;
    use psao_server::points::PointSettings;
    use psao_server::scene::Scene;
    use psao_server::server::ServerSettings;

    use super::*;
    use crate::screen::{Screen, ScreenError, Shading};
    use crate::shapes;
    use crate::sweep::CloudSettings;
    use crate::sweep::{FrameBytes, ReferenceRays, picture_times, views};
    use crate::texture::TextureSettings;
    use crate::video::{VideoClip, VideoCoder, VideoError};

    /// A clock that advances by a millisecond at each reading.
    struct Ticks(Cell<u64>);

    impl Clock for Ticks {
        fn micros(&self) -> u64 {
            self.0.replace(self.0.get() + 1_000)
        }
    }

    /// A method for which everything is open.
    struct Open;

    impl ScreenMethod for Open {
        fn name(&self) -> &'static str {
            "open"
        }

        fn label(&self) -> String {
            "open".to_owned()
        }

        fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
            let start = clock.micros();
            let image = AoImage::new(screen.inner(), vec![1.0; screen.inner().pixels()])?;
            Ok(Shading { image, stages: vec![("fill", clock.micros() - start)], bytes: 4 })
        }
    }

    fn count(info: &FrameInfo) -> FrameBytes {
        FrameBytes { paper: info.body_bytes() - u64::from(info.header_bytes), wire: info.body_bytes() }
    }

    fn check(look: impl FnOnce(&Bench<'_>, &Clip<'_>, &Setting)) {
        let lists = [shapes::floor(2.0), shapes::cube(Vec3::new(0.0, 0.3, 0.0), 0.3)];
        let scene = Arc::new(Scene::from_triangles("cube on floor", &lists, 0.6).unwrap());
        let base = ServerSettings::default().with_points(PointSettings::default().with_minimum(64));
        let setting = Setting { per_m2: 32.0, rays: 16, fps: 10.0, ..Setting::usual() };
        let ao = base.ao.with_rays(32);
        let times = picture_times(0.4, 20.0, 2);
        let size = Size::new(24, 16).unwrap();
        let views = views(&scene, &times, size, 2, &ReferenceRays::Scene(ao), &|| ()).unwrap();
        let clock = Ticks(Cell::new(0));
        let bench = Bench {
            scene: "cube on floor",
            views: &views,
            runs: RunCounts { repeats: 2, warm_up: 1 },
            network: None,
            clock: &clock,
        };
        look(&bench, &Clip { scene: &scene, base, seconds: 0.4, cache: None, count }, &setting);
    }

    #[test]
    fn a_stream_is_better_than_no_occlusion_at_all() {
        check(|bench, clip, setting| {
            let Sample { record, picture } = bench.stream("k", clip, setting).unwrap();
            let open = bench.method("o", &Open).unwrap().record;
            assert!(record.error.mae < open.error.mae / 2.0, "{record:?}");
            assert!(open.error.bias > 0.0 && (open.error.bias - open.error.mae).abs() < 1e-9);
            assert_eq!(picture.size(), bench.views[0].truth.size());
            assert_eq!((record.pictures.len(), open.pictures.len()), (2, 2));
            let stream = record.stream.unwrap();
            assert_eq!(stream.frames, 4);
            assert!(stream.first_state_bytes > stream.later_bytes, "nothing moves: {stream:?}");
            assert!(record.memory.state_bytes.unwrap() >= u64::from(stream.points));
            assert!(
                record.memory.server_bytes > record.memory.state_bytes && open.memory.server_bytes.is_none()
            );
            assert_eq!(record, bench.stream("k", clip, setting).unwrap().record, "on a steady clock");
        });
    }

    /// A lossless coder; it loses the last frame unless it is `whole`.
    struct Plain {
        whole: bool,
    }

    impl VideoCoder for Plain {
        fn label(&self) -> String {
            "plain".to_owned()
        }

        fn code(&self, size: Size, _fps: f32, frames: &[Vec<u8>]) -> Result<VideoClip, VideoError> {
            assert!(frames.iter().all(|frame| frame.len() == size.pixels()));
            let kept = &frames[..frames.len() - usize::from(!self.whole)];
            let bytes = kept.iter().map(|frame| frame.len() as u64).collect();
            Ok(VideoClip { bytes, frames: kept.to_vec(), encode_micros: 4_000, decode_micros: 8_000 })
        }
    }

    #[test]
    fn texture_space_is_measured_as_a_stream_is() {
        check(|bench, clip, _| {
            let settings = TextureSettings::new(8, 16, 10.0);
            let atlases = bench.atlases(clip, &settings).unwrap();
            let texture = |whole| bench.texture("t", &atlases, &Plain { whole });
            let Sample { record, .. } = texture(true).unwrap();
            let open = bench.method("o", &Open).unwrap().record;
            assert!(record.error.mae < open.error.mae / 2.0, "{record:?}");
            assert_eq!(
                (record.kind, record.label.as_str()),
                (RecordKind::Texture, "1/8, 16 rays, 10 Hz, plain")
            );
            let (stream, texels) = (record.stream.unwrap(), record.memory.state_bytes.unwrap());
            assert_eq!(stream.frames, 4);
            assert!(stream.first_state_bytes > texels, "and where blocks are");
            assert_eq!(stream.later_bytes, 3 * texels, "nothing moves, so no block does");
            let stage = |name: &str| record.stages.iter().find(|stage| stage.name == name).unwrap().ms.median;
            assert_eq!((stage("encode"), stage("decode")), (1.0, 2.0), "of a frame");
            assert!(matches!(texture(false), Err(SweepError::Video(_))), "a frame is missing");
        });
    }

    #[test]
    fn cloud_video_without_loss_errs_by_its_rays_alone_until_the_camera_is_late() {
        check(|bench, clip, _| {
            let settings = CloudSettings { rays: 32, fps: 10.0, camera_lag_ms: 0 };
            let error = |camera_lag_ms| {
                let pictures =
                    bench.cloud_pictures(clip, &CloudSettings { camera_lag_ms, ..settings }).unwrap();
                bench.cloud("c", &pictures, &Plain { whole: true }).unwrap().record
            };
            let record = error(0);
            // Nothing moves, so the picture is the reference's but for rounding.
            assert!(record.error.max <= 0.5 / 255.0 + 1e-6, "{record:?}");
            assert_eq!((record.kind, record.label.as_str()), (RecordKind::Cloud, "32 rays, 10 Hz, plain"));
            let stream = record.stream.unwrap();
            assert_eq!((stream.frames, stream.later_bytes), (4, 3 * 24 * 16));
            let late = error(100);
            assert!(late.label.contains("camera 100 ms late"), "{}", late.label);
            assert_eq!(late.error, record.error, "this scene's camera stands still");
        });
    }

    #[test]
    fn times_are_medians_over_frames_and_runs() {
        check(|bench, clip, setting| {
            let record = bench.stream("k", clip, setting).unwrap().record;
            // There are three later frames in each of two runs. Each stage takes one tick of the clock.
            assert_eq!(record.stages.len(), 8);
            for stage in &record.stages {
                let samples = if stage.name == "reconstruct" { 4 } else { 6 };
                assert_eq!((stage.ms.median, stage.ms.samples), (1.0, samples), "{stage:?}");
            }
            assert_eq!((record.picture_ms.median, record.stream.unwrap().server_ms.median), (2.0, 6.0));
            let open = bench.method("o", &Open).unwrap().record;
            assert_eq!((open.picture_ms.median, open.picture_ms.samples), (1.0, 4));
            assert_eq!(open.memory.working_bytes, Some(4));
        });
    }

    #[test]
    fn a_refused_setting_says_why() {
        check(|bench, clip, setting| {
            let refused = bench.stream("k", clip, &Setting { bits: 20, ..*setting });
            assert!(matches!(refused, Err(SweepError::Server(_))));
        });
    }
}
