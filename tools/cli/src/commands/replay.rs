//! `psao replay`: plays a recording, in process or to clients over TCP.

use std::time::{Duration, Instant};

use clap::ValueEnum;
use psao_codec::frame::{FrameKind, FrameMeta};
use psao_codec::stream::keyframe;
use psao_proto::Limits;
use psao_proto::message::CloseCode;
use psao_proto::net::{Hub, Listener};
use psao_proto::recording::{PlayedFrame, Player, PlayerEvent};

use super::client::peer;
use crate::analysis::load;
use crate::args::{Coder, Format, RecordingArg};
use crate::context::{runtime, say};
use crate::error::{Exit, Failure, Outcome};
use crate::output::frames::FrameLog;

/// Play a recording, in process or to clients over TCP
///
/// Without --listen it is played into a client in this process. With --listen it waits for clients and serves the frames
/// as they were recorded; who joins late gets a keyframe made from the state. Exit code 4: damaged frames were left out.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// Serve the recording at this address; port 0 lets the system choose
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Wait for so many clients before the first frame
    #[arg(long, value_name = "N", default_value_t = 1, requires = "listen")]
    clients: usize,
    /// When a frame goes out
    #[arg(long, value_enum, default_value_t = Pace::Fast)]
    pace: Pace,
    /// Speed of --pace wall; 2 is twice as fast as recorded
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    rate: f64,
    /// Start at this time of the stream, in seconds
    #[arg(long, value_name = "T", default_value_t = 0.0)]
    from: f64,
    /// Stop after this time of the stream, in seconds
    #[arg(long, value_name = "T")]
    to: Option<f64>,
    /// Start again at the end
    #[arg(long = "loop")]
    again: bool,
    /// How to print: table, json (a line per frame) or csv
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
    /// Totals alone
    #[arg(long)]
    quiet: bool,
}

/// `--pace`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Pace {
    /// At the recorded times
    Wall,
    /// As fast as the clients take them
    Fast,
    /// Each frame when every client has applied the one before
    Step,
}

/// Frames that `--pace fast` sends before it waits for the clients.
const FAST_WINDOW: u64 = 8;
/// How long a client may take for what it was sent before the replay goes on without it.
const PATIENCE: Duration = Duration::from_secs(30);

pub(crate) fn run(args: &Args) -> Outcome {
    if !(args.rate.is_finite() && args.rate > 0.0) {
        return Err(Failure::usage(format_args!("--rate {} is not a number above 0", args.rate)));
    }
    let times = [Some(args.from), args.to];
    if times.iter().flatten().any(|time| !time.is_finite()) || args.to.is_some_and(|to| to < args.from) {
        return Err(Failure::usage("--from and --to are times in seconds, --to not before --from"));
    }
    let bytes = load(&args.recording.file)?;
    runtime()?.block_on(play(args, &bytes))
}

/// Whom the frames go to.
enum Target {
    Here,
    Clients(Hub),
}

async fn play(args: &Args, bytes: &[u8]) -> Outcome {
    let mut player = open(args, bytes)?;
    let target = match &args.listen {
        None => Target::Here,
        Some(address) => Target::Clients(listen(args, address, &mut player).await?),
    };
    let mut log = FrameLog::new(args.format, args.quiet)?;
    let mut left_out = 0;
    loop {
        play_once(args, bytes, &mut player, &target, &mut log).await?;
        let stats = player.stats();
        left_out += stats.damages + stats.unusable + stats.bad_messages;
        if !args.again || log.frames == 0 {
            break;
        }
        player = open(args, bytes)?;
    }
    if let Target::Clients(hub) = &target {
        hub.close(CloseCode::DONE, "end of the recording", PATIENCE).await;
    }
    log.finish("")?;
    if left_out > 0 {
        return Err(Failure::new(
            Exit::DataLoss,
            format_args!("{left_out} damaged place(s) or frame(s) left out; `psao verify` lists them"),
        ));
    }
    Ok(())
}

fn open<'a>(args: &Args, bytes: &'a [u8]) -> Outcome<Player<'a>> {
    let path = &args.recording.file;
    Player::new(bytes, Limits::default())
        .map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))
}

