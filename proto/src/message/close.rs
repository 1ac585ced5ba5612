//! CLOSE: the last frame of either end.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, Text};
use crate::FrameType;

wire_enum! {
    /// Reason for the end of a connection or recording. Unknown values are kept; the text then tells the reason.
    #[derive(Encode, Decode)]
    pub struct CloseCode(u16), unknown "code" {
        /// The stream is complete.
        DONE = 0 => "DONE",
        /// This end was stopped by its user.
        STOPPED = 1 => "STOPPED",
        /// The other end violated the protocol; the text tells how.
        PROTOCOL = 2 => "PROTOCOL",
        /// The other end took too long.
        TIMEOUT = 3 => "TIMEOUT",
        /// This end failed; the text tells how.
        FAILED = 4 => "FAILED",
        /// The stream's scene is not the client's scene.
        SCENE = 5 => "SCENE",
        /// The other end exceeded its rate of frames or bytes.
        FLOOD = 6 => "FLOOD",
    }
}

/// The last message of an end.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Close {
    /// Reason, for programs.
    pub code: CloseCode,
    /// Reason, for display.
    pub text: Text<512>,
}

impl Close {
    /// Creates a CLOSE. A text over the limit is cut.
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
