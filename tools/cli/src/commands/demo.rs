//! `psao demo`: the main job from end to end, into one folder.

use std::path::{Path, PathBuf};

use psao_codec::block::BlockCoder;
use psao_eval::sweep::ErrorFigures;
use psao_proto::message::SceneHeader;
use psao_proto::recording::file::{Recorder, RecorderOptions};
use psao_proto::recording::{Player, PlayerEvent};
use psao_proto::session::{Access, ClientEvent, ClientSession, ServerSession};
use psao_proto::{Fanout, Limits, Micros, Profile};
use psao_server::server::StageMicros;

use super::inspect;
use super::reconstruct::Playback;
use super::record::{Totals, record_frames};
use crate::analysis::Analysis;
use crate::args::{SizeArg, TuningArgs};
use crate::context::{progress, say};
use crate::edit_script::EditScript;
use crate::error::{Exit, Failure, Outcome};
use crate::input;
use crate::output::report::{Comparison, Report, Section};
use crate::output::{number, table::Figures};
use crate::pictures::{Drawn, SharedPoints, Shot, scene_of};
use crate::producer::open;

/// Record, replay, inspect and draw a scene, into one folder
///
/// The usual settings take about a minute. The folder gets the recording, the pictures, the bandwidth plot and report.html,
/// which opens offline.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao demo
  psao demo --scene robot-lab --frames 120 -o robots")]
pub(crate) struct Args {
    /// Name of a built-in scene (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE", default_value = "colonnade")]
    scene: String,
    /// Frames to record
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    #[command(flatten)]
    tuning: TuningArgs,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "640x360")]
    size: SizeArg,
    /// Rays per pixel of the reference pictures
    #[arg(long, value_name = "N", default_value_t = 512)]
    reference_rays: u32,
    /// The folder to write; existing files of the same names are replaced
    #[arg(short, long, value_name = "FOLDER", default_value = "psao-demo")]
    output: PathBuf,
}

/// A frame that was drawn.
struct Shown {
    frame: u32,
    drawn: Drawn,
    /// The picture from the stream, the reference, and their difference.
    files: [PathBuf; 3],
}

pub(crate) fn run(args: &Args) -> Outcome {
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(|error| Failure::writing(folder, &error))?;
    let recording = folder.join("demo.psao");
    let (mut server, timetable) = open(&args.scene, &args.tuning, args.frames)?;
    timetable.scene().report().lines().iter().try_for_each(say)?;
    let mut recorder = Recorder::create(&recording, RecorderOptions::default().with_backpressure())?;
    let totals =
        record_frames((&mut server, &timetable), &mut recorder, args.frames, &EditScript::default(), false)?;
    let info = server.table().header();
    recorder.finish()?;

    let bytes = input::recording(&recording)?;
    let replayed = replay(&bytes)?;
    let analysis = Analysis::of(&recording, &bytes)?;
    let title = format!("{}: bytes per frame", info.name);
    let plot = inspect::plot(&analysis, title).svg();
    let plot_path = folder.join("bandwidth.svg");
    std::fs::write(&plot_path, &plot).map_err(|error| Failure::writing(&plot_path, &error))?;
    let shown = draw(args, &bytes, folder)?;

    let sections = sections(&info, &totals, &analysis, &shown, replayed);
    let report = Report {
        title: format!("psao demo: {}", info.name),
        lead: super::record::summary(&info, &totals),
        comparisons: comparisons(&shown)?,
        sections,
        plot,
    };
    let report_path = folder.join("report.html");
    std::fs::write(&report_path, report.html()).map_err(|error| Failure::writing(&report_path, &error))?;
    print(&report)?;
    say(format_args!("everything is in {}; open {}", folder.display(), report_path.display()))
}

