//! Sessions: both ends of a connection as state machines without I/O.
//!
//! A session takes bytes and a time, and returns events and bytes to send. [`ClientSession`] and [`ServerSession`]
//! implement the whole protocol; a socket, a file or a test only carries bytes between them. The documentation of the
//! crate shows the drive loop.

mod access;
mod body;
mod client;
mod client_event;
mod clock;
mod datagram;
mod error;
mod flight;
mod negotiation;
mod outbox;
mod server;
mod server_event;
mod timers;

#[cfg(test)]
mod tests;

pub use access::Access;
pub use body::SharedBody;
pub use client::{ClientOptions, ClientSession};
pub use client_event::{AppliedFrame, ClientEvent, ClientStats};
pub use clock::ClockEstimate;
pub use datagram::MIN_DATAGRAM_BYTES;
pub use error::{SendError, SessionError};
pub use server::ServerSession;
pub use server_event::{Demand, ServerEvent, ServerStats};

use crate::message::{Close, CloseCode, Message, MessageError};
use crate::{FramerError, WireFrameError};

/// Oldest protocol version that this crate speaks.
pub const OLDEST_VERSION: u16 = 1;
/// Newest protocol version that this crate speaks.
pub const NEWEST_VERSION: u16 = 1;

/// Default name of both ends in a handshake.
pub(crate) const PEER_NAME: &str = concat!("psao-proto ", env!("CARGO_PKG_VERSION"));

/// Returns the CLOSE that tells the other end about `error`; `None` when the other end knows of it, or could not read
/// it.
fn close_message(error: &SessionError) -> Option<Close> {
    let code = match error {
        SessionError::Framer(FramerError { offset: 0, error: WireFrameError::Magic { .. } })
        | SessionError::NotPsao { .. }
        | SessionError::Rejected(_)
        | SessionError::BadHello(_) => return None,
        SessionError::HandshakeTimeout { .. }
        | SessionError::Silent { .. }
        | SessionError::Stalled { .. } => CloseCode::TIMEOUT,
        SessionError::Flood { .. } => CloseCode::FLOOD,
        SessionError::OtherScene { .. } => CloseCode::SCENE,
        _ => CloseCode::PROTOCOL,
    };
    Some(Close::new(code, &error.to_string()))
}

/// Reads a message from the payload of its frame.
fn read<M: Message>(payload: &[u8]) -> Result<M, MessageError> {
    M::from_payload(payload)
}
