//! Listeners, which accept connections of clients.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::time::sleep;

#[cfg(feature = "tls")]
use super::ServerTls;
use super::serve::serve;
use super::stream::{is_local, resolve};
#[cfg(unix)]
use super::unix::UnixSocketListener;
use super::{Address, HostPort, Hub, NetError, Peer};

/// Pause after a failed accept, for example when the process has no file descriptor left.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Rule for addresses that other machines can reach.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exposure {
    /// Such an address must use TLS and require a token or client certificates.
    #[default]
    Guarded,
    /// Any address is allowed, and every client is served. Use it on closed networks only.
    OpenToEveryone,
}

/// Options of a listener. By default without TLS, and guarded.
#[derive(Clone, Debug, Default)]
pub struct ListenOptions {
    exposure: Exposure,
    #[cfg(feature = "tls")]
    tls: Option<ServerTls>,
}

impl ListenOptions {
    /// Sets the rule for addresses that other machines can reach.
    #[must_use]
    pub const fn with_exposure(mut self, exposure: Exposure) -> Self {
        self.exposure = exposure;
        self
    }

    /// Sets the certificate, for addresses `tls:host:port`.
    #[cfg(feature = "tls")]
    #[must_use]
    pub fn with_tls(mut self, tls: ServerTls) -> Self {
        self.tls = Some(tls);
        self
    }

    const fn has_tls(&self) -> bool {
        #[cfg(feature = "tls")]
        return self.tls.is_some();
        #[cfg(not(feature = "tls"))]
        return false;
    }

    /// Returns whether clients must show certificates.
    fn requires_client_certificates(&self) -> bool {
        #[cfg(feature = "tls")]
        return self.tls.as_ref().is_some_and(ServerTls::requires_client_certificates);
        #[cfg(not(feature = "tls"))]
        return false;
    }

    /// Refuses an address that unknown clients could use.
    fn check_exposure(
        &self,
        address: &Address,
        places: &[SocketAddr],
        has_token: bool,
    ) -> Result<(), NetError> {
        if self.exposure == Exposure::OpenToEveryone || places.iter().all(is_local) {
            return Ok(());
        }
        let lacks =
            match (matches!(address, Address::Tls(_)), has_token || self.requires_client_certificates()) {
                (true, true) => return Ok(()),
                (true, false) => "asks nobody for a token or a certificate",
                (false, true) => "has no TLS",
                (false, false) => "has no TLS and asks nobody for a token or a certificate",
            };
        Err(NetError::Exposed { address: address.to_string(), lacks })
    }
}

/// A bound address at which a server accepts clients.
#[derive(Debug)]
pub struct Listener {
    hub: Hub,
    address: Address,
    socket: Socket,
    #[cfg(feature = "tls")]
    tls: Option<ServerTls>,
}

#[derive(Debug)]
enum Socket {
    Tcp(TcpListener),
    #[cfg(unix)]
    Unix(UnixSocketListener),
}

impl Listener {
    /// Listens at `address` for clients of `hub`. With port 0 the system chooses a port. A stale Unix socket is
    /// replaced. The new socket belongs to its owner alone (mode 0600) and is removed when the listener is dropped.
    ///
    /// # Errors
    /// [`NetError::Exposed`] for an address that other machines can reach, unless it has TLS and a credential or the
    /// options allow everyone; [`NetError::TlsNeeds`] and [`NetError::TlsUnused`] when address and options conflict;
    /// [`NetError::InUse`], [`NetError::NotASocket`], [`NetError::Bind`].
    pub async fn bind(hub: &Hub, address: &Address, options: &ListenOptions) -> Result<Self, NetError> {
        check_tls(address, options)?;
        let (address, socket) = match address {
            Address::Tcp(place) => {
                let (port, socket) = bind_tcp(hub, address, place, options).await?;
                (Address::Tcp(HostPort { port, ..place.clone() }), socket)
            }
            Address::Tls(place) => {
                let (port, socket) = bind_tcp(hub, address, place, options).await?;
                (Address::Tls(HostPort { port, ..place.clone() }), socket)
            }
            #[cfg(unix)]
            Address::Unix(path) => (address.clone(), Socket::Unix(UnixSocketListener::bind(path).await?)),
            #[cfg(not(unix))]
            Address::Unix(_) => {
                return Err(NetError::bind(address, std::io::ErrorKind::Unsupported.into()));
            }
        };
        Ok(Self {
            hub: hub.clone(),
            address,
            socket,
            #[cfg(feature = "tls")]
            tls: options.tls.clone(),
        })
    }

    /// Returns the address of the listener, with the chosen port.
    #[must_use]
    pub const fn address(&self) -> &Address {
        &self.address
    }

    /// Serves every client that connects, each in its own task, until the hub is closed or this future is dropped.
    pub async fn run(self) {
        let mut failing = false;
        loop {
            let accepted = tokio::select! {
                accepted = self.accept() => accepted,
                () = self.hub.closing() => return,
            };
            match accepted {
                Ok(()) => failing = false,
                // A failed accept must not end other sessions. Consecutive failures are reported once.
                Err(error) => {
                    if !std::mem::replace(&mut failing, true) {
                        self.hub.accept_failed(&error);
                    }
                    sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    /// Waits for one connection and starts its task.
    async fn accept(&self) -> std::io::Result<()> {
        let hub = self.hub.clone();
        match &self.socket {
            Socket::Tcp(listener) => {
                let (stream, from) = listener.accept().await?;
                // Frames must not wait for more data. If this fails, they are only later.
                let _ = stream.set_nodelay(true);
                self.start_tcp(hub, stream, from);
            }
            #[cfg(unix)]
            Socket::Unix(listener) => {
                let (stream, peer) = listener.accept().await?;
                tokio::spawn(serve(hub, peer, Box::new(stream)));
            }
        }
        Ok(())
    }

    fn start_tcp(&self, hub: Hub, stream: TcpStream, from: SocketAddr) {
        #[cfg(feature = "tls")]
        if let (Address::Tls(_), Some(tls)) = (&self.address, &self.tls) {
            tokio::spawn(super::serve::serve_tls(hub, from, stream, tls.clone()));
            return;
        }
        tokio::spawn(serve(hub, Peer::Tcp(from), Box::new(stream)));
    }
}

async fn bind_tcp(
    hub: &Hub,
    address: &Address,
    place: &HostPort,
    options: &ListenOptions,
) -> Result<(u16, Socket), NetError> {
    let refused = |source| NetError::bind(address, source);
    let places = resolve(place).await.map_err(refused)?;
    options.check_exposure(address, &places, hub.token().is_some())?;
    let listener = TcpListener::bind(&places[..]).await.map_err(refused)?;
    let port = listener.local_addr().map_err(refused)?.port();
    Ok((port, Socket::Tcp(listener)))
}

/// Checks that address and options agree about TLS.
fn check_tls(address: &Address, options: &ListenOptions) -> Result<(), NetError> {
    match (address, options.has_tls()) {
        (Address::Tls(_), false) => {
            Err(NetError::tls_needs(address, "the server's certificate and its private key"))
        }
        (Address::Tls(_), true) | (_, false) => Ok(()),
        (_, true) => Err(NetError::TlsUnused { address: address.to_string() }),
    }
}
