//! Both ends of the soak test: a server with a frame loop, and many clients, some of which take no bytes.

use std::error::Error;
use std::time::Duration;

use psao_proto::message::CloseCode;
use psao_proto::net::{
    Address, Broadcast, ConnectOptions, Connection, Hub, HubEvent, ListenOptions, Listener, connect,
};
use psao_proto::session::{Access, ClientEvent};
use psao_proto::{Limits, Micros};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};

use crate::source::Source;

pub(crate) type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// Settings of the soak test.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Load {
    pub(crate) clients: usize,
    /// Number of clients that read nothing after their handshake.
    pub(crate) stalled: usize,
    pub(crate) hz: f64,
    pub(crate) seconds: f64,
}

/// Counts of the server.
#[derive(Debug, Default)]
pub(crate) struct ServerTally {
    pub(crate) frames: u64,
    /// Ticks that were late because the frame before took too long.
    pub(crate) late: u64,
    pub(crate) bytes: u64,
    pub(crate) sent: Broadcast,
    pub(crate) joined: u64,
    pub(crate) left: u64,
    /// Errors of the clients that left with one.
    pub(crate) faults: Vec<String>,
    /// Longest time to give one frame to all clients.
    pub(crate) slowest: Duration,
    pub(crate) most_queued: usize,
}

/// Counts of a good client.
#[derive(Debug)]
pub(crate) struct ClientTally {
    pub(crate) frames: u64,
    pub(crate) per_second: f64,
    /// Updates that could not be applied, including wrong hashes.
    pub(crate) unusable: u64,
    pub(crate) error: Option<String>,
}

/// Listens at a port of the loopback. Returns the hub and the address.
pub(crate) async fn listen(source: &Source, coder: psao_codec::block::BlockCoder) -> Result<(Hub, Address)> {
    // Stalled clients stay connected, because their cost is what this test measures.
    let hour = Micros::from_secs(3_600);
    let limits = Limits::default().with_max_clients(10_000).with_silence(hour).with_stall(hour);
    let hub = Hub::new(source.scene().clone(), coder, Access::Open, limits);
    let listener = Listener::bind(&hub, &"127.0.0.1:0".parse()?, &ListenOptions::default()).await?;
    let address = listener.address().clone();
    tokio::spawn(listener.run());
    Ok((hub, address))
}

/// Waits for all clients, sends frames for the given time, and closes the hub. Calls `watch` with the counts every five
/// seconds.
pub(crate) async fn serve(
    hub: &Hub,
    source: &mut Source,
    load: Load,
    mut watch: impl FnMut(&ServerTally, &Hub),
) -> Result<ServerTally> {
    if !hub.wait_joined(load.clients, Duration::from_secs(60)).await {
        return Err(format!("{} of {} clients joined within 60 s", hub.joined(), load.clients).into());
    }
    let mut served = ServerTally::default();
    let start = Instant::now();
    let mut ticks = interval(Duration::from_secs_f64(1.0 / load.hz));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut shown = start;
    while start.elapsed().as_secs_f64() < load.seconds {
        let due = ticks.tick().await;
        served.late += u64::from(due.elapsed().as_secs_f64() > 1.0 / load.hz);
        let captured = hub.now();
        let frame = source.step()?;
        served.bytes += frame.body.len() as u64;
        let begun = Instant::now();
        let sent = hub.broadcast(&frame.info, frame.body, source.state(), captured)?;
        served.slowest = served.slowest.max(begun.elapsed());
        served.frames += 1;
        served.count(sent);
        served.most_queued = served.most_queued.max(hub.queued_bytes());
        served.hear(hub);
        if shown.elapsed() >= Duration::from_secs(5) {
            shown = Instant::now();
            watch(&served, hub);
        }
    }
    hub.close(CloseCode::DONE, "the soak is over", Duration::from_secs(10)).await;
    served.hear(hub);
    Ok(served)
}

impl ServerTally {
    fn count(&mut self, sent: Broadcast) {
        self.sent.updates += sent.updates;
        self.sent.keyframes += sent.keyframes;
        self.sent.patches += sent.patches;
        self.sent.behind += sent.behind;
    }

    fn hear(&mut self, hub: &Hub) {
        for event in hub.take_events() {
            match event {
                HubEvent::Joined { .. } => self.joined += 1,
                HubEvent::Left { error, .. } => {
                    self.left += 1;
                    self.faults.extend(error.map(|error| error.to_string()));
                }
                other => self.faults.push(format!("{other:?}")),
            }
        }
    }
}

/// Connects all clients and follows the stream to its end. Returns the counts of the good clients.
pub(crate) async fn follow(address: &Address, load: Load) -> Result<Vec<ClientTally>> {
    let mut stalled = Vec::new();
    for _ in 0..load.stalled.min(load.clients) {
        let mut connection = dial(address).await?;
        while connection.session().state().is_none() {
            connection.next_event().await?;
        }
        stalled.push(connection);
    }
    let mut following = Vec::new();
    for _ in stalled.len()..load.clients {
        following.push(tokio::spawn(follow_one(dial(address).await?)));
    }
    let mut seen = Vec::new();
    for one in following {
        seen.push(one.await?);
    }
    Ok(seen)
}

async fn dial(address: &Address) -> Result<Connection> {
    Ok(connect(address, &ConnectOptions::default(), Limits::default()).await?)
}

async fn follow_one(mut connection: Connection) -> ClientTally {
    let mut seen = ClientTally { frames: 0, per_second: 0.0, unusable: 0, error: None };
    let (mut first, mut last) = (None, Instant::now());
    loop {
        let event = match timeout(Duration::from_secs(120), connection.next_event()).await {
            Ok(Ok(Some(event))) => event,
            Ok(Ok(None)) => break,
            Ok(Err(error)) => {
                seen.error = Some(error.to_string());
                break;
            }
            Err(_) => {
                seen.error = Some("nothing came for two minutes".to_owned());
                break;
            }
        };
        match event {
            ClientEvent::Applied(_) => {
                seen.frames += 1;
                last = Instant::now();
                first.get_or_insert(last);
            }
            ClientEvent::HashMismatch { .. } | ClientEvent::Unusable { .. } => seen.unusable += 1,
            _ => {}
        }
    }
    let seconds = first.map_or(0.0, |first| (last - first).as_secs_f64());
    if seconds > 0.0 {
        seen.per_second = (seen.frames - 1) as f64 / seconds;
    }
    seen
}
