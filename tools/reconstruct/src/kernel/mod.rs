//! From the points near a place to its accessibility.
//!
//! Profile `paper` takes the weighted mean of the paper (section 3.5, Eq. 2 to 4), see [`weight()`]. Profile `surface`
//! takes a weighted affine fit over the points of the place's own chart.

mod accumulate;
mod blend;
mod fit;
mod group;
mod weight;

use glam::Vec3;

pub(crate) use self::accumulate::{Accumulate, Pointwise};
pub(crate) use self::blend::{Blend, Query};
pub use self::fit::{FACING_THRESHOLD, MOST_POINTS, RIDGE};
pub(crate) use self::fit::{FEWEST_POINTS, Fit, FitQuery, NearestSquares};
pub(crate) use self::group::{LANES, Mark, PointGroup};
pub use self::weight::{DISTANCE_THRESHOLD, NORMAL_THRESHOLD, weight};

/// The accessibility of a place, and how many points support it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Support {
    /// `None` when no point counts.
    pub(crate) ao: Option<f32>,
    /// Points with a weight above 0.
    pub(crate) points: u32,
}

impl Support {
    pub(crate) const NONE: Self = Self { ao: None, points: 0 };
}

/// Returns two unit vectors that span the plane of a unit normal (Duff et al. 2017, "Building an Orthonormal Basis,
/// Revisited").
#[inline]
pub(crate) fn tangent_frame(n: Vec3) -> [Vec3; 2] {
    let sign = 1.0_f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    [Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y)]
}
