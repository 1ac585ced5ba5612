//! The sections of a frame: what each holds, its plain layout, and the writer of all of them.

pub(super) mod changes;
pub(super) mod geometry;
pub(super) mod patch;
pub(super) mod point_mask;
pub(super) mod values;
pub(super) mod writer;
