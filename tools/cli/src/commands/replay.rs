//! `psao replay`: plays a recording, in process or to clients over a network.

use std::sync::Arc;
use std::time::Duration;

use clap::ValueEnum;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameKind, inspect};
use psao_proto::message::CloseCode;
use psao_proto::net::Hub;
use psao_proto::recording::{PlayedFrame, Player, PlayerEvent, Summary};
use psao_proto::{Limits, Micros, SceneTable, StreamTime};

use crate::args::{Format, FormatArg, RecordingArg};
use crate::context::{Stopwatch, runtime, say};
use crate::error::{Exit, Failure, Outcome};
use crate::input;
use crate::network::{self, ListenArgs};
use crate::output::frames::FrameLog;
use crate::output::number;
use crate::pace::Pacer;
use crate::quantity::TimeSpan;

/// Play a recording, or serve it to clients
///
/// Without --listen, a client in this process plays the recording. With --listen, psao waits for clients and sends the
/// frames as they were recorded; a client that joins late gets a keyframe. With --from, the first frame sent is a keyframe
/// of the state at that time. Ctrl-C ends it. Exit code 4 means that damaged frames were left out.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao replay a.psao
  psao replay a.psao --listen 127.0.0.1:4700
  psao replay a.psao --from 2.5s --loop --pace wall --listen 127.0.0.1:4700")]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    #[command(flatten)]
    network: ListenArgs,
    /// Wait for this number of clients before the first frame
    #[arg(long, value_name = "N", default_value_t = 1, requires = "listen", help_heading = network::NETWORK)]
    clients: usize,
    /// When a frame goes out
    #[arg(long, value_enum, default_value_t = Pace::Fast)]
    pace: Pace,
    /// Speed of --pace wall: 2 plays twice as fast as recorded
    #[arg(long, alias = "rate", value_name = "FACTOR", default_value_t = 1.0)]
    speed: f64,
    /// Start with the first frame at or after this time of the stream
    #[arg(long, value_name = "TIME", default_value = "0")]
    from: TimeSpan,
    /// Stop before the first frame after this time of the stream
    #[arg(long, value_name = "TIME")]
    to: Option<TimeSpan>,
    /// Start again at the end
    #[arg(long = "loop")]
    again: bool,
    #[command(flatten)]
    format: FormatArg,
    /// Print the totals only
    #[arg(long)]
    quiet: bool,
}

/// `--pace`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Pace {
    /// At the recorded times; late frames follow at once
    Wall,
    /// As fast as the clients apply them
    Fast,
    /// Each frame once every client has applied the one before
    Step,
}

/// Frames that `--pace fast` sends before it waits for the clients.
const FAST_WINDOW: u64 = 8;
/// How long a client may take for what it was sent before the replay goes on without it.
const PATIENCE: Duration = Duration::from_secs(30);
/// How long it may take after Ctrl-C.
const GOODBYE: Duration = Duration::from_secs(5);

pub(crate) fn run(args: &Args) -> Outcome {
    if !(args.speed.is_finite() && args.speed > 0.0) {
        return Err(Failure::usage(format_args!("--speed {} is not a number above 0", args.speed)));
    }
    let from = args.from.stream_time();
    let to = args.to.map(TimeSpan::stream_time);
    if to.is_some_and(|to| to < from) {
        return Err(Failure::usage("--to is before --from"));
    }
    let bytes = input::recording(&args.recording.file)?;
    let replay = Replay { args, bytes: &bytes, start: start(args, &bytes, from)?, to };
    runtime()?.block_on(replay.play())
}

/// A recording and the part of it that is played.
struct Replay<'a> {
    args: &'a Args,
    bytes: &'a [u8],
    /// Where to start, unless at the start.
    start: Option<(Summary, usize)>,
    to: Option<StreamTime>,
}

/// Where the frames go.
enum Target {
    Here,
    Clients(Hub, Arc<SceneTable>),
}

