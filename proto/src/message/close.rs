//! CLOSE: the last frame of either end.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, Text};
use crate::FrameType;

wire_enum! {
    /// Why a connection or a recording ends. Unknown values survive and mean "some other reason; read the text".
    #[derive(Encode, Decode)]
    pub struct CloseCode(u16), unknown "code" {
        /// The stream is complete.
        DONE = 0 => "DONE",
        /// This end was told to stop.
        STOPPED = 1 => "STOPPED",
        /// The other end broke the protocol; the text says how.
        PROTOCOL = 2 => "PROTOCOL",
        /// The other end took too long.
        TIMEOUT = 3 => "TIMEOUT",
        /// This end failed; the text says how.
        FAILED = 4 => "FAILED",
        /// The stream is of another scene than the one that this client draws.
        SCENE = 5 => "SCENE",
        /// The other end said more than it may in the time.
        FLOOD = 6 => "FLOOD",
    }
}

/// Says that nothing follows.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Close {
    /// Why, for programs.
    pub code: CloseCode,
    /// Why, for people.
    pub text: Text<512>,
}

impl Close {
    /// Creates a CLOSE; a text over the bound is cut.
    #[must_use]
    pub fn new(code: CloseCode, text: &str) -> Self {
        Self { code, text: Text::cut(text) }
    }
}

impl Payload for Close {
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }
}

impl Message for Close {
    const KIND: FrameType = FrameType::CLOSE;
    const NAME: &'static str = "CLOSE";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        golden(&Close::new(CloseCode::TIMEOUT, "late"), "0300 0400000000000000 6c617465");
        assert_eq!(Close::new(CloseCode::DONE, &"x".repeat(600)).text.as_str().len(), 512);
    }
}
