//! The envelope of a frame: its header, its section table, its checksum. It knows no profile: what a profile allows is asked
//! of the profile.
//!
//! The layout is specified in `docs/spec/codec.md`.

mod assemble;
mod body;
mod error;
mod header;
mod ids;
mod info;
mod rules;

pub(crate) use assemble::assemble;
pub use body::{FrameBody, inspect};
pub(crate) use body::{SectionBlock, whole_blocks};
pub use error::{EncodeError, FrameError};
pub(crate) use header::{
    CRC_OFFSET, HASH_OFFSET, PACKING_OFFSET, body_crc, check_follows, header_bytes, read_header,
};
pub use ids::{FrameIndex, FrameKind, Packing, Profile, SectionTag, StreamTime};
pub use info::{EncodedFrame, FrameInfo, FrameMeta, SectionInfo};
pub(crate) use rules::FrameRules;
