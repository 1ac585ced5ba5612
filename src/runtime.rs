//! The thread behind sockets.

use tokio::runtime::{Builder, Runtime};

/// Starts a runtime with one thread of its own: sockets go on while the caller is elsewhere.
pub(crate) fn start() -> std::io::Result<Runtime> {
    Builder::new_multi_thread().worker_threads(1).thread_name("psao-net").enable_all().build()
}
