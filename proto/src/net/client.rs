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

/// Bytes that wait between the two ends of a connection within a process, in each direction.
const IN_PROCESS_BUFFER_BYTES: usize = 256 * 1024;
/// How long to look for what the server said before it closed a connection that breaks.
const FAREWELL_TIMEOUT: Duration = Duration::from_secs(1);

/// How a client connects. The default: no credentials, no authorities, so no TLS.
#[derive(Clone, Debug, Default)]
pub struct ConnectOptions {
    session: ClientOptions,
    token_in_clear: bool,
    #[cfg(feature = "tls")]
    tls: Option<ClientTls>,
}

impl ConnectOptions {
    /// Sets the options of the session; its token is the client's credential.
    #[must_use]
    pub fn session(mut self, session: ClientOptions) -> Self {
        self.session = session;
        self
    }

    /// Sets whether the token may leave this machine without TLS, for closed networks.
    #[must_use]
    pub const fn token_in_clear(mut self, allowed: bool) -> Self {
        self.token_in_clear = allowed;
        self
    }

    /// Sets the trusted authorities, for addresses `tls:host:port`.
    #[cfg(feature = "tls")]
    #[must_use]
    pub fn tls(mut self, tls: ClientTls) -> Self {
        self.tls = Some(tls);
        self
    }

    /// Returns whether what these options tell a server at `to` may go without TLS.
    pub(super) fn may_go_in_clear(&self, to: &SocketAddr) -> bool {
        self.session.token.is_none() || self.token_in_clear || is_local(to)
    }
}

/// Connects to the server at `address`. The handshake of the protocol goes on in [`Connection::next_events`]; that of
/// TLS is over when this returns, but for a client certificate that the server refuses, which shows there, too.
///
/// # Errors
/// [`NetError::Refused`], [`NetError::ConnectTimeout`] after [`Limits::handshake`], [`NetError::Connect`],
/// `NetError::Tls`; [`NetError::TlsNeeds`] and [`NetError::TlsUnused`] when address and options disagree;
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

/// Connects to a hub of the same process, without a socket: the same bytes, the same bounds, the same tasks. Where the
/// hub wants a token, this client has it.
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
    // Acknowledgements are small and must not wait for company. Where this fails they are late, no more.
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

/// A client session and what carries its bytes.
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
        // The deadline of the handshake counts from the start of the connection. Nothing has failed yet.
        let _ = session.tick(Micros(0));
        Self { address, stream, session, started, limits, buffer: vec![0; CHUNK_BYTES] }
    }

    /// Sends what waits, then waits for bytes from the server and returns the events they make: none, one or many.
    /// After [`ClientEvent::Closed`] there is nothing more to wait for.
    ///
    /// It may be cancelled between events, as by `select!`: nothing is lost.
    ///
    /// # Errors
    /// [`NetError::Session`], [`NetError::Disconnected`], [`NetError::Broken`], [`NetError::Stalled`],
    /// `NetError::Tls`, [`NetError::SpeaksTls`]. The session's state stays readable.
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
        let sent = self.flush().await;
        if self.session.is_closed() {
            return sent.map(|()| Vec::new());
        }
        let count = match sent {
            Ok(()) => self.read().await?,
            // Whoever closes a connection may have said why before.
            Err(broken) => match timeout(FAREWELL_TIMEOUT, self.read()).await {
                Ok(Ok(count)) => count,
                Ok(Err(NetError::Broken { .. } | NetError::Disconnected { .. })) | Err(_) => {
                    return Err(broken);
                }
                Ok(Err(told)) => return Err(told),
            },
        };
        let bytes = self.buffer.get(..count).unwrap_or_default();
        let result = self.session.handle_with(bytes, elapsed_since(self.started), tap);
        self.finish_with(result).await
    }

    /// Reads into the buffer: at least one byte. Calls the session whenever it wants to be called.
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
                // Nothing, or TLS without its own goodbye.
                _ => Err(NetError::Disconnected {
                    address: self.address.clone(),
                    unfinished: self.session.unfinished_bytes(),
                }),
            };
        }
    }

    /// Sends what waits: views, edits, requests, a close. It may be cancelled: nothing is lost.
    ///
    /// # Errors
    /// [`NetError::Broken`], `NetError::Tls`; [`NetError::Stalled`] when the server takes nothing for
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

    /// Writes as much as goes at once; false when nothing is left.
    async fn write_some(&mut self) -> std::io::Result<bool> {
        if self.session.output().is_empty() {
            // TLS keeps bytes of its own.
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

    /// Returns the session: its state, and what to tell the server. What it is told goes out with the next
    /// [`flush`](Self::flush) or [`next_events`](Self::next_events).
    pub const fn session(&mut self) -> &mut ClientSession {
        &mut self.session
    }

    /// Returns the state after the last frame; `None` before the scene is known.
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

    /// Passes on what the session says. When it failed, the other end is told if that is still possible.
    async fn finish_with<T>(&mut self, result: Result<T, SessionError>) -> Result<T, NetError> {
        let source = match result {
            Ok(events) => return Ok(events),
            Err(source) => source,
        };
        // The error at hand says more than a socket that broke after it.
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
