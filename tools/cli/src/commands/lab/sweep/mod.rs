//! `psao lab sweep`: settings of the stream and other methods, error against cost.

mod far_field;
mod machine;
mod output;
mod plan;
mod preset;
mod psao;
mod pyramid;
mod store;
mod video;

use std::path::PathBuf;
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_eval::metric::{Lpips, obscurance};
use psao_eval::sweep::{
    AtlasClip, Bench, Clip, CloudClip, CloudSettings, FrameBytes, RunCounts, Sample, SweepError, views,
};
use psao_eval::texture::{TextureError, TextureSettings};
use psao_proto::Profile;
use psao_reconstruct::Size;
use psao_reconstruct::picture::Picture;
use psao_server::scene::Scene;

use self::plan::{Job, Plan, Sweep};
use self::preset::TableArg;
use self::store::Store;
use crate::analysis::{paper_bytes, parts_of};
use crate::args::{CacheArgs, Coder, FormatArg, LpipsArgs, OcclusionArg, ProfileArg, SizeArg};
use crate::cache::{Folder, as_cache};
use crate::context::{Stopwatch, progress};
use crate::error::{Exit, Failure, Outcome};

/// Compare stream settings and other AO methods: error against cost
///
/// Each scene is streamed in memory once for every setting, decoded, reconstructed, and compared with rays traced for every
/// pixel. Screen-space methods shade the same pictures. One axis is swept at a time. The other axes stay at their usual
/// value (512 points, 32 bit, threshold 8, 192 rays, 60 Hz, range, surface) if it is listed, else at the first of the list.
/// --full sweeps every combination. Profile paper uses zstd:15 where the range coder is listed.
///
/// A picture uses the newest frame that began by its time, so a lower frame rate shows older AO. Times are medians over all
/// frames after the first and all repeats, on this machine; all other figures are the same on any machine.
///
/// Two methods send video. texture-space sends AO in a texture atlas, with a block for two triangles. cloud-video sends the
/// AO picture itself, which the client shows as it is. Both need an ffmpeg; without one they are left out, and the output
/// says so. Without --full, later values of --camera-lag are measured with the first --atlas, --video and --crf alone.
///
/// With --output, each result is saved as soon as it is measured; --resume continues an interrupted run.
/// docs/evaluate-json.md describes the JSON.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao lab sweep colonnade -o sweep --recommend
  psao lab sweep colonnade --table pyramid-hbao --radius 0.5,1,2")]
pub(crate) struct Args {
    /// Names of built-in scenes (see `psao scenes`), or files: .toml, .gltf or .glb
    #[arg(value_name = "SCENE", required = true)]
    scenes: Vec<String>,
    #[command(flatten)]
    axes: AxisArgs,
    /// Sweep every combination instead of one axis at a time
    #[arg(long)]
    full: bool,
    #[command(flatten)]
    video: VideoArgs,
    /// Other methods to compare, screen-space, texture-space and cloud-video: all, none, or names [default: all, or
    /// those of --table]
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    methods: Vec<String>,
    /// Leave the streams of points out: compare other methods only
    #[arg(long)]
    no_streams: bool,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "480x270")]
    size: SizeArg,
    /// Pixels that screen-space methods see beyond each edge [default: a tenth of the width]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(0..=4096))]
    guard: Option<u32>,
    /// Frames of the clip at the highest rate of the sweep; slower streams cover the same time
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
    /// Pictures to compare, spread over the clip
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    pictures: u32,
    /// Rays per pixel of the references
    #[arg(long, value_name = "N", default_value_t = 512)]
    reference_rays: u32,
    /// Measured runs of the clip, and of each picture
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    repeats: u32,
    /// Runs of each picture before the measured ones
    #[arg(long, value_name = "N", default_value_t = 1)]
    warm_up: u32,
    /// Fewest points of an instance, however small its surface
    #[arg(long, default_value_t = 1024, value_name = "N")]
    min_points: u32,
    /// Lengths of the rays in metres; each gets its own reference, streams and methods [default: the scene's own; 3 with
    /// --table far-field; 0.25,0.5,1,2,4 with --table pyramid-hbao]
    #[arg(long, value_name = "M,..", value_delimiter = ',', help_heading = AXES)]
    radius: Vec<f32>,
    /// What a ray that hits something adds to the AO value; with --table far-field, an exponential of its distance
    #[arg(long, value_enum, default_value_t = OcclusionArg::Obscurance)]
    occlusion: OcclusionArg,
    /// Seed of the points and their rays
    #[arg(long, default_value_t = 1, value_name = "S")]
    seed: u64,
    #[command(flatten)]
    lpips: LpipsArgs,
    /// Sweep and print what a table or figure of a paper shows, in every combination
    ///
    /// Axes that are not given are those of the table.
    #[arg(long, value_enum, value_name = "NAME")]
    table: Option<TableArg>,
    /// Recommend a setting for each bandwidth and each time, in words
    #[arg(long)]
    recommend: bool,
    /// Write results.csv, results.json, report.html and the pictures into this folder
    #[arg(short, long, alias = "out", value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Show only the pictures of the N methods with the least errors on the page [default: all]
    #[arg(long, value_name = "N", requires = "output")]
    thumbnails: Option<usize>,
    /// Keep the results in the folder that match these settings, and measure the rest
    #[arg(long, requires = "output")]
    resume: bool,
    #[command(flatten)]
    format: FormatArg,
    #[command(flatten)]
    cache: CacheArgs,
}

