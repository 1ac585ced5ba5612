//! The clock of the examples.

use std::time::Instant;

use psao_server::clock::Clock;

/// A clock that counts from its start, by the system's monotonic clock.
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts the clock.
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }
}

impl Clock for Stopwatch {
    fn micros(&self) -> u64 {
        self.0.elapsed().as_micros() as u64
    }
}
