//! The sections of a frame: the content and plain layout of each, and the writer of all.

pub(super) mod changes;
pub(super) mod geometry;
pub(super) mod patch;
pub(super) mod point_mask;
pub(super) mod values;
pub(super) mod writer;
