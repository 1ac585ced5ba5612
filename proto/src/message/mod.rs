//! Control messages: everything in the protocol except frame bodies, one message per file.
//!
//! A message is the payload of a frame of its own type and has at most [`MAX_MESSAGE_BYTES`]. Its fields follow each
//! other without padding. Integers have a fixed size and are little endian; the length of a list or text precedes it as
//! `u64`. Every message is checked when it is written and when it is read: texts are within their limits, floats are
//! finite, and no byte is left over. `bincode` is used only in this module.

/// Implements the layout of a message whose fields are written one after another. `field as Newtype` stands for the
/// single field of another crate's newtype.
macro_rules! fields {
    (@value $value:expr) => { &$value };
    (@value $value:expr, $newtype:ident) => { &$value.0 };
    (@wrap $value:expr) => { $value };
    (@wrap $value:expr, $newtype:ident) => { $newtype($value) };
    ($message:ident { $($field:ident $(as $newtype:ident)?),* $(,)? }) => {
        impl bincode::Encode for $message {
            fn encode<E: bincode::enc::Encoder>(&self, to: &mut E) -> Result<(), bincode::error::EncodeError> {
                $(bincode::Encode::encode(fields!(@value self.$field $(, $newtype)?), to)?;)*
                Ok(())
            }
        }

        impl<C> bincode::Decode<C> for $message {
            fn decode<D: bincode::de::Decoder<Context = C>>(
                from: &mut D,
            ) -> Result<Self, bincode::error::DecodeError> {
                Ok(Self { $($field: fields!(@wrap bincode::Decode::decode(from)? $(, $newtype)?)),* })
            }
        }

        bincode::impl_borrow_decode!($message);
    };
}

mod accept;
mod ack;
mod auth;
mod budget;
mod close;
mod edit;
mod gap;
mod hello;
mod needs;
mod ping;
mod reject;
mod report;
mod request;
mod scene;
mod stamp;
mod surface;
#[cfg(test)]
mod tests;
mod text;
mod view;

pub use accept::Accept;
pub use ack::Ack;
pub use auth::{Auth, MAX_TOKEN_BYTES, MIN_TOKEN_BYTES, Token, TokenError};
pub use budget::Budget;
pub use close::{Close, CloseCode};
pub use edit::{Edit, EditAction};
pub use gap::{Gap, GapReason};
pub use hello::{CoderSet, Hello, PeerLimits, ProfileSet};
pub use needs::Needs;
pub use ping::{Ping, Pong};
pub use reject::{Reject, RejectCode};
pub use report::{MAX_STAGES, Report, StageId, StageTime};
pub use request::{KeyframeReason, Request};
pub use scene::{InstanceBatch, InstanceEntry, MAX_BATCH, Occlusion, Scene, SceneHeader};
pub use stamp::Stamp;
pub use surface::{MemberBatch, MemberEntry, PointSource, SetBatch, SetEntry};
pub use text::{Text, TextError};
pub use view::{CameraPose, View};

use crate::FrameType;

/// Largest control message in bytes.
pub const MAX_MESSAGE_BYTES: usize = 65_536;

/// Why a payload is not a message of its frame's type, or a message cannot be sent.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MessageError {
    /// The bytes cannot be read as this message.
    #[error("{message}: cannot read its {length} bytes: {reason}")]
    Malformed {
        /// Name of the message.
        message: &'static str,
        /// Bytes of the payload.
        length: usize,
        /// The problem.
        reason: PayloadError,
    },
    /// The message ended before its payload did.
    #[error("{message}: {used} bytes make up the message, but its payload has {length}")]
    Extra {
        /// Name of the message.
        message: &'static str,
        /// Bytes that the message takes.
        used: usize,
        /// Bytes of the payload.
        length: usize,
    },
    /// A field has an invalid value.
    #[error("{message}: field `{field}` {problem}")]
    Invalid {
        /// Name of the message.
        message: &'static str,
        /// Name of the field.
        field: &'static str,
        /// What is wrong with it, as the end of a sentence.
        problem: &'static str,
    },
}

/// Why a payload cannot be read as a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PayloadError {
    /// The payload ends inside a field.
    #[error("they end inside a field")]
    Ended,
    /// A list or text is longer than any message may be.
    #[error("a list or text in them is longer than a message may be")]
    TooLong,
    /// A choice of a message has a value that this version does not know.
    #[error("choice {0} is unknown to this version")]
    Variant(u32),
    /// A text is not UTF-8.
    #[error("a text in them is not UTF-8")]
    Utf8,
    /// Another error, which only a damaged or foreign payload causes.
    #[error("a field has a value that cannot be")]
    Value,
}

/// Private part of a message: reading, writing and checks.
pub(crate) mod sealed {
    /// Name of a field and its problem.
    #[derive(Debug)]
    pub struct FieldError {
        pub(super) field: &'static str,
        pub(super) problem: &'static str,
    }

    /// The layout and checks of a message.
    pub trait Payload: bincode::Encode + bincode::Decode<()> {
        /// Checks that every field has a valid value.
        fn check(&self) -> Result<(), FieldError>;
    }
}
use sealed::{FieldError, Payload};

/// A control message: the payload of one type of frame.
///
/// ```
/// use psao_proto::message::{Close, CloseCode, Message};
///
/// let close = Close::new(CloseCode::DONE, "the clip is over");
/// let bytes = close.to_payload()?;
/// assert_eq!(Close::from_payload(&bytes)?, close);
/// assert!(Close::from_payload(&bytes[1..]).is_err());
/// # Ok::<(), psao_proto::message::MessageError>(())
/// ```
///
/// The trait is sealed, because the protocol defines the set of messages.
pub trait Message: Payload + Sized {
    /// Type of the frames that carry it.
    const KIND: FrameType;
    /// Its name in errors and in the specification.
    const NAME: &'static str;

