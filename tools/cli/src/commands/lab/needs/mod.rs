//! `psao lab needs`: what a scene does not need, and what leaving it out saves.

mod figures;
mod measure;
mod rows;

use std::sync::Arc;

use psao_server_sim::clip::{self, Clip};
use psao_server_sim::scene::Scene;
use psao_server_sim::server::ServerSettings;

use crate::args::{Coder, PointArgs, ProfileArg, ReportFormatArg};
use crate::cache::Folder;
use crate::context::say_json;
use crate::error::{Failure, Outcome};
use crate::producer::settings;

/// What a scene does not need, and what leaving it out saves: bytes, rays, milliseconds
///
/// First what is in the scene, by groups of instances that need the same. Then each thing that is left out for that: the
/// stream is made with it, and without; where only the server's work is saved, every frame must be the same to the bit
/// (exit code 6 if not). Rounds take the ways in turn, each in another order; times are medians over the rounds of what
/// one way took more than the other in the same round, with the least and the most. All figures but bytes once are of the
/// frames after the first. Times are of this machine; all else is the same on any.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Built-in scene (see `psao scenes`), or a .toml scene file, .gltf or .glb
    #[arg(value_name = "NAME|FILE")]
    scene: String,
    /// Frames of each run, the first state included
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
    /// Rounds of all runs
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    #[command(flatten)]
    points: PointArgs,
    /// Block coder: range, zstd, zstd:LEVEL, lz4 or none
    #[arg(long, value_name = "CODER", default_value = "range")]
    compress: Coder,
    #[command(flatten)]
    format: ReportFormatArg,
}

pub(crate) fn run(args: &Args) -> Outcome {
    if args.points.exhaustive {
        return Err(Failure::usage("--exhaustive leaves nothing out that could be measured: do without it"));
    }
    let scene = Arc::new(Scene::load(&args.scene).map_err(Failure::input)?);
    let coder = ProfileArg::Surface.coder(Some(args.compress))?;
    let settings = ServerSettings { coder, ..settings(&args.points, &scene, args.frames) };
    settings.validate().map_err(Failure::settings)?;
    let margin = (!args.points.all_visible).then_some(args.points.view_margin);
    let clip = Clip {
        frames: args.frames,
        fps: args.points.fps.into(),
        reach_m: settings.ao.influence() + settings.ao.bias(),
        view_margin: margin,
    };
    let needs = clip::needs(&scene, &clip);
    let folder = Folder::of(&args.points.cache);
    let measured = measure::measure(args, &scene, &settings, folder)?;
    let document = figures::Document::new(args, &scene, &settings, &needs, &measured);
    if args.format.is_json() {
        say_json(&document)?;
    } else {
        document.print()?;
    }
    document.verdict()
}
