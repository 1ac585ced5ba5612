//! The lab: a source of frames, a server, clients and the networks between them, in virtual time.

use std::sync::Arc;

use psao_codec::envelope::EncodedFrame;
use psao_proto::message::CloseCode;
use psao_proto::session::{ServerSession, SessionError};
use psao_proto::{Delivery, Fanout, FanoutError, Micros, StateHash};

use crate::conditions::{ConditionsError, Fault, Schedule};
use crate::connection::Connection;
use crate::measure::{Measures, Report, Staleness};
use crate::plan::ClientPlan;
use crate::queue::Queue;
use crate::source::Source;

/// Why a lab cannot go on. Clients and networks never cause it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LabError {
    /// Conditions or faults are invalid.
    #[error(transparent)]
    Conditions(#[from] ConditionsError),
    /// The source failed.
    #[error("the source of frames: {0}")]
    Source(String),
    /// A keyframe or patch could not be encoded.
    #[error("a body for a client: {0}")]
    Fanout(FanoutError),
}

/// Settings of a lab.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LabSettings {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Time between two frames of the source, at least a microsecond.
    pub period: Micros,
}

impl Default for LabSettings {
    /// Returns seed 1 and 60 frames per second.
    fn default() -> Self {
        Self { seed: 1, period: Micros(16_667) }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// The source makes a frame.
    Frame,
    /// A client's connection opens.
    Open(usize),
    /// A client's connection breaks.
    Reset(usize),
}

/// A frame that the source has made.
#[derive(Clone, Copy, Debug)]
struct SourceFrame {
    number: u32,
    /// State hash after it.
    hash: StateHash,
    captured: Micros,
}

#[derive(Debug)]
struct Client {
    plan: ClientPlan,
    schedule: Arc<Schedule>,
    connection: Option<Connection>,
    /// Number of connections so far.
    connections: u32,
    measures: Measures,
    digest: blake3::Hasher,
}

/// A source of frames, one [`Fanout`] and several clients, each behind a network of its own.
///
/// At every frame of the source the server gives each client the newest frame, as `psao_proto::net::Hub` does. A
/// connection takes the bytes that fit its send buffer. Each session gets the time at its deadlines. Plans and seed
/// determine the run.
///
/// ```
/// use psao_netlab::{ClientPlan, Conditions, Lab, LabSettings, Mode, SampleSource};
/// use psao_proto::{Micros, Profile};
///
/// let bad = Conditions { loss: 50_000, delay: 40_000, ..Conditions::default() }; // 5 %, 40 ms
/// let plans = [Mode::Stream, Mode::Datagram].map(|mode| ClientPlan::symmetric(mode, bad));
/// let source = SampleSource::new(Profile::SURFACE)?;
/// let mut lab = Lab::new(source, LabSettings::default(), plans.into())?;
/// lab.run_until(Micros::from_secs(10))?;
/// let report = lab.report();
/// let [stream, datagram] = &report.clients[..] else { panic!("two clients") };
/// assert!(datagram.staleness.p99_us < stream.staleness.p99_us);
/// assert_eq!(report.wrong_hashes, 0);
/// # Ok::<(), psao_netlab::LabError>(())
/// ```
#[derive(Debug)]
pub struct Lab<S> {
    source: S,
    settings: LabSettings,
    fanout: Fanout,
    clients: Vec<Client>,
    queue: Queue<Event>,
    now: Micros,
    /// Every frame of the source, in order.
    made: Vec<SourceFrame>,
    ended: bool,
    largest_body: usize,
}

impl<S: Source> Lab<S> {
    /// Creates a lab at time 0, before the first frame.
    ///
    /// # Errors
    /// [`LabError::Conditions`] for invalid plans.
    pub fn new(source: S, settings: LabSettings, plans: Vec<ClientPlan>) -> Result<Self, LabError> {
        let mut queue = Queue::default();
        let mut clients = Vec::new();
        queue.push(Micros(0), Event::Frame);
        for (number, plan) in plans.into_iter().enumerate() {
            let plan = plan.checked()?;
            // A connection takes a round trip to open.
            queue.push(plan.joins.plus(plan.round_trip()), Event::Open(number));
            for fault in &plan.faults {
                if let Fault::Reset { at } = fault {
                    queue.push(Micros(*at), Event::Reset(number));
                }
            }
            let schedule = Arc::new(Schedule::new(&plan.faults));
            let (measures, digest) = (Measures::new(&plan), blake3::Hasher::new());
            clients.push(Client { plan, schedule, connection: None, connections: 0, measures, digest });
        }
        let fanout = Fanout::new(source.coder());
        let (now, made) = (Micros(0), Vec::new());
        Ok(Self { source, settings, fanout, clients, queue, now, made, ended: false, largest_body: 0 })
    }

    /// Runs up to and including `end`.
    ///
    /// # Errors
    /// [`LabError`] when the source or the codec fails.
    pub fn run_until(&mut self, end: Micros) -> Result<(), LabError> {
        while let Some(now) = self.next_event_time().filter(|now| *now <= end) {
            self.now = now;
            for number in 0..self.clients.len() {
                if self.is_due(number) {
                    self.pump(number);
                }
            }
            let mut has_frame = false;
            let mut has_event = false;
            while let Some((_, event)) = self.queue.pop(now) {
                has_frame |= event == Event::Frame;
                has_event = true;
                self.handle(event)?;
            }
            for number in 0..self.clients.len() {
                if has_event {
                    self.pump(number);
                }
                if has_frame && !self.ended {
                    self.clients[number].measures.sample(now);
                }
            }
        }
        self.now = self.now.max(end);
        Ok(())
    }

