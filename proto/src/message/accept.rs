//! ACCEPT: the server accepts a client.

use super::sealed::Payload;
use super::{FieldError, Message, PeerLimits, Text, require};
use crate::{FrameType, Profile};

/// The answer to a HELLO that the server can serve. SCENE frames follow.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Accept {
    /// Protocol version of the session.
    pub version: u16,
    /// Profile of the stream.
    pub profile: Profile,
    /// Limits of the server. No message of a client comes near them today.
    pub limits: PeerLimits,
    /// Name of the server, for display.
    pub name: Text<64>,
}

fields!(Accept { version, profile as Profile, limits, name });

impl Payload for Accept {
    fn check(&self) -> Result<(), FieldError> {
        require(self.version >= 1, "version", "is 0")
    }
}

impl Message for Accept {
    const KIND: FrameType = FrameType::ACCEPT;
    const NAME: &'static str = "ACCEPT";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let limits = PeerLimits { frame_bytes: 1, instances: 2, buckets: 3, cells: 4, points: 5 };
        let accept = Accept { version: 1, profile: Profile(1), limits, name: Text::new("s").unwrap() };
        golden(&accept, "0100 01 01000000 02000000 03000000 04000000 05000000 0100000000000000 73");
        assert!(Accept { version: 0, ..accept }.to_payload().is_err());
    }
}