/// What ends a round.
#[derive(PartialEq, Eq)]
enum End {
    /// The recording, or `--to`.
    Done,
    /// Another scene, which a connection cannot change to.
    OtherScene,
    /// Ctrl-C or SIGTERM.
    Stopped,
}

/// The first frame at or after a time, in the order of the file.
fn start(args: &Args, bytes: &[u8], from: StreamTime) -> Outcome<Option<(Summary, usize)>> {
    if from == StreamTime(0) {
        return Ok(None);
    }
    let summary = Summary::scan(bytes, Limits::default()).map_err(|error| refused(args, error))?;
    let Some(entry) = summary.frames().iter().position(|entry| entry.time >= from) else {
        let last = summary.frames().iter().map(|entry| entry.time).max().unwrap_or_default();
        return Err(refused(
            args,
            format_args!(
                "no frame at or after --from {}: the last is at {} s",
                args.from,
                last.0 as f64 / 1e6
            ),
        ));
    };
    Ok(Some((summary, entry)))
}

fn refused(args: &Args, error: impl std::fmt::Display) -> Failure {
    Failure::input(format_args!("{}: {error}", args.recording.file.display()))
}

impl<'a> Replay<'a> {
    async fn play(&self) -> Outcome {
        let args = self.args;
        let mut player = self.open()?;
        let target = match &args.network.listen {
            None => Target::Here,
            Some(_) => self.listen(&mut player).await?,
        };
        let mut log = FrameLog::new(args.format.get(), args.quiet)?;
        let (clock, mut pacer) = (Stopwatch::start(), Pacer::new(args.speed));
        let mut left_out = 0;
        let stop = network::stop();
        tokio::pin!(stop);
        let mut goodbye = (CloseCode::DONE, "end of the recording", PATIENCE);
        loop {
            let end = tokio::select! {
                end = self.round(&mut player, &target, &clock, &mut pacer, &mut log) => end?,
                () = &mut stop => {
                    goodbye = (CloseCode::STOPPED, "the server stops", GOODBYE);
                    End::Stopped
                }
            };
            let stats = player.stats();
            left_out += stats.damages + stats.unusable + stats.bad_messages;
            if end == End::OtherScene {
                eprintln!("psao: the recording goes on with another scene, which takes another connection");
            }
            if !args.again || log.frames == 0 || end == End::Stopped {
                break;
            }
            player = self.open()?;
            pacer.again();
        }
        if let Target::Clients(hub, _) = &target {
            let (code, text, patience) = goodbye;
            hub.close(code, text, patience).await;
            hub.take_events().iter().for_each(network::tell);
        }
        log.finish("")?;
        if left_out > 0 {
            return Err(Failure::new(
                Exit::DataLoss,
                format_args!(
                    "damage left out at {}; `psao verify` lists it",
                    number::counted(left_out, "place")
                ),
            ));
        }
        Ok(())
    }

