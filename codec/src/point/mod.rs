//! The packings of one point.

mod packed32;

pub use packed32::Packed32;
