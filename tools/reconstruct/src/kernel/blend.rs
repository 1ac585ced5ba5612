//! The weighted mean of the points of a neighbourhood (paper, Eq. 4), computed eight points a step.

use glam::Vec3;

use super::Support;
use super::accumulate::Accumulate;
use super::group::{LANES, PointGroup};
use super::weight::{DISTANCE_THRESHOLD, NORMAL_THRESHOLD};

/// A place, in the space of its points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Query {
    pub(crate) position: Vec3,
    pub(crate) normal: Vec3,
    /// `r` of Eq. 2 in metres.
    pub(crate) radius: f32,
}

/// The sums of Eq. 4 over the points so far. There is one sum a lane, so that the order of additions is the same on
/// every machine.
pub(crate) struct Blend {
    weights: [f32; LANES],
    weighted: [f32; LANES],
    blended: [u32; LANES],
}

impl Accumulate for Blend {
    type Query = Query;

    #[inline]
    fn new() -> Self {
        Self { weights: [0.0; LANES], weighted: [0.0; LANES], blended: [0; LANES] }
    }

    /// Adds the points of a group, each with the weight of [`weight`](super::weight()). The operations and their order
    /// are those of that function, without a branch.
    #[inline]
    fn add(&mut self, group: &PointGroup, query: &Query) {
        let ([px, py, pz], [nx, ny, nz]) = (&group.position, &group.normal);
        let (x, n) = (query.position, query.normal);
        for lane in 0..LANES {
            let offset = [px[lane] - x.x, py[lane] - x.y, pz[lane] - x.z];
            let square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
            let alpha = (query.radius - square.sqrt()) / query.radius;
            let along = nx[lane] * offset[0] + ny[lane] * offset[1] + nz[lane] * offset[2];
            let facing = nx[lane] * n.x + ny[lane] * n.y + nz[lane] * n.z;
            let straight = (square > 0.0) & (along * along >= DISTANCE_THRESHOLD * square);
            let counts = (alpha > 0.0) & (facing > NORMAL_THRESHOLD) & !straight;
            let alpha = if counts { alpha } else { 0.0 };
            self.weights[lane] += alpha;
            self.weighted[lane] += alpha * group.ao[lane];
            self.blended[lane] += u32::from(counts);
        }
    }
}

impl Blend {
    /// Returns the weighted mean, and the number of points with a weight above 0.
    #[inline]
    pub(crate) fn support(&self) -> Support {
        let weights = self.weights.iter().sum::<f32>();
        // Rounding may push a mean of values in [0, 1] out of that range.
        let mean = (weights != 0.0).then(|| (self.weighted.iter().sum::<f32>() / weights).clamp(0.0, 1.0));
        Support { ao: mean, points: self.blended.iter().sum() }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kernel::{Mark, weight};

    fn vector() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0_f32..1.0).prop_map(Vec3::from)
    }

    fn group(points: &[(Vec3, Vec3, f32)]) -> PointGroup {
        let lane = |lane: usize| points.get(lane).copied().unwrap_or((Vec3::INFINITY, Vec3::ZERO, 0.0));
        let axis =
            |axis: usize, of: fn((Vec3, Vec3, f32)) -> Vec3| std::array::from_fn(|l| of(lane(l))[axis]);
        PointGroup {
            position: std::array::from_fn(|a| axis(a, |point| point.0)),
            normal: std::array::from_fn(|a| axis(a, |point| point.1)),
            ao: std::array::from_fn(|l| lane(l).2),
            mark: [Mark::NONE; LANES],
        }
    }

    proptest! {
        #[test]
        fn each_lane_has_the_weight_of_the_scalar_function_to_the_bit(
            points in prop::collection::vec((vector(), vector(), 0.0_f32..=1.0), 0..=LANES),
            position in vector(),
            normal in vector(),
            radius in 0.1_f32..2.0,
        ) {
            let query = Query { position, normal, radius };
            let mut all = Blend::new();
            all.add(&group(&points), &query);
            let mut blended = 0;
            for (lane, &(point, point_normal, ao)) in points.iter().enumerate() {
                let alpha = weight(
                    point.to_array(),
                    point_normal.to_array(),
                    position.to_array(),
                    normal.to_array(),
                    radius,
                );
                prop_assert_eq!(all.weights[lane], alpha);
                prop_assert_eq!(all.weighted[lane], alpha * ao);
                blended += u32::from(alpha > 0.0);
            }
            let found = all.support();
            prop_assert_eq!(found.points, blended);
            prop_assert_eq!(found.ao.is_some(), blended > 0);
            prop_assert!(found.ao.is_none_or(|mean| (0.0..=1.0).contains(&mean)));
        }
    }
}
