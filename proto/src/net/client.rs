//! A client's connection.

use std::io::ErrorKind;
use std::net::SocketAddr;
use std::time::Duration;

use psao_codec::State;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout};

use super::peer::TLS_ALERT;
use super::serve::serve;
use super::stream::{Stream, is_local, resolve};
use super::{Address, CHUNK_BYTES, HostPort, Hub, NetError, Peer, elapsed_since};
#[cfg(feature = "tls")]
use super::{ClientTls, TlsError};
use crate::session::{ClientEvent, ClientOptions, ClientSession, SessionError};
use crate::{Limits, Micros, WireFrame};

/// Capacity in bytes of a connection within a process, in each direction.
const IN_PROCESS_BUFFER_BYTES: usize = 256 * 1024;
/// Time limit for the last exchange with the server when a connection ends with an error.
const FAREWELL_TIMEOUT: Duration = Duration::from_secs(1);

/// Options of a client's connection. By default without token and without TLS.
#[derive(Clone, Debug, Default)]
pub struct ConnectOptions {
    session: ClientOptions,
    token_in_clear: bool,
    #[cfg(feature = "tls")]
    tls: Option<ClientTls>,
}

impl ConnectOptions {
    /// Sets the options of the session, which include the token.
    #[must_use]
    pub fn with_session(mut self, session: ClientOptions) -> Self {
        self.session = session;
        self
    }

    /// Sets whether the token may leave this machine without TLS. Use it on closed networks only.
    #[must_use]
    pub const fn with_token_in_clear(mut self, allowed: bool) -> Self {
        self.token_in_clear = allowed;
        self
    }

    /// Sets the trusted authorities, for addresses `tls:host:port`.
    #[cfg(feature = "tls")]
    #[must_use]
    pub fn with_tls(mut self, tls: ClientTls) -> Self {
        self.tls = Some(tls);
        self
    }

    /// Returns whether a connection to `to` without TLS keeps the token within the rules of these options.
    pub(super) fn may_go_in_clear(&self, to: &SocketAddr) -> bool {
        self.session.token.is_none() || self.token_in_clear || is_local(to)
    }
}

/// Connects to the server at `address`. The TLS handshake is complete when this returns; the protocol's handshake
/// continues in [`Connection::next_event`]. A client certificate that the server refuses also shows there.
///
/// # Errors
/// [`NetError::Refused`], [`NetError::ConnectTimeout`] after [`Limits::handshake`], [`NetError::Connect`],
/// `NetError::Tls`; [`NetError::TlsNeeds`] and [`NetError::TlsUnused`] when address and options conflict;
/// [`NetError::TokenInClear`] for a token that would leave this machine without TLS.
pub async fn connect(
    address: &Address,
    options: &ConnectOptions,
    limits: Limits,
) -> Result<Connection, NetError> {
    #[cfg(feature = "tls")]
    if !matches!(address, Address::Tls(_)) && options.tls.is_some() {
        return Err(NetError::TlsUnused { address: address.to_string() });
    }
    let started = Instant::now();
    let connect_timeout = Duration::from_micros(limits.handshake.0);
    let stream = timeout(connect_timeout, open(address, options))
        .await
        .map_err(|_| NetError::ConnectTimeout { address: address.to_string(), waited: limits.handshake })??;
    let session = ClientSession::with(limits, options.session.clone());
    Ok(Connection::new(address.to_string(), stream, session, started, limits))
}

/// Connects to a hub in the same process without a socket. The client uses the hub's token, if there is one. Bytes,
/// limits and tasks are those of a socket connection.
#[must_use]
pub fn connect_in_process(hub: &Hub, limits: Limits) -> Connection {
    let (ours, theirs) = tokio::io::duplex(IN_PROCESS_BUFFER_BYTES);
    tokio::spawn(serve(hub.clone(), Peer::InProcess, Box::new(theirs)));
    let options = ClientOptions { token: hub.token().cloned(), ..ClientOptions::default() };
    let session = ClientSession::with(limits, options);
    Connection::new("this process".to_owned(), Box::new(ours), session, Instant::now(), limits)
}

