//! Ids of the frame header. Wire ids are newtypes, so that an unknown value can be named in an error.

use std::fmt;

use crate::wire::wire_enum;

wire_enum! {
    /// The profile of a frame: what its records mean.
    Profile, unknown "profile";
    /// Cells, buckets and XOR records, as in the paper.
    PAPER = 1 => "paper",
    /// Points at rest and AO changes, see [`crate::surface`].
    SURFACE = 2 => "surface",
}

wire_enum! {
    /// How points are packed.
    Packing, unknown "packing";
    /// Profile `surface`: points lie on the lattices of their sets.
    LATTICE = 0 => "points on lattices",
    /// [`Packed32`](crate::paper::Packed32).
    BITS_32 = 1 => "32-bit points",
    /// [`Packed24`](crate::paper::Packed24).
    BITS_24 = 2 => "24-bit points",
    /// [`Packed16`](crate::paper::Packed16).
    BITS_16 = 3 => "16-bit points",
}

/// The kind of a frame: it replaces the state or changes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FrameKind {
    /// Replaces the whole state; wire id 1.
    Key,
    /// Changes the state after the frame before it; wire id 2.
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

wire_enum! {
    /// What a section of a frame holds.
    SectionTag, unknown "section";
    /// Instance poses: u32 instance and 7 x f32, 32 B each.
    POSES = 1 => "poses",
    /// Buckets: u32 offset and 64 B, 68 B each.
    BUCKETS = 2 => "buckets",
    /// Cells: u32 offset and 7 points, the exclusive or with the cell sent last; 32, 25 or 18 B each.
    CELLS = 3 => "cells",
    /// Profile `surface`: rounded points of sets.
    GEOMETRY = 4 => "geometry",
    /// Profile `surface`: AO of point blocks that arrive.
    VALUES = 5 => "values",
    /// Profile `surface`: which points change, and by how much.
    CHANGES = 6 => "changes",
    /// Profile `surface`: the coder context, which is what the coders have learned so far.
    CONTEXT = 7 => "context",
    /// Profile `surface`: the newest AO of points, for clients that missed frames.
    PATCH = 8 => "patch",
}

/// Number of a frame in its stream; it grows from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct FrameIndex(pub u32);

impl FrameIndex {
    /// Returns the index after this one; `None` at the end of the range.
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

/// Time of a frame in its stream, microseconds. The scene's clock defines its zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct StreamTime(pub u64);

impl StreamTime {
    /// Returns the time in microseconds.
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
