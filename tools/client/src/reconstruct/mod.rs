//! From the stream's state to one accessibility per fragment (paper, section 3.5).

mod blend;
mod cells;
mod neighbours;
mod weight;

pub use self::cells::{ReconstructError, Reconstruction, Statistics, cells};
pub use self::weight::{DISTANCE_THRESHOLD, NORMAL_THRESHOLD, weight};
