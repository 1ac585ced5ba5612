//! Frames in flight to a client, and congestion control of those that go as datagrams.
//!
//! Nothing below datagrams slows them down when a network carries less than it is given, and each lost frame makes the
//! next one larger. So there is a window, as in TCP, but loss alone does not shrink it. It grows with every
//! acknowledgement. It shrinks when acknowledgements take much longer than the fastest one, because a queue has built
//! up (LEDBAT, RFC 6817, with its target). It also shrinks when several frames in a row are lost. Frames of many
//! datagrams go over the connection, because one of their datagrams is likely to be lost.

use std::collections::VecDeque;

use crate::message::Ack;
use crate::{FrameIndex, Micros, StateHash};

/// Largest number of frames whose hashes are kept for acknowledgements.
const MAX_FRAMES_KEPT: usize = 256;
/// Queueing delay of acknowledgements, in microseconds, that the window aims at (RFC 6817, section 2.5).
const QUEUE_TARGET_US: u64 = 100_000;
/// Microseconds beyond two round trips after which an acknowledgement is overdue.
const ACK_PATIENCE_US: u64 = 100_000;
/// Largest number of consecutive lost frames that counts as chance.
const MAX_CONSECUTIVE_LOSSES: u32 = 6;
/// Round-trip time, in microseconds, until one is measured.
const INITIAL_RTT_US: u64 = 150_000;
/// Largest number of datagrams of a frame. At a loss of 5 %, two of three frames of eight datagrams arrive whole; at 20
/// %, one of six.
const MAX_DATAGRAMS_PER_FRAME: usize = 8;
/// Time for which updates go over the connection before datagrams are tried again.
const CONNECTION_PERIOD: Micros = Micros::from_secs(5);
/// Frames that may be in flight whatever the window.
const MIN_FRAMES_IN_FLIGHT: usize = 4;
/// Largest size of the window in bytes.
const MAX_WINDOW_BYTES: u64 = 16 << 20;

/// A frame that is in flight or waits.
#[derive(Clone, Copy, Debug)]
struct SentFrame {
    frame: FrameIndex,
    hash: StateHash,
    at: Micros,
    /// Its bytes; 0 if its delay is no measure of the network.
    bytes: u64,
    /// Whether it was sent as datagrams.
    datagrams: bool,
}

impl SentFrame {
    const fn in_datagrams(&self) -> u64 {
        if self.datagrams { self.bytes } else { 0 }
    }
}

/// Route of a frame to a client that takes datagrams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Route {
    /// Datagrams only.
    Datagrams,
    /// Datagrams and the connection, because acknowledgements are overdue.
    Both,
    /// The connection, also for the next frames, because this one needs too many datagrams.
    Connection,
}

/// The frames in flight to one client.
#[derive(Clone, Debug, Default)]
pub(super) struct Flight {
    sent: VecDeque<SentFrame>,
    /// Newest frame that the client is known to hold.
    acked: Option<FrameIndex>,
    /// Newest frame that was sent over both routes.
    carried: Option<FrameIndex>,
    /// Time until which updates go over the connection.
    large_until: Micros,
    /// Bytes in flight as datagrams.
    outstanding: u64,
    /// Limit of these bytes. [`MIN_FRAMES_IN_FLIGHT`] frames are always allowed.
    window: u64,
    /// Whether the window has shrunk before. It then grows by only one frame per round trip.
    careful: bool,
    /// Smoothed and shortest delay of acknowledgements, in microseconds. The shortest slowly decays.
    round_trip: Option<(u64, u64)>,
    /// Time at which the last acknowledgement arrived, was given up, or was first expected.
    news: Micros,
    /// Time at which the window last shrank.
    shrunk: Micros,
}

impl Flight {
    /// Returns the number of unacknowledged frames.
    pub(super) fn len(&self) -> usize {
        self.sent.len()
    }

    /// Returns the newest frame that the client is known to hold.
    pub(super) const fn acked(&self) -> Option<FrameIndex> {
        self.acked
    }

    /// Forgets all frames in flight.
    pub(super) fn clear(&mut self) {
        self.sent.clear();
        (self.acked, self.carried, self.outstanding) = (None, None, 0);
    }

    /// Forgets the frames after `last`, which were not sent after all.
    pub(super) fn forget_after(&mut self, last: Option<FrameIndex>) {
        self.sent.retain(|sent| last.is_some_and(|last| sent.frame <= last));
        self.outstanding = self.sent.iter().map(SentFrame::in_datagrams).sum();
    }

