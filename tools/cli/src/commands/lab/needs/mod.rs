//! `psao lab needs`: what a scene does not need, and what leaving it out saves.

mod figures;
mod measure;
mod rows;

use std::sync::Arc;

use psao_server::clip::{self, Clip};
use psao_server::scene::Scene;

use crate::args::{Coder, PointArgs, ProfileArg, ReportFormatArg};
use crate::cache::Folder;
use crate::context::say_json;
use crate::error::{Failure, Outcome};
use crate::producer::settings;

/// Show which features a scene does not use, and what that saves
///
/// First lists the scene's instances in groups that need the same features. Then measures each saving: the stream is made
/// with the feature and without. Where only server work is saved, every frame must be bit-identical; if not, the exit code
/// is 6.
///
/// Each round runs every configuration once, in rotating order. Times are the median (min to max) over rounds of the
/// difference to the full configuration. All figures except "B once" cover the frames after the first. Only times depend on
/// the machine. docs/needs-json.md describes the JSON.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  psao lab needs --scene colonnade --points 64")]
pub(crate) struct Args {
    /// Name of a built-in scene (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE", required_unless_present = "named")]
    scene: Option<String>,
    /// The older spelling of --scene
    #[arg(value_name = "NAME|FILE", hide = true, conflicts_with = "scene")]
    named: Option<String>,
    /// Frames of each run, including the first
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
    /// Number of rounds
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    #[command(flatten)]
    points: PointArgs,
    /// Compression of blocks: range, zstd, zstd:LEVEL, lz4 or none
    #[arg(long, value_name = "CODER", default_value = "range")]
    compress: Coder,
    #[command(flatten)]
    format: ReportFormatArg,
}

pub(crate) fn run(args: &Args) -> Outcome {
    if args.points.exhaustive {
        return Err(Failure::usage(
            "--exhaustive skips nothing, so there is nothing to measure: leave it out",
        ));
    }
    let name = args.scene.as_ref().or(args.named.as_ref()).map_or("", String::as_str);
    let scene = Arc::new(Scene::load(name).map_err(Failure::input)?);
    let coder = ProfileArg::Surface.coder(Some(args.compress))?;
    let settings = settings(&args.points, &scene, args.frames).with_coder(coder);
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
