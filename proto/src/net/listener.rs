//! Accepting clients and carrying their bytes.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio::time::{Instant, sleep, timeout};

use super::{CHUNK, ClientId, Hub, NetError, since};

/// How long the last frames of a session may take to leave, and the other end to take them.
const LINGER: Duration = Duration::from_secs(2);
/// Pause after a failed accept, as when the process has no file descriptor left.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// A bound address that clients connect to.
#[derive(Debug)]
pub struct Listener {
    listener: TcpListener,
}

impl Listener {
    /// Listens at `address` (`host:port`; port 0 lets the system choose).
    ///
    /// # Errors
    /// [`NetError::InUse`], [`NetError::Bind`].
    pub async fn bind(address: &str) -> Result<Self, NetError> {
        let listener = TcpListener::bind(address).await.map_err(|source| NetError::bind(address, source))?;
        Ok(Self { listener })
    }

    /// The address that it listens at, with the port that was chosen.
    ///
    /// # Errors
    /// What the system says.
    pub fn local_addr(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves every client that connects, each in a task of its own, until the hub is closed or this is dropped.
    pub async fn run(self, hub: Hub) {
        while !hub.is_closing() {
            match self.listener.accept().await {
                Ok((stream, peer)) => drop(tokio::spawn(serve(hub.clone(), stream, peer))),
                // One client that could not be accepted must not end the others.
                Err(_) => sleep(ACCEPT_PAUSE).await,
            }
        }
    }
}

/// One client, from accept to the end.
async fn serve(hub: Hub, stream: TcpStream, peer: SocketAddr) {
    // Frames must not wait for company. Where this fails they are late, no more.
    let _ = stream.set_nodelay(true);
    let (id, wake) = hub.add(peer);
    let (mut from, mut to) = stream.into_split();
    {
        let reading = read_all(&hub, id, &mut from);
        let writing = write_all(&hub, id, &wake, &mut to);
        tokio::pin!(reading, writing);
        tokio::select! {
            // The client is gone, or said something that ends the session: what waits may still go out.
            () = &mut reading => { let _ = timeout(LINGER, writing).await; }
            () = &mut writing => {}
        }
    }
    let _ = to.shutdown().await;
    // A socket closed with bytes unread is reset, and the last frames may be lost with it.
    let _ = timeout(LINGER, discard(&mut from)).await;
    hub.remove(id);
}

/// Reads until the connection or the session ends.
async fn read_all(hub: &Hub, id: ClientId, from: &mut OwnedReadHalf) {
    let started = Instant::now();
    let mut buffer = vec![0; CHUNK];
    loop {
        let read = from.read(&mut buffer);
        let result = if hub.is_joined(id) {
            read.await
        } else {
            let left = hub.limits().handshake.since(since(started)).0;
            match timeout(Duration::from_micros(left + 1), read).await {
                Ok(result) => result,
                Err(_) => {
                    // Says whether the deadline has passed, and to the client that it has.
                    if hub.received(id, &[], since(started)) {
                        continue;
                    }
                    return;
                }
            }
        };
        match result {
            Ok(0) | Err(_) => return,
            Ok(count) => {
                if !hub.received(id, buffer.get(..count).unwrap_or_default(), since(started)) {
                    return;
                }
            }
        }
    }
}

/// Writes whatever waits, until the session is over or the connection is.
async fn write_all(hub: &Hub, id: ClientId, wake: &Notify, to: &mut OwnedWriteHalf) {
    loop {
        let (bytes, over) = hub.take_output(id, CHUNK);
        if !bytes.is_empty() && to.write_all(&bytes).await.is_err() {
            return;
        }
        if over {
            return;
        }
        if bytes.is_empty() {
            wake.notified().await;
        }
    }
}

async fn discard(from: &mut OwnedReadHalf) {
    let mut buffer = vec![0; CHUNK];
    while matches!(from.read(&mut buffer).await, Ok(count) if count > 0) {}
}
