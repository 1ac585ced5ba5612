//! The clock that examples hand to the library.

use std::time::Instant;

use psao_server::clock::Clock;

/// Time since a start, by the system's monotonic clock.
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts to count.
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }
}

impl Clock for Stopwatch {
    fn micros(&self) -> u64 {
        self.0.elapsed().as_micros() as u64
    }
}
