//! The layout of a `surface` stream: what both ends know before its first frame.

use super::{BLOCK_POINTS, Levels, PaddedIndex, RestPoint};
use crate::paper::MAX_GRID_DIM;
use crate::{Limits, memory};

/// Largest number of charts of a set: a chart's number takes 24 bits in a frame.
pub const MAX_CHARTS: u32 = 1 << 24;

/// A point set: the number of points of a mesh at rest, and the lattice to which their positions are rounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetLayout {
    /// Position of the lattice's first node, metres, rest space.
    pub origin: [f32; 3],
    /// Distance between neighbouring nodes, metres.
    pub step: f32,
    /// Largest coordinate along x, y and z, below [`MAX_GRID_DIM`].
    pub extent: [u32; 3],
    /// Bits of one axis of a normal's octahedral code, 2 to 8.
    pub normal_bits: u8,
    /// Number of points of the set.
    pub points: u32,
    /// Number of charts, 1 to [`MAX_CHARTS`] if there are points. See [`Charts`](super::Charts).
    pub charts: u32,
    /// The levels of the points.
    pub levels: Levels,
    /// Radius of the fit around a place where all points are taken, metres: about 1.5 times the distance of neighbouring
    /// points. See [`SetLayout::level_radius`].
    pub kernel_radius: f32,
    /// Digest of the set's geometry.
    pub digest: super::GeometryDigest,
}

/// An instance: the set of its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Member {
    /// Index of the set.
    pub set: u32,
}

/// The sets and instances of a stream. Point ids run through the instances in order, and through a set in the order of
/// its [`Geometry`](super::Geometry).
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    sets: Vec<SetLayout>,
    members: Vec<Member>,
    /// First point id of every instance, then the number of points.
    point_offsets: Vec<u32>,
    /// First block of every instance, then the number of blocks.
    block_offsets: Vec<u32>,
    /// Instance of every block.
    owners: Vec<u32>,
    /// By instance: the previous instance of the same set.
    previous_of_set: Vec<Option<u32>>,
}

/// Why sets and instances were refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// More instances than agreed.
    #[error("{found} instances, the agreed limit is {limit}")]
    Instances {
        /// Found.
        found: usize,
        /// The agreed limit.
        limit: u32,
    },
    /// More sets than the limit of instances.
    #[error("{found} point sets, the agreed limit is {limit}")]
    Sets {
        /// Found.
        found: usize,
        /// The agreed limit.
        limit: u32,
    },
    /// More points than agreed, of all instances or of all sets together.
    #[error("{found} points, the agreed limit is {limit}")]
    Points {
        /// Found.
        found: u64,
        /// The agreed limit.
        limit: u32,
    },
    /// An instance names a set that does not exist.
    #[error("instance {instance} names set {set}, but there are only {sets} sets")]
    NoSet {
        /// The instance.
        instance: u32,
        /// The set.
        set: u32,
        /// Number of sets.
        sets: usize,
    },
    /// A lattice, kernel or normal precision is out of range.
    #[error("set {set}: {what} is out of range")]
    Lattice {
        /// The set.
        set: u32,
        /// The value that is out of range.
        what: &'static str,
    },
}

