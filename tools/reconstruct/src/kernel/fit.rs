//! The fit of profile `surface`: a weighted affine function of the points near a place.
//!
//! A weighted mean (Eq. 4) cannot follow the slope of AO at a crease, where all its points lie to one side. The fit takes
//! the value at the place of the affine function that has the least weighted square error (moving least squares:
//! Lancaster and Salkauskas 1981), with a ridge for points in a line or a heap.

use glam::Vec3;

use super::accumulate::Accumulate;
use super::group::{LANES, Mark, PointGroup};
use super::{Support, tangent_frame};

/// A point counts when the cosine between its normal and the place's is above it.
pub const FACING_THRESHOLD: f32 = 0.5;

/// Ridge of the covariance, in squared radii.
pub const RIDGE: f32 = 0.02;

/// Most points of a fit. Where more are near, as on narrow charts, the fit reaches only as far as the nearest of them.
pub const MOST_POINTS: usize = 10;

/// Fewest points of a fit; with fewer, the nearest points of the chart are taken, however far.
pub(crate) const FEWEST_POINTS: u32 = 3;

/// A place at rest, and the points that count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FitQuery {
    pub(crate) position: Vec3,
    pub(crate) normal: Vec3,
    /// Two directions of the tangent plane.
    tangents: [Vec3; 2],
    /// Metres.
    pub(crate) radius: f32,
    facing: f32,
}

/// The squared distances of the nearest points that count, ascending: one more than a fit may have.
pub(crate) struct NearestSquares([f32; MOST_POINTS + 1]);

impl Accumulate for NearestSquares {
    type Query = FitQuery;

    fn new() -> Self {
        Self([f32::INFINITY; MOST_POINTS + 1])
    }

    fn add(&mut self, group: &PointGroup, query: &FitQuery) {
        for lane in 0..LANES {
            let [position, normal] = [&group.position, &group.normal]
                .map(|axes| Vec3::new(axes[0][lane], axes[1][lane], axes[2][lane]));
            let square = position.distance_squared(query.position);
            let facing = normal.dot(query.normal) > query.facing;
            if facing && group.mark[lane] != Mark::MISSING && square < self.0[MOST_POINTS] {
                let place = self.0.partition_point(|nearer| *nearer <= square);
                self.0.copy_within(place..MOST_POINTS, place + 1);
                self.0[place] = square;
            }
        }
    }
}

impl NearestSquares {
    /// Returns the query that reaches to the first point too many.
    pub(crate) fn narrowed(&self, query: &FitQuery) -> FitQuery {
        FitQuery { radius: self.0[MOST_POINTS].sqrt().min(query.radius), ..*query }
    }
}

impl FitQuery {
    #[inline]
    pub(crate) fn new(position: Vec3, normal: Vec3, radius: f32) -> Self {
        Self { position, normal, tangents: tangent_frame(normal), radius, facing: FACING_THRESHOLD }
    }

    /// Returns the query for another radius, with points of any direction.
    pub(crate) fn within(self, radius: f32) -> Self {
        Self { radius, facing: f32::NEG_INFINITY, ..self }
    }
}

/// The sums of the fit over the points so far. There is one sum a lane, so that the order of additions is the same on
/// every machine. `u` and `v` are a point's coordinates in the tangent plane, `a` is its accessibility, and `w` its weight.
#[derive(Clone)]
pub(crate) struct Fit {
    w: [f32; LANES],
    wu: [f32; LANES],
    wv: [f32; LANES],
    wuu: [f32; LANES],
    wuv: [f32; LANES],
    wvv: [f32; LANES],
    wa: [f32; LANES],
    wau: [f32; LANES],
    wav: [f32; LANES],
    low: [f32; LANES],
    high: [f32; LANES],
    count: [u32; LANES],
    /// Points of the finest level among them, and points of it that have not arrived.
    finest: [u32; LANES],
    missing: [u32; LANES],
}

impl Accumulate for Fit {
    type Query = FitQuery;

    fn new() -> Self {
        let zero = [0.0; LANES];
        Self {
            w: zero,
            wu: zero,
            wv: zero,
            wuu: zero,
            wuv: zero,
            wvv: zero,
            wa: zero,
            wau: zero,
            wav: zero,
            low: [f32::INFINITY; LANES],
            high: [f32::NEG_INFINITY; LANES],
            count: [0; LANES],
            finest: [0; LANES],
            missing: [0; LANES],
        }
    }

