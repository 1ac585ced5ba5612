//! Frame bodies: the payload of one keyframe or update, and the state that it changes.
//!
//! The layout is specified in `docs/spec/codec.md`; [`inspect`] reads a header, [`apply`] changes a
//! [`State`], [`keyframe`] writes a whole state down.

mod apply;
mod body;
mod error;
#[cfg(test)]
pub(crate) mod example;
mod header;
mod ids;
mod info;
mod keyframe;
mod pose;
mod state;

pub(crate) use apply::check_follows;
pub use apply::{Applied, Applier, apply};
pub(crate) use body::{Records, assemble, write_body};
pub use error::{EncodeError, FrameError};
pub use header::inspect;
pub(crate) use header::{CRC_OFFSET, HASH_OFFSET, body_crc, header_bytes, read_header};
pub use ids::{FrameIndex, FrameKind, Packing, Profile, SectionTag, StreamTime};
pub use info::{EncodedFrame, FrameInfo, FrameMeta, SectionInfo};
pub use keyframe::keyframe;
pub use pose::{Pose, PoseError};
pub use state::State;
