//! How old frames are when a client has them.

use psao_proto::Micros;
use psao_proto::session::{AppliedFrame, ClientEvent, ClientSession};
use serde::Serialize;

/// Collects the times of frames.
#[derive(Default)]
pub(crate) struct Latencies {
    /// From the scene as the frame has it to the frame applied.
    whole: Vec<i64>,
    /// From the scene as the frame has it to the frame given to the connection.
    server: Vec<i64>,
    /// From there to the last byte received.
    network: Vec<i64>,
    /// From there to the frame applied.
    apply: Vec<i64>,
}

/// Percentiles in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Percentiles {
    p50: f64,
    p95: f64,
    p99: f64,
    max: f64,
}

/// The stages of a frame's way, in order, the whole of it last.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Summary {
    server_ms: Percentiles,
    network_ms: Percentiles,
    apply_ms: Percentiles,
    whole_ms: Percentiles,
    /// By how much the server's clock may be off, in milliseconds.
    uncertainty_ms: f64,
}

impl Latencies {
    /// Takes the times of a frame, if the event is of one; `applied` is the time after it, by the session's clock.
    pub(crate) fn take(&mut self, session: &ClientSession, event: &ClientEvent, applied: Micros) {
        let ClientEvent::Applied(AppliedFrame { received, stamp: Some(stamp), .. }) = event else { return };
        let Some(clock) = session.clock() else { return };
        self.whole.push(clock.elapsed(stamp.captured, applied));
        self.server.push(i64::try_from(stamp.sent.since(stamp.captured).0).unwrap_or(i64::MAX));
        self.network.push(clock.elapsed(stamp.sent, *received));
        self.apply.push(i64::try_from(applied.since(*received).0).unwrap_or(i64::MAX));
    }

    /// Returns the percentiles; `None` without a frame whose times are known.
    pub(crate) fn summary(&self, session: &ClientSession) -> Option<Summary> {
        let of = |times: &[i64]| Percentiles::of(times);
        Some(Summary {
            server_ms: of(&self.server)?,
            network_ms: of(&self.network)?,
            apply_ms: of(&self.apply)?,
            whole_ms: of(&self.whole)?,
            uncertainty_ms: session.clock()?.round_trip.0 as f64 / 2e3,
        })
    }
}

impl Percentiles {
    /// Returns the percentiles by nearest rank of times in microseconds.
    fn of(times: &[i64]) -> Option<Self> {
        let mut sorted = times.to_vec();
        sorted.sort_unstable();
        let at = |percent: usize| {
            let rank = (sorted.len() * percent).div_ceil(100).max(1);
            sorted.get(rank - 1).map(|time| *time as f64 / 1e3)
        };
        Some(Self { p50: at(50)?, p95: at(95)?, p99: at(99)?, max: at(100)? })
    }
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "latency, ms             p50      p95      p99      max")?;
        for (name, row) in [
            ("scene to sent", self.server_ms),
            ("sent to received", self.network_ms),
            ("received to applied", self.apply_ms),
            ("scene to applied", self.whole_ms),
        ] {
            let Percentiles { p50, p95, p99, max } = row;
            writeln!(f, "{name:<19} {p50:>8.2} {p95:>8.2} {p99:>8.2} {max:>8.2}")?;
        }
        write!(f, "the server's clock is known to {:.2} ms", self.uncertainty_ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_of_the_nearest_rank() {
        assert_eq!(Percentiles::of(&[]), None);
        let one = Percentiles::of(&[2_500]).unwrap();
        assert_eq!((one.p50, one.p99, one.max), (2.5, 2.5, 2.5));
        let times: Vec<i64> = (1..=200).rev().map(|time| time * 1_000).collect();
        let all = Percentiles::of(&times).unwrap();
        assert_eq!((all.p50, all.p95, all.p99, all.max), (100.0, 190.0, 198.0, 200.0));
    }
}
