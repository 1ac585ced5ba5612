//! Options that several commands share.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, ValueEnum};
use psao_codec::block::BlockCoder;
use psao_codec::surface::GeometrySource;
use psao_eval::metric::Lpips;
use psao_proto::Micros;
use psao_proto::Profile;
use psao_proto::recording::file::{GapTotals, KeyframeInterval, RecorderNotice, RecorderOptions};
use psao_server::ao::Occlusion;

use crate::budget::BudgetArgs;
use crate::error::{Failure, Outcome};
use crate::input::load;
use crate::output::number;
use crate::quantity::{Size, TimeSpan};

/// Headings of the options in `--help`.
pub(crate) const POINTS: &str = "Points and rays";
pub(crate) const STREAM: &str = "Stream";
const CACHE: &str = "Cache of points";

/// How a stream is produced: the scene, its points, their rays, and how they are packed.
#[derive(Args, Clone, Debug)]
pub(crate) struct StreamArgs {
    /// Name of a built-in scene (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) scene: String,
    #[command(flatten)]
    pub(crate) tuning: TuningArgs,
}

/// The options of a stream other than its scene.
#[derive(Args, Clone, Debug)]
pub(crate) struct TuningArgs {
    #[command(flatten)]
    pub(crate) points: PointArgs,
    /// Format of the stream
    #[arg(long, value_enum, default_value_t = ProfileArg::Surface, help_heading = STREAM)]
    pub(crate) profile: ProfileArg,
    /// Compression of blocks: range (profile surface only), zstd, zstd:LEVEL, lz4 or none [default: range for profile
    /// surface, zstd:15 for paper]
    #[arg(long, value_name = "CODER", help_heading = STREAM)]
    pub(crate) compress: Option<Coder>,
    #[command(flatten)]
    pub(crate) budget: BudgetArgs,
    /// Most rays of a frame after the first. Points left over keep their AO and are traced later, by screen size and
    /// waiting time; after 30 frames a point takes precedence over all others
    #[arg(long, value_name = "RAYS", value_parser = clap::value_parser!(u64).range(1..), help_heading = POINTS)]
    pub(crate) ray_budget: Option<u64>,
}

/// The options that mean the same in both profiles: the points, their rays, when they are sent.
#[derive(Args, Clone, Debug)]
pub(crate) struct PointArgs {
    /// Frames per second of stream time
    #[arg(long, default_value_t = 60.0, value_name = "HZ", help_heading = STREAM)]
    pub(crate) fps: f32,
    /// Points per square metre of surface, at most
    #[arg(long = "points", default_value_t = 512.0, value_name = "N_PER_M2", help_heading = POINTS)]
    pub(crate) per_m2: f32,
    /// Distance of neighbouring points on a picture of 1080 rows, in pixels: 4 is fine, 16 is coarse. Surfaces have fewer points
    /// where they are far away, but never more than --points; 0 sends all points of the scene. Profile surface
    #[arg(long, default_value_t = 4.0, value_name = "PIXELS", help_heading = POINTS)]
    pub(crate) quality: f32,
    /// Fewest points of an instance, however small its surface
    #[arg(long, default_value_t = 1024, value_name = "N", help_heading = POINTS)]
    pub(crate) min_points: u32,
    /// Rays per point
    #[arg(long, default_value_t = 192, value_name = "N", help_heading = POINTS)]
    pub(crate) rays: u32,
    /// Length of the rays in metres [default: the scene's own]
    #[arg(long, value_name = "METRES", help_heading = POINTS)]
    pub(crate) radius: Option<f32>,
    /// What a ray that hits something adds to the AO value
    #[arg(long, value_enum, default_value_t = OcclusionArg::Obscurance, help_heading = POINTS)]
    pub(crate) occlusion: OcclusionArg,
    /// Bits of a packed point. Fewer bits make a smaller stream and a coarser picture; in profile surface they set how
    /// finely positions and normals are rounded
    #[arg(long, default_value_t = 32, value_name = "32|24|16", help_heading = STREAM)]
    pub(crate) bits: u8,
    /// How clients of profile surface get the points
    #[arg(long, value_enum, default_value_t = GeometryArg::Sent, help_heading = STREAM)]
    pub(crate) geometry: GeometryArg,
    /// Send a change once clients would be off by this many steps of 1/255; for the finest points twice as much counts
    #[arg(long, default_value_t = 8, value_name = "STEPS", value_parser = clap::value_parser!(u8).range(1..), help_heading = STREAM)]
    pub(crate) threshold: u8,
    /// The same for points that no camera sees [default: 8 times the threshold, at most 64; in profile paper the threshold]
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u8).range(1..), help_heading = STREAM)]
    pub(crate) unseen_threshold: Option<u8>,
    /// Seed of the points and their rays; the same seed gives the same bytes
    #[arg(long, default_value_t = 1, value_name = "S", help_heading = POINTS)]
    pub(crate) seed: u64,
    /// Width of the view in which points are kept up to date, relative to the camera's
    #[arg(long, default_value_t = 1.3, value_name = "FACTOR", help_heading = POINTS)]
    pub(crate) view_margin: f32,
    /// Keep every point of the scene up to date, whatever the camera sees
    #[arg(long, help_heading = POINTS)]
    pub(crate) all_visible: bool,
    /// Trace every point in every frame, even where nothing near it moved; changes no byte of the stream
    #[arg(long, help_heading = POINTS)]
    pub(crate) exhaustive: bool,
    /// Radius within which points count for the AO of a pixel, in Poisson-disk radii of the points [default: 2.8; 2.5 in
    /// profile paper]
    #[arg(long, value_name = "RADII", help_heading = STREAM)]
    pub(crate) kernel: Option<f32>,
    /// Slots of the hash table for each expected cell, in profile paper
    #[arg(long, default_value_t = 4.0, value_name = "N", help_heading = STREAM)]
    pub(crate) slots_per_cell: f32,
    #[command(flatten)]
    pub(crate) cache: CacheArgs,
}

