//! `psao reconstruct`: a picture out of a recorded stream, and beside it the same by rays.

use std::path::PathBuf;
use std::str::FromStr;

use psao_codec::State;
use psao_eval::sweep::ErrorFigures;
use psao_proto::message::CameraPose;
use psao_proto::recording::{PlayedFrame, Player, PlayerEvent, ReaderError};
use psao_proto::{Limits, SceneTable};
use psao_server::scene::Edits;
use serde::Serialize;

use crate::args::{LpipsArgs, RecordingArg, ReportFormatArg, SizeArg, Triple};
use crate::context::{progress, say, say_json};
use crate::error::{Failure, Outcome};
use crate::input;
use crate::output::number;
use crate::output::target::{self, Content, is_standard};
use crate::pictures::{Drawn, SharedPoints, Shot, scene_of};

/// Draw a recorded frame, and compare it with ray tracing
///
/// AO comes from the stream alone. The geometry, which a client has anyway, is loaded by the scene name or path in the
/// recording and edited as it was at that frame. With --reference, psao also writes FILE.reference.png, FILE.difference.png
/// (red: too bright, blue: too dark) and FILE.side-by-side.png, and prints the errors. docs/reconstruct-json.md describes
/// the JSON.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao reconstruct a.psao --frame 60 -o a.png
  psao reconstruct a.psao --frame 60 --reference -o a.png")]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// Number of the frame, as `psao inspect --per-frame` shows it
    #[arg(long, value_name = "N")]
    frame: u32,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "960x540")]
    size: SizeArg,
    /// Camera: its position and the point it looks at, in metres, and its vertical field of view in degrees [default: the
    /// scene's own camera at that time]
    #[arg(long, value_name = "X,Y,Z,X,Y,Z[,FOV]", allow_hyphen_values = true)]
    camera: Option<CameraArg>,
    /// Up direction of the picture with --camera [default: 0,1,0; 0,0,-1 for a camera that looks straight up or down]
    #[arg(long, value_name = "X,Y,Z", requires = "camera", allow_hyphen_values = true)]
    up: Option<Triple>,
    /// Trace a reference picture as well, and compare
    #[arg(long)]
    reference: bool,
    /// Rays per pixel of the reference
    #[arg(long, value_name = "N", default_value_t = 512)]
    reference_rays: u32,
    #[command(flatten)]
    lpips: LpipsArgs,
    /// Where the recorded scene is now, if it was moved
    #[arg(long, value_name = "NAME|FILE")]
    scene: Option<String>,
    /// The picture to write; - for standard output
    #[arg(short, long, value_name = "FILE.png")]
    output: PathBuf,
    #[command(flatten)]
    format: ReportFormatArg,
}

/// What `--format json` prints; `docs/reconstruct-json.md` describes the fields.
#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    frame: u32,
    time_s: f64,
    width: u32,
    height: u32,
    fragments: u64,
    mean_blended: f64,
    unsupported: f64,
    raster_ms: f64,
    reconstruct_ms: f64,
    reference: Option<ReferenceOut<'a>>,
    files: &'a [PathBuf],
}

#[derive(Serialize)]
struct ReferenceOut<'a> {
    rays: u32,
    ms: f64,
    error: &'a ErrorFigures,
}

/// `--camera`.
#[derive(Clone, Copy, Debug)]
struct CameraArg(CameraPose);

impl FromStr for CameraArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
        let (place, fov_y_deg) = match numbers.as_deref() {
            Ok([place @ .., fov]) if place.len() == 6 => (place, *fov),
            Ok(place) if place.len() == 6 => (place, 60.0),
            _ => return Err(format!("\"{text}\" is not six or seven numbers such as 0,1.7,4,0,1,0,60")),
        };
        let (eye, target) = ([place[0], place[1], place[2]], [place[3], place[4], place[5]]);
        let up = CameraPose::usual_up(eye, target);
        let camera = CameraPose { eye, target, up, fov_y_deg, aspect: 1.0 };
        if camera.is_valid() {
            Ok(Self(camera))
        } else {
            Err(format!(
                "\"{text}\" is no camera: position and target are equal, or the field of view is out of range"
            ))
        }
    }
}

/// Returns the camera that was asked for, if any.
fn camera(args: &Args) -> Outcome<Option<CameraPose>> {
    let Some(CameraArg(camera)) = args.camera else { return Ok(None) };
    let camera = CameraPose { up: args.up.map_or(camera.up, |up| up.0), ..camera };
    if camera.is_valid() {
        return Ok(Some(camera));
    }
    Err(Failure::usage("--up is zero, or along the line of sight of --camera: choose another direction"))
}

