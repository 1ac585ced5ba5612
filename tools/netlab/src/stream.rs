//! A reliable, ordered pipe for bytes over packets that are neither, as TCP is.
//!
//! The sender cuts bytes into segments and sends a lost segment again. Segments behind it wait at the receiver. The
//! send buffer keeps every byte until the receiver has it, and is bounded. A full buffer makes the writer wait for a
//! slow network.
//!
//! The pipe performs better than TCP in two ways. It sends at the link's rate from the start, so no packet overflows
//! the queue and loss does not slow it down. Its acknowledgements are delayed but never lost.

use std::collections::{BTreeMap, VecDeque};

use psao_proto::Micros;

use crate::conditions::Schedule;
use crate::link::{Link, Transit};
use crate::queue::Queue;

/// Capacity of a sender's buffer in bytes.
pub const SEND_BUFFER_BYTES: usize = 256 << 10;
/// Shortest time after which an unacknowledged segment is sent again.
pub const MIN_TIMEOUT: Micros = Micros(200_000);
/// Longest time after which an unacknowledged segment is sent again (RFC 6298, 2.5).
pub const MAX_TIMEOUT: Micros = Micros(60_000_000);
/// Number of later segments whose arrival marks a segment as lost before its timeout (RFC 6675, `DupThresh`).
const DUPLICATE_THRESHOLD: u8 = 3;

#[derive(Clone, Debug)]
struct Segment {
    bytes: Vec<u8>,
    /// Number of retransmissions.
    resends: u32,
    /// Whether the last transmission was lost.
    lost: bool,
    /// Number of later segments that arrived before it.
    overtaken: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// The segment with this first byte arrives.
    Arrival(u64),
    /// The segment with this first byte is sent again, if it still has this number of retransmissions.
    Resend(u64, u32),
    /// The sender learns that the receiver has all bytes before this one.
    Ack(u64),
}

/// Bytes in transit in one direction.
#[derive(Clone, Debug)]
pub(crate) struct StreamPipe {
    /// Delay of an acknowledgement.
    ack_delay: Micros,
    events: Queue<Event>,
    unsent: VecDeque<u8>,
    /// Segments sent and not acknowledged, by first byte.
    sent: BTreeMap<u64, Segment>,
    /// First byte that was not sent yet.
    next_byte: u64,
    /// First byte without an acknowledgement at the sender.
    first_unacked: u64,
    /// First byte that the receiver lacks.
    next_expected: u64,
    /// Segments that arrived out of order, by first byte.
    early: BTreeMap<u64, Vec<u8>>,
    resent: u64,
}

/// Returns how long a sender waits for an acknowledgement: two round trips, but at least [`MIN_TIMEOUT`]. The time
/// doubles with each of the `resends` of the same bytes, up to [`MAX_TIMEOUT`].
#[must_use]
pub fn retransmission_timeout(round_trip: Micros, resends: u32) -> Micros {
    let first = MIN_TIMEOUT.0.max(round_trip.0.saturating_mul(2));
    Micros(first.saturating_mul(1 << resends.min(32)).min(MAX_TIMEOUT.0.max(first)))
}

impl StreamPipe {
    pub(crate) fn new(ack_delay: Micros) -> Self {
        Self {
            ack_delay,
            events: Queue::default(),
            unsent: VecDeque::new(),
            sent: BTreeMap::new(),
            next_byte: 0,
            first_unacked: 0,
            next_expected: 0,
            early: BTreeMap::new(),
            resent: 0,
        }
    }

