//! The Pareto front of cost and error.

/// Returns the indices of the points `(cost, error)` on the Pareto front, by rising cost.
///
/// A point is on the front when no other point has at most its cost and at most its error. Of equal points the first is
/// on the front. Points with a figure that is not finite are left out.
///
/// ```
/// use psao_eval::report::pareto_front;
///
/// // The third costs more than the first and is no better.
/// assert_eq!(pareto_front(&[(2.0, 0.3), (5.0, 0.1), (3.0, 0.3), (1.0, 0.9)]), [3, 0, 1]);
/// ```
#[must_use]
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let finite = |&index: &usize| points[index].0.is_finite() && points[index].1.is_finite();
    let mut order: Vec<usize> = (0..points.len()).filter(finite).collect();
    order.sort_by(|&a, &b| {
        let ((cost_a, error_a), (cost_b, error_b)) = (points[a], points[b]);
        cost_a.total_cmp(&cost_b).then(error_a.total_cmp(&error_b)).then(a.cmp(&b))
    });
    let mut least = f64::INFINITY;
    order.retain(|&index| {
        let better = points[index].1 < least;
        least = least.min(points[index].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_is_not_finite_is_left_out() {
        assert_eq!(pareto_front(&[(f64::NAN, 0.1), (1.0, f64::INFINITY), (2.0, 0.5)]), [2]);
        assert_eq!(pareto_front(&[]), [0_usize; 0]);
    }

    proptest! {
        #[test]
        fn the_front_is_what_no_other_point_beats(points in prop::collection::vec((0_u8..12, 0_u8..12), 0..40)) {
            let points: Vec<(f64, f64)> = points.into_iter().map(|(x, y)| (x.into(), y.into())).collect();
            let found = pareto_front(&points);
            for (index, &(x, y)) in points.iter().enumerate() {
                let beaten = points.iter().enumerate().any(|(other, &(cost, error))| {
                    cost <= x && error <= y && ((cost, error) != (x, y) || other < index)
                });
                prop_assert_eq!(found.contains(&index), !beaten);
            }
            prop_assert!(found.is_sorted_by(|&a, &b| points[a].0 < points[b].0 && points[a].1 > points[b].1));
        }
    }
}
