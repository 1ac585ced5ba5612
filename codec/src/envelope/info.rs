//! The header of a frame.

use super::{FrameIndex, FrameKind, Packing, Profile, SectionTag, StreamTime};
use crate::StateHash;
use crate::block::CoderId;

/// What the caller of an encoder tells of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameMeta {
    /// Key or delta.
    pub kind: FrameKind,
    /// Number of the frame.
    pub frame: FrameIndex,
    /// Time of the frame.
    pub time: StreamTime,
    /// Number of points that the server sent again in this frame. It is only for statistics.
    pub changed_points: u32,
}

/// One section of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SectionInfo {
    /// What the section holds.
    pub tag: SectionTag,
    /// The coder of its block.
    pub coder: CoderId,
    /// Number of records, at least 1.
    pub records: u32,
    /// Length of its block after decompression, bytes.
    pub raw_bytes: u32,
    /// Length of its block on the wire, bytes. Its line in the section table counts as header.
    pub wire_bytes: u32,
}

/// The header of a frame body. The length of the body is the sum of `header_bytes` and the `wire_bytes` of all
/// sections.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameInfo {
    /// The profile: what the records mean.
    pub profile: Profile,
    /// How points are packed.
    pub packing: Packing,
    /// Key or delta.
    pub kind: FrameKind,
    /// Number of the frame.
    pub frame: FrameIndex,
    /// Time of the frame.
    pub time: StreamTime,
    /// Hash of the state after the frame.
    pub hash: StateHash,
    /// Number of points that the server sent again in this frame.
    pub changed_points: u32,
    /// Length of the fixed header and the section table, bytes.
    pub header_bytes: u32,
    /// The sections, in tag order.
    pub sections: Vec<SectionInfo>,
}

impl FrameInfo {
    /// Returns the section with this tag, if the frame has one.
    #[must_use]
    pub fn section(&self, tag: SectionTag) -> Option<&SectionInfo> {
        self.sections.iter().find(|section| section.tag == tag)
    }

    /// Returns the length of the compressed buckets and cells in bytes: all that the paper counts.
    #[must_use]
    pub fn paper_payload_bytes(&self) -> u64 {
        let counted = |section: &&SectionInfo| matches!(section.tag, SectionTag::BUCKETS | SectionTag::CELLS);
        self.sections.iter().filter(counted).map(|section| u64::from(section.wire_bytes)).sum()
    }

    /// Returns the length of the whole body in bytes.
    #[must_use]
    pub fn body_bytes(&self) -> u64 {
        let blocks: u64 = self.sections.iter().map(|section| u64::from(section.wire_bytes)).sum();
        u64::from(self.header_bytes) + blocks
    }
}

/// A frame ready for the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncodedFrame {
    /// The frame body.
    pub body: Vec<u8>,
    /// Its header, as [`super::inspect`] would read it.
    pub info: FrameInfo,
}