    /// Takes the bytes that fit the send buffer and returns their number. The next [`receive`](Self::receive) sends
    /// them.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> usize {
        let buffered = self.unsent.len() + (self.next_byte - self.first_unacked) as usize;
        let taken = bytes.len().min(SEND_BUFFER_BYTES.saturating_sub(buffered));
        self.unsent.extend(&bytes[..taken]);
        taken
    }

    /// Advances to `now` and returns the bytes that have arrived, in order.
    pub(crate) fn receive(&mut self, link: &mut Link, now: Micros) -> Vec<u8> {
        let mut out = Vec::new();
        while let Some((at, event)) = self.events.pop(now) {
            // Bytes that fit the link's queue before this event leave before it.
            self.send(link, at);
            match event {
                Event::Arrival(first) => self.arrive(link.schedule(), first, at, &mut out),
                Event::Resend(first, resends) => self.resend(link, first, resends, at),
                Event::Ack(end) => {
                    self.first_unacked = end;
                    self.sent = self.sent.split_off(&end);
                }
            }
        }
        self.send(link, now);
        out
    }

    /// Returns the time of the next event.
    pub(crate) fn next_event_time(&self, link: &Link) -> Option<Micros> {
        let room = link.next_room().filter(|_| !self.unsent.is_empty());
        [self.events.next_event_time(), room].into_iter().flatten().min()
    }

    /// Returns the number of segments that were sent again.
    pub(crate) const fn resent(&self) -> u64 {
        self.resent
    }

    /// Sends what fits the link's queue.
    fn send(&mut self, link: &mut Link, now: Micros) {
        let most = usize::from(link.conditions().mtu);
        while !self.unsent.is_empty() {
            let count = self.unsent.len().min(most);
            if !link.has_room(count, now) {
                return;
            }
            let bytes = self.unsent.drain(..count).collect();
            let first = self.next_byte;
            self.next_byte += count as u64;
            self.sent.insert(first, Segment { bytes, resends: 0, lost: false, overtaken: 0 });
            self.transmit(link, first, now);
        }
    }

    fn transmit(&mut self, link: &mut Link, first: u64, now: Micros) {
        let round_trip = link.conditions().longest_delay().plus(self.ack_delay);
        let Some(segment) = self.sent.get_mut(&first) else { return };
        let transit = link.send(&segment.bytes, now);
        segment.lost = matches!(transit, Transit::Lost { .. });
        segment.overtaken = 0;
        match transit {
            Transit::Lost { left } => {
                let at = left.plus(retransmission_timeout(round_trip, segment.resends));
                self.events.push(at, Event::Resend(first, segment.resends));
            }
            Transit::Arrives { at, duplicate } => {
                for at in duplicate.into_iter().chain([at]) {
                    self.events.push(at, Event::Arrival(first));
                }
            }
        }
    }

    /// Sends a segment again, if it is unacknowledged and still has this number of retransmissions.
    fn resend(&mut self, link: &mut Link, first: u64, resends: u32, now: Micros) {
        let Some(segment) = self.sent.get_mut(&first).filter(|segment| segment.resends == resends) else {
            return;
        };
        if let Some(room) = link.next_room().filter(|_| !link.has_room(segment.bytes.len(), now)) {
            self.events.push(room, Event::Resend(first, resends));
            return;
        }
        segment.resends += 1;
        self.resent += 1;
        self.transmit(link, first, now);
    }

    fn arrive(&mut self, schedule: &Schedule, first: u64, now: Micros, out: &mut Vec<u8>) {
        if first < self.next_expected || self.early.contains_key(&first) {
            return; // A duplicate.
        }
        let Some(segment) = self.sent.get(&first) else { return };
        self.early.insert(first, segment.bytes.clone());
        let before = self.next_expected;
        while let Some(bytes) = self.early.remove(&self.next_expected) {
            self.next_expected += bytes.len() as u64;
            out.extend(bytes);
        }
        // The time at which the sender gets the acknowledgement that the receiver sends now.
        let acked_at = schedule.finish_time(schedule.blackhole_end(now).unwrap_or(now), self.ack_delay);
        if self.next_expected > before {
            self.events.push(acked_at, Event::Ack(self.next_expected));
        }
        // A lost segment that enough later ones have overtaken is sent again at once. One that is lost a second time
        // waits for its timeout.
        for (&missing, segment) in self.sent.range_mut(self.next_expected.min(first)..first) {
            segment.overtaken = segment.overtaken.saturating_add(1);
            if segment.lost && segment.resends == 0 && segment.overtaken == DUPLICATE_THRESHOLD {
                self.events.push(acked_at, Event::Resend(missing, 0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;

    use super::*;
    use crate::conditions::{Conditions, Fault};
    use crate::direction::Direction;
    use crate::random::Random;

    fn pipe(conditions: Conditions, faults: &[Fault], seed: u64) -> Direction {
        let link =
            Link::new(conditions.checked().unwrap(), Arc::new(Schedule::new(faults)), Random::new(seed, &[]));
        Direction::new(link, Micros(conditions.delay))
    }

    /// Writes all bytes as the pipe takes them. Returns the bytes that arrived and the time of the last arrival.
    fn carry(pipe: &mut Direction, bytes: &[u8]) -> (Vec<u8>, Micros) {
        let (mut written, mut came, mut now) = (0, Vec::new(), Micros(0));
        loop {
            written += pipe.write(&bytes[written..]);
            came.extend(pipe.receive(now));
            let Some(next) = pipe.next_event_time().filter(|_| came.len() < bytes.len()) else {
                return (came, now);
            };
            assert!(next >= now);
            now = next;
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn every_byte_comes_once_and_in_order(
            bytes in prop::collection::vec(any::<u8>(), 0..20_000),
            loss in 0_u32..400_000, duplicate in 0_u32..300_000, reorder in 0_u32..300_000,
            (delay, jitter) in (0_u64..100_000, 0_u64..50_000),
            rate in prop::option::of(10_000_u64..1_000_000), mtu in 64_u16..1500,
            (from, lasting) in (0_u64..500_000, 1_u64..500_000), seed: u64,
        ) {
            let conditions =
                Conditions { loss, duplicate, reorder, delay, jitter, rate, mtu, queue_bytes: 3000 };
            let faults = [
                Fault::Stall { from, to: from + lasting },
                Fault::Blackhole { from: from / 2, to: from / 2 + lasting },
            ];
            let (came, _) = carry(&mut pipe(conditions, &faults, seed), &bytes);
            prop_assert!(came == bytes, "{} of {} bytes", came.len(), bytes.len());
        }
    }

    #[test]
    fn the_send_buffer_is_bounded_and_frees_when_acknowledged() {
        let mut pipe = pipe(Conditions { delay: 10_000, ..Conditions::default() }, &[], 1);
        let all = vec![7; SEND_BUFFER_BYTES + 5000];
        assert_eq!(pipe.write(&all), SEND_BUFFER_BYTES);
        assert_eq!((pipe.write(&all), pipe.receive(Micros(0)).len()), (0, 0));
        assert_eq!(pipe.receive(Micros(10_000)).len(), SEND_BUFFER_BYTES);
        assert_eq!(pipe.write(&all[..5000]), 0, "the sender has not heard of it");
        pipe.receive(Micros(20_000));
        assert_eq!(pipe.write(&all[..5000]), 5000);
    }

    #[test]
    fn a_rate_is_kept_without_loss() {
        let conditions =
            Conditions { rate: Some(100_000), queue_bytes: 2400, delay: 5_000, ..Conditions::default() };
        let mut pipe = pipe(conditions, &[], 1);
        let (came, at) = carry(&mut pipe, &[1; 50_000]);
        assert_eq!((came.len(), at, pipe.counts().overflowed), (50_000, Micros(505_000), 0));
    }

    #[test]
    fn what_is_lost_holds_up_what_is_behind_until_it_is_sent_again() {
        // The first segment leaves during the blackhole, the others after it.
        let faults = [Fault::Blackhole { from: 0, to: 10 }];
        let conditions = Conditions { delay: 40_000, mtu: 100, ..Conditions::default() };
        let mut alone = pipe(conditions, &faults, 1);
        assert_eq!(carry(&mut alone, &[1; 100]).1, Micros(240_000), "after the timeout");
        let mut pipe = pipe(conditions, &faults, 1);
        let mut came = Vec::new();
        for number in 0..4_u64 {
            pipe.write(&[number as u8; 100]);
            pipe.receive(Micros(number * 20));
        }
        while let Some(next) = pipe.next_event_time() {
            let bytes = pipe.receive(next);
            came.extend((!bytes.is_empty()).then_some((next, bytes.len())));
        }
        // The third segment behind it leaves at 60 and is acknowledged at 80,060; the retransmission then takes 40 ms.
        assert_eq!((came, pipe.resent()), (vec![(Micros(120_060), 400)], 1));
    }

    #[test]
    fn timeouts_double_up_to_a_minute() {
        let times = [0, 1, 2, 20].map(|resends| retransmission_timeout(Micros(150_000), resends).0);
        assert_eq!(times, [300_000, 600_000, 1_200_000, 60_000_000]);
        assert_eq!(retransmission_timeout(Micros(80_000), 0), MIN_TIMEOUT);
    }
}
