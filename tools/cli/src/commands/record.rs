//! `psao record`: traces a scene's stream into a file, or records a live server's.

use std::path::PathBuf;

use indicatif::ProgressBar;
use psao_proto::message::{CloseCode, KeyframeReason, SceneHeader};
use psao_proto::net::{Address, Connection};
use psao_proto::recording::file::Recorder;
use psao_proto::session::{ClientEvent, ClientOptions};
use psao_proto::{FrameIndex, FrameType, Micros, WireFrame};
use psao_server::server::{FrameStats, FrameTotals, Server};

use crate::args::{RecorderArgs, TuningArgs};
use crate::context::{Stopwatch, progress, runtime};
use crate::edit_script::EditScript;
use crate::error::{Failure, Outcome};
use crate::network::{ConnectArgs, peer};
use crate::output::{number, target};
use crate::producer::{Timetable, open, refused};

/// Trace a scene into a recording, or record a running server
///
/// The recording holds the stream's frames, each with its time; --keyframe-every puts keyframes in place of updates. The
/// same options give the same bytes on any machine, except with --timings. The file is valid after every frame: whatever
/// stops the recorder, at most the frame being written is lost.
///
/// With --from, frames wait in memory for a slow disk. Frames that do not fit are left out up to the next keyframe. The gap
/// is marked in the recording and counted at the end. Exit code 1 means that the disk failed; what was written before can
/// be read.
#[derive(clap::Args, Debug)]
#[command(group(clap::ArgGroup::new("source").required(true)))]
#[command(after_help = "Examples:
  psao record --scene colonnade --frames 120 -o a.psao
  psao record --scene robot-lab --budget 500kbit/s -o b.psao
  psao record --from 127.0.0.1:4700 -o live.psao
  psao record --scene colonnade -o - | psao inspect -")]
