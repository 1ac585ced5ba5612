//! Acceleration structures: bodies of triangles, placed in the world by rigid transforms.

mod blas;
mod block;
mod bodies;
mod bounds;
mod lanes;
mod mover;
mod still;
#[cfg(test)]
mod tests;
mod tree;
mod wide;
mod world;

pub(crate) use blas::{Blas, BlasHit};
#[cfg(test)]
pub(crate) use blas::{naive, tests::soup};
pub(crate) use block::{Facet, Meeting, Pencil, Prepared, Reachable, SPREAD_SLACK};
pub(crate) use bodies::Bodies;
#[cfg(test)]
pub(crate) use bodies::Body;
pub use bodies::Placement;
pub use bounds::Bounds;
pub use lanes::Instructions;
pub(crate) use lanes::{LANES, Lanes, Lanes3, Packed, Packed3, bits};
pub(crate) use mover::{Stir, Swept};
#[cfg(test)]
pub(crate) use tree::Effort;
pub(crate) use tree::Node;
pub(crate) use wide::{Child, Wide};
pub use world::{Hit, SurfaceAt, World};
