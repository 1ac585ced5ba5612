//! Why a stream cannot be followed.

use std::path::PathBuf;

use psao_proto::recording::ReaderError;

/// Why a stream cannot be followed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SubscribeError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a recording that this version reads.
    #[error("{}: {source}", path.display())]
    Recording {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ReaderError,
    },
    /// A recording was asked for something that only a server can do.
    #[error("a recording cannot be changed: connect to a server to edit the scene")]
    NotLive,
    /// The text is not an address.
    #[cfg(feature = "tokio")]
    #[error(transparent)]
    Address(#[from] psao_proto::net::AddressError),
    /// The connection cannot be made, or ended with an error.
    #[cfg(feature = "tokio")]
    #[error(transparent)]
    Network(#[from] psao_proto::net::NetError),
    /// The message has a value that cannot be sent.
    #[cfg(feature = "tokio")]
    #[error(transparent)]
    Send(#[from] psao_proto::session::SendError),
    /// The system gave no thread for the network.
    #[cfg(feature = "tokio")]
    #[error("cannot start the network's thread: {source}")]
    Runtime {
        /// What the system said.
        source: std::io::Error,
    },
}
