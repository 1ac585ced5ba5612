//! Events and counts of a client session.

use std::sync::Arc;

use psao_codec::envelope::FrameInfo;

use crate::follow::FollowError;
use crate::message::{Accept, Budget, Close, Edit, Report, Stamp};
use crate::{FrameHeader, FrameIndex, Group, Micros, SceneTable, Sequence, StateHash};

/// A frame that the client has applied.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AppliedFrame {
    /// Header of its body: frame number, time, hash, sections.
    pub info: FrameInfo,
    /// Group of its wire frame.
    pub group: Group,
    /// Sequence number of its wire frame in the group.
    pub sequence: Sequence,
    /// Its bytes on the wire, including headers of frames and datagrams.
    pub wire_bytes: u64,
    /// Time at which its last byte was given to the session.
    pub received: Micros,
    /// Times of capture and sending, if the client asked for stamps, by the server's clock
    /// ([`ClientSession::clock`](super::ClientSession::clock)).
    pub stamp: Option<Stamp>,
}

/// Event of a client session.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The server has accepted this client. The scene table follows.
    Accepted(Accept),
    /// The scene table is complete. A keyframe follows.
    SceneReady(Arc<SceneTable>),
    /// The state is that of a newer frame.
    Applied(AppliedFrame),
    /// The state after an update would have differed from the server's. The update was not applied, and a keyframe was
    /// requested.
    HashMismatch {
        /// The frame.
        frame: FrameIndex,
        /// The server's hash after it.
        expected: StateHash,
        /// The hash that the client would have had.
        found: StateHash,
    },
    /// A keyframe or update could not be applied for another reason. The state is unchanged; a keyframe was requested.
    Unusable {
        /// Header of its wire frame.
        header: FrameHeader,
        /// Why.
        reason: FollowError,
    },
    /// Server statistics of a frame.
    Report(Report),
    /// Use of the byte budget by a frame.
    Budget(Budget),
    /// Every later frame includes this edit of the scene.
    Edited(Edit),
    /// The server has ended the stream. No event follows.
    Closed(Close),
}

/// Counts of a client session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClientStats {
    /// Bytes received.
    pub wire_bytes: u64,
    /// Keyframes and updates applied.
    pub applied: u64,
    /// Keyframes and updates that could not be applied.
    pub unusable: u64,
    /// Those of them whose state hash differed.
    pub hash_mismatches: u64,
    /// Keyframes requested.
    pub requests: u64,
    /// Frames of a type that this version does not know.
    pub unknown: u64,
    /// Datagrams received.
    pub datagrams: u64,
    /// Datagrams that do not belong to this protocol.
    pub bad_datagrams: u64,
    /// Bodies in datagrams that came too late or build on a missing frame, and updates on the connection that datagrams
    /// superseded.
    pub late_datagram_frames: u64,
}
