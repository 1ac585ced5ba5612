//! Acceleration structures: bodies of triangles, placed in the world by rigid transforms.

mod blas;
mod block;
mod bodies;
mod bounds;
mod lanes;
mod mover;
#[cfg(test)]
mod tests;
mod tree;
mod world;

pub(crate) use blas::{Blas, BlasHit};
#[cfg(test)]
pub(crate) use blas::{naive, tests::soup};
pub(crate) use block::{Facet, Meeting, Prepared};
pub(crate) use bodies::Bodies;
#[cfg(test)]
pub(crate) use bodies::Body;
pub use bodies::Placement;
pub use bounds::Bounds;
pub(crate) use lanes::{LANES, Lanes, Lanes3, larger};
pub(crate) use mover::{Stir, Swept};
#[cfg(test)]
pub(crate) use tree::Effort;
pub(crate) use tree::Node;
pub use world::{Hit, SurfaceAt, World};
