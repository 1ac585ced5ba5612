//! Profile `surface`: points that stay where they are on the rest surface, of which only AO changes.
//!
//! A client draws the scene itself, so it knows every mesh at rest. The points of a mesh (a *set*) are kept there:
//! they are sent once, shared by all instances of the mesh, and whatever an instance does (move, skin, morph), a
//! later frame holds AO changes only.

mod apply;
mod budget;
#[cfg(test)]
mod budget_tests;
mod change_model;
mod changes;
mod context;
mod curve;
mod encoder;
#[cfg(test)]
mod example;
mod geometry;
mod geometry_model;
mod geometry_section;
mod history;
mod keyframe;
mod layout;
mod ledger;
mod marks;
mod patch;
mod patch_model;
mod patch_section;
#[cfg(test)]
mod patch_tests;
mod spent;
mod state;
#[cfg(test)]
mod tests;
mod values;
mod writer;

pub use apply::{Applier, Preview, preview};
pub use budget::{Budget, Postponed};
pub(crate) use change_model::{ChangeModel, Opinions};
pub use changes::ChangeProblem;
pub use context::ContextProblem;
pub use encoder::{Encoder, EncoderSettings, GeometrySource};
pub use geometry::{Geometry, GeometryDigest, GeometryError, RestPoint, Rounded};
pub use geometry_section::GeometryProblem;
pub(crate) use history::{History, NEVER};
pub use keyframe::keyframe;
pub use layout::{Layout, LayoutError, Member, SetLayout};
pub use ledger::Ledger;
pub use patch::patch;
pub use spent::{Spent, spent};
pub use state::State;
pub use values::ValueProblem;

/// Points that come and go together: runs of this many along the curve that orders a set.
pub const BLOCK_POINTS: usize = 64;
