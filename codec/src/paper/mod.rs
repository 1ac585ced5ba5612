//! Profile `paper`: the structures of "PSAO: Point-Based Split Rendering for Ambient Occlusion" (sections 3.1 to 3.5).
//!
//! Every instance has a virtual grid of cells. Hash buckets find the cells in use. A cell holds seven points of 32, 24
//! or 16 bits each. A frame carries whole buckets and poses, and each cell as its exclusive or with the cell sent
//! last.

mod cells;
mod changes;
mod decoder;
mod encoder;
mod error;
#[cfg(test)]
pub(crate) mod example;
mod keyframe;
mod layout;
mod point;
mod pose;
mod records;
mod resend;
mod rules;
mod state;

pub use cells::{
    Bucket, BucketError, Cell, ENTRIES_PER_BUCKET, Entry, Grid, GridLocation, MAX_CELL_INDEX, MAX_GRID_DIM,
    Occupancy, POINTS_PER_CELL, Placement, PutOutcome, bucket_of, cell_id,
};
pub use decoder::{Decoder, apply};
pub use encoder::{Encoder, PointSample};
pub use error::{GridError, LayoutError, PointError, RecordError};
pub use keyframe::keyframe;
pub use layout::{InstanceLayout, Layout, bucket_count};
pub use point::{BitSplit, Packed, Packed16, Packed24, Packed32, Point, PointFormat, WordError};
pub use pose::{Pose, PoseError};
pub(crate) use records::{Records, write_body};
pub use resend::ResendAo;
pub(crate) use rules::Rules;
pub use state::State;
