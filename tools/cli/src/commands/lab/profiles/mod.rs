//! `psao lab profiles`: what both profiles cost and give on the same traced AO.

mod figures;
mod measure;

use std::path::PathBuf;
use std::sync::Arc;

use psao_server::scene::Scene;
use psao_server::server::BothProfiles;

use crate::args::{Coder, PointArgs, ProfileArg, ReportFormatArg, SizeArg};
use crate::cache::{Folder, as_cache};
use crate::context::say_json;
use crate::error::{Failure, Outcome};
use crate::producer::{refused, settings, show_progress};

/// Compare both stream formats on the same rays: bytes, times, errors
///
/// AO is traced once a frame and encoded in both profiles with the same points, visibility and threshold. The bytes of each
/// are those that `psao record --profile` writes with the same options. A client of each follows every frame, and its state
/// hash must equal the server's; if not, the exit code is 6.
///
/// "As the paper counts" is the compressed blocks that hold points, after the first frame. "Everything" adds poses, headers,
/// the wire frames around them, and frames in which nothing changed. The error compares the client's AO of the points in
/// view with AO that was neither rounded nor held back by a threshold. Points for which the paper's tables have no room are
/// counted separately. Only times depend on the machine. docs/compare-json.md describes the JSON.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao lab profiles --scene robot-lab --pictures 60
  psao lab profiles --scene colonnade --format json")]
pub(crate) struct Args {
    /// Name of a built-in scene (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE")]
    scene: String,
    /// Frames to compare, including the first
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
    #[command(flatten)]
    points: PointArgs,
    /// Compression of profile paper: zstd, zstd:LEVEL, lz4 or none
    #[arg(long, value_name = "CODER", default_value = "zstd:15")]
    paper_compress: Coder,
    /// Compression of profile surface: range, zstd, zstd:LEVEL, lz4 or none
    #[arg(long, value_name = "CODER", default_value = "range")]
    surface_compress: Coder,
    /// Draw these frames in both profiles, and compare them with ray tracing
    #[arg(long, value_name = "F,F,..", value_delimiter = ',')]
    pictures: Vec<u32>,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "960x540")]
    size: SizeArg,
    /// Rays per pixel of the reference pictures
    #[arg(long, value_name = "N", default_value_t = 512)]
    reference_rays: u32,
    /// Write the pictures into this folder: reference, paper and surface, side by side and alone
    #[arg(short, long, value_name = "FOLDER", requires = "pictures")]
    output: Option<PathBuf>,
    #[command(flatten)]
    format: ReportFormatArg,
}

pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(frame) = args.pictures.iter().find(|frame| **frame >= args.frames) {
        let last = args.frames - 1;
        return Err(Failure::usage(format_args!(
            "--pictures {frame}: frames go from 0 to {last}; raise --frames"
        )));
    }
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder).map_err(|error| Failure::writing(folder, &error))?;
    }
    let paper_coder = ProfileArg::Paper.coder(Some(args.paper_compress))?;
    let surface_coder = ProfileArg::Surface.coder(Some(args.surface_compress))?;
    let scene = Arc::new(Scene::load(&args.scene).map_err(Failure::input)?);
    let settings = settings(&args.points, &scene, args.frames).with_coder(paper_coder);
    let cache = Folder::of(&args.points.cache);
    let both =
        BothProfiles::new(Arc::clone(&scene), &settings, surface_coder, as_cache(&cache), show_progress());
    let mut both = both.map_err(refused)?;
    let measured = measure::measure(args, &scene, &settings, surface_coder, &mut both)?;
    let document = figures::Document::new(args, &both.tables().surface.header(), &measured);
    if args.format.is_json() { say_json(&document) } else { document.print() }
}
