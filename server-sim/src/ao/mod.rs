//! Ambient occlusion of points: fixed ray sets, traced in bundles.
//!
//! AO is accessibility in [0, 1]: 1 is open. See [`AoSettings`] for the two kinds.

mod bundle;
mod frame;
mod samples;
mod settings;
mod tracer;

pub use frame::tangent_frame;
pub use settings::{AoError, AoSettings, MAX_RAYS, Occlusion};
pub(crate) use tracer::Seat;
pub use tracer::{Scratch, Traced, Tracer};
