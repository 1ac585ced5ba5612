//! The other end of a server's connection, and why it left.

use std::fmt;
use std::net::SocketAddr;

#[cfg(feature = "tls")]
use super::TlsError;
use crate::session::{SendError, SessionError};

/// Address of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Peer {
    /// It came over plain TCP.
    Tcp(SocketAddr),
    /// It came over TLS.
    Tls(SocketAddr),
    /// It came over a Unix socket.
    Unix {
        /// Number of its process, where the system tells.
        process: Option<i32>,
    },
    /// It is in this process.
    InProcess,
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(address) => write!(f, "{address}"),
            Self::Tls(address) => write!(f, "tls:{address}"),
            Self::Unix { process: Some(process) } => write!(f, "unix process {process}"),
            Self::Unix { process: None } => f.write_str("unix"),
            Self::InProcess => f.write_str("in process"),
        }
    }
}

/// Why a connection ended without a CLOSE.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PeerError {
    /// The session failed: the client broke the protocol, was refused, or hung.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The stream's frames cannot be sent to the client.
    #[error(transparent)]
    Unservable(SendError),
    /// The client speaks TLS to a port without TLS.
    #[error("it speaks TLS, which this address does not: listen at tls:host:port, or connect without tls:")]
    TlsAtPlainPort,
    /// TLS failed during the handshake or later.
    #[cfg(feature = "tls")]
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// The server was full.
    #[error("turned away: {limit} clients are connected, as many as the server takes")]
    TurnedAway {
        /// Largest number of clients.
        limit: u32,
    },
    /// The connection ended without a CLOSE.
    #[error("it closed the connection without a goodbye, {unfinished} bytes into a frame")]
    Disconnected {
        /// Bytes received of an incomplete frame.
        unfinished: usize,
    },
    /// The connection broke.
    #[error("the connection broke: {what}")]
    Broken {
        /// The system's message.
        what: String,
    },
}

impl PeerError {
    /// Recognises a TLS client at a plain port: its first bytes are a handshake record of TLS 1.x.
    pub(super) fn session(error: SessionError) -> Self {
        match error {
            SessionError::NotPsao { found: TLS_HANDSHAKE } => Self::TlsAtPlainPort,
            other => Self::Session(other),
        }
    }

    pub(super) fn broken(error: &std::io::Error) -> Self {
        #[cfg(feature = "tls")]
        if let Some(fault) = TlsError::of(error) {
            return Self::Tls(fault);
        }
        Self::Broken { what: error.to_string() }
    }
}

/// First two bytes, little endian, of a TLS record that holds a handshake message: type 22, major version 3 (RFC 8446,
/// 5.1).
const TLS_HANDSHAKE: u16 = 0x0316;
/// As above, of a record that holds an alert: type 21.
pub(super) const TLS_ALERT: u16 = 0x0315;
