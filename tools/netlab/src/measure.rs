//! What is measured of a client, and what is made of it for people and programs.

use std::collections::VecDeque;

use psao_proto::session::{ClientEvent, ClientSession};
use psao_proto::{Micros, StateHash};
use serde::Serialize;

use crate::connection::Connection;
use crate::link::Traffic;
use crate::plan::ClientPlan;

/// A hash computed from scratch is compared every so many frames: it takes as long as many of them.
const FULL_HASH_EVERY: u64 = 16;

/// How old what a client shows is, in microseconds: at the end of every frame of the source, the age of the newest frame
/// that the client has applied, counted from its capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Staleness {
    /// Half of the samples are at most this.
    pub p50_us: u64,
    /// 95 % are.
    pub p95_us: u64,
    /// 99 % are.
    pub p99_us: u64,
    /// All are.
    pub max_us: u64,
}

impl Staleness {
    /// Of these samples (nearest rank); zeros when there are none.
    pub(crate) fn of(mut samples: Vec<u64>) -> Self {
        samples.sort_unstable();
        let at = |percent: usize| {
            let rank = (samples.len() * percent).div_ceil(100);
            samples.get(rank.saturating_sub(1)).copied().unwrap_or_default()
        };
        Self { p50_us: at(50), p95_us: at(95), p99_us: at(99), max_us: at(100) }
    }
}

/// What became of one client.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ClientReport {
    /// From when it started to connect until it had a frame; none if it never had.
    pub first_frame_us: Option<u64>,
    /// Frames applied.
    pub applied: u64,
    /// Frames applied whose state was not the source's of that number. There must be none.
    pub wrong_hashes: u64,
    /// How old what it shows was.
    pub staleness: Staleness,
    /// Longest time from one frame applied to the next.
    pub longest_gap_us: u64,
    /// For each fault: from its end until a frame captured after that was applied.
    pub recoveries_us: Vec<u64>,
    /// Faults that no such frame followed.
    pub unrecovered: u64,
    /// From the server.
    pub down: Traffic,
    /// To the server.
    pub up: Traffic,
    /// Segments of streams that were sent again, both ways.
    pub resent: u64,
    /// Keyframes sent.
    pub keyframes: u64,
    /// Updates sent over the connection, patches among them.
    pub updates: u64,
    /// Frames sent as datagrams.
    pub datagram_frames: u64,
    /// Times that it was brought to the newest frame by a patch, either way.
    pub patches: u64,
    /// Times that it fell behind.
    pub lags: u64,
    /// Updates and other frames that were dropped at the server.
    pub dropped: u64,
    /// Keyframes that it asked for.
    pub requests: u64,
    /// Keyframes and updates that it could not apply.
    pub unusable: u64,
    /// Bodies that came whole in datagrams and were of no use any more.
    pub late: u64,
    /// Times that it connected again.
    pub reconnects: u64,
    /// Of those, because a session ended with an error.
    pub failures: u64,
    /// The last of these errors.
    pub last_failure: Option<String>,
    /// Most bytes that waited for it at the server.
    pub most_queued_bytes: usize,
}

/// What became of all of them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Frames that the source made.
    pub frames: u32,
    /// Virtual time that passed.
    pub time_us: u64,
    /// Bytes of the largest keyframe or update that the source made.
    pub largest_body_bytes: usize,
    /// Frames applied by all clients.
    pub applied: u64,
    /// Wrong ones among them.
    pub wrong_hashes: u64,
    /// Over all samples of all clients.
    pub staleness: Staleness,
    /// Every client, by number.
    pub clients: Vec<ClientReport>,
    /// A digest of all packets of all clients with their times, hexadecimal: same seed, same digest.
    pub digest: String,
}

/// What is measured while the lab runs.
#[derive(Clone, Debug, Default)]
pub(crate) struct Measures {
    joined: Micros,
    pub(crate) report: ClientReport,
    /// Capture of the newest frame applied.
    shows: Option<Micros>,
    last_applied: Micros,
    pub(crate) samples: Vec<u64>,
    /// Ends of the faults that it has not recovered from.
    faults: VecDeque<Micros>,
}

