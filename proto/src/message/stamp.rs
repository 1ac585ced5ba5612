//! STAMP: when a frame was made and sent.

use super::sealed::Payload;
use super::{FieldError, Message, require};
use crate::{FrameIndex, FrameType, Micros};

/// Goes before the KEYFRAME or UPDATE of its frame, to clients that asked for it. Times are those of the server's clock,
/// which a client knows from PONG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Number of the frame.
    pub frame: FrameIndex,
    /// When the scene was as the frame has it.
    pub captured: Micros,
    /// When the frame was given to the connection; not before `captured`.
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
