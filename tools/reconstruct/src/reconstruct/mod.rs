//! From the stream's state to one accessibility per fragment (paper, section 3.5).
//!
//! [`cells`] blends the points of a stream of profile `paper`, in the space that an instance is in now; [`surface`] and
//! [`SurfaceReconstructor`] those of profile `surface`, on the mesh at rest. Weights and mean are the same.

mod blend;
mod cells;
mod neighbours;
mod outcome;
mod surface;
mod walk;
mod weight;

pub use self::cells::cells;
pub use self::outcome::{ReconstructError, Reconstruction, Statistics};
pub use self::surface::{SurfaceIndex, SurfaceReconstructor, surface};
pub use self::weight::{DISTANCE_THRESHOLD, NORMAL_THRESHOLD, weight};