/// Plays up to the scene table, listens, and waits for the clients.
async fn listen(args: &Args, address: &str, player: &mut Player<'_>) -> Outcome<Hub> {
    let scene = loop {
        match player.next_event() {
            Some(PlayerEvent::Scene(scene)) => break scene,
            Some(_) => {}
            None => {
                return Err(Failure::input(format_args!(
                    "{}: it has no whole scene table, so no client could follow it",
                    args.recording.file.display()
                )));
            }
        }
    };
    let hub = Hub::new(scene, Limits::default());
    let listener = Listener::bind(address).await.map_err(peer)?;
    let bound = listener.local_addr().map_err(peer)?;
    eprintln!("listening at {bound}, waiting for {} client(s)", args.clients);
    tokio::spawn(listener.run(hub.clone()));
    while !hub.wait_joined(args.clients, PATIENCE).await {}
    Ok(hub)
}

async fn play_once(
    args: &Args,
    bytes: &[u8],
    player: &mut Player<'_>,
    target: &Target,
    log: &mut FrameLog,
) -> Outcome {
    let mut start = None;
    while let Some(event) = player.next_event() {
        match event {
            PlayerEvent::Frame(frame) => {
                let time = frame.info.time.0 as f64 / 1e6;
                if time < args.from {
                    continue;
                }
                if args.to.is_some_and(|to| time > to) {
                    break;
                }
                let (wall, first) = *start.get_or_insert((Instant::now(), frame.arrival));
                if args.pace == Pace::Wall {
                    let due = Duration::from_secs_f64(frame.arrival.since(first).as_secs_f64() / args.rate);
                    tokio::time::sleep(due.saturating_sub(wall.elapsed())).await;
                }
                deliver(args, bytes, player, target, &frame, log.frames).await?;
                log.frame(&frame.info, frame.wire_bytes)?;
            }
            PlayerEvent::Damage(damage) => eprintln!("psao: {damage}"),
            PlayerEvent::Unusable { offset, reason, .. } => {
                eprintln!("psao: the frame at offset {offset} was left out: {reason}");
            }
            PlayerEvent::BadMessage { offset, error } => {
                eprintln!("psao: the message at offset {offset} was left out: {error}");
            }
            PlayerEvent::Closed(close) if !args.again => say_closed(args, &close.text)?,
            PlayerEvent::Report(report) => {
                // Reports before --from are about frames that nobody gets.
                if let (Target::Clients(hub), true) = (target, start.is_some()) {
                    hub.report(&report);
                }
            }
            PlayerEvent::Scene(_) | PlayerEvent::Closed(_) => {}
        }
    }
    Ok(())
}

fn say_closed(args: &Args, text: &impl std::fmt::Display) -> Outcome {
    if args.quiet || args.format != Format::Table { Ok(()) } else { say(format_args!("closed: {text}")) }
}

/// Gives one frame to the clients, as it was recorded, and waits as the pace says.
async fn deliver(
    args: &Args,
    bytes: &[u8],
    player: &Player<'_>,
    target: &Target,
    frame: &PlayedFrame,
    count: u64,
) -> Outcome {
    let Target::Clients(hub) = target else { return Ok(()) };
    let body = frame.body(bytes);
    let joining = || match (player.state(), player.scene()) {
        (Some(state), Some(scene)) => {
            let meta = FrameMeta {
                kind: FrameKind::Key,
                frame: frame.info.frame,
                time: frame.info.time,
                changed_points: 0,
            };
            keyframe(state, meta, Coder::of(scene.info().coder), &[])
                .map_err(|error| Failure::new(Exit::System, error))
        }
        _ => Err(Failure::new(Exit::System, "there is no state to join at")),
    };
    hub.broadcast(&frame.info, body, joining)?;
    let wait = match args.pace {
        Pace::Wall => false,
        Pace::Fast => count % FAST_WINDOW == FAST_WINDOW - 1,
        Pace::Step => true,
    };
    if wait {
        hub.wait_acked(frame.info.frame, PATIENCE).await;
    }
    // Sockets share this thread: let them write.
    tokio::task::yield_now().await;
    Ok(())
}
