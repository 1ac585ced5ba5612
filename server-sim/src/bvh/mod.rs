//! Acceleration structures: bodies of triangles, placed in the world by rigid transforms.

mod blas;
mod block;
mod bounds;
mod lanes;
mod tlas;
mod tree;
mod wide;

pub(crate) use blas::{Blas, BlasHit};
#[cfg(test)]
pub(crate) use blas::{reference, tests::triangle_soup};
pub(crate) use block::{BlockCulling, BlockSetup, Intersection, RayCone, SPREAD_SLACK, TriangleSetup};
pub use bounds::Bounds;
pub use lanes::Instructions;
pub(crate) use lanes::{LANES, Lanes, Lanes3, PACKET_GROUPS, Packed, Packed3, bits};
pub use tlas::Placement;
pub(crate) use tlas::{BlasInstance, BodyId, Tlas};
pub(crate) use tree::{Effort, Node};
pub(crate) use wide::{Child, WideNode};