/// Where points are kept between runs.
#[derive(Args, Clone, Debug)]
pub(crate) struct CacheArgs {
    /// Folder that keeps points between runs [default: psao in the system's cache folder, such as ~/.cache/psao]
    #[arg(long, value_name = "FOLDER", help_heading = CACHE)]
    pub(crate) cache: Option<PathBuf>,
    /// Size limit of the cache folder; the least recently used files are removed first
    #[arg(long, value_name = "SIZE", default_value = "1GiB", help_heading = CACHE)]
    pub(crate) cache_size: Size,
    /// Compute the points anew, and keep none
    #[arg(long, conflicts_with = "cache", help_heading = CACHE)]
    pub(crate) no_cache: bool,
}

impl TuningArgs {
    /// Returns the stream's block coder. Refuses what the profile does not have.
    pub(crate) fn coder(&self) -> Outcome<BlockCoder> {
        if self.profile == ProfileArg::Paper && self.points.geometry == GeometryArg::Shared {
            return Err(Failure::usage(
                "--geometry shared is for profile surface; keyframes of profile paper carry the points",
            ));
        }
        self.profile.coder(self.compress)
    }
}

impl ProfileArg {
    /// The block coder of a stream of this profile, as asked for or by default.
    pub(crate) fn coder(self, asked: Option<Coder>) -> Outcome<BlockCoder> {
        match (self, asked) {
            (Self::Paper, Some(coder)) if coder == Coder::RANGE => Err(Failure::usage(
                "the range coder is for profile surface; profile paper takes zstd, lz4 or none",
            )),
            (_, Some(Coder(coder))) => Ok(coder),
            (Self::Paper, None) => Ok(BlockCoder::Zstd { level: 15 }),
            (Self::Surface, None) => Ok(Coder::RANGE.0),
        }
    }
}

/// `--occlusion`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum OcclusionArg {
    /// Its distance divided by the radius, as in the paper's prototype
    Obscurance,
    /// Nothing: AO is the share of the rays that hit nothing
    Binary,
}

impl From<OcclusionArg> for Occlusion {
    fn from(occlusion: OcclusionArg) -> Self {
        match occlusion {
            OcclusionArg::Obscurance => Self::Obscurance,
            OcclusionArg::Binary => Self::Binary,
        }
    }
}

/// `--profile`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProfileArg {
    /// Points stay on the mesh at rest; only their AO is sent
    Surface,
    /// Points in cells and buckets, as in the paper; the baseline
    Paper,
}

impl From<ProfileArg> for Profile {
    fn from(profile: ProfileArg) -> Self {
        match profile {
            ProfileArg::Surface => Self::SURFACE,
            ProfileArg::Paper => Self::PAPER,
        }
    }
}

/// `--geometry`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum GeometryArg {
    /// Keyframes carry the points
    Sent,
    /// Clients compute the points from the scene, the density and the seed; needs the scene at the client
    Shared,
}

