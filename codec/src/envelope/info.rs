//! What is known of a frame without its blocks.

use super::{FrameIndex, FrameKind, Packing, Profile, SectionTag, StreamTime};
use crate::StateHash;
use crate::block::CoderId;

/// What the caller says of a frame that it has encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameMeta {
    /// Key or delta.
    pub kind: FrameKind,
    /// Number of the frame.
    pub frame: FrameIndex,
    /// Time of the frame.
    pub time: StreamTime,
    /// Points that the server resent in this frame; carried for statistics, decides nothing.
    pub changed_points: u32,
}

/// One section of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SectionInfo {
    /// What it holds.
    pub tag: SectionTag,
    /// How its block is compressed.
    pub coder: CoderId,
    /// Records, at least 1.
    pub records: u32,
    /// Bytes of its block after decompression.
    pub raw_bytes: u32,
    /// Bytes of its block on the wire (its line in the section table counts as header).
    pub wire_bytes: u32,
}

/// The header of a frame body. `header_bytes` and the `wire_bytes` of all sections add up to the body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameInfo {
    /// What the records mean.
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
    /// Points that the server resent in this frame.
    pub changed_points: u32,
    /// Bytes of the body that are not blocks: the fixed header and the section table.
    pub header_bytes: u32,
    /// The sections, in tag order.
    pub sections: Vec<SectionInfo>,
}

impl FrameInfo {
    /// The section with this tag, if the frame has one.
    #[must_use]
    pub fn section(&self, tag: SectionTag) -> Option<&SectionInfo> {
        self.sections.iter().find(|section| section.tag == tag)
    }

    /// Bytes of the compressed buckets and cells: all that the paper counts.
    #[must_use]
    pub fn paper_payload_bytes(&self) -> u64 {
        let counted = |section: &&SectionInfo| matches!(section.tag, SectionTag::BUCKETS | SectionTag::CELLS);
        self.sections.iter().filter(counted).map(|section| u64::from(section.wire_bytes)).sum()
    }

    /// Bytes of the whole body.
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
