//! A live server as a stream to follow.

use std::collections::VecDeque;
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
    /// Events that came and were not returned yet.
    waiting: VecDeque<Event>,
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
        Ok(Self { runtime, connection, waiting: VecDeque::new(), closed: false })
    }

    pub(super) fn next_event(&mut self) -> Result<Option<Event>, SubscribeError> {
        while self.waiting.is_empty() && !self.closed {
            let events = self.runtime.block_on(self.connection.next_events())?;
            self.take(events);
        }
        Ok(self.waiting.pop_front())
    }

    pub(super) fn poll(&mut self) -> Result<Option<Event>, SubscribeError> {
        if self.waiting.is_empty() && !self.closed {
            // The runtime's thread has seen what the socket holds, so that one look is enough.
            let next = self.connection.next_events();
            let events = self.runtime.block_on(async { timeout(Duration::ZERO, next).await });
            if let Ok(events) = events {
                self.take(events?);
            }
        }
        Ok(self.waiting.pop_front())
    }

    pub(super) fn is_over(&self) -> bool {
        self.closed && self.waiting.is_empty()
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

    fn take(&mut self, events: Vec<ClientEvent>) {
        for event in events {
            self.closed |= matches!(event, ClientEvent::Closed(_));
            self.waiting.extend(translate(event));
        }
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
