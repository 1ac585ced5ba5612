//! Sessions over sockets. Feature `tokio`; feature `tls` adds TLS.
//!
//! A server creates a [`Hub`] and binds a [`Listener`] to it. The listener serves every client that connects, and the
//! server's frame loop gives each frame to the hub. A client calls [`connect`] and takes events. An [`Address`] is TCP,
//! TLS over TCP, or a Unix socket; [`connect_in_process`] needs none.
//!
//! An address that other machines can reach must use TLS and require a token or client certificates, unless the server
//! opens it to everyone ([`Exposure`]). A faulty peer only ends its own connection. The hub reports it once, as
//! [`HubEvent::Left`] with a [`PeerError`].
//!
//! ```
//! use std::time::Duration;
//!
//! use psao_proto::message::CloseCode;
//! use psao_proto::net::{ConnectOptions, Hub, ListenOptions, Listener, connect};
//! use psao_proto::sample::SampleServer;
//! use psao_proto::session::{Access, ClientEvent};
//! use psao_proto::Limits;
//!
//! # #[tokio::main(flavor = "current_thread")]
//! # async fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
//! // The server: accept in the background, send frames from a loop.
//! let mut source = SampleServer::new()?;
//! let hub = Hub::new(source.scene().clone(), source.coder(), Access::Open, Limits::default());
//! let listener = Listener::bind(&hub, &"127.0.0.1:0".parse()?, &ListenOptions::default()).await?;
//! let address = listener.address().clone();
//! tokio::spawn(listener.run());
//! let server = tokio::spawn(async move {
//!     hub.wait_joined(1, Duration::from_secs(10)).await;
//!     for _ in 0..3 {
//!         let frame = source.step()?;
//!         hub.broadcast(&frame.info, frame.body, source.state().into(), hub.now())?;
//!         // In step: wait until every client has applied this frame.
//!         hub.wait_acked(frame.info.frame, Duration::from_secs(10)).await;
//!     }
//!     hub.close(CloseCode::DONE, "three frames are enough", Duration::from_secs(10)).await;
//!     Ok::<_, Box<dyn std::error::Error + Send + Sync>>(source.state().hash())
//! });
//!
//! // The client.
//! let mut connection = connect(&address, &ConnectOptions::default(), Limits::default()).await?;
//! let mut frames = Vec::new();
//! while let Some(event) = connection.next_event().await? {
//!     if let ClientEvent::Applied(frame) = event {
//!         frames.push(frame.info.frame.0);
//!     }
//! }
//! assert_eq!(frames, [0, 1, 2]);
//! assert_eq!(connection.session().state().map(|s| s.hash()), Some(server.await??));
//! # Ok(())
//! # }
//! ```

mod address;
mod client;
mod error;
mod hub;
mod listener;
mod peer;
mod serve;
mod stream;
#[cfg(test)]
mod tests;
#[cfg(feature = "tls")]
mod tls;
#[cfg(unix)]
mod unix;

pub use address::{Address, AddressError, HostPort};
pub use client::{ConnectOptions, Connection, connect, connect_in_process};
pub use error::NetError;
pub use hub::{Broadcast, ClientId, Hub, HubEvent};
pub use listener::{Exposure, ListenOptions, Listener};
pub use peer::{Peer, PeerError};
#[cfg(feature = "tls")]
pub use tls::{ClientTls, ServerTls, TlsCertificateError, TlsConfigError, TlsError};

use tokio::time::Instant;

use crate::Micros;

/// Bytes per read or write.
const CHUNK_BYTES: usize = 64 * 1024;

/// Returns the time since `start`.
fn elapsed_since(start: Instant) -> Micros {
    Micros(u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX))
}
