//! REJECT: the server cannot serve a client.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, Text};
use crate::FrameType;

wire_enum! {
    /// Why a server refuses a client. Unknown values are kept; the text then tells the reason.
    #[derive(Encode, Decode)]
    pub struct RejectCode(u16), unknown "code" {
        /// The ends have no protocol version in common.
        VERSION = 1 => "VERSION",
        /// The client cannot decode the stream's profile.
        PROFILE = 2 => "PROFILE",
        /// The client cannot decode the stream's block coder.
        CODER = 3 => "CODER",
        /// The scene is over the client's limits.
        LIMITS = 4 => "LIMITS",
        /// The server is full.
        BUSY = 5 => "BUSY",
        /// The first frame was not a readable HELLO.
        BAD_HELLO = 6 => "BAD_HELLO",
        /// The server requires a token, and the client sent none or a wrong one before HELLO.
        CREDENTIAL = 7 => "CREDENTIAL",
    }
}

/// The answer to a HELLO that the server cannot serve. The server then closes the connection.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Reject {
    /// Reason, for programs.
    pub code: RejectCode,
    /// Reason and remedy, for display.
    pub text: Text<512>,
}

impl Reject {
    /// Creates a REJECT. A text over the limit is cut.
    #[must_use]
    pub fn new(code: RejectCode, text: &str) -> Self {
        Self { code, text: Text::cut(text) }
    }
}

impl Payload for Reject {
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }
}

impl Message for Reject {
    const KIND: FrameType = FrameType::REJECT;
    const NAME: &'static str = "REJECT";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        golden(&Reject::new(RejectCode::CODER, "no"), "0300 0200000000000000 6e6f");
        golden(&Reject::new(RejectCode(0xfffe), ""), "feff 0000000000000000");
        let bytes = [6, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff];
        let error = Reject::from_payload(&bytes).unwrap_err();
        assert_eq!(error.to_string(), "REJECT: cannot read its 12 bytes: a text in them is not UTF-8");
        let bytes = [6, 0, 1, 2, 0, 0, 0, 0, 0, 0, 0xff, 0xff];
        let error = Reject::from_payload(&bytes).unwrap_err().to_string();
        assert!(error.contains("longer than a message may be"), "{error}");
    }
}