/// Heading of the options in `--help`.
const AXES: &str = "Values to sweep, with commas";

/// What is swept of methods that send video.
#[derive(clap::Args, Clone, Debug)]
struct VideoArgs {
    /// Pixels per texel of texture-space, in each direction, on a screen of 1080 lines
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "8,16,32", help_heading = AXES)]
    atlas: Vec<u32>,
    /// Video coders
    #[arg(long, value_enum, value_name = "NAME,..", value_delimiter = ',', default_value = "x264", help_heading = AXES)]
    video: Vec<video::Encoder>,
    /// Rate factors of video, 0 (best) to 51; to 63 with svt-av1
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "23", help_heading = AXES)]
    crf: Vec<u8>,
}

/// What is swept; an axis that was not given is empty.
#[derive(clap::Args, Clone, Debug)]
struct AxisArgs {
    /// Points per square metre [default: 256,512,1024]
    #[arg(long, value_name = "N,..", value_delimiter = ',', help_heading = AXES)]
    points: Vec<f32>,
    /// Distances of neighbouring points on a picture of 1080 rows, in pixels; 0 for all points [default: 4]
    #[arg(long, value_name = "PIXELS,..", value_delimiter = ',', help_heading = AXES)]
    quality: Vec<f32>,
    /// Bits of a packed point [default: 32,24,16; 32 with --table]
    #[arg(long, value_name = "32,24,16", value_delimiter = ',', help_heading = AXES)]
    bits: Vec<u8>,
    /// Steps of 1/255 by which AO must change to be sent again [default: 2,8; 8 with --table]
    #[arg(long, value_name = "STEPS,..", value_delimiter = ',', value_parser = clap::value_parser!(u8).range(1..), help_heading = AXES)]
    threshold: Vec<u8>,
    /// Rays per point [default: 64,192; 192 with --table]
    #[arg(long, value_name = "N,..", value_delimiter = ',', help_heading = AXES)]
    rays: Vec<u32>,
    /// Frames per second [default: 15,60; with --table, those of the table]
    #[arg(long, value_name = "F,..", value_delimiter = ',', help_heading = AXES)]
    fps: Vec<f32>,
    /// Compression of blocks: range, zstd, zstd:LEVEL, lz4 or none [default: range,zstd; range with --table]
    #[arg(long = "compress", alias = "coder", value_name = "CODER,..", value_delimiter = ',', help_heading = AXES)]
    coder: Vec<Coder>,
    /// Formats of the stream [default: surface,paper]
    #[arg(long, value_enum, value_name = "NAME,..", value_delimiter = ',', help_heading = AXES)]
    profile: Vec<ProfileArg>,
    /// Milliseconds by which the server's camera is behind the client's [default: 0]
    #[arg(long, value_name = "MS,..", value_delimiter = ',', help_heading = AXES)]
    camera_lag: Vec<u32>,
}

