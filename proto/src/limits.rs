//! Limits of an end. They are checked before every allocation whose size comes from the other end.

use psao_codec::setters;

use crate::message::MAX_MESSAGE_BYTES;
use crate::{FrameType, Micros};

/// Limits of a session or reader, including those of the codec.
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
#[non_exhaustive]
pub struct Limits {
    /// Limits of frame bodies and of the state.
    pub codec: psao_codec::Limits,
    /// Server: bytes that wait for one client (default 8 MiB). When an update would exceed the limit, the waiting
    /// updates are dropped. Once no bytes wait, the client gets a patch. A keyframe may be larger, but then waits
    /// alone.
    pub max_queue_bytes: u32,
    /// Server: unacknowledged frames of one client (default 64, about a second at 60 Hz). Beyond the limit the client
    /// counts as behind until at most half as many are unacknowledged. A value above 256 has no effect.
    pub max_unacked: u32,
    /// Server: largest number of clients at the same time (default 256).
    pub max_clients: u32,
    /// Server: frames per second that one client may send (default 2,000), in bursts of at most four times as many.
    pub max_frames_per_s: u32,
    /// Server: bytes per second that one client may send (default 1 MiB), in bursts of at most four times as many.
    pub max_bytes_per_s: u32,
    /// Largest frame body that is sent as datagrams (default 1 MiB). A larger one goes over the connection.
    pub max_datagram_body: u32,
    /// Time that a handshake may take, from the connection to the whole scene table (default 10 s).
    pub handshake: Micros,
    /// Time between two PINGs (default 2 s). A PING is left out while other bytes wait.
    pub keep_alive: Micros,
    /// Time without a byte from the other end after which the session ends (default 30 s).
    pub silence: Micros,
    /// Server: time without progress of waiting bytes after which the session ends (default 60 s).
    pub stall: Micros,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            codec: psao_codec::Limits::default(),
            max_queue_bytes: 8 << 20,
            max_unacked: 64,
            max_clients: 256,
            max_frames_per_s: 2_000,
            max_bytes_per_s: 1 << 20,
            max_datagram_body: 1 << 20,
            handshake: Micros::from_secs(10),
            keep_alive: Micros::from_secs(2),
            silence: Micros::from_secs(30),
            stall: Micros::from_secs(60),
        }
    }
}

impl Limits {
    setters! {
        with_codec: codec as psao_codec::Limits,
        with_max_queue_bytes: max_queue_bytes as u32,
        with_max_unacked: max_unacked as u32,
        with_max_clients: max_clients as u32,
        with_max_frames_per_s: max_frames_per_s as u32,
        with_max_bytes_per_s: max_bytes_per_s as u32,
        with_max_datagram_body: max_datagram_body as u32,
        with_handshake: handshake as Micros,
        with_keep_alive: keep_alive as Micros,
        with_silence: silence as Micros,
        with_stall: stall as Micros,
    }

    /// Returns the longest payload of a frame of type `kind`, in bytes. Unknown types have the limit of a control
    /// message, so that skipping them costs little.
    #[must_use]
    pub const fn payload_limit(&self, kind: FrameType) -> u32 {
        match kind {
            FrameType::KEYFRAME | FrameType::UPDATE | FrameType::INDEX => self.codec.max_frame_bytes,
            _ => MAX_MESSAGE_BYTES as u32,
        }
    }
}
