//! Ambient occlusion of points: fixed ray sets, traced in packets.
//!
//! AO is accessibility in [0, 1]: 1 is open. See [`AoSettings`] for the two kinds.

mod burial;
mod frame;
mod ray_packet;
#[cfg(any(test, feature = "testing"))]
mod ray_workload;
#[cfg(any(test, feature = "testing"))]
mod reference_tracer;
mod samples;
mod self_hits;
mod settings;
mod tracer;

pub use crate::bvh::Instructions;
pub use frame::tangent_frame;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub use ray_workload::{Ray, RayWorkload};
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub use reference_tracer::ReferenceTracer;
pub(crate) use self_hits::SelfHits;
pub use settings::{AoError, AoSettings, MAX_RAYS, Occlusion};
pub use tracer::{PointAo, Scratch, Tracer};
pub(crate) use tracer::{RayFrame, SelfHitCache};
