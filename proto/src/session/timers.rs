//! Deadlines of a session: handshake, keep-alive, silence, stall.

use super::SessionError;
use crate::{Limits, Micros};

/// Times of past events, by the clock of the session's caller.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timers {
    now: Micros,
    /// The first time that was set.
    started: Option<Micros>,
    /// Time at which bytes last arrived.
    last_received: Micros,
    /// Time at which bytes were last sent, or began to wait.
    last_progress: Micros,
    /// Time of the last PING that was due.
    last_ping: Micros,
}

/// Result of a check of deadlines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Due {
    Nothing,
    Ping,
}

impl Timers {
    /// Returns the newest time that was set.
    pub(super) const fn now(&self) -> Micros {
        self.now
    }

    /// Sets the time. It never goes back.
    pub(super) fn set_now(&mut self, now: Micros) {
        self.now = self.now.max(now);
        if self.started.is_none() {
            (self.started, self.last_received, self.last_progress, self.last_ping) =
                (Some(self.now), self.now, self.now, self.now);
        }
    }

    /// Records that bytes arrived from the other end.
    pub(super) const fn note_received(&mut self) {
        self.last_received = self.now;
    }

    /// Records that bytes were sent to the other end, or that the first of them began to wait.
    pub(super) const fn note_progress(&mut self) {
        self.last_progress = self.now;
    }

    /// Checks the deadline of the handshake.
    pub(super) fn handshake(&self, limits: &Limits) -> Result<(), SessionError> {
        let waited = self.now.since(self.started.unwrap_or(self.now));
        if waited > limits.handshake { Err(SessionError::HandshakeTimeout { waited }) } else { Ok(()) }
    }

    /// Checks the deadlines after the handshake, and returns what is due. `waiting` tells whether bytes wait, `stalls`
    /// whether it is an error if none of them are sent.
    pub(super) fn open(&mut self, limits: &Limits, waiting: bool, stalls: bool) -> Result<Due, SessionError> {
        let waited = self.now.since(self.last_received);
        if waited > limits.silence {
            return Err(SessionError::Silent { waited });
        }
        let waited = self.now.since(self.last_progress);
        if waiting && stalls && waited > limits.stall {
            return Err(SessionError::Stalled { waited });
        }
        if self.now.since(self.last_ping) < limits.keep_alive {
            return Ok(Due::Nothing);
        }
        self.last_ping = self.now;
        // While bytes wait, their progress shows whether the other end is alive.
        Ok(if waiting { Due::Nothing } else { Due::Ping })
    }

    /// Returns the next time at which the result of [`handshake`](Self::handshake) may change.
    pub(super) fn next_in_handshake(&self, limits: &Limits) -> Option<Micros> {
        Some(self.started?.plus(limits.handshake).plus(Micros(1)))
    }

    /// Returns the next time at which the result of [`open`](Self::open) may change.
    pub(super) fn next_when_open(&self, limits: &Limits, waiting: bool, stalls: bool) -> Option<Micros> {
        self.started?;
        let silent = self.last_received.plus(limits.silence).plus(Micros(1));
        let ping = self.last_ping.plus(limits.keep_alive);
        let stalled = (waiting && stalls).then(|| self.last_progress.plus(limits.stall).plus(Micros(1)));
        [Some(silent), Some(ping), stalled].into_iter().flatten().min()
    }
}

/// A rate limiter (token bucket). It fills at `rate` tokens per second, up to four seconds' worth.
#[derive(Clone, Copy, Debug)]
pub(super) struct RateLimiter {
    rate: u32,
    /// Tokens left, in millionths.
    left: u64,
    last: Option<Micros>,
}

impl RateLimiter {
    pub(super) fn new(per_second: u32) -> Self {
        Self { rate: per_second, left: Self::most(per_second), last: None }
    }

    const fn most(rate: u32) -> u64 {
        rate as u64 * 4_000_000
    }

    /// Takes `amount` tokens. Returns whether there were enough.
    pub(super) fn take(&mut self, amount: usize, now: Micros) -> bool {
        let passed = now.since(self.last.unwrap_or(now));
        self.last = Some(now);
        let gained = passed.0.saturating_mul(self.rate.into());
        self.left = self.left.saturating_add(gained).min(Self::most(self.rate));
        let cost = (amount as u64).saturating_mul(1_000_000);
        let enough = cost <= self.left;
        self.left = self.left.saturating_sub(cost);
        enough
    }

    /// Gives back tokens.
    pub(super) fn refund(&mut self, amount: usize) {
        let amount = amount as u64 * 1_000_000;
        self.left = self.left.saturating_add(amount).min(Self::most(self.rate));
    }

    pub(super) const fn rate(&self) -> u32 {
        self.rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_allowance_is_a_rate_with_four_seconds_at_once() {
        let mut frames = RateLimiter::new(10);
        assert!(frames.take(40, Micros(0)) && !frames.take(1, Micros(0)));
        let mut frames = RateLimiter::new(10);
        for tenth in 0..1000 {
            assert!(frames.take(1, Micros(tenth * 100_000)), "ten a second may go on for ever");
        }
        let mut frames = RateLimiter::new(10);
        let lasted = (0..1000).find(|twentieth| !frames.take(1, Micros(twentieth * 50_000)));
        assert_eq!(lasted, Some(79), "twice the rate uses up the forty in four seconds");
        assert!(frames.take(3, Micros(u64::MAX)));
    }

    #[test]
    fn each_deadline_is_announced_and_kept() {
        let limits = Limits::default();
        let mut timers = Timers::default();
        assert_eq!(timers.next_in_handshake(&limits), None);
        timers.set_now(Micros(100));
        let next = timers.next_in_handshake(&limits).unwrap();
        timers.set_now(Micros(next.0 - 1));
        assert_eq!(timers.handshake(&limits), Ok(()));
        timers.set_now(next);
        assert!(timers.handshake(&limits).is_err());

        for (waiting, expected) in [(false, "silent"), (true, "stalled")] {
            // One session receives bytes often enough, the other does not.
            let limits = Limits { stall: Micros::from_secs(5), ..limits };
            let mut timers = Timers::default();
            timers.set_now(Micros(7));
            let (mut pings, mut last) = (0, Micros(7));
            let error = loop {
                let next = timers.next_when_open(&limits, waiting, true).unwrap();
                assert!(next > last, "time goes on");
                last = next;
                timers.set_now(next);
                match timers.open(&limits, waiting, true) {
                    Ok(Due::Ping) => pings += 1,
                    Ok(Due::Nothing) => {}
                    Err(error) => break error,
                }
            };
            match error {
                SessionError::Silent { waited } => {
                    assert_eq!((expected, waited, pings), ("silent", Micros(30_000_001), 15));
                }
                SessionError::Stalled { waited } => {
                    assert_eq!((expected, waited, pings), ("stalled", Micros(5_000_001), 0));
                }
                other => panic!("{other}"),
            }
        }
    }
}
