//! CLOSE: the last frame of either end.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, Text};
use crate::FrameType;

/// Why a connection or a recording ends. Unknown values survive and mean "some other reason; read the text".
#[derive(Clone, Copy, PartialEq, Eq, Encode, Decode)]
pub struct CloseCode(pub u16);

impl CloseCode {
    /// The stream is complete.
    pub const DONE: Self = Self(0);
    /// This end was told to stop.
    pub const STOPPED: Self = Self(1);
    /// The other end broke the protocol; the text says how.
    pub const PROTOCOL: Self = Self(2);
    /// The other end took too long.
    pub const TIMEOUT: Self = Self(3);
    /// This end failed; the text says how.
    pub const FAILED: Self = Self(4);
    /// The stream is of another scene than the one that this client draws.
    pub const SCENE: Self = Self(5);
    /// The other end said more than it may in the time.
    pub const FLOOD: Self = Self(6);
}

impl std::fmt::Debug for CloseCode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match *self {
            Self::DONE => "DONE",
            Self::STOPPED => "STOPPED",
            Self::PROTOCOL => "PROTOCOL",
            Self::TIMEOUT => "TIMEOUT",
            Self::FAILED => "FAILED",
            Self::SCENE => "SCENE",
            Self::FLOOD => "FLOOD",
            Self(other) => return write!(f, "code {other}"),
        })
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
    /// A close; a text over the bound is cut.
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
