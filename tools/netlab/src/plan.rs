//! Plans of the lab's clients: their networks, faults and limits.

use psao_proto::{Limits, Micros};
use serde::Serialize;

use crate::conditions::{Conditions, ConditionsError, Fault};

/// Transport of a client's updates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The connection, reliable and in order.
    #[default]
    Stream,
    /// Datagrams of the network's packet size. All other frames use the connection.
    Datagram,
}

/// Plan of one client.
#[derive(Clone, Debug)]
pub struct ClientPlan {
    /// Transport of its updates.
    pub mode: Mode,
    /// The network from the server to it.
    pub down: Conditions,
    /// The network from it to the server.
    pub up: Conditions,
    /// Faults of its network.
    pub faults: Vec<Fault>,
    /// Time at which it starts to connect.
    pub joins: Micros,
    /// Pause between a broken connection and the next attempt to connect.
    pub reconnect: Micros,
    /// The server's limits for it.
    pub limits: Limits,
}

impl Default for ClientPlan {
    /// Returns a client on a perfect network that joins at the start and reconnects after a second.
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

    /// Returns the plan if it is valid.
    ///
    /// # Errors
    /// [`ConditionsError`] names the invalid value.
    pub fn checked(self) -> Result<Self, ConditionsError> {
        self.down.checked()?;
        self.up.checked()?;
        for fault in &self.faults {
            fault.checked()?;
        }
        Ok(self)
    }

    /// Returns the longest time for a packet in each direction together.
    #[must_use]
    pub const fn round_trip(&self) -> Micros {
        self.down.longest_delay().plus(self.up.longest_delay())
    }
}
