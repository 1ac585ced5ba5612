//! The lossy stage: each quantiser states its rounding and how far it can be off.

pub mod oct;
pub mod position;
pub mod unorm;
