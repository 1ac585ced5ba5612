//! Slow, obvious twins of the fast paths, for tests and fuzzing. They search everything, rebuild everything
//! and keep nothing that they could work out again.

mod paper_decoder;
mod paper_encoder;
mod surface;

pub use paper_decoder::{ReferenceError, apply};
pub use paper_encoder::PaperReferenceEncoder;
pub use surface::{SurfaceReferenceEncoder, apply_surface};
