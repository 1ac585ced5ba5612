//! Groups of points that are weighted together.

use glam::Vec3;

/// Number of points in a group: the lanes of a wide vector register.
pub(crate) const LANES: usize = 8;

/// Eight points in the local space of their instance. Lanes without a point lie infinitely far away.
#[derive(Clone, Copy)]
pub(crate) struct PointGroup {
    pub(crate) position: [[f32; LANES]; 3],
    pub(crate) normal: [[f32; LANES]; 3],
    pub(crate) ao: [f32; LANES],
}

impl PointGroup {
    pub(crate) const EMPTY: Self =
        Self { position: [[f32::INFINITY; LANES]; 3], normal: [[0.0; LANES]; 3], ao: [0.0; LANES] };

    pub(crate) fn set(&mut self, lane: usize, position: Vec3, normal: Vec3, ao: f32) {
        for axis in 0..3 {
            self.position[axis][lane] = position[axis];
            self.normal[axis][lane] = normal[axis];
        }
        self.ao[lane] = ao;
    }
}
