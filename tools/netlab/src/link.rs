//! One direction of a network: a queue, a rate, a delay, and random faults.

use std::collections::VecDeque;
use std::sync::Arc;

use psao_proto::Micros;
use serde::Serialize;

use crate::conditions::{Conditions, MAX_REORDER_DELAY, Schedule};
use crate::random::Random;

/// Traffic of one direction, without the headers of any network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Packets sent, retransmissions included.
    pub packets: u64,
    /// Bytes in them.
    pub bytes: u64,
    /// Packets lost in transit.
    pub lost: u64,
    /// Packets dropped because the queue was full.
    pub overflowed: u64,
    /// Packets that arrived twice.
    pub duplicated: u64,
    /// Packets that were held back so that later ones overtook them.
    pub reordered: u64,
}

impl Traffic {
    pub(crate) const fn add(&mut self, other: Self) {
        self.packets += other.packets;
        self.bytes += other.bytes;
        self.lost += other.lost;
        self.overflowed += other.overflowed;
        self.duplicated += other.duplicated;
        self.reordered += other.reordered;
    }
}

/// Outcome of sending a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transit {
    /// It arrives at `at`, and perhaps once more at `duplicate`.
    Arrives { at: Micros, duplicate: Option<Micros> },
    /// It left at `left` and is lost.
    Lost { left: Micros },
}

/// One direction of a network.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    conditions: Conditions,
    schedule: Arc<Schedule>,
    random: Random,
    /// Packets that wait to leave: the time at which each will have left, and its bytes.
    waiting: VecDeque<(Micros, usize)>,
    waiting_bytes: usize,
    /// Time at which the last of them will have left.
    idle_at: Micros,
    counts: Traffic,
    digest: blake3::Hasher,
}

impl Link {
    pub(crate) fn new(conditions: Conditions, schedule: Arc<Schedule>, random: Random) -> Self {
        Self {
            conditions,
            schedule,
            random,
            waiting: VecDeque::new(),
            waiting_bytes: 0,
            idle_at: Micros(0),
            counts: Traffic::default(),
            digest: blake3::Hasher::new(),
        }
    }

    pub(crate) const fn conditions(&self) -> &Conditions {
        &self.conditions
    }

    pub(crate) fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    pub(crate) const fn counts(&self) -> Traffic {
        self.counts
    }

    /// Returns a digest of every packet sent and its time.
    pub(crate) fn digest(&self) -> blake3::Hash {
        self.digest.finalize()
    }

    /// Returns whether a packet of `bytes` bytes fits the queue at `now`.
    pub(crate) fn has_room(&mut self, bytes: usize, now: Micros) -> bool {
        while let Some(&(_, left)) = self.waiting.front().filter(|(at, _)| *at <= now) {
            self.waiting_bytes -= left;
            self.waiting.pop_front();
        }
        self.waiting_bytes + bytes <= self.conditions.queue_bytes as usize
    }

    /// Returns the time at which the next packet leaves the queue.
    pub(crate) fn next_room(&self) -> Option<Micros> {
        self.waiting.front().map(|(left, _)| *left)
    }

