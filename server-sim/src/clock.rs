//! The clock that stage times are read from. The caller hands it in.

/// A monotonic clock. The server reads it for its statistics only: no byte of the stream depends on it.
pub trait Clock {
    /// Microseconds since some moment of the clock's own.
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