    #[inline]
    fn add(&mut self, group: &PointGroup, query: &FitQuery) {
        let ([px, py, pz], [nx, ny, nz]) = (&group.position, &group.normal);
        let (x, n, [t, b]) = (query.position, query.normal, query.tangents);
        for lane in 0..LANES {
            let (ox, oy, oz) = (px[lane] - x.x, py[lane] - x.y, pz[lane] - x.z);
            let distance = (ox * ox + oy * oy + oz * oz).sqrt();
            let near = (query.radius - distance) / query.radius;
            let facing = nx[lane] * n.x + ny[lane] * n.y + nz[lane] * n.z;
            let reached = (near > 0.0) & (facing > query.facing);
            let counts = reached & (group.mark[lane] != Mark::MISSING);
            self.finest[lane] += u32::from(reached & (group.mark[lane] == Mark::FINEST));
            self.missing[lane] += u32::from(reached & (group.mark[lane] == Mark::MISSING));
            // A lane without a point lies infinitely far away: its offset must not reach the sums.
            let offset = |along: Vec3| if counts { ox * along.x + oy * along.y + oz * along.z } else { 0.0 };
            let (u, v) = (offset(t), offset(b));
            let a = group.ao[lane];
            let w = if counts { near * near } else { 0.0 };
            self.w[lane] += w;
            self.wu[lane] += w * u;
            self.wv[lane] += w * v;
            self.wuu[lane] += w * u * u;
            self.wuv[lane] += w * u * v;
            self.wvv[lane] += w * v * v;
            self.wa[lane] += w * a;
            self.wau[lane] += w * a * u;
            self.wav[lane] += w * a * v;
            self.low[lane] = self.low[lane].min(if counts { a } else { f32::INFINITY });
            self.high[lane] = self.high[lane].max(if counts { a } else { f32::NEG_INFINITY });
            self.count[lane] += u32::from(counts);
        }
    }
}

impl Fit {
    /// Returns the number of points that count.
    #[inline]
    pub(crate) fn count(&self) -> u32 {
        self.count.iter().sum()
    }

    /// Returns whether the finest points that may count are here: one of them at least, or none is missing.
    #[inline]
    pub(crate) fn is_complete(&self) -> bool {
        self.finest.iter().any(|finest| *finest > 0) || self.missing.iter().all(|missing| *missing == 0)
    }