    /// Records a frame of `bytes` bytes that was sent at `at`, as `datagrams` or over the connection.
    pub(super) fn expect(
        &mut self,
        (frame, hash): (FrameIndex, StateHash),
        at: Micros,
        bytes: u64,
        datagrams: bool,
    ) {
        if self.sent.is_empty() {
            self.news = at;
        }
        if self.sent.len() >= MAX_FRAMES_KEPT
            && let Some(oldest) = self.sent.pop_front()
        {
            self.outstanding = self.outstanding.saturating_sub(oldest.in_datagrams());
        }
        let sent = SentFrame { frame, hash, at, bytes, datagrams };
        self.outstanding += sent.in_datagrams();
        self.sent.push_back(sent);
    }

    /// Processes an acknowledgement. Returns whether its hash is the frame's.
    pub(super) fn acknowledge(&mut self, ack: &Ack, now: Micros) -> bool {
        let mut passed = 0;
        while let Some(&sent) = self.sent.front().filter(|sent| sent.frame <= ack.frame) {
            self.sent.pop_front();
            self.outstanding = self.outstanding.saturating_sub(sent.in_datagrams());
            passed += u32::from(sent.in_datagrams() > 0);
            if sent.frame == ack.frame {
                if sent.hash != ack.hash {
                    return false;
                }
                self.acked = self.acked.max(Some(sent.frame));
                self.news = now;
                if passed > MAX_CONSECUTIVE_LOSSES {
                    self.shrink(2, now);
                }
                self.took(&sent, now);
            }
        }
        true
    }

    /// Returns whether another frame may be sent as datagrams.
    pub(super) fn has_room(&self, now: Micros) -> bool {
        let few = || self.sent.iter().filter(|sent| sent.in_datagrams() > 0).count() < MIN_FRAMES_IN_FLIGHT;
        self.outstanding < self.window || few() || self.is_overdue(now)
    }

    /// Returns whether updates go over the connection for a while, because the last ones were too large for datagrams.
    pub(super) fn is_large(&self, now: Micros) -> bool {
        now < self.large_until
    }

    /// Returns the route of the next frame. `free` tells that no bytes wait for the connection.
    pub(super) fn choose(&mut self, frame: FrameIndex, datagrams: usize, free: bool, now: Micros) -> Route {
        if datagrams > MAX_DATAGRAMS_PER_FRAME {
            self.large_until = now.plus(CONNECTION_PERIOD);
            return Route::Connection;
        }
        if !self.is_overdue(now) {
            return Route::Datagrams;
        }
        self.news = now;
        self.outstanding = 0;
        self.sent.iter_mut().for_each(|sent| sent.bytes = 0);
        self.shrink(2, now);
        if !free || self.waits() {
            return Route::Datagrams;
        }
        self.carried = Some(frame);
        Route::Both
    }

    /// Returns whether a frame sent over both routes is not acknowledged.
    fn waits(&self) -> bool {
        self.carried > self.acked
    }

    fn is_overdue(&self, now: Micros) -> bool {
        let (smoothed, _) = self.round_trip.unwrap_or((INITIAL_RTT_US, INITIAL_RTT_US));
        !self.sent.is_empty() && now.since(self.news).0 > ACK_PATIENCE_US + 2 * smoothed
    }

    /// Updates delays and window for a frame that was acknowledged now.
    fn took(&mut self, sent: &SentFrame, now: Micros) {
        let SentFrame { at, bytes, datagrams, .. } = *sent;
        if bytes == 0 {
            return;
        }
        let lasted = now.since(at).0;
        let (smoothed, fastest) = self.round_trip.unwrap_or((lasted, lasted));
        // The shortest delay decays, so that a longer route does not count as a queue forever.
        let fastest = lasted.min(fastest + lasted.saturating_sub(fastest) / 1024);
        let queued = lasted.saturating_sub(fastest);
        // A frame over the connection may have waited for retransmissions, but a short delay is still a valid sample.
        if datagrams || queued < QUEUE_TARGET_US {
            // A stall does not predict the next frame's delay.
            let counted = lasted.min(fastest + 2 * QUEUE_TARGET_US);
            self.round_trip = Some(((7 * smoothed + counted) / 8, fastest));
        }
        if queued > QUEUE_TARGET_US && datagrams {
            self.shrink(4, now);
        } else if queued < QUEUE_TARGET_US / 2 {
            let growth =
                if self.careful { bytes.saturating_mul(bytes) / self.window.max(bytes) } else { bytes };
            self.window = (self.window + growth).min(MAX_WINDOW_BYTES);
        }
    }

