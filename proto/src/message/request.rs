//! REQUEST: a client requests a keyframe, stamps or datagrams.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, require};
use crate::FrameType;
use crate::session::MIN_DATAGRAM_BYTES;

wire_enum! {
    /// Why a client needs a keyframe. Unknown values are kept and served too.
    #[derive(Encode, Decode)]
    pub struct KeyframeReason(u8), unknown "reason" {
        /// The state hash after an update differed from the one in its header.
        HASH = 1 => "HASH",
        /// A group or sequence number was skipped.
        GAP = 2 => "GAP",
        /// A frame body could not be read.
        BODY = 3 => "BODY",
        /// The user or program at the client asked for it.
        ASKED = 4 => "ASKED",
    }
}

/// A client's request. An unknown choice is a protocol error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum Request {
    /// A keyframe as soon as possible. A client asks once until it arrives.
    Keyframe {
        /// Why the client needs it.
        reason: KeyframeReason,
    },
    /// A STAMP before every later keyframe and update.
    Stamps,
    /// Later updates as datagrams, if the connection supports datagrams.
    Datagrams {
        /// Largest datagram in bytes, at least [`MIN_DATAGRAM_BYTES`](crate::session::MIN_DATAGRAM_BYTES).
        bytes: u16,
    },
}

impl Payload for Request {
    fn check(&self) -> Result<(), FieldError> {
        let Self::Datagrams { bytes } = self else { return Ok(()) };
        require(*bytes >= MIN_DATAGRAM_BYTES, "bytes", "is less than a datagram has")
    }
}

impl Message for Request {
    const KIND: FrameType = FrameType::REQUEST;
    const NAME: &'static str = "REQUEST";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::super::{MessageError, PayloadError};
    use super::*;

    #[test]
    fn golden_bytes() {
        golden(&Request::Keyframe { reason: KeyframeReason::GAP }, "00000000 02");
        golden(&Request::Stamps, "01000000");
        golden(&Request::Datagrams { bytes: 1200 }, "02000000 b004");
        assert!(Request::Datagrams { bytes: MIN_DATAGRAM_BYTES - 1 }.to_payload().is_err());
        let unknown = Request::from_payload(&[3, 0, 0, 0, 2]);
        let reason = PayloadError::Variant(3);
        assert_eq!(unknown, Err(MessageError::Malformed { message: "REQUEST", length: 5, reason }));
    }
}