    /// Returns the value at the place, kept within half the points' range around that range and within [0, 1].
    #[inline]
    pub(crate) fn support(&self, radius: f32) -> Support {
        let sum = |lanes: &[f32; LANES]| lanes.iter().sum::<f32>();
        let w = sum(&self.w);
        let points = self.count();
        if points == 0 || w <= 0.0 {
            return Support::NONE;
        }
        let mean = |lanes: &[f32; LANES]| sum(lanes) / w;
        let (u, v, a) = (mean(&self.wu), mean(&self.wv), mean(&self.wa));
        let ridge = RIDGE * radius * radius;
        let (uu, uv, vv) =
            (mean(&self.wuu) - u * u + ridge, mean(&self.wuv) - u * v, mean(&self.wvv) - v * v + ridge);
        let (au, av) = (mean(&self.wau) - a * u, mean(&self.wav) - a * v);
        let slope_part = (u * (vv * au - uv * av) + v * (uu * av - uv * au)) / (uu * vv - uv * uv);
        // Radii whose square is 0 or infinite leave no covariance; the mean remains.
        let value = if slope_part.is_finite() { a - slope_part } else { a };
        let low = self.low.iter().copied().fold(f32::INFINITY, f32::min);
        let high = self.high.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let half = 0.5 * (high - low);
        Support { ao: Some(value.clamp(low - half, high + half).clamp(0.0, 1.0)), points }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{fit_reference, unit};

    fn fit(points: &[(Vec3, Vec3, f32)], query: &FitQuery) -> Support {
        let mut fit = Fit::new();
        for points in points.chunks(LANES) {
            let mut group = PointGroup::EMPTY;
            for (lane, (position, normal, ao)) in points.iter().enumerate() {
                group.set(lane, *position, *normal, *ao, Mark::NONE);
            }
            fit.add(&group, query);
        }
        fit.support(query.radius)
    }

    proptest! {
        #[test]
        fn the_fit_is_that_of_the_formula(
            points in prop::collection::vec((prop::array::uniform3(-1.0_f32..1.0), unit(), 0.0_f32..=1.0), 0..24),
            place in prop::array::uniform3(-0.5_f32..0.5),
            normal in unit(),
            radius in 0.2_f32..2.0,
        ) {
            let points: Vec<_> = points.into_iter().map(|(at, n, ao)| (Vec3::from(at), n, ao)).collect();
            let exact = points.iter().map(|(at, n, ao)| (at.as_dvec3(), n.as_dvec3(), f64::from(*ao)));
            let place = Vec3::from(place);
            let wanted = fit_reference(exact, (place.as_dvec3(), normal.as_dvec3()), radius.into());
            let found = fit(&points, &FitQuery::new(place, normal, radius));
            // With fewer points, others are taken.
            if !wanted.near_threshold && found.points >= FEWEST_POINTS {
                prop_assert_eq!(u64::from(found.points), wanted.blended);
                let difference = f64::from(found.ao.unwrap_or(9.0)) - wanted.ao;
                prop_assert!(difference.abs() < 2e-3, "{found:?} {wanted:?}");
            }
        }

        #[test]
        fn an_affine_function_is_found_nearly_as_it_is(
            slope in prop::array::uniform2(-0.2_f32..0.2),
            place in prop::array::uniform2(-0.2_f32..0.2),
        ) {
            let ao = |x: f32, z: f32| 0.5 + slope[0] * x + slope[1] * z;
            let grid = (0..81).map(|n| [(n % 9) as f32 / 4.0 - 1.0, (n / 9) as f32 / 4.0 - 1.0]);
            let points: Vec<_> = grid.map(|[x, z]| (Vec3::new(x, 0.0, z), Vec3::Y, ao(x, z))).collect();
            let query = FitQuery::new(Vec3::new(place[0], 0.0, place[1]), Vec3::Y, 0.5);
            let found = fit(&points, &query).ao.unwrap();
            prop_assert!((found - ao(place[0], place[1])).abs() < 0.01, "{found}");
        }
    }

    #[test]
    fn at_a_crease_the_slope_goes_on_where_a_mean_stops() {
        // AO falls towards a wall at x = 0; all points lie in front of it.
        let points: Vec<_> = (0..25)
            .map(|n| Vec3::new(0.02 + (n % 5) as f32 * 0.04, 0.0, (n / 5) as f32 * 0.04 - 0.08))
            .map(|at| (at, Vec3::Y, 0.5 + 2.0 * at.x))
            .collect();
        let query = FitQuery::new(Vec3::ZERO, Vec3::Y, 0.1);
        let found = fit(&points, &query).ao.unwrap();
        let weight = |at: Vec3| (1.0 - at.length() / 0.1).max(0.0).powi(2);
        let [sum, weighted] = points
            .iter()
            .fold([0.0; 2], |[sum, weighted], (at, _, ao)| [sum + weight(*at), weighted + weight(*at) * ao]);
        let mean = weighted / sum;
        // The ridge keeps half of what a mean is off.
        assert!(mean > 0.55 && (found - 0.5).abs() < 0.03, "{found}, mean {mean}");
    }

    #[test]
    fn heaps_lines_and_numbers_that_are_none_give_values_in_range() {
        let at = |x: f32| (Vec3::X * x, Vec3::Y, 0.25);
        for points in [vec![at(0.0)], vec![at(0.1); 20], vec![at(-0.1), at(0.0), at(0.1)]] {
            let found = fit(&points, &FitQuery::new(Vec3::ZERO, Vec3::Y, 0.5));
            assert!((found.ao.unwrap() - 0.25).abs() < 1e-6, "{found:?}");
        }
        let nan = (Vec3::NAN, Vec3::Y, 0.3);
        assert_eq!(fit(&[nan], &FitQuery::new(Vec3::ZERO, Vec3::Y, 0.5)), Support::NONE);
        for radius in [f32::MIN_POSITIVE, 1e-30, 1e30, f32::MAX] {
            let found = fit(&[at(0.0)], &FitQuery::new(Vec3::ZERO, Vec3::Y, radius));
            assert_eq!(found.ao, Some(0.25), "{radius}");
        }
        assert!(tangent_frame(Vec3::NEG_Z)[0].is_finite());
    }
}
