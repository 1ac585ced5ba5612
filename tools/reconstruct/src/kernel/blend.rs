//! The weighted mean of the points of a neighbourhood (paper, Eq. 4), computed eight points a step.

use glam::Vec3;

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

impl Blend {
    #[inline]
    pub(crate) fn new() -> Self {
        Self { weights: [0.0; LANES], weighted: [0.0; LANES], blended: [0; LANES] }
    }

    /// Adds the points of a group, each with the weight of [`weight`](super::weight()). The operations and their order
    /// are those of that function, without a branch.
    #[inline]
    pub(crate) fn add(&mut self, group: &PointGroup, query: &Query) {
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

    /// Returns the number of points with a weight above 0.
    #[cfg(any(test, feature = "view"))]
    #[inline]
    pub(crate) fn blended(&self) -> u32 {
        self.blended.iter().sum()
    }

    /// Returns the weighted mean; `None` when no point has a weight above 0.
    #[inline]
    pub(crate) fn mean(&self) -> Option<f32> {
        let weights = self.weights.iter().sum::<f32>();
        // Rounding may push a mean of values in [0, 1] out of that range.
        (weights != 0.0).then(|| (self.weighted.iter().sum::<f32>() / weights).clamp(0.0, 1.0))
    }
}

/// A [`Blend`] to which points are added one by one. They take the lanes that they would have in a list of groups, so
/// the result is bit-identical.
pub(crate) struct PointwiseBlend<'a> {
    query: &'a Query,
    blend: Blend,
    group: PointGroup,
    filled: usize,
}

impl<'a> PointwiseBlend<'a> {
    pub(crate) fn new(query: &'a Query) -> Self {
        Self { query, blend: Blend::new(), group: PointGroup::EMPTY, filled: 0 }
    }

    /// Adds a point.
    #[inline]
    pub(crate) fn add(&mut self, position: Vec3, normal: Vec3, ao: f32) {
        self.group.set(self.filled, position, normal, ao);
        self.filled += 1;
        if self.filled == LANES {
            self.blend.add(&self.group, self.query);
            (self.group, self.filled) = (PointGroup::EMPTY, 0);
        }
    }

    /// Returns the blend of all points that were added.
    pub(crate) fn finish(mut self) -> Blend {
        if self.filled > 0 {
            self.blend.add(&self.group, self.query);
        }
        self.blend
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kernel::weight;

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
            prop_assert_eq!(all.blended(), blended);
            prop_assert_eq!(all.mean().is_some(), blended > 0);
            prop_assert!(all.mean().is_none_or(|mean| (0.0..=1.0).contains(&mean)));
        }
    }
}
