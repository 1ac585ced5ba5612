//! Sessions: both ends of a connection as state machines that do no I/O.
//!
//! Bytes and a time go in; events, and bytes to send, come out. [`ClientSession`] and [`ServerSession`] hold all that
//! the protocol knows; a socket, a file or a test only carries bytes between them. The drive loop is shown, compiled
//! and run in the head of this crate.

mod access;
mod body;
mod client;
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
pub use client::{AppliedFrame, ClientEvent, ClientOptions, ClientSession, ClientStats};
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

/// What this crate calls itself in a handshake unless told otherwise.
pub(crate) const PEER_NAME: &str = concat!("psao-proto ", env!("CARGO_PKG_VERSION"));

/// What a session that met `error` says to the other end; `None` when the other end knows, or would not understand.
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

/// Reads a message for a session.
fn read<M: Message>(payload: &[u8]) -> Result<M, MessageError> {
    M::from_payload(payload)
}
