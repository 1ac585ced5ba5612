//! The byte stream of a connection of any kind.

use std::net::SocketAddr;

use tokio::io::{AsyncRead, AsyncWrite};

use super::HostPort;

/// A stream to read from and write to.
pub(super) trait Duplex: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> Duplex for T {}

/// A connection of any kind. The cost of a dynamic call is small beside its system call.
pub(super) type Stream = Box<dyn Duplex>;

/// Returns whether an address belongs to this machine only.
pub(super) fn is_local(address: &SocketAddr) -> bool {
    address.ip().to_canonical().is_loopback()
}

/// Returns all socket addresses of a host and port.
pub(super) async fn resolve(place: &HostPort) -> std::io::Result<Vec<SocketAddr>> {
    let found: Vec<_> = tokio::net::lookup_host((place.host.as_str(), place.port)).await?.collect();
    if found.is_empty() {
        return Err(std::io::Error::other("the name has no address"));
    }
    Ok(found)
}
