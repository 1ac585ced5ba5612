//! The weights of points and their weighted mean, the accessibility of a place (paper, section 3.5, Eq. 2 to 4).

mod blend;
mod group;
mod weight;

pub(crate) use self::blend::{Blend, PointwiseBlend, Query};
pub(crate) use self::group::{LANES, PointGroup};
pub use self::weight::{DISTANCE_THRESHOLD, NORMAL_THRESHOLD, weight};
