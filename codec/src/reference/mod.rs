//! Slow, obvious twins of the fast paths, for tests and fuzzing. They search everything, rebuild everything
//! and keep nothing that they could work out again.

mod decode;
mod encoder;
mod surface;

pub use decode::{Refused, apply};
pub use encoder::NaiveEncoder;
pub use surface::{NaiveSurfaceEncoder, apply_surface};