impl From<GeometryArg> for GeometrySource {
    fn from(geometry: GeometryArg) -> Self {
        match geometry {
            GeometryArg::Sent => Self::Sent,
            GeometryArg::Shared => Self::Shared,
        }
    }
}

/// `--compress`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Coder(pub(crate) BlockCoder);

impl Coder {
    /// The coder of profile `surface`.
    pub(crate) const RANGE: Self = Self(BlockCoder::Range);
}

impl FromStr for Coder {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let coder = match text.split_once(':') {
            None if text == "range" => return Ok(Self::RANGE),
            None if text == "zstd" => BlockCoder::Zstd { level: 15 },
            None if text == "lz4" => BlockCoder::Lz4,
            None if text == "none" => BlockCoder::Stored,
            Some(("zstd", level)) => match level.parse() {
                Ok(level @ 1..=22) => BlockCoder::Zstd { level },
                _ => return Err(format!("zstd has levels 1 to 22, not \"{level}\"")),
            },
            _ => {
                return Err(format!(
                    "\"{text}\" is not a coder: choose range, zstd, zstd:LEVEL, lz4 or none"
                ));
            }
        };
        Ok(Self(coder))
    }
}

/// `--size`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SizeArg {
    pub(crate) width: u32,
    pub(crate) height: u32,
}

impl FromStr for SizeArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parsed = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        match parsed {
            Some((width @ 1..=16_384, height @ 1..=16_384)) => Ok(Self { width, height }),
            _ => Err(format!("\"{text}\" is not a size such as 960x540, each side 1 to 16384")),
        }
    }
}

/// Three numbers with commas between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Triple(pub(crate) [f32; 3]);

impl FromStr for Triple {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        numbers(text).map(Self).ok_or_else(|| format!("\"{text}\" is not three numbers such as 1.5,0,-2"))
    }
}

/// So many finite numbers with commas between them.
pub(crate) fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok().filter(|numbers: &[f32; N]| numbers.iter().all(|v| v.is_finite()))
}

/// `--edits` of a live server.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EditsArg {
    /// Clients may move, hide and show instances, for all clients
    Allow,
    /// The scene stays as it is
    Deny,
}

/// How results are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// For people
    Table,
    /// For programs, with a documented schema
    Json,
    /// For spreadsheets: one line for each row
    Csv,
}

/// `--format` of a command whose result has rows.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct FormatArg {
    /// How to print the result
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
    /// The older spelling of --format json
    #[arg(long, hide = true, conflicts_with = "format")]
    json: bool,
}

impl FormatArg {
    /// Returns the format that was asked for.
    pub(crate) fn get(self) -> Format {
        if self.json { Format::Json } else { self.format }
    }
}

/// How results without rows are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ReportFormat {
    /// For people
    Table,
    /// For programs, with a documented schema
    Json,
}

/// `--format` of a command whose result is more than one table.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct ReportFormatArg {
    /// How to print the result
    #[arg(long, value_enum, default_value_t = ReportFormat::Table)]
    format: ReportFormat,
    /// The older spelling of --format json
    #[arg(long, hide = true, conflicts_with = "format")]
    json: bool,
}

impl ReportFormatArg {
    /// Returns whether JSON was asked for.
    pub(crate) fn is_json(self) -> bool {
        self.json || self.format == ReportFormat::Json
    }
}

/// A recording to read.
#[derive(Args, Clone, Debug)]
pub(crate) struct RecordingArg {
    /// A recording made by `psao record`; - reads standard input
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
}

/// The network of LPIPS.
#[derive(Args, Clone, Debug)]
pub(crate) struct LpipsArgs {
    /// Weights of the LPIPS metric (`AlexNet`, version 0.1: 2,470,848 f16 or f32); without them LPIPS is left out
    #[arg(long, value_name = "FILE")]
    lpips_weights: Option<PathBuf>,
}

impl LpipsArgs {
    /// The network, and the bytes that it was made of; `None` unless asked for.
    pub(crate) fn load(&self) -> Outcome<Option<(Lpips, Vec<u8>)>> {
        let Some(path) = &self.lpips_weights else { return Ok(None) };
        let bytes = load(path)?;
        let network = Lpips::from_weights(&bytes)
            .map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))?;
        Ok(Some((network, bytes)))
    }
}

/// Where a recording made of others goes.
#[derive(Args, Clone, Debug)]
pub(crate) struct OutputArg {
    /// The recording to write, - for standard output; a file of that name is replaced once the new one is whole
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
}