impl Args {
    /// Returns whether all values are combined, instead of one axis varied at a time.
    fn sweeps_every_combination(&self) -> bool {
        self.full || self.table.is_some()
    }
}

pub(crate) fn run(args: &Args) -> Outcome {
    let size = Size::new(args.size.width, args.size.height).map_err(Failure::usage)?;
    let (network, weights) = args.lpips.load()?.unzip();
    let sweep = Sweep::new(args, size, weights.as_deref())?;
    for words in &sweep.rivals.left_out {
        eprintln!("psao: {words}");
    }
    let scenes = args.scenes.iter().map(|name| Scene::load(name).map(Arc::new).map_err(Failure::input));
    let scenes: Vec<Arc<Scene>> = scenes.collect::<Outcome<_>>()?;
    let plans: Vec<Plan<'_>> = scenes.iter().flat_map(|scene| sweep.plans(scene)).collect::<Outcome<_>>()?;
    let mut store = Store::open(args.output.as_deref(), args.resume)?;
    let open = plans.iter().flat_map(|plan| &plan.jobs).filter(|(key, _)| store.record(key).is_none());
    let bar = progress("evaluating", open.count() as u64);
    let cache = Folder::of(&args.cache);
    for plan in &plans {
        measure(plan, network.as_ref(), as_cache(&cache), &mut store, &bar)?;
    }
    bar.finish_and_clear();
    output::write(args, &sweep, &plans, &store)
}

/// Measures the results of a scene at one radius that are missing.
fn measure(
    plan: &Plan<'_>,
    network: Option<&Lpips>,
    cache: Option<&dyn psao_server::points::PointCache>,
    store: &mut Store,
    bar: &indicatif::ProgressBar,
) -> Outcome {
    let open: Vec<_> = plan.jobs.iter().filter(|(key, _)| store.record(key).is_none()).collect();
    if open.is_empty() {
        return Ok(());
    }
    let sweep = plan.sweep;
    let tracing = progress("references", plan.times.len() as u64);
    let views = views(plan.scene, &plan.times, sweep.size, sweep.guard, &plan.truth, &|| tracing.inc(1));
    tracing.finish_and_clear();
    let views = views.map_err(refused)?;
    if let Some(view) = views.first() {
        store.picture(&plan.reference_key, "reference", &Picture::grey(&view.truth))?;
    }
    let clock = Stopwatch::start();
    let bench = Bench {
        scene: plan.scene.name(),
        views: &views,
        runs: RunCounts { repeats: sweep.args.repeats, warm_up: sweep.args.warm_up },
        network,
        clock: &clock,
    };
    let clip = Clip { scene: plan.scene, base: plan.base, seconds: sweep.seconds, cache, count };
    let mut traced = Traced::default();
    for (key, job) in open {
        let sample = match job {
            Job::Stream(setting) => bench.stream(key, &clip, setting),
            Job::Texture(settings, video) => {
                let clip = traced.atlases(&bench, &clip, settings);
                clip.and_then(|clip| bench.texture(key, clip, video))
            }
            Job::Cloud(settings, video) => {
                let clip = traced.pictures(&bench, &clip, settings);
                clip.and_then(|clip| bench.cloud(key, clip, video))
            }
            Job::Method(method) => bench.method(key, method.as_ref()),
        };
        let Sample { record, picture } = sample.map_err(refused)?;
        if let Some(view) = views.first() {
            let map = obscurance::error_map(&view.truth, &picture)
                .map_err(|error| Failure::new(Exit::System, error))?;
            store.picture(key, "picture", &Picture::grey(&picture))?;
            store.picture(key, "error", &Picture::grey(&map))?;
        }
        store.add(record)?;
        bar.inc(1);
    }
    Ok(())
}

