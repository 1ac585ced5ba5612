//! The bytes of a connection, whatever carries them.

use std::net::SocketAddr;

use tokio::io::{AsyncRead, AsyncWrite};

use super::HostPort;

/// Something to read from and write to.
pub(super) trait Duplex: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> Duplex for T {}

/// A connection of any kind. A call through the box costs nothing beside the system call behind it.
pub(super) type Stream = Box<dyn Duplex>;

/// Returns whether only this machine can be at that address.
pub(super) fn is_local(address: &SocketAddr) -> bool {
    address.ip().to_canonical().is_loopback()
}

/// All socket addresses of a host and port.
pub(super) async fn resolve(place: &HostPort) -> std::io::Result<Vec<SocketAddr>> {
    let found: Vec<_> = tokio::net::lookup_host((place.host.as_str(), place.port)).await?.collect();
    if found.is_empty() {
        return Err(std::io::Error::other("the name has no address"));
    }
    Ok(found)
}
