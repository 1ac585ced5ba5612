//! A connection: both ends, and the network between them.

use std::sync::Arc;

use psao_proto::session::{Access, ClientEvent, ClientOptions, ClientSession, ServerSession, SessionError};
use psao_proto::{Limits, Micros, SceneTable};

use crate::conditions::Schedule;
use crate::direction::Direction;
use crate::link::{Link, Traffic};
use crate::plan::{ClientPlan, Mode};
use crate::random::Random;

/// An open connection.
#[derive(Debug)]
pub(crate) struct Connection {
    pub(crate) server: ServerSession,
    pub(crate) client: ClientSession,
    down: Direction,
    up: Direction,
}

impl Connection {
    /// Opens a connection at `now`. Seed and name select its random numbers; each connection has a name of its own.
    pub(crate) fn new(
        scene: &Arc<SceneTable>,
        plan: &ClientPlan,
        schedule: &Arc<Schedule>,
        (seed, name): (u64, [u32; 2]),
        now: Micros,
    ) -> Result<Self, SessionError> {
        let direction = |there, back: Micros, number: u32| {
            let [client, connection] = name;
            let random = Random::new(seed, &[client, connection, number]);
            Direction::new(Link::new(there, Arc::clone(schedule), random), back)
        };
        let datagrams = match plan.mode {
            Mode::Stream => None,
            Mode::Datagram => Some(plan.down.mtu),
        };
        let options = ClientOptions::default().with_datagrams(datagrams);
        let mut connection = Self {
            server: ServerSession::new(scene.clone(), Access::Open, plan.limits),
            client: ClientSession::with(Limits::default(), options),
            down: direction(plan.down, plan.up.longest_delay(), 0),
            up: direction(plan.up, plan.down.longest_delay(), 1),
        };
        connection.server.tick(now)?;
        connection.client.tick(now)?;
        Ok(connection)
    }

    /// Returns the time of the next event.
    pub(crate) fn next_event_time(&self) -> Option<Micros> {
        let ends = [self.server.next_deadline(), self.client.next_deadline()];
        [self.down.next_event_time(), self.up.next_event_time()].into_iter().chain(ends).flatten().min()
    }

    /// Processes all events that are due at `now`, and calls `on_events` with those of the client.
    ///
    /// # Errors
    /// The error with which either end ended the session.
    pub(crate) fn pump(
        &mut self,
        now: Micros,
        on_events: &mut dyn FnMut(&ClientSession, &[ClientEvent]),
    ) -> Result<(), SessionError> {
        let due = |deadline: Option<Micros>| deadline.is_some_and(|deadline| deadline <= now);
        loop {
            let bytes = self.up.receive(now);
            if !bytes.is_empty() {
                self.server.handle(&bytes, now)?;
            }
            while let Some(datagram) = self.up.receive_datagram(now) {
                self.server.handle_datagram(&datagram, now);
            }
            let bytes = self.down.receive(now);
            if !bytes.is_empty() {
                let events = self.client.handle(&bytes, now)?;
                on_events(&self.client, &events);
            }
            while let Some(datagram) = self.down.receive_datagram(now) {
                let events = self.client.handle_datagram(&datagram, now);
                on_events(&self.client, &events);
            }
            if due(self.server.next_deadline()) {
                self.server.tick(now)?;
            }
            if due(self.client.next_deadline()) {
                self.client.tick(now)?;
            }
            if !self.send(now) {
                return Ok(());
            }
        }
    }

    /// Passes the output of both ends to the network, as far as it takes it. Returns whether anything was passed on.
    fn send(&mut self, now: Micros) -> bool {
        let mut sent = false;
        loop {
            let count = self.down.write(self.server.output());
            if count == 0 {
                break;
            }
            self.server.advance(count);
            sent = true;
        }
        loop {
            let count = self.up.write(self.client.output());
            if count == 0 {
                break;
            }
            self.client.advance(count);
            sent = true;
        }
        while let Some(datagram) = self.server.take_datagram() {
            self.down.send_datagram(datagram, now);
            sent = true;
        }
        while let Some(datagram) = self.client.take_datagram() {
            self.up.send_datagram(datagram, now);
            sent = true;
        }
        sent
    }

    /// Returns the traffic down and up.
    pub(crate) fn counts(&self) -> [Traffic; 2] {
        [self.down.counts(), self.up.counts()]
    }

    /// Returns the number of segments that were sent again, in both directions.
    pub(crate) const fn resent(&self) -> u64 {
        self.down.resent() + self.up.resent()
    }

    /// Adds the digests of both directions to `hasher`.
    pub(crate) fn digest(&self, hasher: &mut blake3::Hasher) {
        hasher.update(self.down.digest().as_bytes());
        hasher.update(self.up.digest().as_bytes());
    }
}