impl Layout {
    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        let Layout { sets, members, point_offsets, block_offsets, owners, previous_of_set } = self;
        let tables = memory::list(point_offsets) + memory::list(block_offsets) + memory::list(owners);
        memory::list(sets) + memory::list(members) + tables + memory::list(previous_of_set)
    }

    /// Creates a layout. It checks sets and instances against each other and `limits`.
    ///
    /// # Errors
    /// [`LayoutError`] names the first error.
    pub fn new(sets: Vec<SetLayout>, members: Vec<Member>, limits: &Limits) -> Result<Layout, LayoutError> {
        let limit = limits.max_instances;
        if members.len() > limit as usize {
            return Err(LayoutError::Instances { found: members.len(), limit });
        }
        if sets.len() > limit as usize {
            return Err(LayoutError::Sets { found: sets.len(), limit });
        }
        let found = sets.iter().map(|set| u64::from(set.points)).sum();
        if found > u64::from(limits.max_points) {
            return Err(LayoutError::Points { found, limit: limits.max_points });
        }
        for (set, index) in sets.iter().zip(0_u32..) {
            check_set(set).map_err(|what| LayoutError::Lattice { set: index, what })?;
        }
        let mut point_offsets = Vec::with_capacity(members.len() + 1);
        let mut total = 0_u64;
        for (member, instance) in members.iter().zip(0_u32..) {
            let set = member.set;
            let Some(found) = sets.get(set as usize) else {
                return Err(LayoutError::NoSet { instance, set, sets: sets.len() });
            };
            point_offsets.push(total as u32);
            total += u64::from(found.points);
            if total > u64::from(limits.max_points) {
                return Err(LayoutError::Points { found: total, limit: limits.max_points });
            }
        }
        point_offsets.push(total as u32);
        let mut block_offsets = vec![0];
        let mut owners = Vec::new();
        for (pair, instance) in point_offsets.windows(2).zip(0..) {
            let blocks = ((pair[1] - pair[0]) as usize).div_ceil(BLOCK_POINTS);
            owners.resize(owners.len() + blocks, instance);
            block_offsets.push(owners.len() as u32);
        }
        let mut latest = vec![None; sets.len()];
        let previous_of_set =
            members.iter().zip(0_u32..).map(|(member, at)| latest[member.set as usize].replace(at)).collect();
        Ok(Layout { sets, members, point_offsets, block_offsets, owners, previous_of_set })
    }

    /// Returns the number of blocks over all instances. The points of an instance are in runs of [`BLOCK_POINTS`]; the
    /// last run may be shorter.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.owners.len()
    }

    /// Returns the blocks of an instance; empty if there is no such instance.
    #[must_use]
    pub fn blocks_of(&self, instance: u32) -> std::ops::Range<usize> {
        let at = instance as usize;
        match self.block_offsets.get(at..at + 2) {
            Some(&[first, end]) => first as usize..end as usize,
            _ => 0..0,
        }
    }

    /// Returns the instance of a block. `block` is below [`Layout::blocks`].
    pub(crate) fn owner(&self, block: usize) -> usize {
        self.owners[block] as usize
    }

    /// Returns the previous instance of the same set.
    pub(crate) fn previous_of_set(&self, instance: usize) -> Option<u32> {
        self.previous_of_set[instance]
    }

    /// Returns the padded indices of an instance's points.
    pub(crate) fn padded_range(&self, instance: usize) -> std::ops::Range<usize> {
        let first = self.block_offsets[instance] as usize * BLOCK_POINTS;
        first..first + (self.point_offsets[instance + 1] - self.point_offsets[instance]) as usize
    }

    /// Returns the number of points of a block.
    pub(crate) fn block_len(&self, block: usize) -> usize {
        let end = self.padded_range(self.owner(block)).end;
        (end - block * BLOCK_POINTS).min(BLOCK_POINTS)
    }

    /// Returns the instance of a point; `None` if there is no such point.
    pub(crate) fn instance_of(&self, point: u32) -> Option<usize> {
        (point < self.points()).then(|| self.point_offsets.partition_point(|first| *first <= point) - 1)
    }

    /// Returns the padded index of a point of an instance.
    #[inline]
    pub(crate) fn padded_index_in(&self, instance: usize, point: u32) -> PaddedIndex {
        let place = (point - self.point_offsets[instance]) as usize;
        PaddedIndex::new(self.block_offsets[instance] as usize, place)
    }

    /// Returns the padded index of a point; `None` if there is no such point.
    pub(crate) fn padded_index(&self, point: u32) -> Option<PaddedIndex> {
        Some(self.padded_index_in(self.instance_of(point)?, point))
    }

    /// Returns the instance of a block and its points, counted from the first point of the instance. `None` if there
    /// is no such block.
    #[must_use]
    pub fn points_of_block(&self, block: usize) -> Option<(u32, std::ops::Range<u32>)> {
        let instance = *self.owners.get(block)?;
        let first = ((block - self.block_offsets[instance as usize] as usize) * BLOCK_POINTS) as u32;
        Some((instance, first..first + self.block_len(block) as u32))
    }

    /// Returns the sets.
    #[must_use]
    pub fn sets(&self) -> &[SetLayout] {
        &self.sets
    }

    /// Returns the instances.
    #[must_use]
    pub fn members(&self) -> &[Member] {
        &self.members
    }

    /// Returns the first point id of every instance in order, then the number of all points.
    #[must_use]
    pub fn point_offsets(&self) -> &[u32] {
        &self.point_offsets
    }

    /// Returns the number of points of all instances.
    #[must_use]
    pub fn points(&self) -> u32 {
        self.point_offsets.last().copied().unwrap_or(0)
    }

    /// Returns the point ids of an instance; empty if there is no such instance.
    #[must_use]
    pub fn points_of(&self, instance: u32) -> std::ops::Range<usize> {
        let at = instance as usize;
        match self.point_offsets.get(at..at + 2) {
            Some(&[first, end]) => first as usize..end as usize,
            _ => 0..0,
        }
    }
}

