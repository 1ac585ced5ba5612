//! Errors of reading and of writing a frame body. Offsets count bytes from the start of the body. `raw_offset` counts
//! bytes from the start of a section after decompression.

use super::{FrameIndex, FrameKind, Packing, Profile, SectionTag};
use crate::StateHash;
use crate::block::{BlockError, CoderId};
use crate::profiles::ContentError;
use crate::wire::{VarintError, WireError, WireErrorKind};

/// Why a frame body was refused. The state is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// The body is longer than agreed.
    #[error("frame body of {bytes} B, the agreed limit is {limit} B; raise Limits::max_frame_bytes")]
    TooLong {
        /// Bytes of the body.
        bytes: usize,
        /// The agreed limit.
        limit: u32,
    },
    /// The body ends inside a field.
    #[error("frame body ends inside {field}, which starts at byte {offset}: {missing} B or more are missing")]
    Truncated {
        /// The field.
        field: &'static str,
        /// Start of the field.
        offset: usize,
        /// Smallest number of missing bytes.
        missing: usize,
    },
    /// A varint is malformed.
    #[error("{field} at byte {offset} is not a canonical varint: {problem}")]
    Varint {
        /// The field.
        field: &'static str,
        /// Start of the field.
        offset: usize,
        /// The error.
        problem: VarintError,
    },
    /// The profile is unknown.
    #[error("profile at byte {offset} is unknown ({}): is this a frame body?", found.0)]
    ProfileUnknown {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: Profile,
    },
    /// The packing differs from that of the stream.
    #[error("packing at byte {offset} is {found}, the stream was announced with {expected}")]
    Packing {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: Packing,
        /// The packing of the layout.
        expected: Packing,
    },
    /// The packing is unknown.
    #[error("packing at byte {offset} is unknown ({}): this version reads ids 1 to 3", found.0)]
    PackingUnknown {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: Packing,
    },
    /// The frame kind is neither key nor delta.
    #[error("frame kind at byte {offset} is {found}, neither key (1) nor delta (2)")]
    Kind {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: u8,
    },
    /// A section tag is unknown. Sections change the state, so a decoder cannot skip one.
    #[error("section tag at byte {offset} is unknown ({}); a newer version wrote this frame", found.0)]
    SectionUnknown {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: SectionTag,
    },
    /// Section tags do not ascend.
    #[error("section tag at byte {offset} is {found}, after {previous}: tags must ascend")]
    SectionOrder {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: SectionTag,
        /// The tag before it.
        previous: SectionTag,
    },
    /// This profile or kind of frame does not have such a section.
    #[error("section {found} at byte {offset} is not allowed in a {kind} of profile {profile}")]
    SectionMisplaced {
        /// Start of its line in the section table.
        offset: usize,
        /// Its tag.
        found: SectionTag,
        /// Profile of the frame.
        profile: Profile,
        /// Kind of the frame.
        kind: FrameKind,
    },
    /// Two sections cannot be in one frame.
    #[error("section {found} at byte {offset} cannot follow section {previous} in one frame")]
    SectionBeside {
        /// Start of its line in the section table.
        offset: usize,
        /// Its tag.
        found: SectionTag,
        /// The tag before it.
        previous: SectionTag,
    },
    /// The profile of the frame differs from that of the state.
    #[error("profile at byte {offset} is {found}, that of the stream is {expected}")]
    ProfileOther {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: Profile,
        /// The profile of the state.
        expected: Profile,
    },
    /// The block coder of a section is reserved or unknown.
    #[error(
        "coder of section {section} at byte {offset} is {found}; it may use stored (0), lz4 (1), zstd (2), and with \
         profile surface range (3)"
    )]
    Coder {
        /// Start of the field.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Found.
        found: CoderId,
    },
    /// A section has no records; an encoder must leave it out.
    #[error(
        "record count of section {section} at byte {offset} is 0: an encoder must leave empty sections out"
    )]
    NoRecords {
        /// Start of the field.
        offset: usize,
        /// The section.
        section: SectionTag,
    },
    /// A section has more records than the layout has places.
    #[error("section {section} has {records} records, the layout has {places} places (byte {offset})")]
    TooManyRecords {
        /// Start of the block.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Claimed number of records.
        records: u32,
        /// Places of the layout.
        places: u32,
    },
    /// The raw length of a section is not the length of its records.
    #[error("raw length of section {section} at byte {offset} is {found} B, its records make {expected} B")]
    RawLength {
        /// Start of the field.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Length of the records, bytes.
        expected: u64,
        /// Claimed length, bytes.
        found: u32,
    },
    /// A section is larger after decompression than agreed. Nothing was allocated.
    #[error(
        "raw length of section {section} at byte {offset} is {found} B, the agreed limit is {limit} B; \
         raise Limits::max_block_bytes"
    )]
    BlockTooLarge {
        /// Start of the field.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Claimed length, bytes.
        found: u32,
        /// The agreed limit.
        limit: u32,
    },
    /// Bytes follow the last section.
    #[error("{extra} B follow the last section, which ends at byte {offset}")]
    Trailing {
        /// End of the last section.
        offset: usize,
        /// Number of bytes after it.
        extra: usize,
    },
    /// The checksum of the body is wrong: the body was damaged in transit.
    #[error("checksum at byte {offset} is {stored:08x}, the body makes {computed:08x}: the body is damaged")]
    Checksum {
        /// Start of the field.
        offset: usize,
        /// The checksum in the body.
        stored: u32,
        /// The checksum of the body.
        computed: u32,
    },
    /// A block cannot be decompressed.
    #[error("block of section {section} at byte {offset}: {source}")]
    Block {
        /// Start of the block.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// The error of the coder.
        source: BlockError,
    },
    /// The offsets of a section's records do not ascend.
    #[error(
        "record {record} of section {section} (byte {raw_offset} of its content) has offset {found}, \
         after {previous}: offsets must ascend"
    )]
    OffsetOrder {
        /// The section.
        section: SectionTag,
        /// The record.
        record: u32,
        /// Start of the record.
        raw_offset: usize,
        /// Offset of the record.
        found: u32,
        /// Offset of the record before it.
        previous: u32,
    },
    /// The offset of a record is outside the layout.
    #[error(
        "record {record} of section {section} (byte {raw_offset} of its content) has offset {found}, \
         the layout has {places} places"
    )]
    OffsetRange {
        /// The section.
        section: SectionTag,
        /// The record.
        record: u32,
        /// Start of the record.
        raw_offset: usize,
        /// Offset of the record.
        found: u32,
        /// Places of the layout.
        places: u32,
    },
    /// A record of a section breaks a rule of its profile.
    #[error("record {record} of section {section} (byte {raw_offset} of its content): {problem}")]
    Record {
        /// The section.
        section: SectionTag,
        /// The record.
        record: u32,
        /// Start of the record.
        raw_offset: usize,
        /// The error.
        problem: ContentError,
    },
    /// The content of a section is invalid, or does not fit the state.
    #[error("section {section} at byte {offset}: {problem}")]
    Content {
        /// The section.
        section: SectionTag,
        /// Start of the block.
        offset: usize,
        /// The error.
        problem: ContentError,
    },
    /// A patch does not reach back to the frame of the state.
    #[error(
        "the patch at byte {offset} fits states at most {back} frames before it, but this state is at frame {last}: ask for \
         a keyframe, or for a patch that reaches back to it"
    )]
    PatchBase {
        /// Start of the block.
        offset: usize,
        /// Number of frames that it reaches back.
        back: u32,
        /// The frame of the state.
        last: FrameIndex,
    },
    /// A block of the range coder is longer or shorter than its decisions.
    #[error("range-coded section {section} at byte {offset}: {}", length_mismatch(*.extra))]
    RangeLength {
        /// Start of the block.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Number of remaining bytes; `None` if the block ends too early.
        extra: Option<usize>,
    },
    /// The length of a section's plain layout differs from the section table.
    #[error("section {section} at byte {offset} makes {found} B, the section table says {expected} B")]
    PlainLength {
        /// Start of the block.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Length by the section table, bytes.
        expected: u32,
        /// Length of the plain layout, bytes.
        found: usize,
    },
    /// A delta came before any keyframe.
    #[error("frame kind at byte {offset} is delta, but the state has not received a keyframe yet")]
    NoKeyframe {
        /// Start of the field.
        offset: usize,
    },
    /// A delta is not newer than the state.
    #[error("frame index at byte {offset} is {found}, the state is already at {last}")]
    FrameOrder {
        /// Start of the field.
        offset: usize,
        /// Found.
        found: FrameIndex,
        /// The index of the state.
        last: FrameIndex,
    },
    /// The state after the frame would differ from the server's. Ask for a keyframe.
    #[error(
        "state hash at byte {offset} is {stored}, this state would become {computed}: ask for a keyframe"
    )]
    Hash {
        /// Start of the field.
        offset: usize,
        /// The hash in the body.
        stored: StateHash,
        /// The hash that the state would have.
        computed: StateHash,
    },
}

impl From<WireError> for FrameError {
    fn from(WireError { field, offset, kind }: WireError) -> FrameError {
        match kind {
            WireErrorKind::Ends { missing } => FrameError::Truncated { field, offset, missing },
            WireErrorKind::Varint(problem) => FrameError::Varint { field, offset, problem },
            WireErrorKind::Trailing { extra } => FrameError::Trailing { offset, extra },
        }
    }
}

fn length_mismatch(extra: Option<usize>) -> String {
    match extra {
        Some(extra) => format!("{extra} B remain"),
        None => "it ends too early".to_owned(),
    }
}

/// Why a frame could not be written. The encoder is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The first frame of a stream must be a keyframe.
    #[error("frame {frame} is a delta, but no keyframe was written yet")]
    NoKeyframe {
        /// The requested frame.
        frame: FrameIndex,
    },
    /// Frame indices must grow.
    #[error("frame {frame} after frame {last}: indices must grow")]
    FrameOrder {
        /// The requested frame.
        frame: FrameIndex,
        /// The last frame written.
        last: FrameIndex,
    },
    /// A block could not be compressed.
    #[error("section {section}: {source}")]
    Block {
        /// The section.
        section: SectionTag,
        /// The error of the coder.
        source: BlockError,
    },
}
