//! The terminal and the system: output, progress, the clock, the network's runtime.

use std::fmt::Display;
use std::io::{ErrorKind, IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use crate::error::{Exit, Failure, Outcome};

/// Prints to standard output, newline included.
pub(crate) fn say(text: impl Display) -> Outcome {
    writeln!(std::io::stdout().lock(), "{text}").map_err(|error| broken_output(&error))
}

/// Prints `value` to standard output as indented JSON.
pub(crate) fn say_json(value: &impl Serialize) -> Outcome {
    say(to_json(value)?)
}

/// Returns `value` as indented JSON.
pub(crate) fn to_json(value: &impl Serialize) -> Outcome<String> {
    serde_json::to_string_pretty(value)
        .map_err(|error| Failure::new(Exit::System, format_args!("cannot write JSON: {error}")))
}

/// Prints `value` to standard output as one line of JSON.
pub(crate) fn say_json_line(value: &impl Serialize) -> Outcome {
    say(serde_json::to_string(value)
        .map_err(|error| Failure::new(Exit::System, format_args!("cannot write JSON: {error}")))?)
}

/// Returns the failure to write to standard output. A reader that closed the pipe (`psao inspect | head`) ends the command
/// quietly.
pub(crate) fn broken_output(error: &std::io::Error) -> Failure {
    if error.kind() == ErrorKind::BrokenPipe {
        std::process::exit(0);
    }
    Failure::new(Exit::System, format_args!("cannot write to standard output: {error}"))
}

/// Returns a progress bar on standard error: shown on a terminal, silent elsewhere.
pub(crate) fn progress(what: &'static str, total: u64) -> ProgressBar {
    let target = if std::io::stderr().is_terminal() {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    if let Ok(style) = ProgressStyle::with_template("{msg:>12} {wide_bar} {pos}/{len} {eta} left") {
        bar.set_style(style);
    }
    bar.set_message(what);
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// Time since a start, by the system's monotonic clock.
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts to count.
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }

    /// Returns the microseconds since the start.
    pub(crate) fn micros(&self) -> u64 {
        u64::try_from(self.0.elapsed().as_micros()).unwrap_or(u64::MAX)
    }

    /// Returns the seconds since the start.
    pub(crate) fn seconds(&self) -> f64 {
        self.0.elapsed().as_secs_f64()
    }

    /// Returns the milliseconds since the start.
    pub(crate) fn millis(&self) -> f64 {
        self.seconds() * 1e3
    }
}

/// Returns a runtime for sockets, which continue while a frame is traced in [`tokio::task::block_in_place`].
pub(crate) fn runtime() -> Outcome<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(|error| Failure::new(Exit::System, format_args!("cannot start the network: {error}")))
}
