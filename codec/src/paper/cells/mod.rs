//! The paper's structures (section 3.2): a virtual grid of cells per instance, hash buckets that find the cells in use, and
//! cells of seven points.

mod bucket;
mod cell;
mod grid;
mod occupancy;
mod tables;

pub use bucket::{Bucket, BucketError, ENTRIES_PER_BUCKET, Entry, MAX_CELL_INDEX};
pub use cell::{Cell, POINTS_PER_CELL};
pub use grid::{Grid, GridLocation, MAX_GRID_DIM, bucket_of, cell_id};
pub use occupancy::{Occupancy, Placement, PutOutcome};
pub(super) use tables::{CellAddress, DirtySet, Tables};
