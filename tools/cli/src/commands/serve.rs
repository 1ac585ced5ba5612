//! `psao serve`: a live server.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::{Duration, Instant};

use psao_proto::message::{Close, CloseCode, Edit};
use psao_proto::net::{Hub, HubEvent};
use psao_proto::recording::file::Recorder;
use psao_proto::sinks::Sinks;
use psao_proto::{FrameIndex, Limits, Micros};
use psao_server::server::Server;
use psao_server::server::live::{LatePoints, Pipeline, PipelineSettings};

use crate::args::{EditsArg, RecorderArgs, StreamArgs};
use crate::context::runtime;
use crate::error::Outcome;
use crate::network::{self, ListenArgs};
use crate::output::{number, target};
use crate::producer::{Timetable, open};
use crate::quantity::TimeSpan;

/// Trace a scene live and send its AO stream to clients
///
/// The animation plays in a loop until Ctrl-C or --frames. Nothing is traced while no client is connected. A frame that
/// takes longer than its time is followed by the frame that is then due; the number of skipped frames is printed at the
/// end. To skip few, points are traced later when time is short (--frame-time). A frame is encoded and sent while the
/// next one is traced.
///
/// With --record, the animation plays from the start without a client. A slow or full disk costs frames of the recording,
/// never of the stream. Exit code 1 then means that the disk failed.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao serve --scene colonnade
  psao serve --scene robot-lab --fps 30 --frame-time 20ms
  psao serve --scene robot-lab --record live.psao --listen unix:/tmp/psao.socket")]
pub(crate) struct Args {
    #[command(flatten)]
    stream: StreamArgs,
    #[command(flatten)]
    network: ListenArgs,
    /// Stop after this number of frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Whether clients may change the scene; all clients see the change, and the AO follows
    #[arg(long, value_enum, default_value_t = EditsArg::Allow)]
    edits: EditsArg,
    /// Time limit for tracing a frame. Points left over are traced in later frames, by screen size and waiting time. auto
    /// is the time from frame to frame; off traces everything, however long that takes
    #[arg(long, value_name = "auto|off|TIME", default_value = "auto", conflicts_with = "ray_budget")]
    frame_time: FrameTime,
    /// Send with every frame how long the server's stages took
    #[arg(long)]
    timings: bool,
    /// Record the stream into this file as well; - for standard output
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    recording: RecorderArgs,
}

/// `--frame-time`.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FrameTime {
    /// As long as until the next frame.
    Auto,
    /// As long as it takes.
    Off,
    Time(TimeSpan),
}

impl FromStr for FrameTime {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            _ => match text.parse() {
                Ok(time @ TimeSpan(Micros(100..=1_000_000_000))) => Ok(Self::Time(time)),
                Ok(_) => Err(format!("\"{text}\" is not from 100us to 1000s")),
                Err(error) => Err(format!("{error}, or auto, or off")),
            },
        }
    }
}

impl Args {
    /// Returns the time from frame to frame.
    fn tick(&self) -> Duration {
        Duration::from_secs_f64(1.0 / f64::from(self.stream.tuning.points.fps))
    }

    /// Returns how frames are made.
    fn pipeline(&self) -> PipelineSettings {
        let frame_time = match self.frame_time {
            _ if self.stream.tuning.ray_budget.is_some() => None,
            FrameTime::Off => None,
            FrameTime::Auto => Some(Micros((self.tick().as_secs_f64() * 1e6) as u64)),
            FrameTime::Time(TimeSpan(time)) => Some(time),
        };
        PipelineSettings::default().with_frame_time(frame_time).with_timings(self.timings)
    }
}

/// How long to wait for clients before looking again, and for goodbyes.
const PATIENCE: Duration = Duration::from_secs(5);

pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.record {
        Recorder::check_place(&target::recording(path)?)?;
    }
    let (server, timetable) = open(&args.stream.scene, &args.stream.tuning, 0)?;
    runtime()?.block_on(serve(args, server, &timetable))
}