/// Serves the recording to a client through both session ends; every hash must be the recorded one. Gives the number of
/// frames.
fn replay(bytes: &[u8]) -> Outcome<u64> {
    let wrong = |text: String| Failure::new(Exit::Check, text);
    let mut player = Player::new(bytes, Limits::default()).map_err(Failure::input)?;
    let Some(PlayerEvent::Scene(scene)) = player.next_event() else {
        return Err(wrong("the recording does not start with its scene".to_owned()));
    };
    let mut fanout = Fanout::new(BlockCoder::of(scene.info().coder));
    let mut server = ServerSession::new(scene, Access::Open, Limits::default());
    let mut client = ClientSession::new(Limits::default());
    let session = |error: psao_proto::session::SessionError| wrong(error.to_string());
    server.handle(&client.take_output(), Micros(0)).map_err(session)?;
    let bar = progress("replaying", 0);
    let mut applied = 0;
    while let Some(event) = player.next_event() {
        let PlayerEvent::Frame(frame) = event else { continue };
        let Some(state) = player.state() else { continue };
        fanout.advance(&frame.info, frame.body(bytes), state.into(), frame.arrival);
        fanout.give(&mut server, state.into()).map_err(|error| wrong(error.to_string()))?;
        let events = client.handle(&server.take_output(), frame.arrival).map_err(session)?;
        let same = events.iter().any(|event| {
            matches!(event, ClientEvent::Applied(applied) if applied.info.hash == frame.info.hash
                && client.state().is_some_and(|state| state.hash() == frame.info.hash))
        });
        if !same {
            return Err(wrong(format!(
                "frame {}: the client's state hash is not the recorded one",
                frame.info.frame.0
            )));
        }
        server.handle(&client.take_output(), frame.arrival).map_err(session)?;
        applied += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(applied)
}

/// Draws the first, the middle and the last frame.
fn draw(args: &Args, bytes: &[u8], folder: &Path) -> Outcome<Vec<Shown>> {
    let mut wanted = vec![0, args.frames / 2, args.frames - 1];
    wanted.dedup();
    let bar = progress("drawing", wanted.len() as u64);
    let mut playback = Playback::new(bytes).map_err(Failure::input)?;
    let mut scene = None;
    let mut points = SharedPoints::default();
    let mut shown = Vec::new();
    for frame in wanted {
        let played = playback.to(frame).map_err(Failure::input)?;
        let (Some(table), Some(state)) = (playback.scene(), playback.state()) else { continue };
        let scene = match &scene {
            Some(scene) => std::sync::Arc::clone(scene),
            None => scene.insert(scene_of(table.info(), None)?).clone(),
        };
        let state = points.complete(state, &scene, table.info())?;
        let drawn = Shot {
            scene: &scene,
            info: table.info(),
            state: &state,
            edits: playback.edits(),
            time_s: played.info.time.0 as f64 / 1e6,
            camera: None,
            size: args.size,
            reference_rays: Some(args.reference_rays),
            network: None,
        }
        .draw()?;
        let files = drawn.write(&folder.join(format!("frame-{frame}.png")))?;
        let files = std::array::from_fn(|file| files.get(file).cloned().unwrap_or_default());
        shown.push(Shown { frame, drawn, files });
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(shown)
}

/// Returns the errors of a frame against rays in a few words.
fn figures(drawn: &Drawn) -> String {
    let words =
        |error: &ErrorFigures| format!(" PSNR {}, FLIP {:.4}.", number::decibels(error.psnr_db), error.flip);
    drawn.reference.as_ref().map(|reference| words(&reference.error)).unwrap_or_default()
}

/// Returns the frames for the page, the middle one first: the first frame has everything exact.
fn comparisons(shown: &[Shown]) -> Outcome<Vec<Comparison>> {
    let read = |path: &PathBuf| std::fs::read(path).map_err(|error| Failure::reading(path, &error));
    let comparison = |shown: &Shown| {
        let [stream, reference, difference] = &shown.files;
        Ok(Comparison {
            title: format!("Frame {}", shown.frame),
            caption: format!(
                "Drag the edge: left of it, a client computed AO from the points of the stream; right of it, rays were traced \
                 for every pixel.{}",
                figures(&shown.drawn)
            ),
            stream: read(stream)?,
            reference: read(reference)?,
            difference: read(difference)?,
        })
    };
    let (before, after) = shown.split_at(shown.len() / 2);
    after.iter().chain(before).map(comparison).collect()
}

fn row<const N: usize>(cells: [String; N]) -> Vec<String> {
    cells.into()
}

fn sections(
    info: &SceneHeader,
    totals: &Totals,
    analysis: &Analysis,
    shown: &[Shown],
    replayed: u64,
) -> Vec<Section> {
    vec![points(info, totals), bandwidth(analysis, replayed), stages(totals), quality(shown)]
}

fn heads(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

fn points(info: &SceneHeader, totals: &Totals) -> Section {
    let later = totals.frames.saturating_sub(1).max(1);
    let last = totals.last.occupancy.unwrap_or_default();
    let count = |value: u64| number::count(value);
    let mut rows = vec![row(["points".into(), count(u64::from(info.point_count))])];
    let paper = info.profile == Profile::PAPER;
    if paper {
        rows.extend([
            row(["cells in use".into(), count(last.cells.into())]),
            row(["points stored in cells".into(), count(last.points_stored.into())]),
            row(["left out: bucket full".into(), count(last.bucket_full.into())]),
            row(["left out: cell full".into(), count(last.cell_full.into())]),
            row(["left out: no free cell".into(), count(last.no_cell.into())]),
            row(["left out: cell id taken by another cell".into(), count(last.id_collisions.into())]),
        ]);
    }
    rows.extend([
        row(["visible points a frame".into(), count(totals.later.visible / later)]),
        row(["traced points a frame".into(), count(totals.later.traced / later)]),
        row(["sent points a frame".into(), count(totals.later.changed / later)]),
        row(["rays, first frame".into(), count(totals.first.rays)]),
        row(["rays a frame after it".into(), count(totals.later.rays / later)]),
    ]);
    let traced = "A visible point is traced again only when something near it moved.";
    let left_out = " What the paper's tables cannot hold is left out and counted.";
    Section {
        title: "Points and rays".to_owned(),
        heads: heads(&["", "count"]),
        rows,
        note: format!("{traced}{}", if paper { left_out } else { "" }),
    }
}

fn bandwidth(analysis: &Analysis, replayed: u64) -> Section {
    let totals = analysis.totals();
    let rows = inspect::part_rows(analysis, &totals).into_iter().map(Vec::from).collect();
    Section {
        title: "Bytes on the wire".to_owned(),
        heads: heads(&inspect::PART_HEADS),
        rows,
        note: format!(
            "{} A client followed all {replayed} frames, and its state hash was the server's after each.",
            inspect::summary_lines(analysis, &totals).replace('\n', ". ") + "."
        ),
    }
}

fn stages(totals: &Totals) -> Section {
    let later = totals.frames.saturating_sub(1).max(1) as f64;
    let (first, after) = (&totals.first.micros, &totals.later.micros);
    let times = |name: &str, first: u64, after: u64| {
        row([name.to_owned(), number::millis(first as f64), number::millis(after as f64 / later)])
    };
    let by_stage = first.by_stage().into_iter().zip(after.by_stage());
    let by_stage = StageMicros::NAMES.into_iter().zip(by_stage);
    let mut rows: Vec<Vec<String>> =
        by_stage.map(|(name, ((_, first), (_, after)))| times(name, first, after)).collect();
    rows.push(times("all", first.total(), after.total()));
    Section {
        title: "Server time".to_owned(),
        heads: heads(&["stage", "first frame, ms", "a frame after it, ms"]),
        rows,
        note: format!(
            "Wall time on {} threads; the mean of {later} frames. The first frame traces all points that it sends.",
            std::thread::available_parallelism().map_or(1, usize::from)
        ),
    }
}

fn quality(shown: &[Shown]) -> Section {
    let rows = shown
        .iter()
        .filter_map(|shown| shown.drawn.reference.as_ref().map(|reference| (shown, reference)))
        .map(|(shown, reference)| {
            row([
                format!("frame {}", shown.frame),
                number::decibels(reference.error.psnr_db),
                format!("{:.5}", reference.error.mae),
                format!("{:.4}", reference.error.p99),
                number::where_known(reference.error.ssim),
                format!("{:.4}", reference.error.flip),
                format!("{:.3} %", shown.drawn.statistics.unsupported_share() * 100.0),
                format!("{:.1}", shown.drawn.reconstruct_ms),
                format!("{:.0}", reference.ms),
            ])
        })
        .collect();
    Section {
        title: "Pictures against rays".to_owned(),
        heads: heads(&[
            "",
            "PSNR",
            "mean error",
            "99th percentile",
            "SSIM",
            "FLIP",
            "no point near",
            "client ms",
            "rays ms",
        ]),
        rows,
        note: "Errors in units of AO, 0 to 1; of PSNR and SSIM more is better, of FLIP less. The client's time is its reconstruction (paper, section 3.5); the rays' is \
               the reference of the same view."
            .to_owned(),
    }
}

/// Prints the report's tables to the terminal.
fn print(report: &Report) -> Outcome {
    for section in &report.sections {
        say(format_args!("\n{}", section.title))?;
        let mut table = Figures::of(&section.heads);
        for row in &section.rows {
            table.row(row.iter().cloned());
        }
        say(table)?;
        say(&section.note)?;
    }
    say("")
}
