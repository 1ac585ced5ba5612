//! What an end is willing to hold: checked before every allocation whose size comes from the other end.

use crate::message::MAX_MESSAGE_BYTES;
use crate::{FrameType, Micros};

/// Bounds of a session or a reader, the codec's included.
///
/// ```
/// use psao_proto::{FrameType, Limits};
///
/// let mut limits = Limits::default();
/// limits.codec.max_frame_bytes = 1 << 20; // a small client: frames of at most 1 MiB
/// assert_eq!(limits.payload_limit(FrameType::KEYFRAME), 1 << 20);
/// assert_eq!(limits.payload_limit(FrameType::HELLO), 65_536);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bounds of frame bodies and of the state.
    pub codec: psao_codec::Limits,
    /// Server: bytes that wait for one client (default 8 MiB). When an update would go over it, the updates that wait
    /// are dropped and the client gets a keyframe once the rest is gone. A keyframe may be larger; it waits alone.
    pub max_queue_bytes: u32,
    /// Server: clients at a time (default 64).
    pub max_clients: u32,
    /// Time that a handshake may take, from the connection to the whole scene table (default 10 s).
    pub handshake: Micros,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            codec: psao_codec::Limits::default(),
            max_queue_bytes: 8 << 20,
            max_clients: 64,
            handshake: Micros::from_secs(10),
        }
    }
}

impl Limits {
    /// Longest payload of a frame of type `kind`, in bytes. Types that this version does not know have the bound of a
    /// control message, so that skipping them costs little.
    #[must_use]
    pub const fn payload_limit(&self, kind: FrameType) -> u32 {
        match kind {
            FrameType::KEYFRAME | FrameType::UPDATE | FrameType::INDEX => self.codec.max_frame_bytes,
            _ => MAX_MESSAGE_BYTES as u32,
        }
    }
}
