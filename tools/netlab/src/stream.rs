//! A pipe for bytes, reliable and in order, as TCP makes one of packets that are neither.
//!
//! Bytes are cut into segments. One that is lost is sent again, and what came behind it waits for it at the receiver. What
//! the writer may hand over is bounded by the send buffer, which keeps every byte until the receiver has it: that is what
//! makes a sender wait for a slow network.
//!
//! It sends as fast as the line takes, as if it knew the line's rate from the start: nothing is lost to a full queue, and
//! loss does not slow it down, as it would TCP. Acknowledgements are never lost, only delayed. Both are in its favour.

use std::collections::{BTreeMap, VecDeque};

use psao_proto::Micros;

use crate::conditions::Schedule;
use crate::link::{Link, Passage};
use crate::queue::Queue;

/// Bytes that a sender's buffer holds.
pub const SEND_BUFFER: usize = 256 << 10;
/// Shortest time after which a segment that was not acknowledged is sent again.
pub const LEAST_TIMEOUT: Micros = Micros(200_000);
/// Longest (RFC 6298, 2.5).
pub const MOST_TIMEOUT: Micros = Micros(60_000_000);
/// Later segments that have come by when one counts as lost, before its time is over (RFC 6675, `DupThresh`).
const OVERTAKEN: u8 = 3;

#[derive(Clone, Debug)]
struct Segment {
    bytes: Vec<u8>,
    /// How often it was sent again.
    again: u32,
    /// The last one sent was lost.
    lost: bool,
    /// Segments sent later that came before it.
    overtaken: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// A segment comes, named by its first byte.
    Comes(u64),
    /// It is sent again, unless it was since: so often it had been.
    Again(u64, u32),
    /// The sender learns that the receiver has everything before this byte.
    Acknowledged(u64),
}

/// Bytes on their way in one direction.
#[derive(Clone, Debug)]
pub(crate) struct StreamPipe {
    /// How long an acknowledgement is on the way.
    back: Micros,
    events: Queue<Event>,
    unsent: VecDeque<u8>,
    /// Sent and not acknowledged, by first byte.
    sent: BTreeMap<u64, Segment>,
    /// First byte not sent yet.
    next_byte: u64,
    /// First byte that the sender does not know to have come.
    acknowledged: u64,
    /// First byte that the receiver lacks.
    lacking: u64,
    /// Segments that came before their turn.
    early: BTreeMap<u64, Vec<u8>>,
    resent: u64,
}

/// How long a sender waits for an acknowledgement: 200 ms, or two round trips if that is longer, and twice as long for every
/// time that the same bytes were lost before.
#[must_use]
pub fn timeout(round_trip: Micros, again: u32) -> Micros {
    let first = LEAST_TIMEOUT.0.max(round_trip.0.saturating_mul(2));
    Micros(first.saturating_mul(1 << again.min(32)).min(MOST_TIMEOUT.0.max(first)))
}

impl StreamPipe {
    pub(crate) fn new(back: Micros) -> Self {
        Self {
            back,
            events: Queue::default(),
            unsent: VecDeque::new(),
            sent: BTreeMap::new(),
            next_byte: 0,
            acknowledged: 0,
            lacking: 0,
            early: BTreeMap::new(),
            resent: 0,
        }
    }

    /// Takes as many of the bytes as fit the send buffer; they go with the next [`receive`](Self::receive).
    pub(crate) fn write(&mut self, bytes: &[u8]) -> usize {
        let held = self.unsent.len() + (self.next_byte - self.acknowledged) as usize;
        let taken = bytes.len().min(SEND_BUFFER.saturating_sub(held));
        self.unsent.extend(&bytes[..taken]);
        taken
    }

    /// Lets everything happen up to now; the bytes that came, in order.
    pub(crate) fn receive(&mut self, link: &mut Link, now: Micros) -> Vec<u8> {
        let mut out = Vec::new();
        while let Some((at, event)) = self.events.pop(now) {
            // What should have gone before goes before.
            self.send(link, at);
            match event {
                Event::Comes(first) => self.comes(link.schedule(), first, at, &mut out),
                Event::Again(first, again) => self.again(link, first, again, at),
                Event::Acknowledged(end) => {
                    self.acknowledged = end;
                    self.sent = self.sent.split_off(&end);
                }
            }
        }
        self.send(link, now);
        out
    }

