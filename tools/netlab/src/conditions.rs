//! Conditions and faults of a network.

use psao_proto::Micros;
use serde::Serialize;

use crate::random::MILLION;

/// Properties of one direction of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Conditions {
    /// Lost packets per million.
    pub loss: u32,
    /// Packets per million that arrive twice.
    pub duplicate: u32,
    /// Packets per million that are held back by up to [`MAX_REORDER_DELAY`], so that later ones overtake them.
    pub reorder: u32,
    /// Delay of every packet, in microseconds.
    pub delay: u64,
    /// Largest additional delay, in microseconds, drawn at random for each packet.
    pub jitter: u64,
    /// Bytes that can leave per second; `None` for no limit.
    pub rate: Option<u64>,
    /// Bytes that may wait to leave. A datagram that does not fit is dropped; bytes of a stream wait at the sender.
    pub queue_bytes: u32,
    /// Largest packet in bytes.
    pub mtu: u16,
}

/// Longest time for which a reordered packet is held back: three frames at 60 Hz.
pub const MAX_REORDER_DELAY: Micros = Micros(50_000);
/// Smallest allowed [`Conditions::mtu`] in bytes: the smallest datagram limit that a client may ask for.
pub const MIN_MTU: u16 = psao_proto::session::MIN_DATAGRAM_BYTES;

impl Default for Conditions {
    /// Returns a perfect network: no loss, no delay, no rate limit, packets of 1,200 bytes, a queue of 64 KiB.
    fn default() -> Self {
        let queue_bytes = 64 << 10;
        Self { loss: 0, duplicate: 0, reorder: 0, delay: 0, jitter: 0, rate: None, queue_bytes, mtu: 1200 }
    }
}

/// Why conditions or faults are invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ConditionsError {
    /// A share is above one.
    #[error("{what} of {ppm} in a million packets: a share is at most all of them, 1000000")]
    Share {
        /// Which.
        what: &'static str,
        /// What was asked for.
        ppm: u32,
    },
    /// The rate is zero, so no packet would ever leave.
    #[error("a rate of 0 bytes a second: leave the rate out for a network without a limit")]
    NoRate,
    /// Packets are too small for this protocol's datagrams.
    #[error("packets of {mtu} bytes: the smallest that carry this protocol have {MIN_MTU}")]
    Mtu {
        /// What was asked for.
        mtu: u16,
    },
    /// The queue is smaller than one packet.
    #[error(
        "a queue of {queue_bytes} bytes takes no packet of {mtu}: make it larger, or the packets smaller"
    )]
    Queue {
        /// What was asked for.
        queue_bytes: u32,
        /// Bytes of a packet.
        mtu: u16,
    },
    /// A time is over an hour.
    #[error("{what} of {micros} microseconds: at most an hour makes sense")]
    Time {
        /// Which.
        what: &'static str,
        /// What was asked for.
        micros: u64,
    },
    /// A fault ends before it begins.
    #[error("a fault from {from} to {to} microseconds: it must end after it begins")]
    Fault {
        /// Its start, microseconds.
        from: u64,
        /// Its end, microseconds.
        to: u64,
    },
}

impl Conditions {
    /// Returns the longest time from a packet's departure to its arrival.
    #[must_use]
    pub const fn longest_delay(&self) -> Micros {
        let held = if self.reorder > 0 { MAX_REORDER_DELAY.0 } else { 0 };
        Micros(self.delay + self.jitter + held)
    }

    /// Returns the time that `bytes` take to leave at [`rate`](Self::rate); zero without a limit.
    #[must_use]
    pub fn serialization_delay(&self, bytes: u64) -> Micros {
        Micros(self.rate.map_or(0, |rate| bytes.saturating_mul(1_000_000).div_ceil(rate.max(1))))
    }

    /// Returns the conditions if they are valid.
    ///
    /// # Errors
    /// [`ConditionsError`] names the field that is not.
    pub fn checked(self) -> Result<Self, ConditionsError> {
        for (what, ppm) in [("loss", self.loss), ("duplicates", self.duplicate), ("reordering", self.reorder)]
        {
            if ppm > MILLION {
                return Err(ConditionsError::Share { what, ppm });
            }
        }
        for (what, micros) in [("a delay", self.delay), ("a jitter", self.jitter)] {
            if micros > 3_600_000_000 {
                return Err(ConditionsError::Time { what, micros });
            }
        }
        let Self { mtu, queue_bytes, .. } = self;
        match self {
            Self { rate: Some(0), .. } => Err(ConditionsError::NoRate),
            _ if mtu < MIN_MTU => Err(ConditionsError::Mtu { mtu }),
            _ if queue_bytes < u32::from(mtu) => Err(ConditionsError::Queue { queue_bytes, mtu }),
            _ => Ok(self),
        }
    }
}