    /// Shrinks the window by one part in `part`, at most once per round trip: earlier frames do not reflect the change.
    fn shrink(&mut self, part: u64, now: Micros) {
        let (smoothed, _) = self.round_trip.unwrap_or_default();
        if !self.careful || now.since(self.shrunk).0 > smoothed {
            (self.careful, self.shrunk) = (true, now);
            self.window -= self.window / part;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: u64 = 16_667;

    fn ack(frame: u32) -> Ack {
        Ack { frame: FrameIndex(frame), hash: StateHash(frame.into()) }
    }

    /// Frames of 1,000 B to a network on which acknowledgements take `trip(frame)`, none where that is nothing; how
    /// many went as datagrams, and both ways.
    fn fly(flight: &mut Flight, frames: u32, trip: impl Fn(u32) -> Option<u64>) -> (u32, u32) {
        let (mut went, mut both) = (0, 0);
        let mut coming = Vec::new();
        for frame in 1..=frames {
            let now = u64::from(frame) * FRAME;
            coming.retain(|&(at, frame)| {
                if at <= now {
                    assert!(flight.acknowledge(&ack(frame), Micros(at)));
                }
                at > now
            });
            if !flight.has_room(Micros(now)) {
                continue;
            }
            let way = flight.choose(FrameIndex(frame), 1, true, Micros(now));
            (went, both) = (went + 1, both + u32::from(way == Route::Both));
            let sent = (FrameIndex(frame), StateHash(frame.into()));
            flight.expect(sent, Micros(now), 1000, true);
            coming.extend(trip(frame).map(|trip| (now + trip, frame)));
        }
        (went, both)
    }

    #[test]
    fn a_wide_network_takes_every_frame_also_when_some_are_lost() {
        assert_eq!(
            fly(&mut Flight::default(), 600, |_| Some(80_000)),
            (598, 0),
            "but while the window opens"
        );
        let (went, both) = fly(&mut Flight::default(), 600, |frame| (frame % 3 > 0).then_some(80_000));
        assert!(went > 560 && both == 0, "{went} {both}");
    }

    #[test]
    fn a_queue_slows_datagrams_down() {
        // Every frame beyond the fourth that is on its way makes acknowledgements 50 ms slower.
        let mut flight = Flight { round_trip: Some((80_000, 80_000)), ..Flight::default() };
        let mut most = 0;
        for frame in 1..600_u32 {
            let now = u64::from(frame) * FRAME;
            most = most.max(flight.sent.len());
            let due = flight.sent.front().is_some_and(|sent| {
                let queued = (flight.sent.len() as u64).saturating_sub(4) * 50_000;
                sent.at.0 + 80_000 + queued <= now
            });
            if due {
                let first = flight.sent[0].frame.0;
                flight.acknowledge(&ack(first), Micros(now));
            }
            if flight.has_room(Micros(now)) {
                flight.expect((FrameIndex(frame), StateHash(frame.into())), Micros(now), 1000, true);
            }
        }
        assert!((4..=9).contains(&most), "{most} frames on their way");
    }

    #[test]
    fn without_acknowledgements_little_goes_and_one_frame_both_ways() {
        let mut flight = Flight::default();
        let (went, both) = fly(&mut flight, 600, |_| None);
        assert!(went <= 100 && both == 1, "{went} {both}");
        // Once they come again, it is as before.
        flight.clear();
        let (went, both) = fly(&mut flight, 600, |_| Some(80_000));
        assert!(went > 300 && both == 0, "{went} {both}");
    }

    #[test]
    fn frames_of_many_datagrams_leave_the_way_to_the_connection_for_a_while() {
        let mut flight = Flight::default();
        assert_eq!(flight.choose(FrameIndex(1), MAX_DATAGRAMS_PER_FRAME, true, Micros(7)), Route::Datagrams);
        assert!(!flight.is_large(Micros(7)));
        assert_eq!(
            flight.choose(FrameIndex(1), MAX_DATAGRAMS_PER_FRAME + 1, true, Micros(7)),
            Route::Connection
        );
        assert!(flight.is_large(Micros(7)) && !flight.is_large(Micros(7).plus(CONNECTION_PERIOD)));
    }

    #[test]
    fn another_hash_is_noticed() {
        let mut flight = Flight::default();
        flight.expect((FrameIndex(3), StateHash(3)), Micros(0), 10, true);
        let wrong = Ack { frame: FrameIndex(3), hash: StateHash(4) };
        assert!(!flight.acknowledge(&wrong, Micros(5)));
        assert!(flight.acknowledge(&wrong, Micros(6)), "it is not waited for any more");
        assert_eq!((flight.acked(), flight.len(), flight.outstanding), (None, 0, 0));
    }
}