    /// When something happens next.
    pub(crate) fn next(&self, link: &Link) -> Option<Micros> {
        let room = link.next_room().filter(|_| !self.unsent.is_empty());
        [self.events.next(), room].into_iter().flatten().min()
    }

    /// Segments sent again.
    pub(crate) const fn resent(&self) -> u64 {
        self.resent
    }

    /// Sends what the line's queue takes.
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
            self.sent.insert(first, Segment { bytes, again: 0, lost: false, overtaken: 0 });
            self.transmit(link, first, now);
        }
    }

    fn transmit(&mut self, link: &mut Link, first: u64, now: Micros) {
        let round_trip = link.conditions().longest_delay().plus(self.back);
        let Some(segment) = self.sent.get_mut(&first) else { return };
        let passage = link.send(&segment.bytes, now);
        segment.lost = matches!(passage, Passage::Lost { .. });
        segment.overtaken = 0;
        match passage {
            Passage::Lost { left } => {
                let at = left.plus(timeout(round_trip, segment.again));
                self.events.push(at, Event::Again(first, segment.again));
            }
            Passage::Comes { at, again } => {
                for at in again.into_iter().chain([at]) {
                    self.events.push(at, Event::Comes(first));
                }
            }
        }
    }

    /// Sends a segment again, if it is not here and was not sent again since.
    fn again(&mut self, link: &mut Link, first: u64, again: u32, now: Micros) {
        let Some(segment) = self.sent.get_mut(&first).filter(|segment| segment.again == again) else {
            return;
        };
        if let Some(room) = link.next_room().filter(|_| !link.has_room(segment.bytes.len(), now)) {
            self.events.push(room, Event::Again(first, again));
            return;
        }
        segment.again += 1;
        self.resent += 1;
        self.transmit(link, first, now);
    }

    fn comes(&mut self, schedule: &Schedule, first: u64, now: Micros, out: &mut Vec<u8>) {
        if first < self.lacking || self.early.contains_key(&first) {
            return; // It came twice.
        }
        let Some(segment) = self.sent.get(&first) else { return };
        self.early.insert(first, segment.bytes.clone());
        let before = self.lacking;
        while let Some(bytes) = self.early.remove(&self.lacking) {
            self.lacking += bytes.len() as u64;
            out.extend(bytes);
        }
        // When the sender learns what the receiver tells it now.
        let told = schedule.after(schedule.swallows(now).unwrap_or(now), self.back);
        if self.lacking > before {
            self.events.push(told, Event::Acknowledged(self.lacking));
        }
        // Lost ones that enough later ones have overtaken are sent again at once; what is lost a second time waits for
        // its timeout.
        for (&missing, segment) in self.sent.range_mut(self.lacking.min(first)..first) {
            segment.overtaken = segment.overtaken.saturating_add(1);
            if segment.lost && segment.again == 0 && segment.overtaken == OVERTAKEN {
                self.events.push(told, Event::Again(missing, 0));
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

    /// Writes all of it as the pipe takes it; what came, and when the last of it did.
    fn carry(pipe: &mut Direction, bytes: &[u8]) -> (Vec<u8>, Micros) {
        let (mut written, mut came, mut now) = (0, Vec::new(), Micros(0));
        loop {
            written += pipe.write(&bytes[written..]);
            came.extend(pipe.receive(now));
            let Some(next) = pipe.next().filter(|_| came.len() < bytes.len()) else { return (came, now) };
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
        let all = vec![7; SEND_BUFFER + 5000];
        assert_eq!(pipe.write(&all), SEND_BUFFER);
        assert_eq!((pipe.write(&all), pipe.receive(Micros(0)).len()), (0, 0));
        assert_eq!(pipe.receive(Micros(10_000)).len(), SEND_BUFFER);
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
        // The first segment leaves into a blackhole, the others behind it.
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
        while let Some(next) = pipe.next() {
            let bytes = pipe.receive(next);
            came.extend((!bytes.is_empty()).then_some((next, bytes.len())));
        }
        // The third that came behind it was sent at 60 and told at 80,060; it then takes 40 ms.
        assert_eq!((came, pipe.resent()), (vec![(Micros(120_060), 400)], 1));
    }

    #[test]
    fn timeouts_double_up_to_a_minute() {
        let times = [0, 1, 2, 20].map(|again| timeout(Micros(150_000), again).0);
        assert_eq!(times, [300_000, 600_000, 1_200_000, 60_000_000]);
        assert_eq!(timeout(Micros(80_000), 0), LEAST_TIMEOUT);
    }
}
