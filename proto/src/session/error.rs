//! Errors of sessions.

use crate::message::{MessageError, Reject};
use crate::{FrameType, FramerError, Micros, SceneError, WireFrameError};

/// Why a session cannot go on. The state of a client stays.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The first bytes do not belong to this protocol.
    #[error(
        "the other end does not speak the psao protocol (its first bytes are {found:#06x}): is this the right address and port?"
    )]
    NotPsao {
        /// Its first two bytes, little endian.
        found: u16,
    },
    /// The bytes are not frames any more.
    #[error("{0}")]
    Framer(FramerError),
    /// A control message is invalid.
    #[error("the other end sent a bad message: {0}")]
    Message(#[from] MessageError),
    /// The SCENE messages do not form a valid scene table.
    #[error("the server sent a bad scene: {0}")]
    Scene(#[from] SceneError),
    /// A frame is not allowed at this point of the session.
    #[error("a {kind} frame came while {state}")]
    Unexpected {
        /// Type of the frame.
        kind: FrameType,
        /// State of the session.
        state: &'static str,
    },
    /// The ends have no protocol version in common.
    #[error(
        "the {peer} speaks protocol versions {oldest} to {newest}, this program {}: update the older of the two",
        own_versions()
    )]
    Version {
        /// `client` or `server`.
        peer: &'static str,
        /// Oldest version of the other end.
        oldest: u16,
        /// Newest version of the other end.
        newest: u16,
    },
    /// The server refused this client.
    #[error("the server refused: {} ({:?})", .0.text, .0.code)]
    Rejected(Reject),
    /// This server refused a client.
    #[error("turned the client away: {} ({:?})", .0.text, .0.code)]
    BadHello(Reject),
    /// The handshake took too long.
    #[error("the handshake was not complete after {:.1} s: the other end is stuck, or speaks another protocol", waited.as_secs_f64())]
    HandshakeTimeout {
        /// Time since its start.
        waited: Micros,
    },
    /// The other end sent nothing for too long.
    #[error("nothing came from the other end for {:.1} s: it hangs, or the network between is gone", waited.as_secs_f64())]
    Silent {
        /// Time since the last byte.
        waited: Micros,
    },
    /// The client took no bytes for too long, although bytes wait for it.
    #[error("the client took none of the bytes that wait for it for {:.1} s: it hangs, or the network between is gone", waited.as_secs_f64())]
    Stalled {
        /// Time since the last byte.
        waited: Micros,
    },
    /// The client exceeded its rate of frames or bytes.
    #[error("the client sent more than {limit} {what} a second")]
    Flood {
        /// Frames or bytes.
        what: &'static str,
        /// Allowed number per second.
        limit: u32,
    },
    /// The stream's scene is not the client's scene.
    #[error(
        "the server streams \"{name}\", whose digest {} is not that of the scene here, {}: its AO would be drawn on the wrong surfaces",
        hex(found),
        hex(expected)
    )]
    OtherScene {
        /// Name of the server's scene.
        name: String,
        /// Digest of the client's scene.
        expected: [u8; 32],
        /// Digest in the stream.
        found: [u8; 32],
    },
    /// The server chose a profile or coder that this client did not offer.
    #[error("the server chose {what}, which this client did not offer")]
    NotOffered {
        /// The server's choice.
        what: &'static str,
    },
}

/// Returns the first bytes of a digest, which are enough to tell two digests apart.
fn hex(digest: &[u8; 32]) -> String {
    digest.iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}

fn own_versions() -> String {
    match (super::OLDEST_VERSION, super::NEWEST_VERSION) {
        (oldest, newest) if oldest == newest => newest.to_string(),
        (oldest, newest) => format!("{oldest} to {newest}"),
    }
}

impl From<FramerError> for SessionError {
    fn from(error: FramerError) -> Self {
        match error {
            FramerError { offset: 0, error: WireFrameError::Magic { found } } => Self::NotPsao { found },
            other => Self::Framer(other),
        }
    }
}

/// Why a body or message cannot be sent.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SendError {
    /// The session is not open yet, or has ended.
    #[error("the session is not open")]
    NotOpen,
    /// The frame body is over the client's limit.
    #[error(
        "a frame body of {bytes} bytes is over the {limit} bytes that the client takes: send fewer points, or raise its limit"
    )]
    OverPeerLimit {
        /// Bytes of the body.
        bytes: usize,
        /// Largest body that the client takes, in bytes.
        limit: u32,
    },
    /// A keyframe was given as an update, or an update as a keyframe.
    #[error("the body is of the other kind")]
    Kind,
    /// The frame does not fit the wire's 32-bit length.
    #[error(transparent)]
    Frame(#[from] WireFrameError),
    /// The message holds an invalid value.
    #[error(transparent)]
    Message(#[from] MessageError),
}
