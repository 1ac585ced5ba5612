//! HELLO: the abilities and limits of a client. It is the first frame of every connection, except for AUTH.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, Text, require};
use crate::{CoderId, FrameType, Limits, Profile};

/// A set of profiles. Bit `n` stands for the profile with wire id `n`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct ProfileSet(pub u32);

/// A set of block coders. Bit `n` stands for the coder with wire id `n`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct CoderSet(pub u32);

/// Returns the bit of an id; 0 for ids above 31.
const fn bit(id: u8) -> u32 {
    if id < 32 { 1 << id } else { 0 }
}

impl ProfileSet {
    /// Returns this set with `profile` added. Ids above 31 cannot be in a set.
    #[must_use]
    pub const fn with(self, profile: Profile) -> Self {
        Self(self.0 | bit(profile.0))
    }

    /// Returns whether the set contains `profile`.
    #[must_use]
    pub const fn has(self, profile: Profile) -> bool {
        self.0 & bit(profile.0) != 0
    }
}

impl CoderSet {
    /// Returns this set with `coder` added. Ids above 31 cannot be in a set.
    #[must_use]
    pub const fn with(self, coder: CoderId) -> Self {
        Self(self.0 | bit(coder.0))
    }

    /// Returns whether the set contains `coder`.
    #[must_use]
    pub const fn has(self, coder: CoderId) -> bool {
        self.0 & bit(coder.0) != 0
    }
}

/// Limits that one end sends to the other; see [`Limits`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct PeerLimits {
    /// Longest payload of a KEYFRAME or UPDATE frame, in bytes.
    pub frame_bytes: u32,
    /// Largest number of instances of a scene.
    pub instances: u32,
    /// Largest number of buckets of a scene.
    pub buckets: u32,
    /// Largest number of cells of a scene.
    pub cells: u32,
    /// Largest number of points of a scene in profile `surface`.
    pub points: u32,
}

/// Requests a stream. The layout of `oldest` and `newest` is the same in all versions.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Hello {
    /// Oldest protocol version that the client speaks.
    pub oldest: u16,
    /// Newest protocol version that the client speaks.
    pub newest: u16,
    /// Profiles that the client can decode.
    pub profiles: ProfileSet,
    /// Block coders that the client can decode.
    pub coders: CoderSet,
    /// Limits of the client.
    pub limits: PeerLimits,
    /// Program and version of the client, for display.
    pub name: Text<64>,
}

impl From<&Limits> for PeerLimits {
    fn from(limits: &Limits) -> Self {
        Self {
            frame_bytes: limits.codec.max_frame_bytes,
            instances: limits.codec.max_instances,
            buckets: limits.codec.max_buckets,
            cells: limits.codec.max_cells,
            points: limits.codec.max_points,
        }
    }
}

impl Payload for Hello {
    fn check(&self) -> Result<(), FieldError> {
        require(self.oldest >= 1 && self.oldest <= self.newest, "oldest", "is 0 or above `newest`")
    }
}

impl Message for Hello {
    const KIND: FrameType = FrameType::HELLO;
    const NAME: &'static str = "HELLO";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let hello = Hello {
            oldest: 1,
            newest: 2,
            profiles: ProfileSet::default().with(Profile(1)),
            coders: [0, 1, 2, 200].map(CoderId).into_iter().fold(CoderSet::default(), CoderSet::with),
            limits: PeerLimits {
                frame_bytes: 0x10000000,
                instances: 65_536,
                buckets: 7,
                cells: 9,
                points: 10,
            },
            name: Text::new("psao 0.1").unwrap(),
        };
        golden(
            &hello,
            "0100 0200 02000000 07000000 00000010 00000100 07000000 09000000 0a000000 0800000000000000 \
             7073616f20302e31",
        );
        assert!(
            hello.coders.has(CoderId(2)) && !hello.coders.has(CoderId(3)) && !hello.coders.has(CoderId(200))
        );
        assert!(Hello { oldest: 3, ..hello.clone() }.to_payload().is_err());
        assert!(Hello { oldest: 0, ..hello }.to_payload().is_err());
    }
}
