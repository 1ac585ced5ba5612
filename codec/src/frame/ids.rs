//! Ids of the frame header. Wire ids are newtypes: an unknown value survives long enough to be named.

use std::fmt;

/// What the records of a frame mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Profile(pub u8);

impl Profile {
    /// Cells, buckets and XOR records, as in the paper.
    pub const PAPER: Profile = Profile(1);
    /// Reserved: rest-space points and AO planes.
    pub const SURFACE: Profile = Profile(2);
}

impl fmt::Display for Profile {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Profile::PAPER => out.write_str("paper"),
            Profile::SURFACE => out.write_str("surface"),
            Profile(other) => write!(out, "profile {other}"),
        }
    }
}

/// How a point is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Packing(pub u8);

impl Packing {
    /// [`crate::point::Packed32`].
    pub const BITS_32: Packing = Packing(1);
    /// Reserved: 24 bits a point.
    pub const BITS_24: Packing = Packing(2);
    /// Reserved: 16 bits a point.
    pub const BITS_16: Packing = Packing(3);
}

impl fmt::Display for Packing {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Packing::BITS_32 => out.write_str("32-bit points"),
            Packing::BITS_24 => out.write_str("24-bit points"),
            Packing::BITS_16 => out.write_str("16-bit points"),
            Packing(other) => write!(out, "packing {other}"),
        }
    }
}

/// Whether a frame replaces the state or changes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FrameKind {
    /// Replaces the whole state; wire id 1.
    Key,
    /// Changes the state that the frame before it left; wire id 2.
    Delta,
}

impl FrameKind {
    pub(crate) const fn id(self) -> u8 {
        match self {
            FrameKind::Key => 1,
            FrameKind::Delta => 2,
        }
    }

    pub(crate) const fn from_id(id: u8) -> Option<FrameKind> {
        match id {
            1 => Some(FrameKind::Key),
            2 => Some(FrameKind::Delta),
            _ => None,
        }
    }
}

/// What a section of a frame holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SectionTag(pub u8);

impl SectionTag {
    /// Instance poses: u32 instance and 7 x f32, 32 B.
    pub const POSES: SectionTag = SectionTag(1);
    /// Buckets: u32 offset and 64 B, 68 B.
    pub const BUCKETS: SectionTag = SectionTag(2);
    /// Cells: u32 offset and 7 x u32, the exclusive or with the last sent cell, 32 B.
    pub const CELLS: SectionTag = SectionTag(3);

    /// Bytes of one record; `None` for an unknown tag.
    #[must_use]
    pub const fn record_bytes(self) -> Option<u32> {
        match self {
            SectionTag::POSES | SectionTag::CELLS => Some(32),
            SectionTag::BUCKETS => Some(68),
            _ => None,
        }
    }
}

impl fmt::Display for SectionTag {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            SectionTag::POSES => out.write_str("poses"),
            SectionTag::BUCKETS => out.write_str("buckets"),
            SectionTag::CELLS => out.write_str("cells"),
            SectionTag(other) => write!(out, "section {other}"),
        }
    }
}

/// Number of a frame in its stream; grows from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct FrameIndex(pub u32);

impl FrameIndex {
    /// The index after this one; `None` at the end of the range.
    #[must_use]
    pub const fn next(self) -> Option<FrameIndex> {
        match self.0.checked_add(1) {
            Some(next) => Some(FrameIndex(next)),
            None => None,
        }
    }
}

impl fmt::Display for FrameIndex {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(out)
    }
}

/// Time of a frame in its stream, microseconds; what 0 means is up to the scene's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct StreamTime(pub u64);

impl StreamTime {
    /// The time in microseconds.
    #[must_use]
    pub const fn micros(self) -> u64 {
        self.0
    }
}

impl fmt::Display for StreamTime {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} us", self.0)
    }
}
