//! The paper's structures (section 3.2): a virtual grid of cells per instance, hash buckets that find the
//! cells in use, and cells of seven points.

mod bucket;
mod cell;
mod changes;
mod encoder;
mod error;
mod grid;
mod occupancy;
mod slots;
mod table;

pub use bucket::{Bucket, BucketProblem, ENTRIES_PER_BUCKET, Entry, MAX_CELL_INDEX};
pub use cell::{Cell, POINTS_PER_CELL};
pub use encoder::{PaperEncoder, PointSample};
pub use error::{GridError, LayoutError, PointError};
pub use grid::{Grid, Located, MAX_GRID_DIM, bucket_of, cell_id};
pub use occupancy::{Occupancy, Placed, Placement};
pub use table::{InstanceLayout, Layout, bucket_count};
