//! Sums over the points of a neighbourhood, in groups of eight or one by one.

use glam::Vec3;

use super::group::{LANES, Mark, PointGroup};

/// Sums over points, taken a group at a time.
pub(crate) trait Accumulate {
    /// The place for which points count.
    type Query;

    /// Returns sums over no points.
    fn new() -> Self;

    /// Adds the points of a group.
    fn add(&mut self, group: &PointGroup, query: &Self::Query);
}

/// Sums to which points are added one by one. They take the lanes that they would have in a list of groups, so the result
/// is bit-identical.
pub(crate) struct Pointwise<'a, A: Accumulate> {
    query: &'a A::Query,
    sums: A,
    group: PointGroup,
    filled: usize,
}

impl<'a, A: Accumulate> Pointwise<'a, A> {
    pub(crate) fn new(query: &'a A::Query) -> Self {
        Self { query, sums: A::new(), group: PointGroup::EMPTY, filled: 0 }
    }

    /// Adds a point.
    #[inline]
    pub(crate) fn add(&mut self, position: Vec3, normal: Vec3, ao: f32, mark: Mark) {
        self.group.set(self.filled, position, normal, ao, mark);
        self.filled += 1;
        if self.filled == LANES {
            self.sums.add(&self.group, self.query);
            (self.group, self.filled) = (PointGroup::EMPTY, 0);
        }
    }

    /// Returns the sums over all points that were added.
    pub(crate) fn finish(mut self) -> A {
        if self.filled > 0 {
            self.sums.add(&self.group, self.query);
        }
        self.sums
    }
}