    /// Returns the time of the lab.
    #[must_use]
    pub const fn now(&self) -> Micros {
        self.now
    }

    /// Returns the source.
    #[must_use]
    pub const fn source(&self) -> &S {
        &self.source
    }

    /// Returns whether the source has ended. Clients that lack the last frame still get it.
    #[must_use]
    pub const fn has_ended(&self) -> bool {
        self.ended
    }

    /// Returns the server's session of a client; `None` while the client is not connected.
    #[must_use]
    pub fn server(&self, client: usize) -> Option<&ServerSession> {
        Some(&self.clients.get(client)?.connection.as_ref()?.server)
    }

    /// Returns the capture time of the newest frame that a client has applied.
    #[must_use]
    pub fn newest(&self, client: usize) -> Option<Micros> {
        self.clients.get(client)?.measures.newest()
    }

    /// Returns the measurements so far.
    #[must_use]
    pub fn report(&self) -> Report {
        let mut digest = blake3::Hasher::new();
        for client in &self.clients {
            let mut own = client.digest.clone();
            if let Some(connection) = &client.connection {
                connection.digest(&mut own);
            }
            digest.update(own.finalize().as_bytes());
        }
        let reports = self.clients.iter().map(|client| client.measures.report(client.connection.as_ref()));
        let clients: Vec<_> = reports.collect();
        let samples =
            self.clients.iter().flat_map(|client| client.measures.samples.iter().copied()).collect();
        Report {
            frames: self.made.len() as u32,
            time_us: self.now.0,
            largest_body_bytes: self.largest_body,
            applied: clients.iter().map(|client| client.applied).sum(),
            wrong_hashes: clients.iter().map(|client| client.wrong_hashes).sum(),
            staleness: Staleness::of(samples),
            clients,
            digest: digest.finalize().to_hex().to_string(),
        }
    }

    /// Returns the time of the next event.
    fn next_event_time(&self) -> Option<Micros> {
        let clients = self.clients.iter().filter_map(|client| client.connection.as_ref()?.next_event_time());
        clients.chain(self.queue.next_event_time()).min()
    }

    fn is_due(&self, number: usize) -> bool {
        let next = self.clients[number].connection.as_ref().and_then(Connection::next_event_time);
        next.is_some_and(|next| next <= self.now)
    }

    fn handle(&mut self, event: Event) -> Result<(), LabError> {
        match event {
            Event::Frame => self.frame()?,
            Event::Open(number) => self.open(number),
            Event::Reset(number) => self.end_connection(number, None),
        }
        Ok(())
    }

    /// Takes a frame from the source, if it has one, and gives every client the newest frame.
    fn frame(&mut self) -> Result<(), LabError> {
        self.queue.push(self.now.plus(self.settings.period.max(Micros(1))), Event::Frame);
        let made = self.source.step()?;
        self.ended = made.is_none();
        let Some(state) = self.source.state() else { return Ok(()) };
        if let Some(EncodedFrame { info, body }) = made {
            self.made.push(SourceFrame { number: info.frame.0, hash: info.hash, captured: self.now });
            self.largest_body = self.largest_body.max(body.len());
            self.fanout.advance(&info, body, state, self.now);
        }
        for client in &mut self.clients {
            let Some(connection) = &mut client.connection else { continue };
            let report = &mut client.measures.report;
            match self.fanout.give(&mut connection.server, state) {
                Ok(offer) => report.patches += u64::from(offer == Delivery::Patch),
                Err(FanoutError::Send(error)) => {
                    connection.server.close(CloseCode::FAILED, &error.to_string());
                }
                Err(error) => return Err(LabError::Fanout(error)),
            }
            report.most_queued_bytes = report.most_queued_bytes.max(connection.server.queued_bytes());
        }
        Ok(())
    }

    fn open(&mut self, number: usize) {
        let client = &mut self.clients[number];
        let name = [number as u32, client.connections];
        client.connections += 1;
        let seed = (self.settings.seed, name);
        match Connection::new(self.source.scene(), &client.plan, &client.schedule, seed, self.now) {
            Ok(connection) => client.connection = Some(connection),
            Err(error) => self.end_connection(number, Some(&error)),
        }
    }

    /// Ends a connection. The client connects again later.
    fn end_connection(&mut self, number: usize, error: Option<&SessionError>) {
        let client = &mut self.clients[number];
        // A client without a connection is connecting already.
        let Some(connection) = client.connection.take() else { return };
        client.measures.add_connection(&connection);
        connection.digest(&mut client.digest);
        let report = &mut client.measures.report;
        report.reconnects += 1;
        if let Some(error) = error {
            report.failures += 1;
            report.last_failure = Some(error.to_string());
        }
        let open = self.now.plus(client.plan.reconnect).plus(client.plan.round_trip());
        self.queue.push(open, Event::Open(number));
    }

    fn pump(&mut self, number: usize) {
        let (now, made) = (self.now, &self.made);
        let client = &mut self.clients[number];
        let Some(connection) = &mut client.connection else { return };
        let measures = &mut client.measures;
        let find = |frame: u32| {
            let SourceFrame { hash, captured, .. } =
                made[made.binary_search_by_key(&frame, |made| made.number).ok()?];
            Some((hash, captured))
        };
        let result =
            connection.pump(now, &mut |client, events| measures.record_events(client, events, now, find));
        match result {
            Err(error) => self.end_connection(number, Some(&error)),
            Ok(()) if connection.client.is_closed() || connection.server.is_closed() => {
                self.end_connection(number, None);
            }
            Ok(()) => {}
        }
    }
}
