//! Why a session ended, or refused to send.

use crate::message::{MessageError, Reject};
use crate::{FrameType, FramerError, Micros, SceneError, WireFrameError};

/// Why a session cannot go on. Nothing of the state that a client has received is lost by it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The first bytes are not of this protocol.
    #[error(
        "the other end does not speak the psao protocol (its first bytes are {found:#06x}): is this the right address and port?"
    )]
    NotPsao {
        /// Its first two bytes, little endian.
        found: u16,
    },
    /// The bytes stopped being frames.
    #[error("{0}")]
    Framer(FramerError),
    /// A control message is bad.
    #[error("the other end sent a bad message: {0}")]
    Message(#[from] MessageError),
    /// The SCENE messages do not make a scene.
    #[error("the server sent a bad scene: {0}")]
    Scene(#[from] SceneError),
    /// A frame came that has no place here.
    #[error("a {kind} frame came while {state}")]
    Unexpected {
        /// Type of the frame.
        kind: FrameType,
        /// What the session was doing.
        state: &'static str,
    },
    /// The ends have no version in common.
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
    /// The server turned this client away.
    #[error("the server refused: {} ({:?})", .0.text, .0.code)]
    Rejected(Reject),
    /// This server turned a client away.
    #[error("turned the client away: {} ({:?})", .0.text, .0.code)]
    BadHello(Reject),
    /// The handshake took too long.
    #[error("the handshake was not complete after {:.1} s: the other end is stuck, or speaks another protocol", waited.as_secs_f64())]
    HandshakeTimeout {
        /// How long it took.
        waited: Micros,
    },
    /// Nothing came from the other end.
    #[error("nothing came from the other end for {:.1} s: it hangs, or the network between is gone", waited.as_secs_f64())]
    Silent {
        /// For how long.
        waited: Micros,
    },
    /// The client takes none of the bytes that wait for it.
    #[error("the client took none of the bytes that wait for it for {:.1} s: it hangs, or the network between is gone", waited.as_secs_f64())]
    Stalled {
        /// For how long.
        waited: Micros,
    },
    /// The client says too much.
    #[error("the client sent more than {limit} {what} a second")]
    Flood {
        /// Frames or bytes.
        what: &'static str,
        /// How many a second it may send.
        limit: u32,
    },
    /// The stream is of another scene than the one that this client has.
    #[error(
        "the server streams \"{name}\", whose digest {} is not that of the scene here, {}: its AO would be drawn on the wrong surfaces",
        hex(found),
        hex(expected)
    )]
    OtherScene {
        /// What the server calls its scene.
        name: String,
        /// Digest of the scene that the client has.
        expected: [u8; 32],
        /// Digest in the stream.
        found: [u8; 32],
    },
    /// The stream has a profile or coder that this client did not offer.
    #[error("the server chose {what}, which this client did not offer")]
    NotOffered {
        /// What it chose.
        what: &'static str,
    },
}

/// Returns the first bytes of a digest: enough for people to tell two apart.
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

/// Why something cannot be sent.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SendError {
    /// The session is not, or no longer, open.
    #[error("the session is not open")]
    NotOpen,
    /// The frame is longer than the other end takes.
    #[error(
        "a frame body of {bytes} bytes is over the {limit} bytes that the client takes: send fewer points, or raise its limit"
    )]
    OverPeerLimit {
        /// Bytes of the body.
        bytes: usize,
        /// What the client takes.
        limit: u32,
    },
    /// A keyframe was given as an update, or an update as a keyframe.
    #[error("the body is of the other kind")]
    Kind,
    /// The frame does not fit the wire's 32-bit length.
    #[error(transparent)]
    Frame(#[from] WireFrameError),
    /// The message makes no sense.
    #[error(transparent)]
    Message(#[from] MessageError),
}