/// The frames that were traced last: several video coders code the same.
#[derive(Default)]
struct Traced {
    atlases: Option<AtlasClip>,
    pictures: Option<CloudClip>,
}

impl Traced {
    fn atlases(
        &mut self,
        bench: &Bench<'_>,
        clip: &Clip<'_>,
        settings: &TextureSettings,
    ) -> Result<&AtlasClip, SweepError> {
        let kept = match self.atlases.take().filter(|kept| kept.settings() == settings) {
            Some(kept) => kept,
            None => bench.atlases(clip, settings)?,
        };
        Ok(self.atlases.insert(kept))
    }

    fn pictures(
        &mut self,
        bench: &Bench<'_>,
        clip: &Clip<'_>,
        settings: &CloudSettings,
    ) -> Result<&CloudClip, SweepError> {
        // The atlases of a clip take as much room as all else.
        self.atlases = None;
        let kept = match self.pictures.take().filter(|kept| kept.settings() == settings) {
            Some(kept) => kept,
            None => bench.cloud_pictures(clip, settings)?,
        };
        Ok(self.pictures.insert(kept))
    }
}

fn count(info: &psao_codec::envelope::FrameInfo) -> FrameBytes {
    let parts = parts_of(info);
    FrameBytes { paper: paper_bytes(&parts), wire: parts.iter().sum() }
}

/// Returns the failure of a measurement, with the exit code of its cause.
fn refused(error: SweepError) -> Failure {
    match error {
        SweepError::Server(error) => crate::producer::refused(error),
        SweepError::Frame { .. } | SweepError::Repeat { .. } => Failure::new(Exit::Check, error),
        SweepError::Metric(error) => Failure::new(Exit::System, error),
        SweepError::Video(error) => Failure::new(Exit::System, error),
        SweepError::Texture(
            error @ (TextureError::Setting { .. } | TextureError::Power { .. } | TextureError::Rays(_)),
        ) => Failure::usage(error),
        SweepError::Reference(error) => Failure::reference(error),
        error => Failure::input(error),
    }
}

impl AxisArgs {
    /// Returns the axes of a sweep without `--table`.
    fn usual() -> Self {
        Self {
            points: vec![256.0, 512.0, 1024.0],
            quality: Vec::new(),
            bits: vec![32, 24, 16],
            threshold: vec![2, 8],
            rays: vec![64, 192],
            fps: vec![15.0, 60.0],
            coder: vec![Coder::RANGE, Coder(BlockCoder::Zstd { level: 15 })],
            profile: vec![ProfileArg::Surface, ProfileArg::Paper],
            camera_lag: Vec::new(),
        }
    }

    /// Returns the axes that were given, and for the others those of `usual`.
    fn or(&self, usual: Self) -> Self {
        fn or<T: Clone>(given: &[T], usual: Vec<T>) -> Vec<T> {
            if given.is_empty() { usual } else { given.to_vec() }
        }
        Self {
            points: or(&self.points, usual.points),
            quality: or(&self.quality, usual.quality),
            bits: or(&self.bits, usual.bits),
            threshold: or(&self.threshold, usual.threshold),
            rays: or(&self.rays, usual.rays),
            fps: or(&self.fps, usual.fps),
            coder: or(&self.coder, usual.coder),
            profile: or(&self.profile, usual.profile),
            camera_lag: or(&self.camera_lag, usual.camera_lag),
        }
    }

    fn grid(&self) -> psao_eval::sweep::SettingGrid {
        psao_eval::sweep::SettingGrid {
            per_m2: self.points.clone(),
            quality: self.quality.clone(),
            bits: self.bits.clone(),
            threshold: self.threshold.clone(),
            rays: self.rays.clone(),
            fps: self.fps.clone(),
            coder: self.coder.iter().map(|coder| coder.0).collect(),
            profile: self.profile.iter().map(|&profile| Profile::from(profile)).collect(),
            camera_lag_ms: self.camera_lag.clone(),
        }
    }
}