async fn open(address: &Address, options: &ConnectOptions) -> Result<Stream, NetError> {
    let failed = |source| NetError::connect(address, source);
    match address {
        Address::Tcp(place) => {
            let stream = open_tcp(address, place).await?;
            if !options.may_go_in_clear(&stream.peer_addr().map_err(failed)?) {
                return Err(NetError::TokenInClear { address: address.to_string() });
            }
            Ok(Box::new(stream))
        }
        Address::Tls(place) => open_tls(address, place, options).await,
        #[cfg(unix)]
        Address::Unix(path) => Ok(Box::new(tokio::net::UnixStream::connect(path).await.map_err(failed)?)),
        #[cfg(not(unix))]
        Address::Unix(_) => Err(failed(std::io::ErrorKind::Unsupported.into())),
    }
}

async fn open_tcp(address: &Address, place: &HostPort) -> Result<TcpStream, NetError> {
    let failed = |source| NetError::connect(address, source);
    let places = resolve(place).await.map_err(failed)?;
    let stream = TcpStream::connect(&places[..]).await.map_err(failed)?;
    // Acknowledgements are small and must not wait for more data. If this fails, they are only later.
    let _ = stream.set_nodelay(true);
    Ok(stream)
}

#[cfg(feature = "tls")]
async fn open_tls(address: &Address, place: &HostPort, options: &ConnectOptions) -> Result<Stream, NetError> {
    let failed = |source| NetError::connect(address, source);
    let Some(tls) = &options.tls else { return Err(tls_needs(address)) };
    let name = place.host.clone().try_into();
    let name = name.map_err(|error| failed(std::io::Error::new(ErrorKind::InvalidInput, error)))?;
    let stream = open_tcp(address, place).await?;
    match tls.connector().connect(name, stream).await {
        Ok(stream) => Ok(Box::new(stream)),
        Err(error) => Err(match TlsError::of_handshake(&error) {
            Some(source) => NetError::Tls { address: address.to_string(), source },
            None => failed(error),
        }),
    }
}

#[cfg(not(feature = "tls"))]
async fn open_tls(address: &Address, _: &HostPort, _: &ConnectOptions) -> Result<Stream, NetError> {
    Err(tls_needs(address))
}

fn tls_needs(address: &Address) -> NetError {
    NetError::tls_needs(address, "the certificate of the authority that signed the server's")
}

/// A client session and the stream that carries its bytes.
pub struct Connection {
    address: String,
    stream: Stream,
    session: ClientSession,
    started: Instant,
    limits: Limits,
    buffer: Vec<u8>,
}

impl Connection {
    fn new(
        address: String,
        stream: Stream,
        mut session: ClientSession,
        started: Instant,
        limits: Limits,
    ) -> Self {
        // The deadline of the handshake counts from the start of the connection. The first call cannot fail.
        let _ = session.tick(Micros(0));
        Self { address, stream, session, started, limits, buffer: vec![0; CHUNK_BYTES] }
    }

    /// Returns the next event; waits for bytes from the server, and sends waiting bytes meanwhile. Until the next
    /// call, [`state`](Self::state) is that after the event's frame. Returns `None` after [`ClientEvent::Closed`], or
    /// when the session was closed here.
    ///
    /// This method is cancel-safe, for example in `select!`.
    ///
    /// # Errors
    /// [`NetError::Session`], [`NetError::Disconnected`], [`NetError::Broken`], [`NetError::Stalled`],
    /// `NetError::Tls`, [`NetError::SpeaksTls`]. The state stays readable.
    pub async fn next_event(&mut self) -> Result<Option<ClientEvent>, NetError> {
        self.next_event_with(&mut |_| {}).await
    }