/// How recordings are written.
#[derive(Args, Clone, Debug)]
pub(crate) struct RecorderArgs {
    /// Time between keyframes, from which a player can start, and with which the loss by damage ends; off writes only the
    /// stream's own. auto is 5 s or more, so that keyframes are about a fifth of the recording at most
    #[arg(long, value_name = "auto|off|TIME", default_value = "auto", value_parser = keyframe_interval)]
    keyframe_every: KeyframeInterval,
    /// Memory for frames of a live recording that wait for the disk, 1MiB to 64GiB
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = buffer)]
    record_buffer: Size,
}

/// Parses `--record-buffer`.
fn buffer(text: &str) -> Result<Size, String> {
    Size::between(text, 1 << 20, 64 << 30)
}

/// Parses `--keyframe-every`.
fn keyframe_interval(text: &str) -> Result<KeyframeInterval, String> {
    match text {
        "auto" => Ok(KeyframeInterval::default()),
        "off" => Ok(KeyframeInterval::Never),
        _ => match text.parse() {
            Ok(TimeSpan(time @ Micros(1_000..))) => Ok(KeyframeInterval::Every(time)),
            Ok(_) => Err(format!("\"{text}\" is below 1ms")),
            Err(error) => Err(format!("{error}, or auto, or off")),
        },
    }
}

impl RecorderArgs {
    /// Returns how to record a stream that can wait for the disk.
    pub(crate) fn waiting(&self) -> RecorderOptions {
        RecorderOptions::default().with_keyframes(self.keyframe_every).with_backpressure()
    }

    /// Returns how to record a live stream into a file; what happens meanwhile goes to standard error.
    pub(crate) fn options(&self, path: &Path) -> RecorderOptions {
        let path = path.display().to_string();
        let bytes = usize::try_from(self.record_buffer.0).unwrap_or(usize::MAX);
        let options = RecorderOptions::default().with_keyframes(self.keyframe_every).with_buffer_bytes(bytes);
        options.with_observer(move |notice| match notice {
            // It names the file itself.
            RecorderNotice::Failed(_) => eprintln!("psao: {notice}"),
            RecorderNotice::Incomplete(GapTotals { gaps, frames, bytes, .. }) => eprintln!(
                "psao: {path}: {} ({}) missing from the recording, in {}",
                number::counted(frames, "frame"),
                number::bytes(bytes),
                number::counted(gaps, "gap")
            ),
            _ => eprintln!("psao: {path}: {notice}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coders_parse_and_say_what_is_wrong() {
        assert_eq!("zstd".parse(), Ok(Coder(BlockCoder::Zstd { level: 15 })));
        assert_eq!("zstd:3".parse(), Ok(Coder(BlockCoder::Zstd { level: 3 })));
        assert_eq!("lz4".parse(), Ok(Coder(BlockCoder::Lz4)));
        assert_eq!("none".parse(), Ok(Coder(BlockCoder::Stored)));
        assert_eq!("range".parse(), Ok(Coder::RANGE));
        for bad in ["zstd:0", "zstd:23", "zstd:", "lz4:1", "", "gzip"] {
            assert!(bad.parse::<Coder>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_profile_has_its_own_coder_unless_told_otherwise() {
        let lz4 = Some(Coder(BlockCoder::Lz4));
        assert_eq!(ProfileArg::Paper.coder(None).unwrap(), BlockCoder::Zstd { level: 15 });
        assert_eq!(ProfileArg::Surface.coder(None).unwrap(), Coder::RANGE.0);
        assert_eq!(ProfileArg::Surface.coder(lz4).unwrap(), BlockCoder::Lz4);
        assert!(ProfileArg::Paper.coder(Some(Coder::RANGE)).is_err());
    }

    #[test]
    fn sizes_and_triples_refuse_nonsense() {
        assert_eq!("960x540".parse(), Ok(SizeArg { width: 960, height: 540 }));
        for bad in ["0x5", "5", "axb", "99999x1", "1x2x3"] {
            assert!(bad.parse::<SizeArg>().is_err(), "{bad}");
        }
        assert_eq!("1,-2.5,3".parse(), Ok(Triple([1.0, -2.5, 3.0])));
        for bad in ["1,2", "1,2,3,4", "1,x,2,3", "nan,0,0", ""] {
            assert!(bad.parse::<Triple>().is_err(), "{bad}");
        }
    }
}
