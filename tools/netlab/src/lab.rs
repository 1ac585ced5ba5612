//! The lab: a source, a server, clients and the networks between them, in virtual time.

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

/// Why a lab cannot go on. What clients and networks do is never among it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LabError {
    /// Conditions or faults that make no sense.
    #[error(transparent)]
    Conditions(#[from] ConditionsError),
    /// The source does not go on.
    #[error("the source of frames: {0}")]
    Source(String),
    /// A keyframe or patch cannot be made.
    #[error("a body for a client: {0}")]
    Fanout(FanoutError),
}

/// What the whole lab is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Seed of all chance.
    pub seed: u64,
    /// Time from frame to frame, at least a microsecond.
    pub period: Micros,
}

impl Default for Settings {
    /// Seed 1, 60 frames a second.
    fn default() -> Self {
        Self { seed: 1, period: Micros(16_667) }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// The source makes a frame.
    Frame,
    /// A client's connection is open.
    Open(usize),
    /// A client's connection breaks.
    Reset(usize),
}

#[derive(Debug)]
struct Client {
    plan: ClientPlan,
    schedule: Arc<Schedule>,
    connection: Option<Connection>,
    /// Connections so far.
    connections: u32,
    measures: Measures,
    digest: blake3::Hasher,
}

/// A source of frames, one [`Fanout`] and some clients, each behind a network of its own.
///
/// The server gives every client the newest frame once a frame, as `net`'s hub does; sockets take what fits a send buffer;
/// each end is told the time when it asked for that. Everything follows from the plans and the seed.
///
/// ```
/// use psao_netlab::{ClientPlan, Conditions, Lab, Mode, SampleSource, Settings};
/// use psao_proto::{Micros, Profile};
///
/// let bad = Conditions { loss: 50_000, delay: 40_000, ..Conditions::default() }; // 5 %, 40 ms
/// let plans = [Mode::Stream, Mode::Datagram].map(|mode| ClientPlan::symmetric(mode, bad));
/// let source = SampleSource::new(Profile::SURFACE)?;
/// let mut lab = Lab::new(source, Settings::default(), plans.into())?;
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
    settings: Settings,
    fanout: Fanout,
    clients: Vec<Client>,
    queue: Queue<Event>,
    now: Micros,
    /// Hash and capture of every frame made, in order.
    made: Vec<(u32, StateHash, Micros)>,
    ended: bool,
    largest_body: usize,
}

impl<S: Source> Lab<S> {
    /// Creates a lab at time 0, before the first frame.
    ///
    /// # Errors
    /// [`LabError::Conditions`] for plans that make no sense.
    pub fn new(source: S, settings: Settings, plans: Vec<ClientPlan>) -> Result<Self, LabError> {
        let mut queue = Queue::default();
        let mut clients = Vec::new();
        queue.push(Micros(0), Event::Frame);
        for (number, plan) in plans.into_iter().enumerate() {
            let plan = plan.checked()?;
            // A connection is open after a round trip.
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

    /// Lets everything happen up to and including `end`.
    ///
    /// # Errors
    /// [`LabError`] when the source or the codec fails.
    pub fn run_until(&mut self, end: Micros) -> Result<(), LabError> {
        while let Some(now) = self.next().filter(|now| *now <= end) {
            self.now = now;
            for number in 0..self.clients.len() {
                if self.due(number) {
                    self.pump(number);
                }
            }
            let mut framed = false;
            let mut happened = false;
            while let Some((_, event)) = self.queue.pop(now) {
                framed |= event == Event::Frame;
                happened = true;
                self.happen(event)?;
            }
            for number in 0..self.clients.len() {
                if happened {
                    self.pump(number);
                }
                if framed && !self.ended {
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

    /// Returns whether the source has no more frames. The last one is still given to clients that lack it.
    #[must_use]
    pub const fn has_ended(&self) -> bool {
        self.ended
    }

    /// Returns the server's session of a client, while there is one.
    #[must_use]
    pub fn server(&self, client: usize) -> Option<&ServerSession> {
        Some(&self.clients.get(client)?.connection.as_ref()?.server)
    }

    /// Capture of the newest frame that a client has applied.
    #[must_use]
    pub fn newest(&self, client: usize) -> Option<Micros> {
        self.clients.get(client)?.measures.newest()
    }

    /// What has been measured so far.
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

    /// When something happens next.
    fn next(&self) -> Option<Micros> {
        let clients = self.clients.iter().filter_map(|client| client.connection.as_ref()?.next());
        clients.chain(self.queue.next()).min()
    }

    fn due(&self, number: usize) -> bool {
        let next = self.clients[number].connection.as_ref().and_then(Connection::next);
        next.is_some_and(|next| next <= self.now)
    }

    fn happen(&mut self, event: Event) -> Result<(), LabError> {
        match event {
            Event::Frame => self.frame()?,
            Event::Open(number) => self.open(number),
            Event::Reset(number) => self.end(number, None),
        }
        Ok(())
    }

    /// Lets the source make a frame, if it has one, and gives every client the newest.
    fn frame(&mut self) -> Result<(), LabError> {
        self.queue.push(self.now.plus(self.settings.period.max(Micros(1))), Event::Frame);
        let made = self.source.step()?;
        self.ended = made.is_none();
        let Some(state) = self.source.state() else { return Ok(()) };
        if let Some(EncodedFrame { info, body }) = made {
            self.made.push((info.frame.0, info.hash, self.now));
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
            Err(error) => self.end(number, Some(&error)),
        }
    }

    /// A connection is over; the client starts another later.
    fn end(&mut self, number: usize, error: Option<&SessionError>) {
        let client = &mut self.clients[number];
        // Without one it is connecting already.
        let Some(connection) = client.connection.take() else { return };
        client.measures.ends(&connection);
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
            let found = made.binary_search_by_key(&frame, |(number, ..)| *number).ok()?;
            Some((made[found].1, made[found].2))
        };
        let result = connection.pump(now, &mut |client, events| measures.heard(client, events, now, find));
        match result {
            Err(error) => self.end(number, Some(&error)),
            Ok(()) if connection.client.is_closed() || connection.server.is_closed() => {
                self.end(number, None);
            }
            Ok(()) => {}
        }
    }
}
