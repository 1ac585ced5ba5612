//! Groups of points that are weighted together.

use glam::Vec3;

/// Number of points in a group: the lanes of a wide vector register.
pub(crate) const LANES: usize = 8;

/// What is special about a point. A number as wide as the other lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mark(u32);

impl Mark {
    /// Nothing is.
    pub(crate) const NONE: Self = Self(0);
    /// It is of the finest level that is looked at.
    pub(crate) const FINEST: Self = Self(1);
    /// So it is, but its value has not arrived: it does not count.
    pub(crate) const MISSING: Self = Self(2);
}

/// Eight points in the local space of their instance. Lanes without a point lie infinitely far away.
#[derive(Clone, Copy)]
pub(crate) struct PointGroup {
    pub(crate) position: [[f32; LANES]; 3],
    pub(crate) normal: [[f32; LANES]; 3],
    pub(crate) ao: [f32; LANES],
    pub(crate) mark: [Mark; LANES],
}

impl PointGroup {
    pub(crate) const EMPTY: Self = Self {
        position: [[f32::INFINITY; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        ao: [0.0; LANES],
        mark: [Mark::NONE; LANES],
    };

    pub(crate) fn set(&mut self, lane: usize, position: Vec3, normal: Vec3, ao: f32, mark: Mark) {
        for axis in 0..3 {
            self.position[axis][lane] = position[axis];
            self.normal[axis][lane] = normal[axis];
        }
        self.ao[lane] = ao;
        self.mark[lane] = mark;
    }
}
