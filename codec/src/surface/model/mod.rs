//! What the range coder knows of points: the contexts and probabilities behind every kind of section.

pub(super) mod change;
pub(super) mod context;
pub(super) mod curve;
pub(super) mod geometry;
pub(super) mod history;
pub(super) mod patch;
pub(super) mod value;