    /// Returns the message as a payload.
    ///
    /// # Errors
    /// [`MessageError::Invalid`] when a field has an invalid value, [`MessageError::Malformed`] when the message is too
    /// long.
    fn to_payload(&self) -> Result<Vec<u8>, MessageError> {
        self.check().map_err(|i| invalid::<Self>(&i))?;
        let bytes = bincode::encode_to_vec(self, CONFIG).map_err(|_| MessageError::Malformed {
            message: Self::NAME,
            length: 0,
            reason: PayloadError::Value,
        })?;
        if bytes.len() > MAX_MESSAGE_BYTES {
            let (length, reason) = (bytes.len(), PayloadError::TooLong);
            return Err(MessageError::Malformed { message: Self::NAME, length, reason });
        }
        Ok(bytes)
    }

    /// Reads a message that must fill the payload.
    ///
    /// # Errors
    /// [`MessageError`]; no payload makes it panic or allocate more than [`MAX_MESSAGE_BYTES`].
    fn from_payload(payload: &[u8]) -> Result<Self, MessageError> {
        let length = payload.len();
        let (message, used): (Self, usize) = bincode::decode_from_slice(payload, CONFIG)
            .map_err(|e| MessageError::Malformed { message: Self::NAME, length, reason: malformed(&e) })?;
        if used != length {
            return Err(MessageError::Extra { message: Self::NAME, used, length });
        }
        message.check().map_err(|i| invalid::<Self>(&i))?;
        Ok(message)
    }
}

/// The layout of every message, described in the module's documentation.
const CONFIG: bincode::config::Configuration<
    bincode::config::LittleEndian,
    bincode::config::Fixint,
    bincode::config::Limit<MAX_MESSAGE_BYTES>,
> = bincode::config::standard()
    .with_little_endian()
    .with_fixed_int_encoding()
    .with_limit::<MAX_MESSAGE_BYTES>();

const fn invalid<M: Message>(invalid: &FieldError) -> MessageError {
    MessageError::Invalid { message: M::NAME, field: invalid.field, problem: invalid.problem }
}

fn malformed(error: &bincode::error::DecodeError) -> PayloadError {
    use bincode::error::DecodeError as E;
    match error {
        E::UnexpectedEnd { .. } => PayloadError::Ended,
        E::LimitExceeded | E::OutsideUsizeRange(_) | E::ArrayLengthMismatch { .. } => PayloadError::TooLong,
        E::UnexpectedVariant { found, .. } => PayloadError::Variant(*found),
        E::Utf8 { .. } => PayloadError::Utf8,
        E::Other(text::TOO_LONG) => PayloadError::TooLong,
        _ => PayloadError::Value,
    }
}

/// Returns an error unless `ok`.
const fn require(ok: bool, field: &'static str, problem: &'static str) -> Result<(), FieldError> {
    if ok { Ok(()) } else { Err(FieldError { field, problem }) }
}

/// Returns an error unless every value is finite.
fn finite(values: &[f32], field: &'static str) -> Result<(), FieldError> {
    require(values.iter().all(|v| v.is_finite()), field, "is not finite")
}

#[cfg(test)]
pub(crate) mod testing {
    //! Checks that the tests of every message share.
    use super::*;

    /// Returns bytes as lower-case hex.
    pub(crate) fn hex(bytes: &[u8]) -> String {
        bytes.iter().map(|b| format!("{b:02x}")).collect()
    }

    /// Returns the bytes of the one annotated dump in a specification; the offsets at its lines' start are checked.
    pub(crate) fn dump(spec: &str) -> Vec<u8> {
        let (_, rest) = spec.split_once("```hex\n").expect("the specification has a dump");
        let (lines, _) = rest.split_once("```").expect("the dump ends");
        let mut bytes = Vec::new();
        for line in lines.lines() {
            let mut columns = line.split("  ").filter(|column| !column.is_empty());
            let offset = usize::from_str_radix(columns.next().unwrap(), 16).unwrap();
            assert_eq!(offset, bytes.len(), "offset of line {line:?}");
            let pairs = columns.next().unwrap().split_whitespace();
            bytes.extend(pairs.map(|pair| u8::from_str_radix(pair, 16).unwrap()));
        }
        bytes
    }

    /// Checks the round trip and the golden bytes, and that every prefix and every extra byte is refused.
    pub(crate) fn golden<M: Message + PartialEq + std::fmt::Debug>(message: &M, expected: &str) {
        let bytes = message.to_payload().unwrap();
        let expected: String = expected.split_whitespace().collect();
        assert_eq!(hex(&bytes), expected, "{} changed on the wire: that needs a new version", M::NAME);
        assert_eq!(&M::from_payload(&bytes).unwrap(), message);
        for end in 0..bytes.len() {
            assert!(M::from_payload(&bytes[..end]).is_err(), "{} was read from {end} bytes", M::NAME);
        }
        for extra in [0u8, 1, 0xff] {
            let mut longer = bytes.clone();
            longer.push(extra);
            assert_eq!(
                M::from_payload(&longer),
                Err(MessageError::Extra { message: M::NAME, used: bytes.len(), length: longer.len() })
            );
        }
    }
}