async fn serve(args: &Args, server: Server, timetable: &Timetable) -> Outcome {
    let table = server.table().clone();
    let hub = Hub::new(table.clone(), server.coder(), args.network.access()?, Limits::default());
    let bound = args.network.serve(&hub).await?;
    eprintln!("serving {} at {bound}; stop with Ctrl-C", table.header().name);
    let mut sinks = Sinks::new().with_hub(hub.clone());
    if let Some(path) = &args.record {
        let path = target::recording(path)?;
        sinks = sinks.with_recorder(Recorder::create(&path, args.recording.options(&path))?, &table)?;
    }
    let mut pipeline = Pipeline::new(server, sinks, args.pipeline())?;
    let mut counts = Counts::default();
    let ended = tokio::select! {
        () = network::stop() => Ok(()),
        result = frames(args, (&mut pipeline, timetable), &hub, &mut counts) => result,
    };
    // An encoder that failed says more than the frame that it could not be given.
    let (sinks, late) = tokio::task::block_in_place(|| pipeline.finish())?;
    ended?;
    let goodbye = "the server stops";
    hub.close(CloseCode::STOPPED, goodbye, PATIENCE).await;
    handle(args.edits, None, &hub);
    counts.tell(late);
    if let Some(recorded) = sinks.finish(&Close::new(CloseCode::STOPPED, goodbye))? {
        eprintln!("recorded {}", number::bytes(recorded.bytes));
    }
    Ok(())
}

/// Frames of a live server.
#[derive(Default)]
struct Counts {
    sent: u64,
    skipped: u64,
}

impl Counts {
    /// Prints the totals.
    fn tell(&self, late: LatePoints) {
        eprintln!(
            "{} sent, {} skipped because the frame before took too long",
            number::counted(self.sent, "frame"),
            self.skipped
        );
        if late.frames > 0 {
            eprintln!(
                "in {} frames points waited for rays: at most {} points, for at most {} frames (--frame-time)",
                number::count(late.frames),
                number::count(late.points.into()),
                late.oldest
            );
        }
    }
}

async fn frames(
    args: &Args,
    (pipeline, timetable): (&mut Pipeline, &Timetable),
    hub: &Hub,
    counts: &mut Counts,
) -> Outcome {
    let tick = args.tick();
    let mut start = Instant::now();
    let mut number = 0_u32;
    while args.frames.is_none_or(|frames| counts.sent < frames) {
        handle(args.edits, Some(pipeline), hub);
        if hub.joined() == 0 && args.record.is_none() {
            // The stream's clock stands still while nobody listens.
            let waited = Instant::now();
            hub.wait_joined(1, PATIENCE).await;
            start += waited.elapsed();
            continue;
        }
        tokio::time::sleep((tick * number).saturating_sub(start.elapsed())).await;
        let captured = hub.now();
        let (time, views) = timetable.frame(number, &hub.views());
        tokio::task::block_in_place(|| pipeline.frame(FrameIndex(number), time, &views, captured))?;
        if number == 0 {
            // The first frame traces all points that it sends; without a new start, hundreds of frames would be skipped.
            start = Instant::now();
        }
        counts.sent += 1;
        let due = (start.elapsed().as_secs_f64() / tick.as_secs_f64()) as u32;
        counts.skipped += u64::from(due.saturating_sub(number + 1));
        number = due.max(number + 1);
    }
    Ok(())
}

/// Applies the edits of clients, and prints which clients came and went and what was refused.
fn handle(edits: EditsArg, mut pipeline: Option<&mut Pipeline>, hub: &Hub) {
    let mut refused = BTreeMap::new();
    for event in hub.take_events() {
        match event {
            HubEvent::Edit { client, edit } => {
                if let Err(reason) = take(edits, pipeline.as_deref_mut(), &edit) {
                    refused.entry(client).or_insert((reason, 0_u64)).1 += 1;
                }
            }
            other => network::tell(&other),
        }
    }
    // One line for each client, however many edits it sends.
    for (client, (reason, count)) in refused {
        let more =
            if count > 1 { format!(", and {} more edits", number::count(count - 1)) } else { String::new() };
        eprintln!("client {}: edit refused: {reason}{more}", number::count(client.0));
    }
}

/// Applies an edit from the next frame on.
fn take(edits: EditsArg, pipeline: Option<&mut Pipeline>, edit: &Edit) -> Result<(), String> {
    match pipeline {
        _ if edits == EditsArg::Deny => Err("the server runs with --edits deny".to_owned()),
        None => Err("the server stops".to_owned()),
        Some(pipeline) => pipeline.edit(edit).map(drop).map_err(|error| error.to_string()),
    }
}
