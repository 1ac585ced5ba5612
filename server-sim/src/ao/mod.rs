//! Ambient occlusion of points: fixed ray sets, traced in bundles.
//!
//! AO is accessibility in [0, 1]: 1 is open. See [`AoSettings`] for the two kinds.

mod bundle;
mod frame;
mod probe;
mod remembered;
mod samples;
mod settings;
mod tracer;
mod twin;

pub use crate::bvh::Instructions;
pub use frame::tangent_frame;
pub use probe::{Probe, Ray};
pub(crate) use remembered::Remembered;
pub use settings::{AoError, AoSettings, MAX_RAYS, Occlusion};
pub(crate) use tracer::{Memory, Seat};
pub use tracer::{Scratch, Traced, Tracer};
pub use twin::Twin;