    /// Does the same as [`next_event`](Self::next_event), and passes every whole frame to `tap`, for example to a recorder.
    ///
    /// # Errors
    /// As [`next_event`](Self::next_event).
    pub async fn next_event_with(
        &mut self,
        tap: &mut (dyn FnMut(&WireFrame<'_>) + Send),
    ) -> Result<Option<ClientEvent>, NetError> {
        loop {
            let result = self.session.next_event_with(tap);
            if let Some(event) = self.finish_with(result).await? {
                return Ok(Some(event));
            }
            let sent = self.flush().await;
            if self.session.is_closed() {
                return sent.map(|()| None);
            }
            let count = self.read_after(sent).await?;
            let bytes = self.buffer.get(..count).unwrap_or_default();
            let result = self.session.push(bytes, elapsed_since(self.started));
            self.finish_with(result).await?;
        }
    }

    /// Reads at least one byte into the buffer, after sending succeeded or failed.
    async fn read_after(&mut self, sent: Result<(), NetError>) -> Result<usize, NetError> {
        let Err(broken) = sent else { return self.read().await };
        // A server may have sent a CLOSE before it closed the connection.
        match timeout(FAREWELL_TIMEOUT, self.read()).await {
            Ok(Ok(count)) => Ok(count),
            Ok(Err(NetError::Broken { .. } | NetError::Disconnected { .. })) | Err(_) => Err(broken),
            Ok(Err(error)) => Err(error),
        }
    }

    /// Reads at least one byte into the buffer. Calls the session at its deadlines.
    async fn read(&mut self) -> Result<usize, NetError> {
        loop {
            let deadline = self.session.next_deadline();
            let read = self.stream.read(&mut self.buffer);
            let result = match deadline {
                None => read.await,
                Some(deadline) => {
                    let left = Duration::from_micros(deadline.since(elapsed_since(self.started)).0);
                    match timeout(left, read).await {
                        Ok(result) => result,
                        Err(_) => {
                            let result = self.session.tick(elapsed_since(self.started));
                            self.finish_with(result).await?;
                            self.flush().await?;
                            continue;
                        }
                    }
                }
            };
            return match result {
                Ok(count) if count > 0 => Ok(count),
                Err(source) if source.kind() != ErrorKind::UnexpectedEof => Err(self.broken(source)),
                // The end of the stream, or of TLS without a `close_notify` alert.
                _ => Err(NetError::Disconnected {
                    address: self.address.clone(),
                    unfinished: self.session.unfinished_bytes(),
                }),
            };
        }
    }

    /// Sends all waiting bytes, such as views, edits, requests and CLOSE. This method is cancel-safe.
    ///
    /// # Errors
    /// [`NetError::Broken`], `NetError::Tls`; [`NetError::Stalled`] when the server takes no bytes for
    /// [`Limits::stall`].
    pub async fn flush(&mut self) -> Result<(), NetError> {
        let stall = Duration::from_micros(self.limits.stall.0);
        loop {
            match timeout(stall, self.write_some()).await {
                Ok(Ok(true)) => {}
                Ok(Ok(false)) => return Ok(()),
                Ok(Err(source)) => return Err(self.broken(source)),
                Err(_) => {
                    let (address, waited) = (self.address.clone(), self.limits.stall);
                    return Err(NetError::Stalled { address, waited });
                }
            }
        }
    }

    /// Writes as many bytes as the stream takes at once. Returns false when none are left.
    async fn write_some(&mut self) -> std::io::Result<bool> {
        if self.session.output().is_empty() {
            // TLS buffers bytes itself.
            self.stream.flush().await?;
            return Ok(false);
        }
        match self.stream.write(self.session.output()).await? {
            0 => Err(ErrorKind::WriteZero.into()),
            count => {
                self.session.advance(count);
                Ok(true)
            }
        }
    }

    /// Returns the session. Messages that are given to it leave with the next [`flush`](Self::flush) or
    /// [`next_event`](Self::next_event).
    pub const fn session(&mut self) -> &mut ClientSession {
        &mut self.session
    }

    /// Returns the state after the last frame applied; `None` before the scene table.
    #[must_use]
    pub fn state(&self) -> Option<&State> {
        self.session.state()
    }

    /// Returns the time by the session's clock: microseconds since the connection began.
    #[must_use]
    pub fn now(&self) -> Micros {
        elapsed_since(self.started)
    }

    /// Returns the address as it was given.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Converts a result of the session. After an error, sends the session's CLOSE if that is still possible.
    async fn finish_with<T>(&mut self, result: Result<T, SessionError>) -> Result<T, NetError> {
        let source = match result {
            Ok(events) => return Ok(events),
            Err(source) => source,
        };
        // The session's error is more useful than a socket that broke after it.
        let _ = timeout(FAREWELL_TIMEOUT, self.flush()).await;
        let address = self.address.clone();
        Err(match source {
            SessionError::NotPsao { found: TLS_ALERT } => NetError::SpeaksTls { address },
            source => NetError::Session { address, source },
        })
    }

    fn broken(&self, source: std::io::Error) -> NetError {
        let address = self.address.clone();
        #[cfg(feature = "tls")]
        if let Some(source) = TlsError::of(&source) {
            return NetError::Tls { address, source };
        }
        NetError::Broken { address, source }
    }
}

impl std::fmt::Debug for Connection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Connection")
            .field("address", &self.address)
            .field("session", &self.session)
            .finish_non_exhaustive()
    }
}
