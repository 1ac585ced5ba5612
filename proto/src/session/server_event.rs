//! Events, demands and counts of a client at its server.

use crate::FrameIndex;
use crate::message::{Ack, CameraPose, Close, Edit, Hello, KeyframeReason};

/// Event of a client at its server.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerEvent {
    /// It was accepted; the scene is on its way and it waits for a keyframe.
    Joined(Hello),
    /// It looks from here now.
    View(CameraPose),
    /// It wants the scene changed. A server may ignore it.
    Edit(Edit),
    /// It holds a frame.
    Acked(Ack),
    /// It says that it holds a frame, but with another hash than the frame's: it gets a keyframe.
    Diverged(Ack),
    /// It cannot go on without a keyframe; [`ServerSession::demand`](super::ServerSession::demand) says so until it got one.
    KeyframeWanted(KeyframeReason),
    /// It left. Nothing follows.
    Closed(Close),
}

/// What brings a client to the newest frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Demand {
    /// Nothing now. It did not join yet, has left, or must first take the bytes that wait for it.
    Nothing,
    /// A keyframe.
    Keyframe,
    /// An update that builds on this frame: the stream's own, or a patch.
    Update {
        /// What it holds once everything queued has arrived.
        base: FrameIndex,
    },
    /// A patch with context that builds on this frame: what it has now came without.
    Patch {
        /// What it holds once everything queued has arrived, or has acknowledged.
        base: FrameIndex,
    },
    /// A patch without context, as datagrams.
    Datagrams {
        /// What it has acknowledged.
        base: FrameIndex,
    },
}

/// Counts of a server session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerStats {
    /// Bytes queued for the client, dropped ones left out; datagrams included.
    pub wire_bytes: u64,
    /// Keyframes queued.
    pub keyframes: u64,
    /// Updates queued, patches included.
    pub updates: u64,
    /// Frames that went as datagrams.
    pub datagram_frames: u64,
    /// Updates and other frames dropped, before or after they were queued.
    pub dropped: u64,
    /// How often the client fell behind.
    pub lags: u64,
    /// Acknowledgements whose hash was not the frame's.
    pub diverged: u64,
    /// Frames of a type that this version does not know.
    pub unknown: u64,
    /// Datagrams that do not belong to this protocol.
    pub bad_datagrams: u64,
}
