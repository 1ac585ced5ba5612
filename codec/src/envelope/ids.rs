//! Ids of the frame header. Wire ids are newtypes: an unknown value survives long enough to be named.

use std::fmt;

/// What the records of a frame mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Profile(pub u8);

impl Profile {
    /// Cells, buckets and XOR records, as in the paper.
    pub const PAPER: Profile = Profile(1);
    /// Rest-space points and AO changes, see [`crate::surface`].
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
    /// Profile `surface`: points lie on the lattices of their sets.
    pub const LATTICE: Packing = Packing(0);
    /// [`Packed32`](crate::paper::Packed32).
    pub const BITS_32: Packing = Packing(1);
    /// [`Packed24`](crate::paper::Packed24).
    pub const BITS_24: Packing = Packing(2);
    /// [`Packed16`](crate::paper::Packed16).
    pub const BITS_16: Packing = Packing(3);
}

impl fmt::Display for Packing {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Packing::LATTICE => out.write_str("points on lattices"),
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

impl fmt::Display for FrameKind {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            FrameKind::Key => "keyframe",
            FrameKind::Delta => "delta",
        })
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
    /// Cells: u32 offset and 7 points, the exclusive or with the last sent cell: 32, 25 or 18 B.
    pub const CELLS: SectionTag = SectionTag(3);

    /// Profile `surface`: rounded points of sets.
    pub const GEOMETRY: SectionTag = SectionTag(4);
    /// Profile `surface`: AO of blocks of points that come.
    pub const VALUES: SectionTag = SectionTag(5);
    /// Profile `surface`: which points change and by how much.
    pub const CHANGES: SectionTag = SectionTag(6);
    /// Profile `surface`: what the coders have learned so far.
    pub const CONTEXT: SectionTag = SectionTag(7);
    /// Profile `surface`: the newest AO of points, for clients that missed frames.
    pub const PATCH: SectionTag = SectionTag(8);

    /// Every known tag.
    pub const ALL: [SectionTag; 8] = [
        SectionTag::POSES,
        SectionTag::BUCKETS,
        SectionTag::CELLS,
        SectionTag::GEOMETRY,
        SectionTag::VALUES,
        SectionTag::CHANGES,
        SectionTag::CONTEXT,
        SectionTag::PATCH,
    ];
}

impl fmt::Display for SectionTag {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            SectionTag::POSES => out.write_str("poses"),
            SectionTag::BUCKETS => out.write_str("buckets"),
            SectionTag::CELLS => out.write_str("cells"),
            SectionTag::GEOMETRY => out.write_str("geometry"),
            SectionTag::VALUES => out.write_str("values"),
            SectionTag::CHANGES => out.write_str("changes"),
            SectionTag::CONTEXT => out.write_str("context"),
            SectionTag::PATCH => out.write_str("patch"),
            SectionTag(other) => write!(out, "section {other}"),
        }
    }
}

/// NumberModel of a frame in its stream; grows from frame to frame.
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