impl Measures {
    pub(crate) fn new(plan: &ClientPlan) -> Self {
        let mut faults: Vec<Micros> = plan.faults.iter().map(|fault| fault.end()).collect();
        faults.sort_unstable();
        Self { joined: plan.joins, faults: faults.into(), ..Self::default() }
    }

    /// What the client met. `made` says what the source's state was at a frame, and when.
    pub(crate) fn heard(
        &mut self,
        client: &ClientSession,
        events: &[ClientEvent],
        now: Micros,
        made: impl Fn(u32) -> Option<(StateHash, Micros)>,
    ) {
        let mut any = false;
        for event in events {
            let ClientEvent::Applied(frame) = event else { continue };
            any = true;
            self.report.applied += 1;
            match made(frame.info.frame.0) {
                Some((hash, captured)) if hash == frame.info.hash => self.shows(captured, now),
                _ => self.report.wrong_hashes += 1,
            }
        }
        let Some(state) = client.state().filter(|_| any) else { return };
        let expected = state.frame().and_then(|frame| made(frame.0)).map(|(hash, _)| hash);
        let full = self.report.applied.is_multiple_of(FULL_HASH_EVERY);
        if Some(state.hash()) != expected || (full && state.full_hash() != state.hash()) {
            self.report.wrong_hashes += 1;
        }
    }

    /// A frame that was captured then is shown from now on.
    fn shows(&mut self, captured: Micros, now: Micros) {
        if self.shows.is_some() {
            self.gap(now);
        } else {
            self.report.first_frame_us = Some(now.since(self.joined).0);
        }
        self.last_applied = now;
        self.shows = self.shows.max(Some(captured));
        while let Some(end) = self.faults.front().filter(|end| **end <= captured) {
            self.report.recoveries_us.push(now.since(*end).0);
            self.faults.pop_front();
        }
    }

    /// Takes a sample at the end of a frame.
    pub(crate) fn sample(&mut self, now: Micros) {
        if let Some(captured) = self.shows {
            self.gap(now);
            self.samples.push(now.since(captured).0);
        }
    }

    fn gap(&mut self, now: Micros) {
        self.report.longest_gap_us = self.report.longest_gap_us.max(now.since(self.last_applied).0);
    }

    /// Records that the newest frame that the client shows was captured then.
    pub(crate) const fn newest(&self) -> Option<Micros> {
        self.shows
    }

    /// Returns the report, with that of an open connection.
    pub(crate) fn report(&self, open: Option<&Connection>) -> ClientReport {
        let mut measures = self.clone();
        if let Some(connection) = open {
            measures.ends(connection);
        }
        measures.report.unrecovered = self.faults.len() as u64;
        measures.report.staleness = Staleness::of(measures.samples);
        measures.report
    }

    /// Adds what a connection has counted.
    pub(crate) fn ends(&mut self, connection: &Connection) {
        let (server, client) = (connection.server.stats(), connection.client.stats());
        let report = &mut self.report;
        let [down, up] = connection.counts();
        report.down.add(down);
        report.up.add(up);
        report.resent += connection.resent();
        report.keyframes += server.keyframes;
        report.updates += server.updates;
        report.datagram_frames += server.datagram_frames;
        report.lags += server.lags;
        report.dropped += server.dropped;
        report.requests += client.requests;
        report.unusable += client.unusable;
        report.late += client.late_datagram_frames;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_by_nearest_rank() {
        let of = |samples: Vec<u64>| {
            let Staleness { p50_us, p95_us, p99_us, max_us } = Staleness::of(samples);
            [p50_us, p95_us, p99_us, max_us]
        };
        assert_eq!(of(vec![]), [0; 4]);
        assert_eq!(of(vec![7]), [7; 4]);
        assert_eq!(of((1..=200).rev().collect()), [100, 190, 198, 200]);
        assert_eq!(of(vec![1, 2, 3]), [2, 3, 3, 3]);
    }
}
