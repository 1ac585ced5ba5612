//! The offset of the other end's clock, estimated from PINGs and their PONGs.

use std::collections::VecDeque;

use crate::Micros;
use crate::message::Pong;

/// Number of answers behind an estimate. The one with the shortest round trip is the most exact.
const KEPT: usize = 8;

/// Estimate of the other end's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockEstimate {
    /// Time of the other end minus time of this end, in microseconds.
    pub offset: i64,
    /// Round-trip time of a PING and its PONG. The error of the offset is at most half of it.
    pub round_trip: Micros,
}

impl ClockEstimate {
    /// Returns the microseconds from `theirs`, by the other end's clock, to `ours`, by this end's clock. The result is
    /// negative when the estimate's error exceeds the time that passed.
    #[must_use]
    pub const fn elapsed(&self, theirs: Micros, ours: Micros) -> i64 {
        (ours.0 as i64).wrapping_add(self.offset).wrapping_sub(theirs.0 as i64)
    }
}

/// Collects PONGs.
#[derive(Clone, Debug, Default)]
pub(super) struct Clock {
    answers: VecDeque<ClockEstimate>,
}

impl Clock {
    /// Takes a PONG that arrived at `now`. An impossible one is dropped.
    pub(super) fn take(&mut self, pong: &Pong, now: Micros) {
        let (Some(away), Some(there)) =
            (now.0.checked_sub(pong.sent.0), pong.replied.0.checked_sub(pong.received.0))
        else {
            return;
        };
        let Some(round_trip) = away.checked_sub(there) else { return };
        // The mean of the clock differences at the PING's arrival and at the PONG's departure (RFC 5905, section 8).
        let ahead = |theirs: Micros, ours: Micros| i128::from(theirs.0) - i128::from(ours.0);
        let offset = (ahead(pong.received, pong.sent) + ahead(pong.replied, now)) / 2;
        let Ok(offset) = i64::try_from(offset) else { return };
        if self.answers.len() == KEPT {
            self.answers.pop_front();
        }
        self.answers.push_back(ClockEstimate { offset, round_trip: Micros(round_trip) });
    }

    /// Returns the best estimate of the last PONGs.
    pub(super) fn estimate(&self) -> Option<ClockEstimate> {
        self.answers.iter().min_by_key(|answer| answer.round_trip).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the PONG of a clock that is `ahead`, with the given delays in both directions.
    fn answer(clock: &mut Clock, sent: u64, ahead: i64, there: u64, back: u64) {
        let theirs = |ours: u64| Micros((ours as i64 + ahead) as u64);
        let received = sent + there;
        let pong = Pong { sent: Micros(sent), received: theirs(received), replied: theirs(received + 50) };
        clock.take(&pong, Micros(received + 50 + back));
    }

    #[test]
    fn the_offset_is_found_to_half_the_round_trip() {
        for ahead in [0, 5_000_000, -700_000] {
            let mut clock = Clock::default();
            assert_eq!(clock.estimate(), None);
            answer(&mut clock, 1_000_000, ahead, 90_000, 10_000);
            assert_eq!(clock.estimate().unwrap().round_trip, Micros(100_000));
            assert_eq!((clock.estimate().unwrap().offset - ahead).abs(), 40_000);
            answer(&mut clock, 2_000_000, ahead, 3_000, 1_000);
            let best = clock.estimate().unwrap();
            assert_eq!((best.round_trip, best.offset - ahead), (Micros(4_000), 1_000));
            assert_eq!(best.elapsed(Micros((3_000_000 + ahead) as u64), Micros(3_000_500)), 1_500);
            for turn in 0..KEPT as u64 {
                answer(&mut clock, 4_000_000 + turn, ahead, 20_000, 20_000);
            }
            assert_eq!(clock.estimate().unwrap().round_trip, Micros(40_000), "old answers are forgotten");
        }
    }

    #[test]
    fn answers_that_cannot_be_are_forgotten() {
        let mut clock = Clock::default();
        let pong = |sent, received, replied| Pong {
            sent: Micros(sent),
            received: Micros(received),
            replied: Micros(replied),
        };
        for bad in [pong(11, 0, 0), pong(0, 5, 4), pong(9, 0, 5), pong(0, u64::MAX, u64::MAX)] {
            clock.take(&bad, Micros(10));
        }
        assert_eq!(clock.estimate(), None);
    }
}
