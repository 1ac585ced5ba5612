//! ACK: a client has applied a frame.

use super::sealed::Payload;
use super::{FieldError, Message};
use crate::{FrameIndex, FrameType, StateHash};

/// Acknowledges a frame that the client has applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ack {
    /// The frame.
    pub frame: FrameIndex,
    /// The client's state hash after it.
    pub hash: StateHash,
}

fields!(Ack { frame as FrameIndex, hash as StateHash });

impl Payload for Ack {
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }
}

impl Message for Ack {
    const KIND: FrameType = FrameType::ACK;
    const NAME: &'static str = "ACK";
}

#[cfg(test)]
mod tests {
    use super::super::testing::{dump, golden};
    use super::*;

    #[test]
    fn the_specifications_dump_is_a_frame_of_this_crate() {
        let spec = include_str!("../../../docs/spec/protocol.md");
        let ack = Ack { frame: FrameIndex(2), hash: StateHash(0x0102_0304_0506_0708) };
        assert_eq!(dump(spec), crate::Numbering::default().message(&ack).unwrap());
    }

    #[test]
    fn golden_bytes() {
        golden(
            &Ack { frame: FrameIndex(258), hash: StateHash(0x0102_0304_0506_0708) },
            "02010000 0807060504030201",
        );
    }
}
