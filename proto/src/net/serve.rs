//! One client's connection at a server.

use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadHalf, WriteHalf, split};
use tokio::sync::Notify;
use tokio::time::timeout;

use super::stream::Stream;
use super::{CHUNK_BYTES, ClientId, Hub, Peer, PeerError};

/// Time limit for the last frames of a session, and for the other end to take them.
const LINGER: Duration = Duration::from_secs(2);
/// Bytes per read from a client. Messages of clients are short.
const READ_CHUNK_BYTES: usize = 4 * 1024;

/// Serves a client over an open connection.
pub(super) async fn serve(hub: Hub, peer: Peer, stream: Stream) {
    let Some((id, wake)) = hub.add(peer) else { return };
    // Starts the session's deadline.
    hub.tick(id);
    run_session(&hub, id, &wake, stream).await;
    hub.remove(id);
}

/// Does the same as [`serve`] after a TLS handshake, which counts against the deadline of the session's handshake.
#[cfg(feature = "tls")]
pub(super) async fn serve_tls(
    hub: Hub,
    from: std::net::SocketAddr,
    stream: tokio::net::TcpStream,
    tls: super::ServerTls,
) {
    let Some((id, wake)) = hub.add(Peer::Tls(from)) else { return };
    // Starts the session's deadline.
    hub.tick(id);
    let deadline = hub.time_to_deadline(id).unwrap_or_default();
    let accepting = timeout(deadline, tls.acceptor().accept(stream).into_fallible());
    tokio::select! {
        result = accepting => match result {
            Ok(Ok(stream)) => run_session(&hub, id, &wake, Box::new(stream)).await,
            Ok(Err((error, stream))) => {
                let fault = super::TlsError::of_handshake(&error).map(PeerError::Tls);
                hub.fault(id, fault.unwrap_or_else(|| PeerError::broken(&error)));
                let (mut from, mut to) = stream.into_split();
                close_gracefully(&mut from, &mut to).await;
            }
            // The session reports that its deadline has passed.
            Err(_) => drop(hub.tick(id)),
        },
        () = hub.closing() => {}
    }
    hub.remove(id);
}

/// Carries a session's bytes until the session or the connection ends.
async fn run_session(hub: &Hub, id: ClientId, wake: &Notify, stream: Stream) {
    let (mut from, to) = split(stream);
    let mut outgoing = Outgoing { to, bytes: Vec::new(), sent: 0 };
    tokio::select! {
        () = read_all(hub, id, &mut from) => {}
        () = write_all(hub, id, wake, &mut outgoing) => {}
    }
    // Waiting bytes are still sent, within a time limit.
    let _ = timeout(LINGER, write_all(hub, id, wake, &mut outgoing)).await;
    close_gracefully(&mut from, &mut outgoing.to).await;
}

/// Closes the connection so that the last frames arrive. Unread bytes would reset the socket and could lose these
/// frames, so they are read first.
async fn close_gracefully(from: &mut (impl AsyncRead + Unpin), to: &mut (impl AsyncWrite + Unpin)) {
    let closing = async {
        let _ = to.shutdown().await;
        let mut buffer = vec![0; READ_CHUNK_BYTES];
        while matches!(from.read(&mut buffer).await, Ok(count) if count > 0) {}
    };
    let _ = timeout(LINGER, closing).await;
}

/// Reads until the connection or the session ends.
async fn read_all(hub: &Hub, id: ClientId, from: &mut ReadHalf<Stream>) {
    let mut buffer = vec![0; READ_CHUNK_BYTES];
    loop {
        let read = from.read(&mut buffer);
        let result = match hub.time_to_deadline(id) {
            None => read.await,
            Some(deadline) => match timeout(deadline, read).await {
                Ok(result) => result,
                Err(_) if hub.tick(id) => continue,
                Err(_) => return,
            },
        };
        match result {
            Ok(0) => return hub.disconnected(id),
            Err(error) => return hub.fault(id, PeerError::broken(&error)),
            Ok(count) => {
                if !hub.received(id, buffer.get(..count).unwrap_or_default()) {
                    return;
                }
            }
        }
    }
}

/// Bytes that are being sent to a client.
struct Outgoing {
    to: WriteHalf<Stream>,
    bytes: Vec<u8>,
    /// Number of bytes sent.
    sent: usize,
}

/// Writes waiting bytes until the session or connection ends, or the client takes no bytes for too long.
async fn write_all(hub: &Hub, id: ClientId, wake: &Notify, outgoing: &mut Outgoing) {
    let stall = Duration::from_micros(hub.limits().stall.0);
    loop {
        match timeout(stall, outgoing.write_some()).await {
            Ok(Ok(true)) => {}
            Ok(Ok(false)) => {
                let (bytes, over) = hub.take_output(id, CHUNK_BYTES);
                if bytes.is_empty() && over {
                    return;
                }
                if bytes.is_empty() {
                    wake.notified().await;
                }
                (outgoing.bytes, outgoing.sent) = (bytes, 0);
            }
            Ok(Err(error)) => return hub.fault(id, PeerError::broken(&error)),
            Err(_) => return hub.stalled(id),
        }
    }
}

impl Outgoing {
    /// Writes as many bytes as the stream takes at once. Returns false when none are left. This method is cancel-safe.
    async fn write_some(&mut self) -> std::io::Result<bool> {
        let rest = self.bytes.get(self.sent..).unwrap_or_default();
        if rest.is_empty() {
            // TLS buffers bytes itself.
            self.to.flush().await?;
            return Ok(false);
        }
        match self.to.write(rest).await? {
            0 => Err(std::io::ErrorKind::WriteZero.into()),
            count => {
                self.sent += count;
                Ok(true)
            }
        }
    }
}
