//! The envelope of a frame: header, section table and checksum. It knows no profile; it asks each profile what that
//! profile allows.
//!
//! `docs/spec/codec.md` specifies the layout.

mod assemble;
mod body;
mod error;
mod header;
mod ids;
mod info;
mod rules;

pub(crate) use assemble::{FrameIds, assemble};
pub use body::{FrameBody, inspect};
pub(crate) use body::{SectionBlock, whole_blocks};
pub use error::{EncodeError, FrameError};
pub(crate) use header::{
    CRC_OFFSET, HASH_OFFSET, PACKING_OFFSET, body_crc, check_follows, header_bytes, read_header,
};
pub use ids::{FrameIndex, FrameKind, Packing, Profile, SectionTag, StreamTime};
pub use info::{EncodedFrame, FrameInfo, FrameMeta, SectionInfo};
pub(crate) use rules::FrameRules;
