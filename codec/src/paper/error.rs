//! Errors of grids, layouts, points and records.

use super::{BucketError, PoseError};

/// Why a [`super::Grid`] was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GridError {
    /// A coordinate of the origin is infinite or not a number.
    #[error("grid origin {origin:?} is not finite")]
    Origin {
        /// The origin.
        origin: [f32; 3],
    },
    /// The edge is not a finite length above 0.
    #[error("grid cell edge {edge} m is not a finite length above 0")]
    Edge {
        /// The edge, metres.
        edge: f32,
    },
    /// A dimension is 0 or above [`super::MAX_GRID_DIM`].
    #[error("grid of {dims:?} cells: every axis takes 1 to {} cells", super::MAX_GRID_DIM)]
    Dims {
        /// The dimensions, cells.
        dims: [u32; 3],
    },
    /// The far corner of the grid is beyond the range of `f32`.
    #[error("grid of {dims:?} cells of {edge} m reaches beyond what f32 can hold")]
    Extent {
        /// The edge, metres.
        edge: f32,
        /// The dimensions, cells.
        dims: [u32; 3],
    },
}

/// Why a [`super::Layout`] was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// More instances than agreed.
    #[error("layout of {found} instances, the agreed limit is {limit}; raise Limits::max_instances")]
    Instances {
        /// Found.
        found: usize,
        /// The agreed limit.
        limit: u32,
    },
    /// The bucket count of an instance is not a power of two.
    #[error("instance {instance}: {found} buckets is not a power of two")]
    BucketCount {
        /// Index of the instance.
        instance: u32,
        /// Found.
        found: u32,
    },
    /// The buckets of an instance do not start where those of the instance before it end.
    #[error("instance {instance}: its buckets start at {found}, those before it end at {expected}")]
    FirstBucket {
        /// Index of the instance.
        instance: u32,
        /// Expected start.
        expected: u32,
        /// Found start.
        found: u32,
    },
    /// More buckets than agreed, over all instances.
    #[error(
        "instance {instance} brings the layout to {found} buckets, the agreed limit is {limit}; raise Limits::max_buckets"
    )]
    Buckets {
        /// Index of the instance that goes past the limit.
        instance: u32,
        /// Number of buckets up to this instance, including it.
        found: u64,
        /// The agreed limit.
        limit: u32,
    },
    /// More cells than agreed, or than a 22-bit cell index can name.
    #[error("layout of {found} cells, the limit is {limit} (Limits::max_cells, and 2^22 at most)")]
    Cells {
        /// Found.
        found: u32,
        /// The limit.
        limit: u32,
    },
    /// The kernel radius of an instance is not a finite length above 0.
    #[error("instance {instance}: kernel radius {found} m is not a finite length above 0")]
    KernelRadius {
        /// Index of the instance.
        instance: u32,
        /// Found, metres.
        found: f32,
    },
}

/// Why the encoder refused its points, or one point.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PointError {
    /// The number of point counts is not the number of instances.
    #[error("{found} point counts for {expected} instances")]
    Instances {
        /// Instances of the layout.
        expected: usize,
        /// Number of counts.
        found: usize,
    },
    /// More points than there are point ids, over all instances.
    #[error("{found} points, ids reach up to 2^32 - 2")]
    TooMany {
        /// Found.
        found: u64,
    },
    /// No point has this id.
    #[error("point {point}: ids end at {count}")]
    Unknown {
        /// The id.
        point: u32,
        /// Number of points.
        count: u32,
    },
    /// A coordinate is infinite or not a number.
    #[error("point {point}: local position {local:?} is not finite")]
    Position {
        /// The point.
        point: u32,
        /// The position, metres, instance-local.
        local: [f32; 3],
    },
    /// The normal has no direction.
    #[error("point {point}: normal {normal:?} has no direction")]
    Normal {
        /// The point.
        point: u32,
        /// The normal.
        normal: [f32; 3],
    },
}

/// Why a record of a frame was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// A pose is not finite, or its rotation is not of unit length.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// A bucket breaks the rules of its layout.
    #[error(transparent)]
    Bucket(#[from] BucketError),
    /// A cell has set bits after its last point.
    #[error("slot {slot} holds no point but is not empty, or a point follows it")]
    Cell {
        /// Index of the slot, 0 to 6.
        slot: usize,
    },
}
