//! References: slow and plain implementations to check the fast ones against, in tests and fuzzing. They search
//! everything, rebuild everything and store nothing that they can compute again.

mod paper_decoder;
mod paper_encoder;
mod surface;

pub use paper_decoder::{ReferenceError, apply};
pub use paper_encoder::PaperReferenceEncoder;
pub use surface::{ReferenceDelta, SurfaceReferenceEncoder, apply_surface};
