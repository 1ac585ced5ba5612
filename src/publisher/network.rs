//! Clients of a published stream.

use std::time::Duration;

use psao_proto::message::{CameraPose, CloseCode};
use psao_proto::net::{Address, Hub, HubEvent, ListenOptions, Listener};
use tokio::runtime::Runtime;

use super::{PublishError, Publisher};
use crate::runtime;

/// How long clients may take for what was sent when a stream ends.
const GOODBYE: Duration = Duration::from_secs(5);

/// The clients, and the thread that serves them.
#[derive(Debug)]
pub(super) struct Network {
    runtime: Runtime,
    hub: Hub,
}

impl Network {
    /// Says goodbye to all clients.
    pub(super) fn close(self, reason: &str) {
        self.runtime.block_on(self.hub.close(CloseCode::STOPPED, reason, GOODBYE));
    }
}

impl Publisher {
    /// Listens for clients at `host:port` or `unix:PATH`, and returns the address with the port that the system chose for
    /// port 0. It may be called for several addresses, at any time.
    ///
    /// # Errors
    /// As [`listen_with`](Self::listen_with). An address that other machines can reach needs TLS and a credential.
    pub fn listen(&mut self, address: &str) -> Result<Address, PublishError> {
        self.listen_with(address, &ListenOptions::default())
    }

    /// Listens for clients with options: certificates for `tls:host:port`, or an address that is open to everyone.
    ///
    /// # Errors
    /// [`PublishError::Address`], [`PublishError::Network`], [`PublishError::Runtime`].
    pub fn listen_with(&mut self, address: &str, options: &ListenOptions) -> Result<Address, PublishError> {
        let address: Address = address.parse()?;
        let Network { runtime, hub } = self.network()?;
        let listener = runtime.block_on(Listener::bind(hub, &address, options))?;
        let bound = listener.address().clone();
        runtime.spawn(listener.run());
        Ok(bound)
    }

    /// Returns the hub of this stream's clients, for programs that carry bytes themselves or want counts.
    ///
    /// # Errors
    /// [`PublishError::Runtime`].
    pub fn hub(&mut self) -> Result<&Hub, PublishError> {
        Ok(&self.network()?.hub)
    }

    /// Waits until `count` clients have joined, or for `patience`. Returns whether they have.
    ///
    /// # Errors
    /// [`PublishError::Runtime`].
    pub fn wait_for_clients(&mut self, count: usize, patience: Duration) -> Result<bool, PublishError> {
        let Network { runtime, hub } = self.network()?;
        Ok(runtime.block_on(hub.wait_joined(count, patience)))
    }

    /// Returns what clients did since the last call: joined, left, asked for edits.
    #[must_use]
    pub fn take_events(&mut self) -> Vec<HubEvent> {
        self.network.as_ref().map_or_else(Vec::new, |network| network.hub.take_events())
    }

    /// Returns the cameras of the clients that sent one: what is worth tracing now.
    #[must_use]
    pub fn views(&self) -> Vec<CameraPose> {
        self.network.as_ref().map_or_else(Vec::new, |network| network.hub.views())
    }

    fn network(&mut self) -> Result<&Network, PublishError> {
        match &mut self.network {
            Some(network) => Ok(network),
            none => {
                let runtime = runtime::start().map_err(|source| PublishError::Runtime { source })?;
                let hub = Hub::new(self.scene.clone(), self.coder, self.access.clone(), self.limits);
                self.sinks = std::mem::take(&mut self.sinks).with_hub(hub.clone());
                Ok(none.insert(Network { runtime, hub }))
            }
        }
    }
}