    /// Sends a packet and returns its outcome.
    pub(crate) fn send(&mut self, packet: &[u8], now: Micros) -> Transit {
        self.counts.packets += 1;
        self.counts.bytes += packet.len() as u64;
        self.digest.update(&now.0.to_le_bytes());
        self.digest.update(&(packet.len() as u64).to_le_bytes());
        self.digest.update(packet);
        // Every packet takes the same number of draws, so that no packet's outcome changes those after it.
        let Conditions { loss, duplicate, reorder, delay, jitter, .. } = self.conditions;
        let [lost, doubled, held] = [loss, duplicate, reorder].map(|ppm| self.random.happens(ppm));
        let [first, second] = [(); 2].map(|()| delay + self.random.up_to(jitter));
        let held_for = self.random.up_to(MAX_REORDER_DELAY.0);
        if !self.has_room(packet.len(), now) {
            self.counts.overflowed += 1;
            return Transit::Lost { left: now };
        }
        let leaving = self.conditions.serialization_delay(packet.len() as u64);
        let left = self.schedule.finish_time(self.idle_at.max(now), leaving);
        self.idle_at = left;
        if left > now {
            self.waiting.push_back((left, packet.len()));
            self.waiting_bytes += packet.len();
        }
        if lost || self.schedule.blackhole_end(left).is_some() {
            self.counts.lost += 1;
            return Transit::Lost { left };
        }
        self.counts.duplicated += u64::from(doubled);
        self.counts.reordered += u64::from(held);
        let comes = |lasting| self.schedule.finish_time(left, Micros(lasting));
        let at = comes(first + if held { held_for } else { 0 });
        Transit::Arrives { at, duplicate: doubled.then(|| comes(second)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conditions::Fault;

    fn link(conditions: Conditions, faults: &[Fault]) -> Link {
        Link::new(conditions.checked().unwrap(), Arc::new(Schedule::new(faults)), Random::new(1, &[]))
    }

    fn at(transit: Transit) -> u64 {
        match transit {
            Transit::Arrives { at, .. } => at.0,
            Transit::Lost { left } => panic!("lost at {left:?}"),
        }
    }

    #[test]
    fn a_rate_spaces_packets_and_a_full_queue_drops_them() {
        let conditions = Conditions {
            rate: Some(1_000_000),
            queue_bytes: 1500,
            mtu: 500,
            delay: 10,
            ..Conditions::default()
        };
        let mut link = link(conditions, &[]);
        let times = [0, 0, 0].map(|now| at(link.send(&[0; 500], Micros(now))));
        assert_eq!(times, [510, 1010, 1510]);
        assert_eq!(link.send(&[0; 1], Micros(0)), Transit::Lost { left: Micros(0) });
        assert_eq!(link.next_room(), Some(Micros(500)));
        assert_eq!(at(link.send(&[0; 500], Micros(500))), 2010, "the first has left");
        assert_eq!(link.counts(), Traffic { packets: 5, bytes: 2001, overflowed: 1, ..Traffic::default() });
        assert_eq!(at(link.send(&[0; 500], Micros(9000))), 9510, "an idle link is free at once");
    }

    #[test]
    fn shares_are_as_asked_for() {
        let conditions = Conditions {
            loss: 200_000,
            duplicate: 100_000,
            reorder: 50_000,
            jitter: 999,
            ..Conditions::default()
        };
        let mut link = link(conditions, &[]);
        let mut latest = 0;
        for now in 0..10_000 {
            if let Transit::Arrives { at, .. } = link.send(&[1], Micros(now * 1_000_000)) {
                latest = latest.max(at.0 - now * 1_000_000);
            }
        }
        let Traffic { lost, duplicated, reordered, .. } = link.counts();
        assert!((1_850..2_150).contains(&lost), "{lost}");
        assert!(
            (700..900).contains(&duplicated) && (340..460).contains(&reordered),
            "{duplicated} {reordered}"
        );
        assert!(latest <= conditions.longest_delay().0 && latest > MAX_REORDER_DELAY.0 / 2, "{latest}");
    }

    #[test]
    fn stalls_hold_packets_and_blackholes_swallow_them() {
        let faults = [Fault::Stall { from: 100, to: 1_100 }, Fault::Blackhole { from: 5_000, to: 6_000 }];
        let mut link = link(Conditions { delay: 50, ..Conditions::default() }, &faults);
        let times = [0, 60, 100, 500, 1_100].map(|now| at(link.send(&[0; 40], Micros(now))));
        assert_eq!(times, [50, 1_110, 1_150, 1_150, 1_150]);
        assert_eq!(link.send(&[0; 40], Micros(5_500)), Transit::Lost { left: Micros(5_500) });
        assert_eq!(at(link.send(&[0; 40], Micros(6_000))), 6_050);
    }
}
