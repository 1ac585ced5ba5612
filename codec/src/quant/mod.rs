//! Quantisers, the lossy stage. Each states its rounding and its largest error.

pub mod oct;
pub mod position;
pub mod unorm;
