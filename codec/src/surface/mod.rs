//! Profile `surface`: points stay where they are on the surface at rest, and only their AO changes.
//!
//! A client draws the scene itself, so it knows every mesh at rest. The points of a mesh (a *set*) lie there. They are
//! sent once, and all instances of the mesh share them. Whatever an instance does (move, skin, morph), later frames
//! hold only AO changes.

mod arrival;
mod bit_breakdown;
mod budget;
#[cfg(test)]
mod budget_tests;
mod cells;
mod change_log;
mod charts;
mod decoder;
mod encoder;
mod error;
#[cfg(test)]
mod example;
mod geometry;
mod keyframe;
mod layout;
mod levels;
mod model;
mod padded_index;
mod parents;
mod patch;
#[cfg(test)]
mod patch_tests;
mod prediction;
#[cfg(test)]
mod prediction_tests;
mod preview;
mod rules;
mod section;
mod state;
mod targets;
#[cfg(test)]
mod tests;

pub use bit_breakdown::{BitBreakdown, bit_breakdown};
pub use budget::{Budget, Postponed};
pub use change_log::ChangeLog;
pub use charts::Charts;
pub use decoder::Decoder;
pub use encoder::{Encoder, EncoderSettings, GeometrySource};
pub use error::SectionError;
pub use geometry::{Geometry, GeometryDigest, GeometryError, RestPoint, RoundedGeometry};
pub use keyframe::keyframe;
pub use layout::{Layout, LayoutError, MAX_CHARTS, Member, SetLayout};
pub use levels::{Levels, MAX_LEVELS, PICTURE_ROWS};
#[cfg(any(test, feature = "testing"))]
pub(crate) use model::change::{ChangeModel, ContextMixer};
pub use model::context::ContextError;
#[cfg(any(test, feature = "testing"))]
pub(crate) use model::history::{History, NEVER};
pub(crate) use padded_index::PaddedIndex;
pub use patch::patch;
pub use preview::{Preview, preview};
pub(crate) use rules::{Rules, frame_ids};
pub use section::changes::ChangeError;
pub use section::geometry::GeometrySectionError;
pub use section::values::ValueError;
pub use state::State;

use crate::quant::unorm;

/// The AO byte of a point without a value: it lies inside another solid. Clients leave it out. An AO of 0 is sent as 1.
pub const NO_VALUE: u8 = 0;

/// Returns the AO byte nearest to an accessibility, 1 to 255; the input is limited to [0, 1], and NaN counts as 0.
#[inline]
#[must_use]
pub fn ao_byte(accessibility: f32) -> u8 {
    unorm::quantise(accessibility).max(NO_VALUE + 1)
}

/// Number of points in a point block: a run along the curve that orders a set. Points of a block arrive together.
pub const BLOCK_POINTS: usize = 64;
