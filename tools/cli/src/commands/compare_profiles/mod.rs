//! `psao compare-profiles`: what both profiles cost and give on the same traced AO.

mod figures;
mod measure;

use std::path::PathBuf;
use std::sync::Arc;

use psao_server_sim::scene::Scene;
use psao_server_sim::server::BothProfiles;

use crate::args::{Coder, PointArgs, ProfileArg, SizeArg};
use crate::cache::{Folder, as_cache};
use crate::context::say;
use crate::error::{Exit, Failure, Outcome};
use crate::producer::{refused, settings, show_progress};

/// Both profiles on the same scene, points and rays: bytes by part, Mbit/s, times, error, PSNR
///
/// AO is traced once a frame and written in both profiles, with the same points, visibility and threshold; the bytes of
/// each are those that `psao record --profile` writes with the same options. A client of each follows every frame, and
/// its state hash must be the server's (exit code 6 if not). "As the paper counts" is the compressed blocks that hold
/// points, after the first state: cells and buckets, or changes and values. "Everything" adds poses, headers, the wire
/// frames around them, and frames in which nothing changed. The error is that of the AO that the client holds for the
/// points in view against AO that was neither rounded nor held back by a threshold; points that the paper's tables have
/// no room for are counted apart. Times are of this machine; all else is the same on any.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Built-in scene (see `psao scenes`), or a .toml scene file, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE")]
    scene: String,
    /// Frames to compare, the first state included
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
    #[command(flatten)]
    points: PointArgs,
    /// Block coder of profile paper: zstd, zstd:LEVEL, lz4 or none
    #[arg(long, value_name = "CODER", default_value = "zstd:15")]
    paper_compress: Coder,
    /// Block coder of profile surface: range, zstd, zstd:LEVEL, lz4 or none
    #[arg(long, value_name = "CODER", default_value = "range")]
    surface_compress: Coder,
    /// Draw these frames in both profiles, and compare them with rays
    #[arg(long, value_name = "F,F,..", value_delimiter = ',')]
    pictures: Vec<u32>,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "960x540")]
    size: SizeArg,
    /// Rays a pixel of the reference pictures
    #[arg(long, value_name = "N", default_value_t = 512)]
    reference_rays: u32,
    /// Write the pictures into this folder: by rays, paper and surface side by side, and each alone
    #[arg(short, long, value_name = "FOLDER", requires = "pictures")]
    output: Option<PathBuf>,
    /// Print JSON (docs/compare-json.md) instead of tables
    #[arg(long)]
    json: bool,
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
    let settings = psao_server_sim::server::ServerSettings {
        coder: paper_coder,
        ..settings(&args.points, &scene, args.frames)
    };
    let cache = Folder::of(&args.points.cache);
    let both =
        BothProfiles::new(Arc::clone(&scene), &settings, surface_coder, as_cache(&cache), show_progress());
    let mut both = both.map_err(refused)?;
    let measured = measure::measure(args, &scene, &settings, surface_coder, &mut both)?;
    let document = figures::Document::new(args, &both.tables().surface.header(), &measured);
    if args.json {
        let text = serde_json::to_string_pretty(&document);
        say(text.map_err(|error| Failure::new(Exit::System, format_args!("cannot write JSON: {error}")))?)
    } else {
        document.print()
    }
}
