//! The clock for stage times, passed in by the caller.

/// A monotonic clock. The server uses it for statistics only: no byte of the stream depends on it.
pub trait Clock {
    /// Returns the microseconds since an arbitrary moment.
    fn micros(&self) -> u64;
}

/// A clock that stands still: all times are zero.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoClock;

impl Clock for NoClock {
    fn micros(&self) -> u64 {
        0
    }
}