/// A failure of both directions of a network at a given time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// Nothing moves and nothing is lost. Packets in transit stand still, others wait to leave.
    Stall {
        /// Its start, microseconds.
        from: u64,
        /// Its end, microseconds.
        to: u64,
    },
    /// Every packet that leaves is lost.
    Blackhole {
        /// Its start, microseconds.
        from: u64,
        /// Its end, microseconds.
        to: u64,
    },
    /// The connection breaks and everything in transit is lost. Both ends learn of it at once.
    Reset {
        /// Its time, microseconds.
        at: u64,
    },
}

impl Fault {
    /// Returns the time from which the network works as before.
    #[must_use]
    pub const fn end(self) -> Micros {
        match self {
            Self::Stall { to, .. } | Self::Blackhole { to, .. } => Micros(to),
            Self::Reset { at } => Micros(at),
        }
    }

    /// Returns the fault if it is valid.
    ///
    /// # Errors
    /// [`ConditionsError::Fault`].
    pub const fn checked(self) -> Result<Self, ConditionsError> {
        match self {
            Self::Stall { from, to } | Self::Blackhole { from, to } if to <= from => {
                Err(ConditionsError::Fault { from, to })
            }
            _ => Ok(self),
        }
    }
}

/// The faults of a network, sorted by start.
#[derive(Clone, Debug, Default)]
pub(crate) struct Schedule {
    stalls: Vec<(u64, u64)>,
    blackholes: Vec<(u64, u64)>,
}

impl Schedule {
    pub(crate) fn new(faults: &[Fault]) -> Self {
        let mut schedule = Self::default();
        for fault in faults {
            match *fault {
                Fault::Stall { from, to } => schedule.stalls.push((from, to)),
                Fault::Blackhole { from, to } => schedule.blackholes.push((from, to)),
                Fault::Reset { .. } => {}
            }
        }
        schedule.stalls.sort_unstable();
        schedule
    }

    /// Returns the time at which something that starts at `start` and takes `lasting` ends. Stalls do not count.
    pub(crate) fn finish_time(&self, start: Micros, lasting: Micros) -> Micros {
        let (mut at, mut left) = (start.0, lasting.0);
        for &(from, to) in &self.stalls {
            if to <= at {
                continue;
            }
            if from > at.saturating_add(left) {
                break;
            }
            left -= from.saturating_sub(at);
            at = to;
        }
        Micros(at.saturating_add(left))
    }

    /// Returns the end of the blackhole that is active at `at`, if there is one: a packet that leaves then is lost.
    pub(crate) fn blackhole_end(&self, at: Micros) -> Option<Micros> {
        let inside = |(from, to): &&(u64, u64)| (*from..*to).contains(&at.0);
        self.blackholes.iter().find(inside).map(|(_, to)| Micros(*to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stands_still_in_a_stall() {
        let faults = [Fault::Stall { from: 300, to: 400 }, Fault::Stall { from: 100, to: 200 }];
        let schedule = Schedule::new(&faults);
        let after = |start, lasting| schedule.finish_time(Micros(start), Micros(lasting)).0;
        assert_eq!([after(0, 99), after(0, 100), after(0, 150), after(50, 0)], [99, 200, 250, 50]);
        assert_eq!([after(100, 0), after(150, 10), after(199, 100), after(199, 101)], [200, 210, 400, 401]);
        assert_eq!([after(0, 250), after(400, 5), after(200, 5), after(250, 60)], [450, 405, 205, 410]);
        // Overlapping stalls act as one.
        let schedule = Schedule::new(&[Fault::Stall { from: 10, to: 30 }, Fault::Stall { from: 20, to: 50 }]);
        assert_eq!(schedule.finish_time(Micros(5), Micros(10)), Micros(55));
    }

    #[test]
    fn conditions_that_make_no_sense_are_refused() {
        let good = Conditions::default();
        assert_eq!(good.checked(), Ok(good));
        for (bad, says) in [
            (Conditions { loss: MILLION + 1, ..good }, "loss"),
            (Conditions { rate: Some(0), ..good }, "rate of 0"),
            (Conditions { mtu: 63, ..good }, "63 bytes"),
            (Conditions { queue_bytes: 1199, ..good }, "queue of 1199"),
            (Conditions { jitter: u64::MAX, ..good }, "an hour"),
        ] {
            let error = bad.checked().unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
        assert!(Fault::Stall { from: 5, to: 5 }.checked().is_err());
        assert!(Fault::Reset { at: 0 }.checked().is_ok());
    }
}
