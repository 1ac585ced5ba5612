//! A scene at a given time, ready for rays. Its instances are bodies, which are updated from pose to pose.

mod build;
mod dynamic_instance;
mod scene_bvh;
mod static_batch;
#[cfg(test)]
mod tests;

pub(crate) use dynamic_instance::{InstanceChange, SweptBounds};
pub use scene_bvh::{Hit, SceneBvh, SurfaceAt};
