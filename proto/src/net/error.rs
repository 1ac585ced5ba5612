//! What goes wrong with sockets, in words for the person at the terminal.

use std::io;

use crate::Micros;
use crate::session::SessionError;

/// Why a connection or a listener failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetError {
    /// Nothing listens at the address.
    #[error("nothing answers at {address}: is the server running there, and is the port the right one?")]
    Refused {
        /// The address as it was given.
        address: String,
    },
    /// The address could not be reached in time.
    #[error("{address} did not answer within {:.1} s: check the address and the network between", waited.as_secs_f64())]
    ConnectTimeout {
        /// The address as it was given.
        address: String,
        /// How long was waited.
        waited: Micros,
    },
    /// The address could not be reached for another reason.
    #[error("cannot connect to {address}: {source}")]
    Connect {
        /// The address as it was given.
        address: String,
        /// What the system says.
        source: io::Error,
    },
    /// Another program listens at the address already.
    #[error(
        "{address} is in use: another program, or another server of this kind, listens there. Stop it, or choose another port"
    )]
    InUse {
        /// The address as it was given.
        address: String,
    },
    /// The address cannot be listened at for another reason.
    #[error("cannot listen at {address}: {source}")]
    Bind {
        /// The address as it was given.
        address: String,
        /// What the system says.
        source: io::Error,
    },
    /// The connection broke.
    #[error("the connection to {address} broke: {source}")]
    Broken {
        /// The other end.
        address: String,
        /// What the system says.
        source: io::Error,
    },
    /// The other end went away without a CLOSE.
    #[error(
        "{address} closed the connection without a goodbye, {unfinished} bytes into a frame: it was stopped, or it failed"
    )]
    Disconnected {
        /// The other end.
        address: String,
        /// Bytes that came of a frame that never became whole.
        unfinished: usize,
    },
    /// The bytes that came broke the protocol, or the other end refused.
    #[error("{address}: {source}")]
    Session {
        /// The other end.
        address: String,
        /// What was wrong.
        source: SessionError,
    },
}

impl NetError {
    pub(super) fn connect(address: &str, source: io::Error) -> Self {
        let address = address.to_owned();
        match source.kind() {
            io::ErrorKind::ConnectionRefused => Self::Refused { address },
            _ => Self::Connect { address, source },
        }
    }

    pub(super) fn bind(address: &str, source: io::Error) -> Self {
        let address = address.to_owned();
        match source.kind() {
            io::ErrorKind::AddrInUse => Self::InUse { address },
            _ => Self::Bind { address, source },
        }
    }
}
