//! `psao serve`: a live server.

use std::time::{Duration, Instant};

use psao_proto::Limits;
use psao_proto::message::CloseCode;
use psao_proto::net::{Hub, HubEvent, Listener};

use super::client::peer;
use crate::args::StreamArgs;
use crate::context::{WallClock, runtime};
use crate::error::Outcome;
use crate::output::number;
use crate::producer::Producer;

/// A live server: traces the scene as it plays and sends what changed to every client
///
/// The clip plays over and over until Ctrl-C or --frames. Nothing is traced while nobody listens. A frame that takes
/// longer than its time is followed by the one that is then due; how many were skipped is printed at the end.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    stream: StreamArgs,
    /// Address to listen at; port 0 lets the system choose
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:4700")]
    listen: String,
    /// Stop after so many frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Send stage times with every frame
    #[arg(long)]
    timings: bool,
}

/// How long to wait for clients before looking again, and for goodbyes.
const PATIENCE: Duration = Duration::from_secs(5);

pub(crate) fn run(args: &Args) -> Outcome {
    let mut producer = Producer::new(&args.stream.scene, &args.stream.tuning, 0)?;
    runtime()?.block_on(serve(args, &mut producer))
}

async fn serve(args: &Args, producer: &mut Producer) -> Outcome {
    let hub = Hub::new(producer.table().clone(), Limits::default());
    let listener = Listener::bind(&args.listen).await.map_err(peer)?;
    let bound = listener.local_addr().map_err(peer)?;
    eprintln!("serving {} at {bound}; stop with Ctrl-C", producer.info().name);
    tokio::spawn(listener.run(hub.clone()));
    let stop = tokio::signal::ctrl_c();
    tokio::pin!(stop);
    let mut skipped = 0_u64;
    let mut sent = 0_u64;
    tokio::select! {
        _ = &mut stop => {}
        result = frames(args, producer, &hub, &mut sent, &mut skipped) => result?,
    }
    hub.close(CloseCode::STOPPED, "the server stops", PATIENCE).await;
    eprintln!("{sent} frames sent, {skipped} skipped because the one before took too long");
    Ok(())
}

async fn frames(
    args: &Args,
    producer: &mut Producer,
    hub: &Hub,
    sent: &mut u64,
    skipped: &mut u64,
) -> Outcome {
    let clock = WallClock::start();
    let tick = Duration::from_secs_f64(1.0 / f64::from(args.stream.tuning.points.fps));
    let mut start = Instant::now();
    let mut number = 0_u32;
    while args.frames.is_none_or(|frames| *sent < frames) {
        if hub.joined() == 0 {
            // The stream's clock stands still while nobody listens.
            let waited = Instant::now();
            hub.wait_joined(1, PATIENCE).await;
            start += waited.elapsed();
            continue;
        }
        tell(hub);
        tokio::time::sleep((tick * number).saturating_sub(start.elapsed())).await;
        let (output, produced) = tokio::task::block_in_place(|| producer.step(number, &hub.views(), &clock))?;
        hub.broadcast(&output.info, &output.body, || producer.keyframe(&output.info))?;
        if args.timings {
            hub.report(&produced.report(output.info.frame, true));
        }
        *sent += 1;
        let due = (start.elapsed().as_secs_f64() / tick.as_secs_f64()) as u32;
        *skipped += u64::from(due.saturating_sub(number + 1));
        number = due.max(number + 1);
    }
    Ok(())
}

/// Says who came and went.
fn tell(hub: &Hub) {
    for event in hub.take_events() {
        match event {
            HubEvent::Joined { peer, name, .. } => eprintln!("{peer} joined: {name}"),
            HubEvent::Left { peer, error: None, .. } => eprintln!("{peer} left"),
            HubEvent::Left { peer, error: Some(error), .. } => eprintln!("{peer} left: {error}"),
            HubEvent::Edit { client, .. } => {
                eprintln!("client {} asks to change the scene: not in this version", number::count(client.0));
            }
        }
    }
}