impl SetLayout {
    /// Returns the layout of a lattice that covers these points and their charts with this step, or with the finest
    /// possible one if they are too far apart. Without points it has one node. [`Geometry::round`](super::Geometry::round) fills in
    /// the number, levels and digest of the points.
    #[must_use]
    pub fn covering(points: &[RestPoint], step: f32, normal_bits: u8, kernel_radius: f32) -> SetLayout {
        let axis = |axis: usize| points.iter().map(move |point| point.position[axis]);
        let (low, high): ([f32; 3], [f32; 3]) = if points.is_empty() {
            ([0.0; 3], [0.0; 3])
        } else {
            let low = std::array::from_fn(|at| axis(at).fold(f32::INFINITY, f32::min));
            (low, std::array::from_fn(|at| axis(at).fold(f32::NEG_INFINITY, f32::max)))
        };
        let size: [f32; 3] = std::array::from_fn(|at| (high[at] - low[at]).max(0.0));
        let finest = size.into_iter().fold(0.0, f32::max) / (MAX_GRID_DIM - 2) as f32;
        let step = step.max(finest);
        SetLayout {
            origin: low,
            step,
            extent: size.map(|axis| ((axis / step).ceil() as u32).min(MAX_GRID_DIM - 1)),
            normal_bits,
            points: 0,
            charts: points.iter().map(|point| point.chart.saturating_add(1)).max().unwrap_or(0),
            levels: Levels::default(),
            kernel_radius,
            digest: super::GeometryDigest::default(),
        }
    }

    /// Returns the position of a lattice node, metres, rest space.
    #[inline]
    #[must_use]
    pub fn position(&self, coord: [u32; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| self.origin[axis] + coord[axis] as f32 * self.step)
    }

    /// Returns the lattice node nearest to a position, and whether the position is inside the lattice; NaN is outside.
    pub(super) fn nearest(&self, position: [f32; 3]) -> ([u32; 3], bool) {
        let mut inside = true;
        let coord = std::array::from_fn(|axis| {
            let at = (position[axis] - self.origin[axis]) / self.step;
            let last = self.extent[axis] as f32;
            inside &= at >= -0.5 && at <= last + 0.5;
            // The cast turns NaN into 0 and truncates.
            ((at.max(0.0) + 0.5) as u32).min(self.extent[axis])
        });
        (coord, inside)
    }

    /// Returns the largest error of one axis of a position inside the lattice, metres: half a step and the rounding of
    /// `f32`.
    #[must_use]
    pub fn max_position_error(&self) -> f32 {
        let far = (0..3).map(|axis| self.origin[axis].abs() + self.extent[axis] as f32 * self.step);
        0.5 * self.step + 2.0 * f32::EPSILON * far.fold(0.0, f32::max)
    }
}

fn check_set(set: &SetLayout) -> Result<(), &'static str> {
    let positive = |value: f32| value.is_normal() && value > 0.0;
    if !positive(set.step) {
        return Err("the step of the lattice");
    }
    if !set.extent.iter().all(|axis| *axis < MAX_GRID_DIM) {
        return Err("the extent of the lattice");
    }
    let ends = [set.origin, set.position(set.extent)];
    if !ends.as_flattened().iter().all(|axis| axis.is_finite()) {
        return Err("the place of the lattice");
    }
    if !(2..=8).contains(&set.normal_bits) {
        return Err("the precision of normals");
    }
    if set.charts > MAX_CHARTS || set.charts < set.points.min(1) {
        return Err("the number of charts");
    }
    if set.levels.ends().last().is_some_and(|end| *end > set.points) {
        return Err("the number of points in a level");
    }
    if !positive(set.kernel_radius) || !positive(set.level_radius(0)) {
        return Err("the kernel radius");
    }
    Ok(())
}
