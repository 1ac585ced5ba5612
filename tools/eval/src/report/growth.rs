//! The growth of a cost.

/// Returns the exponent p of the power law `cost ~ at^p` that fits the points `(at, cost)` best, by least squares of
/// logarithms.
///
/// `None` with fewer than two different places, or when a place or cost is not above 0 and finite.
///
/// ```
/// use psao_eval::report::power_law_exponent;
///
/// let p = power_law_exponent(&[(1.0, 3.0), (2.0, 12.0), (4.0, 48.0)]).unwrap();
/// assert!((p - 2.0).abs() < 1e-12, "quadratic");
/// ```
#[must_use]
pub fn power_law_exponent(points: &[(f64, f64)]) -> Option<f64> {
    let usable = |value: f64| value > 0.0 && value.is_finite();
    if !points.iter().all(|&(at, cost)| usable(at) && usable(cost)) {
        return None;
    }
    let logs: Vec<(f64, f64)> = points.iter().map(|&(at, cost)| (libm::log(at), libm::log(cost))).collect();
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(&|log| log.0), mean(&|log| log.1));
    let (across, both) = (mean(&|log| (log.0 - x) * (log.0 - x)), mean(&|log| (log.0 - x) * (log.1 - y)));
    // Rounding may give equal places a variance above 0, so the places themselves are compared, too.
    (points.iter().any(|point| point.0 != points[0].0) && across > 0.0).then(|| both / across)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_has_no_slope_has_no_exponent() {
        let none: [&[(f64, f64)]; 6] = [
            &[],
            &[(2.0, 3.0)],
            &[(0.3, 3.0), (0.3, 4.0), (0.3, 9.0)],
            &[(0.0, 3.0), (1.0, 4.0)],
            &[(1.0, 3.0), (2.0, f64::NAN)],
            &[(1.0, 0.0), (2.0, 1.0)],
        ];
        for points in none {
            assert_eq!(power_law_exponent(points), None, "{points:?}");
        }
    }

    #[test]
    fn points_off_the_line_pull_it_evenly() {
        // Logarithms to base 2: (0, 0), (1, 3), (2, 2); the slope of least squares is 1.
        let found = power_law_exponent(&[(1.0, 1.0), (2.0, 8.0), (4.0, 4.0)]).unwrap();
        assert!((found - 1.0).abs() < 1e-12, "{found}");
    }

    proptest! {
        #[test]
        fn a_power_law_gives_its_exponent(p in -3.0..3.0_f64, scale in 1e-3..1e3_f64, at in prop::collection::vec(0.01..100.0_f64, 2..9)) {
            prop_assume!(at.iter().any(|place| (place / at[0]).ln().abs() > 0.01));
            let points: Vec<(f64, f64)> = at.iter().map(|&at| (at, scale * at.powf(p))).collect();
            let found = power_law_exponent(&points).unwrap();
            prop_assert!((found - p).abs() < 1e-9, "{} {}", found, p);
        }
    }
}
