//! PING and PONG: whether the other end is there, and what its clock says.

use super::sealed::Payload;
use super::{FieldError, Message};
use crate::{FrameType, Micros};

/// Asks the other end to answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ping {
    /// When it was sent, by the clock of its sender.
    pub sent: Micros,
}

/// The answer to a PING.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pong {
    /// That of the PING.
    pub sent: Micros,
    /// When the PING came, by the clock of the answering end.
    pub received: Micros,
    /// When the answer went out, by the same clock.
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