pub(crate) fn run(args: &Args) -> Outcome {
    let path = &args.recording.file;
    if is_standard(&args.output) && (args.reference || args.format.is_json()) {
        return Err(Failure::usage(
            "-o - writes one picture and nothing else to standard output: name a file with --reference or --format json",
        ));
    }
    if is_standard(&args.output) {
        target::refuse_terminal()?;
    }
    target::check(&args.output, &Content::PNG)?;
    for beside in crate::pictures::BESIDE.iter().filter(|_| args.reference) {
        target::check(&args.output.with_extension(beside), &Content::PNG)?;
    }
    let bytes = input::recording(path)?;
    let network = args.lpips.load()?.map(|(network, _)| network);
    let mut playback =
        Playback::new(&bytes).map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))?;
    let frame = playback
        .to(args.frame)
        .map_err(|reason| Failure::input(format_args!("{}: {reason}", path.display())))?;
    let (Some(table), Some(state)) = (playback.scene(), playback.state()) else {
        return Err(Failure::input(format_args!(
            "{}: its scene table is damaged or missing",
            path.display()
        )));
    };
    let scene = scene_of(table.info(), args.scene.as_deref())?;
    let bar = progress("drawing", 1);
    let state = SharedPoints::default().complete(state, &scene, table.info())?;
    let drawn = Shot {
        scene: &scene,
        info: table.info(),
        state: &state,
        edits: playback.edits(),
        time_s: frame.info.time.0 as f64 / 1e6,
        camera: camera(args)?,
        size: args.size,
        reference_rays: args.reference.then_some(args.reference_rays),
        network: network.as_ref(),
    }
    .draw()?;
    bar.finish_and_clear();
    let files = drawn.write(&args.output)?;
    if args.format.is_json() {
        return say_json(&document(&drawn, &frame, &files));
    }
    target::note(&args.output, describe(&drawn))?;
    for file in files.iter().filter(|file| !is_standard(file)) {
        say(format_args!("wrote {}", file.display()))?;
    }
    Ok(())
}

/// Returns the figures of a picture, for programs.
fn document<'a>(drawn: &'a Drawn, frame: &PlayedFrame, files: &'a [PathBuf]) -> Document<'a> {
    let size = drawn.image.size();
    Document {
        schema: "psao-reconstruct/1",
        frame: frame.info.frame.0,
        time_s: frame.info.time.0 as f64 / 1e6,
        width: size.width(),
        height: size.height(),
        fragments: drawn.statistics.fragments,
        mean_blended: drawn.statistics.mean_blended(),
        unsupported: drawn.statistics.unsupported_share(),
        raster_ms: drawn.raster_ms,
        reconstruct_ms: drawn.reconstruct_ms,
        reference: drawn.reference.as_ref().map(|by_rays| ReferenceOut {
            rays: by_rays.rays,
            ms: by_rays.ms,
            error: &by_rays.error,
        }),
        files,
    }
}

/// A recording, played from its start to the frames that are drawn.
pub(crate) struct Playback<'a> {
    player: Player<'a>,
    edits: Edits,
}

impl<'a> Playback<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, ReaderError> {
        Ok(Self { player: Player::new(bytes, Limits::default())?, edits: Edits::default() })
    }

    /// Returns the scene table, once it was played.
    pub(crate) fn scene(&self) -> Option<&SceneTable> {
        self.player.scene().map(AsRef::as_ref)
    }

    /// Returns the state of the frame played to.
    pub(crate) fn state(&self) -> Option<&State> {
        self.player.state()
    }

    /// Returns the edits in force at the frame played to.
    pub(crate) fn edits(&self) -> &Edits {
        &self.edits
    }

    /// Plays on to a frame, and returns it.
    pub(crate) fn to(&mut self, number: u32) -> Result<PlayedFrame, String> {
        let (mut first, mut last, mut left_out) = (None, None, 0_u32);
        while let Some(event) = self.player.next_event() {
            match event {
                PlayerEvent::Scene(table) => self.edits = Edits::new(table.instance_count()),
                // Without the edit every later picture would be of another scene.
                PlayerEvent::Edit(edit) => {
                    self.edits
                        .apply(&edit)
                        .map_err(|error| format!("an edit in it cannot be followed: {error}"))?;
                }
                PlayerEvent::Frame(frame) if frame.info.frame.0 == number => return Ok(frame),
                PlayerEvent::Frame(frame) => {
                    first.get_or_insert(frame.info.frame.0);
                    last = Some(frame.info.frame.0);
                }
                PlayerEvent::Unusable { frame, reason, .. } => {
                    left_out += 1;
                    if frame.is_some_and(|frame| frame.0 == number) {
                        return Err(format!("frame {number} cannot be used: {reason}"));
                    }
                }
                _ => {}
            }
        }
        Err(match (first, last) {
            (Some(first), Some(last)) => {
                let damaged = match left_out {
                    0 => String::new(),
                    _ => format!(", except {}", number::counted(left_out.into(), "damaged frame")),
                };
                format!("it has no frame {number}; frames {first} to {last} can be drawn{damaged}")
            }
            _ => "it has no frame that can be drawn".to_owned(),
        })
    }
}

/// Returns the figures of a picture, for people.
pub(crate) fn describe(drawn: &Drawn) -> String {
    let statistics = &drawn.statistics;
    let mut text = format!(
        "{} fragments, {:.2} points blended each, {:.3} % without any; visibility {:.1} ms, reconstruction {:.1} ms",
        number::count(statistics.fragments),
        statistics.mean_blended(),
        statistics.unsupported_share() * 100.0,
        drawn.raster_ms,
        drawn.reconstruct_ms,
    );
    if let Some(reference) = &drawn.reference {
        let error = &reference.error;
        text.push_str(&format!(
            "\nagainst {} rays a pixel ({:.1} s): PSNR {}, mean error {:.5}, RMSE {:.5}, bias {:+.5}, 99th percentile {:.4}, \
             largest {:.4}, within 5 % {:.1} %, SSIM {}, FLIP {:.4}",
            reference.rays,
            reference.ms / 1e3,
            number::decibels(error.psnr_db),
            error.mae,
            error.rmse,
            error.bias,
            error.p99,
            error.max,
            error.within_5 * 100.0,
            number::where_known(error.ssim),
            error.flip,
        ));
        if let Some(lpips) = error.lpips {
            text.push_str(&format!(", LPIPS {lpips:.4}"));
        }
    }
    text
}
