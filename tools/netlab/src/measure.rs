//! Measurements of clients, and the report of a run.

use std::collections::VecDeque;

use psao_proto::session::{ClientEvent, ClientSession};
use psao_proto::{Micros, StateHash};
use serde::Serialize;

use crate::connection::Connection;
use crate::link::Traffic;
use crate::plan::ClientPlan;

/// Frames between two checks of the full state hash, which takes longer than many frames.
const FULL_HASH_INTERVAL: u64 = 16;

/// Percentiles of the staleness of clients, in microseconds. A sample is the age, counted from its capture, of the
/// newest frame that a client has applied. There is one sample for each client and frame of the source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Staleness {
    /// Median.
    pub p50_us: u64,
    /// 95th percentile.
    pub p95_us: u64,
    /// 99th percentile.
    pub p99_us: u64,
    /// Maximum.
    pub max_us: u64,
}

impl Staleness {
    /// Returns the percentiles of `samples` by nearest rank; zeros without samples.
    pub(crate) fn of(mut samples: Vec<u64>) -> Self {
        samples.sort_unstable();
        let at = |percent: usize| {
            let rank = (samples.len() * percent).div_ceil(100);
            samples.get(rank.saturating_sub(1)).copied().unwrap_or_default()
        };
        Self { p50_us: at(50), p95_us: at(95), p99_us: at(99), max_us: at(100) }
    }
}

/// Measurements of one client.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ClientReport {
    /// Time from the start of its first attempt to connect to its first frame; none without a frame.
    pub first_frame_us: Option<u64>,
    /// Frames applied.
    pub applied: u64,
    /// Frames after which its state differed from the source's. There must be none.
    pub wrong_hashes: u64,
    /// Age of the newest frame that it had applied.
    pub staleness: Staleness,
    /// Longest time between two applied frames.
    pub longest_gap_us: u64,
    /// For each fault, the time from its end until a frame that was captured later is applied.
    pub recoveries_us: Vec<u64>,
    /// Faults after which no such frame was applied.
    pub unrecovered: u64,
    /// Traffic from the server.
    pub down: Traffic,
    /// Traffic to the server.
    pub up: Traffic,
    /// Segments of the connection that were sent again, in both directions.
    pub resent: u64,
    /// Keyframes sent.
    pub keyframes: u64,
    /// Updates sent over the connection, patches among them.
    pub updates: u64,
    /// Frames sent as datagrams.
    pub datagram_frames: u64,
    /// Patches sent, over the connection or as datagrams.
    pub patches: u64,
    /// Number of times that it fell behind.
    pub lags: u64,
    /// Updates and other frames that the server dropped.
    pub dropped: u64,
    /// Keyframes that it requested.
    pub requests: u64,
    /// Keyframes and updates that it could not apply.
    pub unusable: u64,
    /// Bodies that arrived whole in datagrams but too late to apply.
    pub late: u64,
    /// Number of reconnections.
    pub reconnects: u64,
    /// Reconnections after a session that ended with an error.
    pub failures: u64,
    /// The last of these errors.
    pub last_failure: Option<String>,
    /// Largest number of bytes that waited for it at the server.
    pub most_queued_bytes: usize,
}

/// Measurements of a run.
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
    /// Frames after which a client's state differed from the source's.
    pub wrong_hashes: u64,
    /// Staleness over the samples of all clients.
    pub staleness: Staleness,
    /// Measurements of each client, in the order of the plans.
    pub clients: Vec<ClientReport>,
    /// Digest of all packets of all clients with their times, hexadecimal. The same seed gives the same digest.
    pub digest: String,
}

/// Running measurements of a client.
#[derive(Clone, Debug, Default)]
pub(crate) struct Measures {
    joined: Micros,
    pub(crate) report: ClientReport,
    /// Capture time of the newest frame applied.
    newest_applied: Option<Micros>,
    last_applied: Micros,
    pub(crate) samples: Vec<u64>,
    /// Ends of the faults that it did not recover from yet.
    faults: VecDeque<Micros>,
}

impl Measures {
    pub(crate) fn new(plan: &ClientPlan) -> Self {
        let mut faults: Vec<Micros> = plan.faults.iter().map(|fault| fault.end()).collect();
        faults.sort_unstable();
        Self { joined: plan.joins, faults: faults.into(), ..Self::default() }
    }

    /// Records events of the client. `made` returns the source's state hash after a frame, and the frame's capture
    /// time.
    pub(crate) fn record_events(
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
                Some((hash, captured)) if hash == frame.info.hash => self.show(captured, now),
                _ => self.report.wrong_hashes += 1,
            }
        }
        let Some(state) = client.state().filter(|_| any) else { return };
        let expected = state.frame().and_then(|frame| made(frame.0)).map(|(hash, _)| hash);
        let full = self.report.applied.is_multiple_of(FULL_HASH_INTERVAL);
        if Some(state.hash()) != expected || (full && state.full_hash() != state.hash()) {
            self.report.wrong_hashes += 1;
        }
    }

    /// Records that a frame with this capture time is applied at `now`.
    fn show(&mut self, captured: Micros, now: Micros) {
        if self.newest_applied.is_some() {
            self.extend_gap(now);
        } else {
            self.report.first_frame_us = Some(now.since(self.joined).0);
        }
        self.last_applied = now;
        self.newest_applied = self.newest_applied.max(Some(captured));
        while let Some(end) = self.faults.front().filter(|end| **end <= captured) {
            self.report.recoveries_us.push(now.since(*end).0);
            self.faults.pop_front();
        }
    }

    /// Takes a sample of the staleness at `now`.
    pub(crate) fn sample(&mut self, now: Micros) {
        if let Some(captured) = self.newest_applied {
            self.extend_gap(now);
            self.samples.push(now.since(captured).0);
        }
    }

    fn extend_gap(&mut self, now: Micros) {
        self.report.longest_gap_us = self.report.longest_gap_us.max(now.since(self.last_applied).0);
    }

    /// Returns the capture time of the newest frame that the client has applied.
    pub(crate) const fn newest(&self) -> Option<Micros> {
        self.newest_applied
    }

    /// Returns the report, including the counts of the open connection.
    pub(crate) fn report(&self, open: Option<&Connection>) -> ClientReport {
        let mut measures = self.clone();
        if let Some(connection) = open {
            measures.add_connection(connection);
        }
        measures.report.unrecovered = self.faults.len() as u64;
        measures.report.staleness = Staleness::of(measures.samples);
        measures.report
    }

    /// Adds the counts of a connection.
    pub(crate) fn add_connection(&mut self, connection: &Connection) {
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
