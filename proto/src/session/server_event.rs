//! Events, demands and counts of a client at its server.

use crate::FrameIndex;
use crate::message::{Ack, CameraPose, Close, Edit, Hello, KeyframeReason};

/// Event of a client at its server.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerEvent {
    /// The client was accepted. Its scene table is queued, and it needs a keyframe.
    Joined(Hello),
    /// The client sent its camera.
    View(CameraPose),
    /// The client asks for an edit of the scene. A server may ignore it.
    Edit(Edit),
    /// The client has applied a frame.
    Acked(Ack),
    /// The client has applied a frame but its state hash differs. It gets a keyframe.
    Diverged(Ack),
    /// The client asked for a keyframe. [`ServerSession::demand`](super::ServerSession::demand) is a keyframe until it
    /// is sent.
    KeyframeWanted(KeyframeReason),
    /// The client has left. No event follows.
    Closed(Close),
}

/// Kind of body that brings a client to the newest frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Demand {
    /// Nothing now. The client did not join yet, has left, or must first take the bytes that wait for it.
    Nothing,
    /// A keyframe.
    Keyframe,
    /// An update that builds on this frame: the stream's own, or a patch.
    Update {
        /// The frame that the client holds once all queued bytes have arrived.
        base: FrameIndex,
    },
    /// A patch with coder context that builds on this frame, because the client's last frames came without context.
    Patch {
        /// The frame that the client holds once all queued bytes have arrived, or a later one that it acknowledged.
        base: FrameIndex,
    },
    /// A patch without coder context, as datagrams.
    Datagrams {
        /// The frame that the client acknowledged last.
        base: FrameIndex,
    },
}

/// Counts of a server session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerStats {
    /// Bytes queued for the client, including datagrams but without dropped frames.
    pub wire_bytes: u64,
    /// Keyframes queued.
    pub keyframes: u64,
    /// Updates queued, patches included.
    pub updates: u64,
    /// Frames sent as datagrams.
    pub datagram_frames: u64,
    /// Updates and other frames dropped before or after they were queued.
    pub dropped: u64,
    /// Number of times that the client fell behind.
    pub lags: u64,
    /// Acknowledgements with a wrong state hash.
    pub diverged: u64,
    /// Frames of a type that this version does not know.
    pub unknown: u64,
    /// Datagrams that do not belong to this protocol.
    pub bad_datagrams: u64,
}