pub(crate) struct Args {
    /// Name of a built-in scene (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE", group = "source")]
    scene: Option<String>,
    /// Record this server instead (`psao serve` or `psao replay --listen`)
    #[arg(long, value_name = "ADDR", group = "source")]
    from: Option<Address>,
    #[command(flatten)]
    network: ConnectArgs,
    /// Frames to record [default: 120; with --from, until the server ends]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    #[command(flatten)]
    tuning: TuningArgs,
    /// Script of edits: which instances move, hide or show before which frame
    ///
    /// One edit a line, `#` starts a comment:
    ///
    ///     FRAME INSTANCE move X,Y,Z [QX,QY,QZ,QW]
    ///     FRAME INSTANCE release|hide|show
    ///
    /// INSTANCE is an index or a unique name, quoted if it has spaces;
    /// see `psao scenes --instances`. X,Y,Z (metres) and the unit
    /// quaternion place the instance in the world, instead of its
    /// animation, until `release`. `hide` removes it from view and from
    /// all occlusion until `show`.
    #[arg(long, value_name = "FILE", conflicts_with = "from", verbatim_doc_comment)]
    edits: Option<PathBuf>,
    /// Record how long the server's stages took; the recording then differs from run to run
    #[arg(long)]
    timings: bool,
    #[command(flatten)]
    recording: RecorderArgs,
    /// The recording to write; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

/// Frames of a recording unless said otherwise.
const FRAMES: u32 = 120;

pub(crate) fn run(args: &Args) -> Outcome {
    match (&args.from, &args.scene) {
        (Some(address), _) => runtime()?.block_on(from_server(args, address)),
        (None, Some(scene)) => trace(args, scene),
        (None, None) => Err(Failure::usage("name what to record: --scene NAME|FILE, or --from ADDR")),
    }
}

fn trace(args: &Args, scene: &str) -> Outcome {
    let frames = args.frames.unwrap_or(FRAMES);
    let output = target::recording(&args.output)?;
    Recorder::check_place(&output)?;
    let (mut server, timetable) = open(scene, &args.tuning, frames)?;
    for line in timetable.scene().report().lines() {
        target::note(&args.output, line)?;
    }
    let edits = match &args.edits {
        Some(path) => EditScript::load(path, timetable.scene(), Some(frames))?,
        None => EditScript::default(),
    };
    let mut recorder = Recorder::create(&output, args.recording.waiting())?;
    let totals = record_frames((&mut server, &timetable), &mut recorder, frames, &edits, args.timings)?;
    let bytes = recorder.finish()?.bytes;
    target::note(&args.output, summary(&server.table().header(), &totals))?;
    target::note(
        &args.output,
        format_args!(
            "wrote {}: {}, {}",
            target::name(&args.output),
            number::counted(totals.frames, "frame"),
            number::bytes(bytes)
        ),
    )
}

/// What the frames of a recording took.
#[derive(Clone, Debug, Default)]
pub(crate) struct Totals {
    pub(crate) frames: u64,
    pub(crate) first: FrameStats,
    /// Of all frames after the first.
    pub(crate) later: FrameTotals,
    pub(crate) last: FrameStats,
}

/// Records `frames` frames, the closing message included.
pub(crate) fn record_frames(
    (server, timetable): (&mut Server, &Timetable),
    recorder: &mut Recorder,
    frames: u32,
    edits: &EditScript,
    timings: bool,
) -> Outcome<Totals> {
    recorder.scene(server.table())?;
    let clock = Stopwatch::start();
    let bar = progress("tracing", u64::from(frames));
    let mut totals = Totals::default();
    let mut arrival = Micros(0);
    for number in 0..frames {
        let mut changes = Vec::new();
        for edit in edits.before(number) {
            if server.trace_stage().edit(edit).map_err(Failure::input)? {
                changes.push(edit);
            }
        }
        let (time, views) = timetable.frame(number, &[]);
        let output = server.step(FrameIndex(number), time, &views, &clock).map_err(refused)?;
        arrival = Micros(output.info.time.0);
        for edit in changes {
            recorder.message(arrival, edit)?;
        }
        recorder.body_or_keyframe(arrival, output.info.kind, &output.body, || {
            server.keyframe(FrameIndex(number), time, server.coder()).map_err(refused)
        })?;
        if let Some(budget) = &output.budget {
            recorder.message(arrival, budget)?;
        }
        // How the tables are filled is worth a report when they were made and when all is done.
        if timings || number == 0 || number + 1 == frames {
            recorder.message(arrival, &output.stats.report(output.info.frame, timings))?;
        }
        totals.frames += 1;
        if number == 0 {
            totals.first = output.stats;
        } else {
            totals.later.add(&output.stats);
        }
        totals.last = output.stats;
        bar.inc(1);
    }
    bar.finish_and_clear();
    recorder.message(arrival, &psao_proto::message::Close::new(CloseCode::DONE, "end of the recording"))?;
    Ok(totals)
}

/// Returns what was traced, in words.
pub(crate) fn summary(info: &SceneHeader, totals: &Totals) -> String {
    let later = totals.frames.saturating_sub(1).max(1);
    let waiting = &totals.later.waiting;
    let waited = if waiting.points > 0 {
        format!(
            "; {} points a frame waited for rays, for {} frames at most",
            number::count(u64::from(waiting.points) / later),
            waiting.oldest
        )
    } else {
        String::new()
    };
    format!(
        "{}: {} points; first frame {} rays; then {} visible points, {} traced, {} rays a frame{waited}",
        info.name,
        number::count(u64::from(info.point_count)),
        number::count(totals.first.rays),
        number::count(totals.later.visible / later),
        number::count(totals.later.traced / later),
        number::count(totals.later.rays / later),
    )
}

async fn from_server(args: &Args, address: &Address) -> Outcome {
    let output = target::recording(&args.output)?;
    let mut connection = args.network.connect(address, ClientOptions::default()).await?;
    let mut recorder = Recorder::create(&output, args.recording.options(&output))?;
    let mut counts = Counts::default();
    let bar = progress("recording", u64::from(args.frames.unwrap_or(0)));
    let ended = follow(args, &mut connection, &mut recorder, &mut counts, &bar).await;
    bar.finish_and_clear();
    // Whatever ended it, what came is kept.
    let bytes = match recorder.finish() {
        Ok(recorded) => recorded.bytes,
        Err(error) => return Err(ended.err().unwrap_or_else(|| error.into())),
    };
    let note = if counts.unusable > 0 {
        format!("; {} could not be applied", counts.unusable)
    } else {
        String::new()
    };
    target::note(
        &args.output,
        format_args!(
            "wrote {}: {}, {}{note}",
            target::name(&args.output),
            number::counted(counts.applied.into(), "frame"),
            number::bytes(bytes)
        ),
    )?;
    ended
}

/// Frames that came.
#[derive(Default)]
struct Counts {
    applied: u32,
    unusable: u32,
}

/// Records until the server ends, `--frames` have come, or Ctrl-C.
async fn follow(
    args: &Args,
    connection: &mut Connection,
    recorder: &mut Recorder,
    counts: &mut Counts,
    bar: &ProgressBar,
) -> Outcome {
    let mut taken = Ok(());
    while !connection.session().is_closed() && args.frames.is_none_or(|wanted| counts.applied < wanted) {
        let mut tap = |frame: &WireFrame<'_>| {
            let wanted = matches!(
                frame.header.kind,
                FrameType::SCENE
                    | FrameType::KEYFRAME
                    | FrameType::UPDATE
                    | FrameType::EDIT
                    | FrameType::REPORT
                    | FrameType::BUDGET
                    | FrameType::CLOSE
            );
            if wanted && taken.is_ok() {
                taken = recorder.wire(recorder.now(), frame.bytes);
            }
        };
        let event = tokio::select! {
            event = connection.next_event_with(&mut tap) => event.map_err(peer)?,
            _ = tokio::signal::ctrl_c() => break,
        };
        taken?;
        taken = Ok(());
        match event {
            Some(ClientEvent::Applied(_)) => {
                counts.applied += 1;
                bar.inc(1);
            }
            Some(ClientEvent::HashMismatch { .. } | ClientEvent::Unusable { .. }) => counts.unusable += 1,
            _ => {}
        }
        if recorder.wants_keyframe(recorder.now()) {
            connection.session().request_keyframe(KeyframeReason::ASKED);
        }
    }
    connection.session().close(CloseCode::DONE, "recorded enough");
    // The recording is whole already; a server that is gone does not mind.
    connection.flush().await.or(Ok(()))
}
