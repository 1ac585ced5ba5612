//! A client's connection.

use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout};

use super::{CHUNK, NetError, since};
use crate::session::{ClientEvent, ClientSession, SessionError};
use crate::{Limits, WireFrame};

/// Connects to a server at `address` (`host:port`). The handshake goes on in [`Connection::next_events`].
///
/// # Errors
/// [`NetError::Refused`], [`NetError::ConnectTimeout`] after [`Limits::handshake`], [`NetError::Connect`].
pub async fn connect(address: &str, limits: Limits) -> Result<Connection, NetError> {
    let patience = Duration::from_micros(limits.handshake.0);
    let stream = match timeout(patience, TcpStream::connect(address)).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(error)) => return Err(NetError::connect(address, error)),
        Err(_) => {
            return Err(NetError::ConnectTimeout { address: address.to_owned(), waited: limits.handshake });
        }
    };
    // Acknowledgements are small and must not wait for company. Where this fails they are late, no more.
    let _ = stream.set_nodelay(true);
    let buffer = vec![0; CHUNK];
    let session = ClientSession::new(limits);
    Ok(Connection { address: address.to_owned(), stream, session, started: Instant::now(), limits, buffer })
}

/// A client session and its socket.
#[derive(Debug)]
pub struct Connection {
    address: String,
    stream: TcpStream,
    session: ClientSession,
    started: Instant,
    limits: Limits,
    buffer: Vec<u8>,
}

impl Connection {
    /// Sends what waits, then waits for bytes from the server and returns the events they make: none, one or many.
    /// After [`ClientEvent::Closed`] there is nothing more to wait for.
    ///
    /// It may be cancelled between events, as by `select!`: nothing is lost.
    ///
    /// # Errors
    /// [`NetError::Session`], [`NetError::Disconnected`], [`NetError::Broken`]. The session's state stays readable.
    pub async fn next_events(&mut self) -> Result<Vec<ClientEvent>, NetError> {
        self.next_events_with(&mut |_| {}).await
    }

    /// As [`next_events`](Self::next_events), and shows every whole frame to `tap`, for recording.
    ///
    /// # Errors
    /// As [`next_events`](Self::next_events).
    pub async fn next_events_with(
        &mut self,
        tap: &mut (dyn FnMut(&WireFrame<'_>) + Send),
    ) -> Result<Vec<ClientEvent>, NetError> {
        self.flush().await?;
        if self.session.is_closed() {
            return Ok(Vec::new());
        }
        let read = self.stream.read(&mut self.buffer);
        let count = if self.session.state().is_none() {
            // Only the handshake has a deadline: a scene that stands still has nothing to send.
            let left = self.limits.handshake.since(since(self.started)).0;
            match timeout(Duration::from_micros(left + 1), read).await {
                Ok(result) => result.map_err(|source| self.broken(source))?,
                Err(_) => {
                    let result = self.session.tick(since(self.started));
                    return self.farewell(result.map(|()| Vec::new())).await;
                }
            }
        } else {
            read.await.map_err(|source| self.broken(source))?
        };
        if count == 0 {
            let (address, unfinished) = (self.address.clone(), self.session.unfinished_bytes());
            return Err(NetError::Disconnected { address, unfinished });
        }
        let bytes = self.buffer.get(..count).unwrap_or_default();
        let result = self.session.handle_with(bytes, since(self.started), tap);
        self.farewell(result).await
    }

    /// Sends what waits: views, edits, requests, a close.
    ///
    /// # Errors
    /// [`NetError::Broken`].
    pub async fn flush(&mut self) -> Result<(), NetError> {
        while !self.session.output().is_empty() {
            let count = match self.stream.write(self.session.output()).await {
                Ok(count) => count,
                Err(source) => return Err(self.broken(source)),
            };
            self.session.advance(count);
        }
        Ok(())
    }

    /// The session: its state, and what to tell the server. What it is told goes out with the next
    /// [`flush`](Self::flush) or [`next_events`](Self::next_events).
    pub const fn session(&mut self) -> &mut ClientSession {
        &mut self.session
    }

    /// The address as it was given.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Passes on what the session says. When it failed, the other end is told if that is still possible.
    async fn farewell(
        &mut self,
        result: Result<Vec<ClientEvent>, SessionError>,
    ) -> Result<Vec<ClientEvent>, NetError> {
        let source = match result {
            Ok(events) => return Ok(events),
            Err(source) => source,
        };
        // The error at hand says more than a socket that broke after it.
        let _ = timeout(Duration::from_secs(1), self.flush()).await;
        Err(NetError::Session { address: self.address.clone(), source })
    }

    fn broken(&self, source: std::io::Error) -> NetError {
        NetError::Broken { address: self.address.clone(), source }
    }
}
