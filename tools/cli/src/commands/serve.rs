//! `psao serve`: a live server.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use psao_codec::frame::{FrameInfo, FrameKind};
use psao_proto::Limits;
use psao_proto::message::{Close, CloseCode, Edit};
use psao_proto::net::{Hub, HubEvent};

use crate::args::{BufferArg, EditsArg, StreamArgs};
use crate::context::{WallClock, runtime};
use crate::error::{Exit, Failure, Outcome};
use crate::network::{self, ListenArgs};
use crate::output::number;
use crate::producer::Producer;
use crate::recorder::{Live, Recorder, check_place};

/// A live server: traces the scene as it plays and sends what changed to every client
///
/// The clip plays over and over until Ctrl-C or --frames. Nothing is traced while nobody listens. A frame that takes
/// longer than its time is followed by the one that is then due; how many were skipped is printed at the end. With --record
/// the recording listens too: the clip plays from the start. A slow or full disk costs frames of the recording, never of
/// the stream; exit code 1 then means that the disk failed.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    stream: StreamArgs,
    #[command(flatten)]
    network: ListenArgs,
    /// Stop after so many frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Whether clients may change the scene: what one moves, hides or shows, all of them get, and the AO follows
    #[arg(long, value_enum, default_value_t = EditsArg::Allow)]
    edits: EditsArg,
    /// Send stage times with every frame
    #[arg(long)]
    timings: bool,
    /// Record the stream into this file as well
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    buffer: BufferArg,
}

/// How long to wait for clients before looking again, and for goodbyes.
const PATIENCE: Duration = Duration::from_secs(5);

pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.record {
        check_place(path)?;
    }
    let mut producer = Producer::new(&args.stream.scene, &args.stream.tuning, 0)?;
    runtime()?.block_on(serve(args, &mut producer))
}

async fn serve(args: &Args, producer: &mut Producer) -> Outcome {
    let hub = Hub::new(producer.table().clone(), producer.coder(), args.network.access()?, Limits::default());
    let bound = args.network.serve(&hub).await?;
    eprintln!("serving {} at {bound}; stop with Ctrl-C", producer.info().name);
    let mut recorder = match &args.record {
        Some(path) => Some(Recorder::live(path, args.buffer.bytes())?),
        None => None,
    };
    if let Some(recorder) = &mut recorder {
        recorder.scene(producer.table())?;
    }
    let mut skipped = 0_u64;
    let mut sent = 0_u64;
    tokio::select! {
        () = network::stop() => {}
        result = frames(args, producer, &hub, &mut recorder, &mut sent, &mut skipped) => result?,
    }
    let goodbye = "the server stops";
    hub.close(CloseCode::STOPPED, goodbye, PATIENCE).await;
    handle(EditsArg::Deny, producer, &hub, &mut None)?;
    eprintln!("{sent} frames sent, {skipped} skipped because the one before took too long");
    if let Some(mut recorder) = recorder {
        recorder.message(recorder.now(), &Close::new(CloseCode::STOPPED, goodbye))?;
        let bytes = recorder.finish()?;
        eprintln!("recorded {}", number::bytes(bytes));
    }
    Ok(())
}

/// Gives a frame to the recording: as it was sent, or as a keyframe where one ends a gap.
fn record(recorder: &mut Recorder<Live>, producer: &Producer, info: &FrameInfo, body: &[u8]) -> Outcome {
    let now = recorder.now();
    if recorder.wants_keyframe() {
        return recorder.body(now, true, &producer.keyframe(info)?);
    }
    recorder.body(now, info.kind == FrameKind::Key, body)
}

async fn frames(
    args: &Args,
    producer: &mut Producer,
    hub: &Hub,
    recorder: &mut Option<Recorder<Live>>,
    sent: &mut u64,
    skipped: &mut u64,
) -> Outcome {
    let clock = WallClock::start();
    let tick = Duration::from_secs_f64(1.0 / f64::from(args.stream.tuning.points.fps));
    let mut start = Instant::now();
    let mut number = 0_u32;
    while args.frames.is_none_or(|frames| *sent < frames) {
        handle(args.edits, producer, hub, recorder)?;
        if hub.joined() == 0 && recorder.is_none() {
            // The stream's clock stands still while nobody listens.
            let waited = Instant::now();
            hub.wait_joined(1, PATIENCE).await;
            start += waited.elapsed();
            continue;
        }
        tokio::time::sleep((tick * number).saturating_sub(start.elapsed())).await;
        let captured = hub.now();
        let (output, produced) = tokio::task::block_in_place(|| producer.step(number, &hub.views(), &clock))?;
        let (info, body) = (output.info, Arc::<[u8]>::from(output.body));
        hub.broadcast(&info, Arc::clone(&body), producer.state(), captured)
            .map_err(|error| Failure::new(Exit::System, error))?;
        let report = args.timings.then(|| produced.report(info.frame, true));
        if let Some(budget) = &produced.budget {
            hub.budget(budget);
        }
        if let Some(report) = &report {
            hub.report(report);
        }
        if let Some(recorder) = recorder {
            record(recorder, producer, &info, &body)?;
            produced.budget.map_or(Ok(()), |budget| recorder.message(recorder.now(), &budget))?;
            report.map_or(Ok(()), |report| recorder.message(recorder.now(), &report))?;
        }
        *sent += 1;
        let due = (start.elapsed().as_secs_f64() / tick.as_secs_f64()) as u32;
        *skipped += u64::from(due.saturating_sub(number + 1));
        number = due.max(number + 1);
    }
    Ok(())
}

/// Edits the scene as clients ask, and says who came and went and what was refused.
fn handle(
    edits: EditsArg,
    producer: &mut Producer,
    hub: &Hub,
    recorder: &mut Option<Recorder<Live>>,
) -> Outcome {
    let mut refused = BTreeMap::new();
    for event in hub.take_events() {
        match event {
            HubEvent::Edit { client, edit } => match take(edits, producer, &edit) {
                Ok(false) => {}
                Ok(true) => {
                    hub.edit(&edit);
                    recorder.as_mut().map_or(Ok(()), |tape| tape.message(tape.now(), &edit))?;
                }
                Err(reason) => refused.entry(client).or_insert((reason, 0_u64)).1 += 1,
            },
            other => network::tell(&other),
        }
    }
    // A line for each client, however much it asks for.
    for (client, (reason, count)) in refused {
        let more =
            if count > 1 { format!(", and {} more edits", number::count(count - 1)) } else { String::new() };
        eprintln!("client {}: edit refused: {reason}{more}", number::count(client.0));
    }
    Ok(())
}

/// Takes an edit in from the next frame on; whether it changes anything.
fn take(edits: EditsArg, producer: &mut Producer, edit: &Edit) -> Result<bool, String> {
    if edits == EditsArg::Deny {
        return Err("the server runs with --edits deny".to_owned());
    }
    producer.edit(edit).map_err(|error| error.to_string())
}