    /// Returns a player with the state before the first frame.
    fn open(&self) -> Outcome<Player<'a>> {
        let mut player =
            Player::new(self.bytes, Limits::default()).map_err(|error| refused(self.args, error))?;
        if let Some((summary, entry)) = &self.start {
            player.jump(summary, *entry);
        }
        Ok(player)
    }

    /// Plays up to the scene table, listens, and waits for the clients.
    async fn listen(&self, player: &mut Player<'_>) -> Outcome<Target> {
        while player.scene().is_none() {
            if player.next_event().is_none() {
                return Err(refused(self.args, "it has no whole scene table, so no client could follow it"));
            }
        }
        let Some(scene) = player.scene().cloned() else { return Ok(Target::Here) };
        let (coder, network) = (BlockCoder::of(scene.info().coder), &self.args.network);
        let hub = Hub::new(Arc::clone(&scene), coder, network.access()?, Limits::default());
        let bound = network.serve(&hub).await?;
        eprintln!(
            "listening at {bound}, waiting for {}",
            number::counted(self.args.clients as u64, "client")
        );
        while !hub.wait_joined(self.args.clients, PATIENCE).await {
            hub.take_events().iter().for_each(network::tell);
        }
        player.edits().iter().for_each(|edit| hub.edit(edit));
        Ok(Target::Clients(hub, scene))
    }

    /// Plays the part once.
    async fn round(
        &self,
        player: &mut Player<'_>,
        target: &Target,
        clock: &Stopwatch,
        pacer: &mut Pacer,
        log: &mut FrameLog,
    ) -> Outcome<End> {
        let args = self.args;
        let first = self.start.as_ref().map_or(0, |(summary, entry)| summary.frames()[*entry].offset);
        let mut begun = false;
        while let Some(event) = player.next_event() {
            match event {
                // What lies before the part is played for the state alone.
                PlayerEvent::Frame(frame) if frame.offset < first => {}
                PlayerEvent::Frame(frame) => {
                    if self.to.is_some_and(|to| frame.info.time > to) {
                        break;
                    }
                    if args.pace == Pace::Wall {
                        let wait = pacer.wait(Micros(clock.micros()), frame.arrival);
                        tokio::time::sleep(Duration::from_micros(wait.0)).await;
                    }
                    if let Target::Clients(hub, _) = target {
                        self.deliver(player, hub, &frame, !begun, log.frames).await?;
                    }
                    begun = true;
                    // A replay without clients waits for nothing else, and must hear Ctrl-C.
                    tokio::task::yield_now().await;
                    log.frame(&frame.info, frame.wire_bytes)?;
                }
                PlayerEvent::Damage(damage) => eprintln!("psao: {damage}"),
                PlayerEvent::Unusable { offset, reason, .. } => {
                    eprintln!("psao: the frame at offset {offset} was left out: {reason}");
                }
                PlayerEvent::BadMessage { offset, error } => {
                    eprintln!("psao: the message at offset {offset} was left out: {error}");
                }
                PlayerEvent::Gap(gap) => eprintln!("psao: {gap}"),
                PlayerEvent::Closed(close) if !args.again => say_closed(args, &close.text)?,
                PlayerEvent::Report(report) => {
                    // Reports before the part are about frames that nobody gets.
                    if let (Target::Clients(hub, _), true) = (target, begun) {
                        hub.report(&report);
                    }
                }
                PlayerEvent::Budget(budget) => {
                    if let (Target::Clients(hub, _), true) = (target, begun) {
                        hub.budget(&budget);
                    }
                }
                PlayerEvent::Edit(edit) => {
                    if let Target::Clients(hub, _) = target {
                        hub.edit(&edit);
                    }
                }
                PlayerEvent::Scene(scene) => {
                    if matches!(target, Target::Clients(_, served) if *served != scene) {
                        return Ok(End::OtherScene);
                    }
                }
                PlayerEvent::Closed(_) => {}
            }
        }
        Ok(End::Done)
    }

    /// Gives one frame to the clients, as it was recorded or, the first of a round, as a keyframe of the state; then waits
    /// as the pace says.
    async fn deliver(
        &self,
        player: &Player<'_>,
        hub: &Hub,
        frame: &PlayedFrame,
        opens: bool,
        count: u64,
    ) -> Outcome {
        let failed = |error| Failure::new(Exit::System, error);
        let Some(state) = player.state() else { return Ok(()) };
        let made = if opens && frame.info.kind != FrameKind::Key { player.keyframe() } else { None };
        let (info, body) = match made {
            Some(body) => {
                let body = body.map_err(failed)?;
                let info = inspect(&body, &Limits::default().codec)
                    .map_err(|error| Failure::new(Exit::System, error))?;
                (info, body)
            }
            None => (frame.info.clone(), frame.body(self.bytes).to_vec()),
        };
        hub.broadcast(&info, body, state.into(), hub.now()).map_err(failed)?;
        let wait = match self.args.pace {
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
}

fn say_closed(args: &Args, text: &impl std::fmt::Display) -> Outcome {
    if args.quiet || args.format.get() != Format::Table {
        Ok(())
    } else {
        say(format_args!("closed: {text}"))
    }
}
