//! Errors of connections and listeners, with messages for users.

use std::io;

#[cfg(feature = "tls")]
use super::TlsError;
use super::{Address, AddressError};
use crate::Micros;
use crate::session::SessionError;

/// Why a connection or a listener failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetError {
    /// The address cannot be read.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// Other machines can reach the address, but it lacks TLS or credentials.
    #[error(
        "{address} can be reached from other machines, but {lacks}: listen at 127.0.0.1 or a unix: socket, or at a tls: address with a token or client certificates, or open it to everyone on purpose"
    )]
    Exposed {
        /// The address as it was given.
        address: String,
        /// The missing protection.
        lacks: &'static str,
    },
    /// The address uses TLS, but the certificates for it were not given.
    #[error("{address} needs {needs}")]
    TlsNeeds {
        /// The address as it was given.
        address: String,
        /// The missing certificate or feature.
        needs: &'static str,
    },
    /// Certificates were given for an address without TLS.
    #[error(
        "certificates were given, but {address} does not use TLS: write tls:host:port, or leave them out"
    )]
    TlsUnused {
        /// The address as it was given.
        address: String,
    },
    /// TLS failed during the handshake or later.
    #[cfg(feature = "tls")]
    #[error("{address}: {source}")]
    Tls {
        /// The other end.
        address: String,
        /// The TLS error.
        source: TlsError,
    },
    /// The server uses TLS, but the address does not start with `tls:`.
    #[error(
        "the server at {address} speaks TLS: connect to tls:{address}, with the certificate of its authority"
    )]
    SpeaksTls {
        /// The address as it was given.
        address: String,
    },
    /// A token would leave this machine without TLS.
    #[error(
        "the token would go to {address} in the clear, for everyone on the way to read: use a tls: address, leave the token out, or allow it on purpose"
    )]
    TokenInClear {
        /// The address as it was given.
        address: String,
    },
    /// The path of a Unix socket exists but is not a socket.
    #[error("{} exists and is no socket: choose another path, or remove it", path.display())]
    NotASocket {
        /// The path.
        path: std::path::PathBuf,
    },
    /// The server took no bytes for too long.
    #[error("{address} took none of this client's bytes for {:.1} s", waited.as_secs_f64())]
    Stalled {
        /// The other end.
        address: String,
        /// Time without progress.
        waited: Micros,
    },
    /// Nothing listens at the address.
    #[error("nothing answers at {address}: is the server running, and is the address the right one?")]
    Refused {
        /// The address as it was given.
        address: String,
    },
    /// The server did not answer in time.
    #[error("{address} did not answer within {:.1} s: check the address and the network between", waited.as_secs_f64())]
    ConnectTimeout {
        /// The address as it was given.
        address: String,
        /// Time that the client waited.
        waited: Micros,
    },
    /// The address could not be reached for another reason.
    #[error("cannot connect to {address}: {source}")]
    Connect {
        /// The address as it was given.
        address: String,
        /// The system's error.
        source: io::Error,
    },
    /// Another program listens at the address already.
    #[error(
        "{address} is in use: another program, or another server of this kind, listens there. Stop it, or choose another address"
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
        /// The system's error.
        source: io::Error,
    },
    /// The connection broke.
    #[error("the connection to {address} broke: {source}")]
    Broken {
        /// The other end.
        address: String,
        /// The system's error.
        source: io::Error,
    },
    /// The other end closed the connection without a CLOSE.
    #[error(
        "{address} closed the connection without a goodbye, {unfinished} bytes into a frame: it was stopped, or it failed"
    )]
    Disconnected {
        /// The other end.
        address: String,
        /// Bytes received of an incomplete frame.
        unfinished: usize,
    },
    /// The session ended with an error, or the other end refused it.
    #[error("{address}: {source}")]
    Session {
        /// The other end.
        address: String,
        /// The session's error.
        source: SessionError,
    },
}

impl NetError {
    /// Creates [`TlsNeeds`](Self::TlsNeeds). `needs` names what is missing in a program built with TLS.
    pub(super) fn tls_needs(address: &Address, needs: &'static str) -> Self {
        let needs = if cfg!(feature = "tls") { needs } else { "a program that is built with TLS" };
        Self::TlsNeeds { address: address.to_string(), needs }
    }

    pub(super) fn connect(address: &Address, source: io::Error) -> Self {
        let address = address.to_string();
        match source.kind() {
            io::ErrorKind::ConnectionRefused => Self::Refused { address },
            // A missing Unix socket. Unknown host names have another error kind.
            io::ErrorKind::NotFound => Self::Refused { address },
            _ => Self::Connect { address, source },
        }
    }

    pub(super) fn bind(address: &Address, source: io::Error) -> Self {
        let address = address.to_string();
        match source.kind() {
            io::ErrorKind::AddrInUse => Self::InUse { address },
            _ => Self::Bind { address, source },
        }
    }
}
