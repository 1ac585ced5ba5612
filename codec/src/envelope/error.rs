//! Why a frame body was refused, or could not be written. Offsets count bytes from the start of the body;
//! `raw_offset` counts bytes from the start of a section after decompression.

use super::{FrameIndex, FrameKind, Packing, Profile, SectionTag};
use crate::StateHash;
use crate::block::{BlockError, CoderId};
use crate::paper::{BucketError, PoseError};
use crate::surface::{ChangeError, ContextError, GeometrySectionError, ValueError};
use crate::wire::{VarintError, WireError, WireErrorKind};

/// Why a frame body was refused. The state is as it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// The body is longer than agreed on.
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
        /// Where the field starts.
        offset: usize,
        /// Bytes that are missing at least.
        missing: usize,
    },
    /// A varint is malformed.
    #[error("{field} at byte {offset} is not a canonical varint: {problem}")]
    Varint {
        /// The field.
        field: &'static str,
        /// Where the field starts.
        offset: usize,
        /// What is wrong with it.
        problem: VarintError,
    },
    /// The profile is unknown.
    #[error("profile at byte {offset} is unknown ({}): is this a frame body?", found.0)]
    ProfileUnknown {
        /// Where the field is.
        offset: usize,
        /// The profile found.
        found: Profile,
    },
    /// The packing is not that of the stream.
    #[error("packing at byte {offset} is {found}, the stream was announced with {expected}")]
    Packing {
        /// Where the field is.
        offset: usize,
        /// The packing found.
        found: Packing,
        /// The packing of the layout.
        expected: Packing,
    },
    /// The packing is unknown.
    #[error("packing at byte {offset} is unknown ({}): this version reads ids 1 to 3", found.0)]
    PackingUnknown {
        /// Where the field is.
        offset: usize,
        /// The packing found.
        found: Packing,
    },
    /// The frame kind is neither key nor delta.
    #[error("frame kind at byte {offset} is {found}, neither key (1) nor delta (2)")]
    Kind {
        /// Where the field is.
        offset: usize,
        /// The id found.
        found: u8,
    },
    /// A section tag is unknown. Sections change the state, so none can be skipped.
    #[error("section tag at byte {offset} is unknown ({}); a newer version wrote this frame", found.0)]
    SectionUnknown {
        /// Where the field is.
        offset: usize,
        /// The tag found.
        found: SectionTag,
    },
    /// Section tags do not ascend.
    #[error("section tag at byte {offset} is {found}, after {previous}: tags must ascend")]
    SectionOrder {
        /// Where the field is.
        offset: usize,
        /// The tag found.
        found: SectionTag,
        /// The tag before it.
        previous: SectionTag,
    },
    /// A section that this profile or kind of frame does not have.
    #[error("section {found} at byte {offset} has no place in a {kind} of profile {profile}")]
    SectionMisplaced {
        /// Where its line is.
        offset: usize,
        /// Its tag.
        found: SectionTag,
        /// Profile of the frame.
        profile: Profile,
        /// Kind of the frame.
        kind: FrameKind,
    },
    /// Two sections that cannot be in one frame.
    #[error("section {found} at byte {offset} cannot follow section {previous} in one frame")]
    SectionBeside {
        /// Where its line is.
        offset: usize,
        /// Its tag.
        found: SectionTag,
        /// The tag before it.
        previous: SectionTag,
    },
    /// The frame is of another profile than the state.
    #[error("profile at byte {offset} is {found}, the stream's is {expected}")]
    ProfileOther {
        /// Where the field is.
        offset: usize,
        /// The profile found.
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
        /// Where the field is.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// The coder found.
        found: CoderId,
    },
    /// A section has no records; it must be left out.
    #[error("record count of section {section} at byte {offset} is 0: empty sections are left out")]
    NoRecords {
        /// Where the field is.
        offset: usize,
        /// The section.
        section: SectionTag,
    },
    /// A section has more records than the layout has places for them.
    #[error("section {section} has {records} records, the layout has {places} places (byte {offset})")]
    TooManyRecords {
        /// Where the block starts.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Records claimed.
        records: u32,
        /// Places of the layout.
        places: u32,
    },
    /// The raw length of a section is not its records times their size.
    #[error("raw length of section {section} at byte {offset} is {found} B, its records make {expected} B")]
    RawLength {
        /// Where the field is.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Bytes that the records make.
        expected: u64,
        /// Bytes claimed.
        found: u32,
    },
    /// A section is larger, after decompression, than agreed on. Nothing was allocated.
    #[error(
        "raw length of section {section} at byte {offset} is {found} B, the agreed limit is {limit} B; \
         raise Limits::max_block_bytes"
    )]
    BlockTooLarge {
        /// Where the field is.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Bytes claimed.
        found: u32,
        /// The agreed limit.
        limit: u32,
    },
    /// Bytes follow the last section.
    #[error("{extra} B follow the last section, which ends at byte {offset}")]
    Trailing {
        /// Where the last section ends.
        offset: usize,
        /// Bytes after it.
        extra: usize,
    },
    /// The checksum of the body is wrong: it was damaged on its way.
    #[error("checksum at byte {offset} is {stored:08x}, the body makes {computed:08x}: the body is damaged")]
    Checksum {
        /// Where the field is.
        offset: usize,
        /// The checksum in the body.
        stored: u32,
        /// The checksum of the body.
        computed: u32,
    },
    /// A block cannot be decompressed.
    #[error("block of section {section} at byte {offset}: {source}")]
    Block {
        /// Where the block starts.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// What the coder says.
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
        /// Where the record starts.
        raw_offset: usize,
        /// Its offset.
        found: u32,
        /// The offset before it.
        previous: u32,
    },
    /// The offset of a record names no place of the layout.
    #[error(
        "record {record} of section {section} (byte {raw_offset} of its content) has offset {found}, \
         the layout has {places} places"
    )]
    OffsetRange {
        /// The section.
        section: SectionTag,
        /// The record.
        record: u32,
        /// Where the record starts.
        raw_offset: usize,
        /// Its offset.
        found: u32,
        /// Places of the layout.
        places: u32,
    },
    /// A pose is not finite, or its rotation not of unit length.
    #[error("record {record} of section poses (byte {raw_offset} of its content): {source}")]
    Pose {
        /// The record.
        record: u32,
        /// Where the record starts.
        raw_offset: usize,
        /// What is wrong with it.
        source: PoseError,
    },
    /// A bucket breaks the rules of its layout.
    #[error("record {record} of section buckets (byte {raw_offset} of its content): {problem}")]
    Bucket {
        /// The record.
        record: u32,
        /// Where the record starts.
        raw_offset: usize,
        /// What is wrong with it.
        problem: BucketError,
    },
    /// A cell has bits set after its last point.
    #[error(
        "record {record} of section cells (byte {raw_offset} of its content): slot {slot} holds no point \
         but is not empty, or a point follows it"
    )]
    Cell {
        /// The record.
        record: u32,
        /// Where the record starts.
        raw_offset: usize,
        /// Index of the slot, 0 to 6.
        slot: usize,
    },
    /// The points of a set make no geometry.
    #[error("section geometry at byte {offset}: {problem}")]
    Geometry {
        /// Where the block starts.
        offset: usize,
        /// What is wrong.
        problem: GeometrySectionError,
    },
    /// Blocks of points or their AO are not sound.
    #[error("section values at byte {offset}: {problem}")]
    Values {
        /// Where the block starts.
        offset: usize,
        /// What is wrong.
        problem: ValueError,
    },
    /// Changes of AO are not sound, or do not suit the state.
    #[error("section changes at byte {offset}: {problem}")]
    Changes {
        /// Where the block starts.
        offset: usize,
        /// What is wrong.
        problem: ChangeError,
    },
    /// A patch is not sound, or does not suit the state.
    #[error("section patch at byte {offset}: {problem}")]
    Patch {
        /// Where the block starts.
        offset: usize,
        /// What is wrong.
        problem: ChangeError,
    },
    /// A patch does not reach back to the frame of the state.
    #[error(
        "the patch at byte {offset} suits states at most {back} frames before it, this one is of frame {last}: ask for a \
         keyframe, or for a patch that reaches back to it"
    )]
    PatchBase {
        /// Where the block starts.
        offset: usize,
        /// How many frames it reaches back.
        back: u32,
        /// The frame of the state.
        last: FrameIndex,
    },
    /// What the coder has learned is not sound.
    #[error("section context at byte {offset}: {problem}")]
    Context {
        /// Where the block starts.
        offset: usize,
        /// What is wrong.
        problem: ContextError,
    },
    /// A block of the range coder is longer or shorter than what was read from it.
    #[error("range-coded section {section} at byte {offset}: {}", length_mismatch(*.extra))]
    RangeLength {
        /// Where the block starts.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// Bytes left over; `None` when it ends too early.
        extra: Option<usize>,
    },
    /// The plain layout of a section has another length than the section table says.
    #[error("section {section} at byte {offset} makes {found} B, the section table says {expected} B")]
    PlainLength {
        /// Where the block starts.
        offset: usize,
        /// The section.
        section: SectionTag,
        /// By the section table.
        expected: u32,
        /// What it makes.
        found: usize,
    },
    /// A delta came before any keyframe.
    #[error("frame kind at byte {offset} is delta, but the state has had no keyframe yet")]
    NoKeyframe {
        /// Where the field is.
        offset: usize,
    },
    /// A delta is not newer than the state.
    #[error("frame index at byte {offset} is {found}, the state is already at {last}")]
    FrameOrder {
        /// Where the field is.
        offset: usize,
        /// The index found.
        found: FrameIndex,
        /// The index of the state.
        last: FrameIndex,
    },
    /// The state after the frame would not be the server's: ask for a keyframe.
    #[error(
        "state hash at byte {offset} is {stored}, this state would become {computed}: ask for a keyframe"
    )]
    Hash {
        /// Where the field is.
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
        Some(extra) => format!("{extra} B are left over"),
        None => "it ends too early".to_owned(),
    }
}

/// Why a frame could not be written. The encoder is as it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The first frame of a stream must be a keyframe.
    #[error("frame {frame} is a delta, but no keyframe was written yet")]
    NoKeyframe {
        /// The frame asked for.
        frame: FrameIndex,
    },
    /// Frame indices must grow.
    #[error("frame {frame} after frame {last}: indices must grow")]
    FrameOrder {
        /// The frame asked for.
        frame: FrameIndex,
        /// The last frame written.
        last: FrameIndex,
    },
    /// A block could not be compressed.
    #[error("section {section}: {source}")]
    Block {
        /// The section.
        section: SectionTag,
        /// What the coder says.
        source: BlockError,
    },
}
