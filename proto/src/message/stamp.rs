//! STAMP: capture and send times of a frame.

use super::sealed::Payload;
use super::{FieldError, Message, require};
use crate::{FrameIndex, FrameType, Micros};

/// Capture and send times of a frame, by the server's clock. It precedes the KEYFRAME or UPDATE of its frame, for
/// clients that asked for it. A client estimates the server's clock from PONG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Number of the frame.
    pub frame: FrameIndex,
    /// Time of the scene that the frame shows.
    pub captured: Micros,
    /// Time at which the frame was given to the connection, not before `captured`.
    pub sent: Micros,
}

fields!(Stamp { frame as FrameIndex, captured as Micros, sent as Micros });

impl Payload for Stamp {
    fn check(&self) -> Result<(), FieldError> {
        require(self.captured <= self.sent, "sent", "is before `captured`")
    }
}

impl Message for Stamp {
    const KIND: FrameType = FrameType::STAMP;
    const NAME: &'static str = "STAMP";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let stamp = Stamp { frame: FrameIndex(5), captured: Micros(1), sent: Micros(2) };
        golden(&stamp, "05000000 0100000000000000 0200000000000000");
        assert!(Stamp { captured: Micros(3), ..stamp }.to_payload().is_err());
    }
}
