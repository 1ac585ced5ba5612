//! When recorded frames are due: arithmetic alone, so that a test can be the clock.

use psao_proto::Micros;

/// Keeps a replay to the recorded times. Every frame is timed from the first one, never from the one before, so delays do
/// not add up.
#[derive(Debug)]
pub(crate) struct Pacer {
    rate: f64,
    /// A time on the clock, and the arrival that is due then.
    origin: Option<(Micros, Micros)>,
    /// Arrival of the last frame, and time from the one before to it.
    last: Option<(Micros, Micros)>,
    /// When the first frame of the next round is due.
    resume: Option<Micros>,
}

impl Pacer {
    /// Starts a pacer that plays `rate` times as fast as recorded; above 0.
    pub(crate) fn new(rate: f64) -> Self {
        Self { rate, origin: None, last: None, resume: None }
    }

    /// Returns how long to wait, at the time `now`, before the frame that arrived at `arrival`.
    pub(crate) fn wait(&mut self, now: Micros, arrival: Micros) -> Micros {
        let interval = self.last.map_or(Micros(0), |(last, _)| arrival.since(last));
        self.last = Some((arrival, interval));
        if self.origin.is_none() {
            self.origin = Some((self.resume.take().unwrap_or(now), arrival));
        }
        self.due(arrival).since(now)
    }

    /// Starts again: the next frame is due one frame after the last.
    pub(crate) fn again(&mut self) {
        if let Some((arrival, interval)) = self.last.take() {
            self.resume = Some(self.due(arrival.plus(interval)));
        }
        self.origin = None;
    }

    fn due(&self, arrival: Micros) -> Micros {
        let (time, first) = self.origin.unwrap_or_default();
        time.plus(Micros((arrival.since(first).0 as f64 / self.rate).round() as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Plays frames 60 Hz apart on a clock of its own, each taking the given microseconds to send; returns when each was sent.
    fn play(pacer: &mut Pacer, clock: &mut u64, sending: impl IntoIterator<Item = u64>) -> Vec<u64> {
        let mut sent = Vec::new();
        for (frame, takes) in (0u64..).zip(sending) {
            *clock += pacer.wait(Micros(*clock), Micros(5_000 + frame * 16_667)).0;
            sent.push(*clock);
            *clock += takes;
        }
        sent
    }

    #[test]
    fn frames_go_out_when_they_are_due_however_long_sending_takes() {
        for (rate, interval) in [(1.0, 16_667.0), (4.0, 4_166.75), (0.5, 33_334.0)] {
            let mut clock = 77;
            let work = (0..1000).map(|frame| frame * 7919 % 4_000);
            let sent = play(&mut Pacer::new(rate), &mut clock, work);
            for (frame, sent) in sent.into_iter().enumerate() {
                let due = 77.0 + frame as f64 * interval;
                assert!((sent as f64 - due).abs() <= 1.0, "frame {frame} at {sent}, due at {due}");
            }
        }
    }

    #[test]
    fn a_delay_is_caught_up_with() {
        let mut clock = 0;
        let work = (0..100).map(|frame| if frame == 10 { 200_000 } else { 1_000 });
        let sent = play(&mut Pacer::new(1.0), &mut clock, work);
        // Behind by up to 12 frames, which go out at once; from then on in time again.
        assert_eq!(sent[11], sent[10] + 200_000);
        assert_eq!(sent[12], sent[11] + 1_000);
        for (frame, sent) in sent.iter().enumerate().skip(24) {
            assert_eq!(*sent, frame as u64 * 16_667);
        }
    }

    #[test]
    fn rounds_follow_each_other_without_a_seam() {
        let mut pacer = Pacer::new(2.0);
        let mut clock = 0;
        let mut sent = Vec::new();
        for _ in 0..50 {
            sent.extend(play(&mut pacer, &mut clock, [500; 6]));
            pacer.again();
        }
        for (frame, sent) in sent.iter().enumerate() {
            let due = frame as f64 * 16_667.0 / 2.0;
            // Each round may round once.
            assert!((*sent as f64 - due).abs() <= 50.0, "frame {frame} at {sent}, due at {due}");
        }
    }

    #[test]
    fn arrivals_that_go_back_wait_for_nothing() {
        let mut pacer = Pacer::new(1.0);
        assert_eq!(pacer.wait(Micros(0), Micros(100)), Micros(0));
        assert_eq!(pacer.wait(Micros(1), Micros(50)), Micros(0));
        assert_eq!(pacer.wait(Micros(1), Micros(150)), Micros(49));
    }
}
