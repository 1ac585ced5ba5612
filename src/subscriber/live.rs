//! A live server as a stream to follow.

use std::time::Duration;

use psao_codec::State;
use psao_proto::Limits;
use psao_proto::message::{CameraPose, Edit};
use psao_proto::net::{Address, ConnectOptions, Connection, connect};
use psao_proto::session::ClientEvent;
use tokio::runtime::Runtime;
use tokio::time::timeout;

use super::{Event, SubscribeError};
use crate::runtime;

/// A connection, and the thread that watches its socket.
#[derive(Debug)]
pub(super) struct Live {
    runtime: Runtime,
    connection: Connection,
    closed: bool,
}

impl Live {
    pub(super) fn connect(
        address: &str,
        options: &ConnectOptions,
        limits: Limits,
    ) -> Result<Self, SubscribeError> {
        let address: Address = address.parse()?;
        let runtime = runtime::start().map_err(|source| SubscribeError::Runtime { source })?;
        let connection = runtime.block_on(connect(&address, options, limits))?;
        Ok(Self { runtime, connection, closed: false })
    }

    pub(super) fn next_event(&mut self) -> Result<Option<Event>, SubscribeError> {
        while !self.closed {
            let next = self.runtime.block_on(self.connection.next_event())?;
            if let Some(event) = self.take(next) {
                return Ok(Some(event));
            }
        }
        Ok(None)
    }

    pub(super) fn poll(&mut self) -> Result<Option<Event>, SubscribeError> {
        while !self.closed {
            // The runtime's thread has seen what the socket holds, so that one look is enough.
            let next = self.connection.next_event();
            let next = self.runtime.block_on(async { timeout(Duration::ZERO, next).await });
            let Ok(next) = next else { break };
            if let Some(event) = self.take(next?) {
                return Ok(Some(event));
            }
        }
        Ok(None)
    }

    pub(super) fn is_over(&self) -> bool {
        self.closed
    }

    pub(super) fn state(&self) -> Option<&State> {
        self.connection.state()
    }

    pub(super) fn set_view(&mut self, camera: &CameraPose) -> Result<(), SubscribeError> {
        Ok(self.connection.session().set_view(camera)?)
    }

    pub(super) fn edit(&mut self, edit: &Edit) -> Result<(), SubscribeError> {
        Ok(self.connection.session().edit(edit)?)
    }

    /// Returns what the connection's next event means to the user, if anything. After its last one the stream is over.
    fn take(&mut self, next: Option<ClientEvent>) -> Option<Event> {
        self.closed = matches!(next, None | Some(ClientEvent::Closed(_)));
        next.and_then(translate)
    }
}

/// Returns what a session's event means to the user of a stream; `None` for a handshake.
fn translate(event: ClientEvent) -> Option<Event> {
    Some(match event {
        ClientEvent::SceneReady(scene) => Event::Scene(scene),
        ClientEvent::Applied(frame) => Event::Frame(frame.info),
        ClientEvent::Unusable { reason, .. } => Event::Unusable(reason),
        ClientEvent::HashMismatch { frame, expected, found } => {
            Event::HashMismatch { frame, expected, found }
        }
        ClientEvent::Report(report) => Event::Report(report),
        ClientEvent::Budget(budget) => Event::Budget(budget),
        ClientEvent::Edited(edit) => Event::Edit(edit),
        ClientEvent::Closed(close) => Event::Closed(close),
        _ => return None,
    })
}
