//! The static layout of a stream, which both ends know before the first frame.

use super::{ENTRIES_PER_BUCKET, Grid, LayoutError, MAX_CELL_INDEX, PointFormat};
use crate::{Limits, memory};

/// The part of the layout that belongs to one instance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InstanceLayout {
    /// Grid of its cells.
    pub grid: Grid,
    /// Index of its first bucket among the buckets of the state.
    pub first_bucket: u32,
    /// Number of its buckets, a power of two.
    pub bucket_count: u32,
    /// Kernel radius `r` of Eq. 2, metres.
    pub kernel_radius: f32,
}

/// The tables of a stream: the packing of points, the instances, and the sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    format: PointFormat,
    instances: Vec<InstanceLayout>,
    cell_capacity: u32,
    bucket_total: u32,
}

impl Layout {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.instances)
    }

    /// Creates a layout of these instances, in order, with points packed as `format` tells. It has room for
    /// `cell_capacity` cells, over all instances.
    ///
    /// # Errors
    /// [`LayoutError`] unless all of the following hold. The buckets of the instances follow one another without gaps,
    /// from 0. Each count is a power of two. Each kernel radius is finite and above 0. The sizes are within `limits`,
    /// and the number of cells is at most 2^22.
    pub fn new(
        format: PointFormat,
        instances: Vec<InstanceLayout>,
        cell_capacity: u32,
        limits: &Limits,
    ) -> Result<Layout, LayoutError> {
        if instances.len() > limits.max_instances as usize {
            return Err(LayoutError::Instances { found: instances.len(), limit: limits.max_instances });
        }
        let limit = limits.max_cells.min(MAX_CELL_INDEX + 1);
        if cell_capacity > limit {
            return Err(LayoutError::Cells { found: cell_capacity, limit });
        }
        let mut bucket_total = 0_u32;
        for (instance, layout) in (0_u32..).zip(&instances) {
            bucket_total = layout.end_of_buckets(instance, bucket_total, limits.max_buckets)?;
        }
        Ok(Layout { format, instances, cell_capacity, bucket_total })
    }

    /// Returns the packing of the points.
    #[inline]
    #[must_use]
    pub fn format(&self) -> PointFormat {
        self.format
    }

    /// Returns the instances, in order.
    #[must_use]
    pub fn instances(&self) -> &[InstanceLayout] {
        &self.instances
    }

    /// Returns the number of cells that there is room for, over all instances.
    #[must_use]
    pub fn cell_capacity(&self) -> u32 {
        self.cell_capacity
    }

    /// Returns the number of buckets, over all instances.
    #[must_use]
    pub fn bucket_total(&self) -> u32 {
        self.bucket_total
    }
}

impl InstanceLayout {
    /// Checks this instance, whose buckets must start at `start`. Returns where they end.
    fn end_of_buckets(&self, instance: u32, start: u32, limit: u32) -> Result<u32, LayoutError> {
        if !(self.kernel_radius.is_finite() && self.kernel_radius > 0.0) {
            return Err(LayoutError::KernelRadius { instance, found: self.kernel_radius });
        }
        if !self.bucket_count.is_power_of_two() {
            return Err(LayoutError::BucketCount { instance, found: self.bucket_count });
        }
        if self.first_bucket != start {
            return Err(LayoutError::FirstBucket { instance, expected: start, found: self.first_bucket });
        }
        match start.checked_add(self.bucket_count) {
            Some(end) if end <= limit => Ok(end),
            _ => {
                let found = u64::from(start) + u64::from(self.bucket_count);
                Err(LayoutError::Buckets { instance, found, limit })
            }
        }
    }
}

/// Returns the number of buckets for an instance with `area_m2` square metres of surface in cells of `edge` metres
/// (paper, section 3.2: four slots for an average cell, eight slots a bucket).
///
/// The average number of cells is the area over the square of the edge. The result is rounded up to a power of two, at
/// least 1 and at most 2^31. It is 1 if the arguments give no number.
#[must_use]
pub fn bucket_count(area_m2: f32, edge: f32, slots_per_cell: f32) -> u32 {
    let cells = f64::from(area_m2) / (f64::from(edge) * f64::from(edge));
    let buckets = (f64::from(slots_per_cell) * cells / ENTRIES_PER_BUCKET as f64).ceil();
    // The cast saturates, and turns NaN into 0.
    (buckets as u32).clamp(1, 1 << 31).next_power_of_two()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instance(first_bucket: u32, bucket_count: u32) -> InstanceLayout {
        let grid = Grid::new([0.0; 3], 1.0, [4, 4, 4]).unwrap();
        InstanceLayout { grid, first_bucket, bucket_count, kernel_radius: 0.5 }
    }

    #[test]
    fn bucket_counts_follow_the_paper() {
        // 100 m^2 in cells of 0.25 m: 1,600 cells, 6,400 slots, 800 buckets.
        assert_eq!(bucket_count(100.0, 0.25, 4.0), 1024);
        assert_eq!(bucket_count(128.0, 0.25, 4.0), 1024);
        assert_eq!(bucket_count(128.1, 0.25, 4.0), 2048);
        assert_eq!(bucket_count(0.0, 0.25, 4.0), 1);
        assert_eq!(bucket_count(f32::NAN, 0.25, 4.0), 1);
        assert_eq!(bucket_count(-1.0, 0.25, 4.0), 1);
        assert_eq!(bucket_count(f32::INFINITY, 0.25, 4.0), 1 << 31);
        assert_eq!(bucket_count(1.0, 0.0, 4.0), 1 << 31);
    }

    #[test]
    fn layouts_that_make_no_sense_are_refused() {
        let limits = Limits { max_instances: 2, max_buckets: 16, max_cells: 100, ..Limits::default() };
        let new = |instances, cells| Layout::new(PointFormat::Bits32, instances, cells, &limits);
        let layout = new(vec![instance(0, 8), instance(8, 8)], 100).unwrap();
        assert_eq!((layout.bucket_total(), layout.cell_capacity()), (16, 100));
        assert_eq!(new(vec![], 101), Err(LayoutError::Cells { found: 101, limit: 100 }));
        assert_eq!(new(vec![instance(0, 1); 3], 1), Err(LayoutError::Instances { found: 3, limit: 2 }));
        assert_eq!(new(vec![instance(0, 12)], 1), Err(LayoutError::BucketCount { instance: 0, found: 12 }));
        assert_eq!(
            new(vec![instance(0, 8), instance(9, 8)], 1),
            Err(LayoutError::FirstBucket { instance: 1, expected: 8, found: 9 })
        );
        assert_eq!(
            new(vec![instance(0, 8), instance(8, 1 << 31)], 1),
            Err(LayoutError::Buckets { instance: 1, found: (1 << 31) + 8, limit: 16 })
        );
        let flat = InstanceLayout { kernel_radius: 0.0, ..instance(0, 1) };
        assert_eq!(new(vec![flat], 1), Err(LayoutError::KernelRadius { instance: 0, found: 0.0 }));
    }

    #[test]
    fn no_layout_has_more_cells_than_an_index_can_name() {
        let limits = Limits { max_cells: u32::MAX, ..Limits::default() };
        assert!(Layout::new(PointFormat::Bits16, vec![], 1 << 22, &limits).is_ok());
        let refused = Layout::new(PointFormat::Bits16, vec![], (1 << 22) + 1, &limits);
        assert_eq!(refused, Err(LayoutError::Cells { found: (1 << 22) + 1, limit: 1 << 22 }));
    }
}
