//! What a client of the lab is and meets.

use psao_proto::{Limits, Micros};
use serde::Serialize;

use crate::conditions::{Conditions, ConditionsError, Fault};

/// How updates go to a client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Over the connection, reliable and in order.
    #[default]
    Stream,
    /// As datagrams of the size that the network takes; the rest goes over the connection.
    Datagram,
}

/// One client.
#[derive(Clone, Debug)]
pub struct ClientPlan {
    /// How updates go to it.
    pub mode: Mode,
    /// The network from the server to it.
    pub down: Conditions,
    /// The network from it to the server.
    pub up: Conditions,
    /// What goes wrong.
    pub faults: Vec<Fault>,
    /// When it starts to connect.
    pub joins: Micros,
    /// How long it waits after a connection broke before it starts again.
    pub reconnect: Micros,
    /// The server's limits for it.
    pub limits: Limits,
}

impl Default for ClientPlan {
    /// A client of a perfect network that is there from the start and waits for a second before it connects again.
    fn default() -> Self {
        Self {
            mode: Mode::Stream,
            down: Conditions::default(),
            up: Conditions::default(),
            faults: Vec::new(),
            joins: Micros(0),
            reconnect: Micros::from_secs(1),
            limits: Limits::default(),
        }
    }
}

impl ClientPlan {
    /// Creates a client with the same conditions both ways.
    #[must_use]
    pub fn symmetric(mode: Mode, conditions: Conditions) -> Self {
        Self { mode, down: conditions, up: conditions, ..Self::default() }
    }

    /// This, if it makes sense.
    ///
    /// # Errors
    /// [`ConditionsError`] says what does not.
    pub fn checked(self) -> Result<Self, ConditionsError> {
        self.down.checked()?;
        self.up.checked()?;
        for fault in &self.faults {
            fault.checked()?;
        }
        Ok(self)
    }

    /// Time for a packet there and one back, at worst.
    #[must_use]
    pub const fn round_trip(&self) -> Micros {
        self.down.longest_delay().plus(self.up.longest_delay())
    }
}
