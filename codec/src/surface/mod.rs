//! Profile `surface`: points that stay where they are on the rest surface, of which only AO changes.
//!
//! A client draws the scene itself, so it knows every mesh at rest. The points of a mesh (a *set*) are kept there:
//! they are sent once, shared by all instances of the mesh, and whatever an instance does (move, skin, morph), a
//! later frame holds AO changes only.

mod bit_breakdown;
mod budget;
#[cfg(test)]
mod budget_tests;
mod change_log;
mod decoder;
mod encoder;
#[cfg(test)]
mod example;
mod geometry;
mod keyframe;
mod layout;
mod model;
mod padded_index;
mod patch;
#[cfg(test)]
mod patch_tests;
mod preview;
mod rules;
mod section;
mod state;
#[cfg(test)]
mod tests;

pub use bit_breakdown::{BitBreakdown, bit_breakdown};
pub use budget::{Budget, Postponed};
pub use change_log::ChangeLog;
pub use decoder::Decoder;
pub use encoder::{Encoder, EncoderSettings, GeometrySource};
pub use geometry::{Geometry, GeometryDigest, GeometryError, RestPoint, RoundedGeometry};
pub use keyframe::keyframe;
pub use layout::{Layout, LayoutError, Member, SetLayout};
#[cfg(any(test, feature = "testing"))]
pub(crate) use model::change::{ChangeModel, ContextMixer};
pub use model::context::ContextError;
#[cfg(any(test, feature = "testing"))]
pub(crate) use model::history::{History, NEVER};
pub(crate) use padded_index::PaddedIndex;
pub use patch::patch;
pub use preview::{Preview, preview};
pub(crate) use rules::Rules;
pub use section::changes::ChangeError;
pub use section::geometry::GeometrySectionError;
pub use section::values::ValueError;
pub use state::State;

/// Points that come and go together: runs of this many along the curve that orders a set.
pub const BLOCK_POINTS: usize = 64;
