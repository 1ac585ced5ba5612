//! PING and PONG: checks that the other end is alive, and reads its clock.

use super::sealed::Payload;
use super::{FieldError, Message};
use crate::{FrameType, Micros};

/// Asks the other end for a PONG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ping {
    /// Time of sending, by the sender's clock.
    pub sent: Micros,
}

/// The answer to a PING.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pong {
    /// [`Ping::sent`] of the PING.
    pub sent: Micros,
    /// Arrival of the PING, by the clock of the answering end.
    pub received: Micros,
    /// Time of sending, by the same clock.
    pub replied: Micros,
}

fields!(Ping { sent as Micros });
fields!(Pong { sent as Micros, received as Micros, replied as Micros });

impl Payload for Ping {
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }
}

impl Message for Ping {
    const KIND: FrameType = FrameType::PING;
    const NAME: &'static str = "PING";
}

impl Payload for Pong {
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }
}

impl Message for Pong {
    const KIND: FrameType = FrameType::PONG;
    const NAME: &'static str = "PONG";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        golden(&Ping { sent: Micros(0x0102) }, "0201000000000000");
        let pong = Pong { sent: Micros(1), received: Micros(2), replied: Micros(3) };
        golden(&pong, "0100000000000000 0200000000000000 0300000000000000");
    }
}
