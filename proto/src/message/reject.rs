//! REJECT: the server cannot serve a client.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, Text};
use crate::FrameType;

wire_enum! {
    /// Why a server turns a client away. Unknown values survive and mean "some other reason; read the text".
    #[derive(Encode, Decode)]
    pub struct RejectCode(u16), unknown "code" {
        /// The ends have no protocol version in common.
        VERSION = 1 => "VERSION",
        /// The client cannot apply the stream's profile.
        PROFILE = 2 => "PROFILE",
        /// The client cannot undo the stream's block coder.
        CODER = 3 => "CODER",
        /// The scene is over the client's limits.
        LIMITS = 4 => "LIMITS",
        /// The server has as many clients as it takes.
        BUSY = 5 => "BUSY",
        /// The first frame was not a HELLO that can be read.
        BAD_HELLO = 6 => "BAD_HELLO",
        /// The server wants a token, and none or a wrong one came before the HELLO.
        CREDENTIAL = 7 => "CREDENTIAL",
    }
}

/// The answer to a hello that the server cannot serve; the server closes the connection after it.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Reject {
    /// Why, for programs.
    pub code: RejectCode,
    /// Why and what to do, for people.
    pub text: Text<512>,
}

impl Reject {
    /// Creates a REJECT; a text over the bound is cut.
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
