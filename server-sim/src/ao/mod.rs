//! Ambient occlusion of points: fixed ray sets, traced in bundles.
//!
//! AO is accessibility in [0, 1]: 1 is open. See [`AoSettings`] for the two kinds.

mod frame;
mod ray_packet;
mod ray_workload;
mod reference_tracer;
mod samples;
mod self_hits;
mod settings;
mod tracer;

pub use crate::bvh::Instructions;
pub use frame::tangent_frame;
pub use ray_workload::{Probe, Ray};
pub use reference_tracer::Twin;
pub(crate) use self_hits::Remembered;
pub use settings::{AoError, AoSettings, MAX_RAYS, Occlusion};
pub(crate) use tracer::{Memory, Seat};
pub use tracer::{Scratch, Traced, Tracer};
