//! Sessions: both ends of a connection as state machines that do no I/O.
//!
//! Bytes and a time go in; events, and bytes to send, come out. [`ClientSession`] and [`ServerSession`] hold all that
//! the protocol knows; a socket, a file or a test only carries bytes between them. The drive loop is shown, compiled
//! and run in the head of this crate.

mod client;
mod error;
mod outbox;
mod server;

#[cfg(test)]
mod tests;

pub use client::{AppliedFrame, ClientEvent, ClientSession, ClientStats};
pub use error::{SendError, SessionError};
pub use server::{Sent, ServerEvent, ServerSession, ServerStats};

use crate::message::{Close, CloseCode, Message, MessageError};
use crate::{FrameFault, FramerError, Limits, Micros};

/// Oldest protocol version that this crate speaks.
pub const OLDEST_VERSION: u16 = 1;
/// Newest protocol version that this crate speaks.
pub const NEWEST_VERSION: u16 = 1;

/// What this crate calls itself in a handshake unless told otherwise.
pub(crate) const PEER_NAME: &str = concat!("psao-proto ", env!("CARGO_PKG_VERSION"));

/// The handshake's deadline. It starts with the first time that the session is told.
#[derive(Clone, Copy, Debug, Default)]
struct Deadline {
    started: Option<Micros>,
}

impl Deadline {
    fn check(&mut self, now: Micros, limits: &Limits) -> Result<(), SessionError> {
        let started = *self.started.get_or_insert(now);
        if now.since(started) > limits.handshake {
            return Err(SessionError::HandshakeTimeout { waited: now.since(started) });
        }
        Ok(())
    }
}

/// What a session that met `error` says to the other end; `None` when the other end knows, or would not understand.
fn farewell(error: &SessionError) -> Option<Close> {
    let code = match error {
        SessionError::Framer(FramerError { offset: 0, fault: FrameFault::Magic { .. } })
        | SessionError::NotPsao { .. }
        | SessionError::Rejected(_)
        | SessionError::BadHello(_) => return None,
        SessionError::HandshakeTimeout { .. } => CloseCode::TIMEOUT,
        _ => CloseCode::PROTOCOL,
    };
    Some(Close::new(code, &error.to_string()))
}

/// Reads a message for a session.
fn read<M: Message>(payload: &[u8]) -> Result<M, MessageError> {
    M::from_payload(payload)
}
