//! The weight of a point for a fragment (paper, Eq. 2 and 3).

use glam::Vec3;

/// `T_n` of Eq. 3. A point counts when the cosine between its normal and the fragment's is above it.
pub const NORMAL_THRESHOLD: f32 = 0.1;

/// `T_d` of Eq. 3. A point counts when the squared cosine between its normal and the direction from the fragment to it
/// is below it. Points straight behind or in front of the fragment's surface therefore do not count.
pub const DISTANCE_THRESHOLD: f32 = 0.7;

/// Returns the weight of a point for a fragment, in `[0, 1]`. It is the definition against which to check a shader.
///
/// Eq. 2: `max(0, (radius - |point - fragment|) / radius)`. Eq. 3: 0 when
/// `point_normal . fragment_normal <= T_n`, or when
/// `(point_normal . (point - fragment) / |point - fragment|)^2 >= T_d`. The second criterion is not applied when the
/// point lies exactly at the fragment, because there is no direction. Both of its sides are multiplied by the squared
/// distance, which avoids a division.
///
/// Positions and `radius` are in metres of one space, normals of unit length. NaN anywhere gives 0.
#[inline]
pub fn weight(
    point: [f32; 3],
    point_normal: [f32; 3],
    fragment: [f32; 3],
    fragment_normal: [f32; 3],
    radius: f32,
) -> f32 {
    let (point_normal, fragment_normal) = (Vec3::from(point_normal), Vec3::from(fragment_normal));
    let offset = Vec3::from(point) - Vec3::from(fragment);
    let square = offset.dot(offset);
    let alpha = (radius - square.sqrt()) / radius;
    let along = point_normal.dot(offset);
    let straight = square > 0.0 && along * along >= DISTANCE_THRESHOLD * square;
    let facing = point_normal.dot(fragment_normal) > NORMAL_THRESHOLD;
    // The comparisons are written so that NaN gives 0.
    if alpha > 0.0 && facing && !straight { alpha } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Calls [`super::weight`] with vectors.
    fn weight(point: Vec3, point_normal: Vec3, fragment: Vec3, fragment_normal: Vec3, radius: f32) -> f32 {
        let [p, pn, f, n] = [point, point_normal, fragment, fragment_normal].map(|vector| vector.to_array());
        super::weight(p, pn, f, n, radius)
    }

    #[test]
    fn weight_falls_linearly_to_zero_at_the_radius() {
        let at = |x: f32| weight(Vec3::new(x, 0.0, 0.0), Vec3::Y, Vec3::ZERO, Vec3::Y, 2.0);
        assert_eq!(at(0.0), 1.0, "a point at the fragment counts in full");
        assert_eq!(at(0.5), 0.75);
        assert_eq!(at(1.5), 0.25);
        assert_eq!(at(2.0), 0.0);
        assert_eq!(at(3.0), 0.0, "never negative");
    }

    #[test]
    fn the_normal_criterion_leaves_out_its_threshold() {
        let with_cosine = |c: f32| weight(Vec3::X * 0.5, Vec3::new(0.0, c, 1.0), Vec3::ZERO, Vec3::Y, 1.0);
        assert_eq!(with_cosine(NORMAL_THRESHOLD), 0.0, "Eq. 3 says <=");
        assert_eq!(with_cosine(NORMAL_THRESHOLD + 1e-6), 0.5);
        assert_eq!(with_cosine(-1.0), 0.0);
    }

    #[test]
    fn the_distance_criterion_is_squared_and_takes_out_its_threshold() {
        // The point is one metre along x, so the cosine is the x component of its normal.
        let with_cosine = |c: f32| weight(Vec3::X, Vec3::new(c, 1.0, 0.0), Vec3::ZERO, Vec3::Y, 2.0);
        let edge = DISTANCE_THRESHOLD.sqrt();
        assert_eq!(with_cosine(edge + 1e-6), 0.0);
        assert_eq!(with_cosine(-edge - 1e-6), 0.0, "in front as well as behind");
        assert_eq!(with_cosine(edge - 1e-6), 0.5);
        assert_eq!(with_cosine(1e-6 - edge), 0.5);
        // No f32 squares to 0.7 exactly; the neighbours above it must be out.
        let least_out =
            (0..8).map(|n| f32::from_bits(edge.to_bits() + n - 4)).find(|c| c * c >= 0.7).unwrap();
        assert_eq!(with_cosine(least_out), 0.0, "Eq. 3 says >=");
    }

    #[test]
    fn nothing_that_is_not_a_number_gets_through() {
        let nan = Vec3::splat(f32::NAN);
        let good = (Vec3::X * 0.5, Vec3::Y);
        assert_eq!(weight(nan, Vec3::Y, Vec3::ZERO, Vec3::Y, 1.0), 0.0);
        assert_eq!(weight(good.0, nan, Vec3::ZERO, Vec3::Y, 1.0), 0.0);
        assert_eq!(weight(good.0, good.1, nan, Vec3::Y, 1.0), 0.0);
        assert_eq!(weight(good.0, good.1, Vec3::ZERO, nan, 1.0), 0.0);
        assert_eq!(weight(good.0, good.1, Vec3::ZERO, Vec3::Y, f32::NAN), 0.0);
        assert_eq!(weight(good.0, good.1, Vec3::ZERO, Vec3::Y, 0.0), 0.0);
    }

    proptest! {
        #[test]
        fn weights_are_in_range_and_the_same_under_translation_of_whole_numbers(
            point in prop::array::uniform3(-64_i16..64),
            fragment in prop::array::uniform3(-64_i16..64),
            shift in prop::array::uniform3(-64_i16..64),
            radius in 1.0_f32..200.0,
        ) {
            let v = |a: [i16; 3]| Vec3::from(a.map(f32::from));
            let (p, x, s) = (v(point), v(fragment), v(shift));
            let normal = Vec3::new(1.0, 2.0, 2.0) / 3.0;
            let w = weight(p, normal, x, normal, radius);
            prop_assert!((0.0..=1.0).contains(&w));
            prop_assert_eq!(w, weight(p + s, normal, x + s, normal, radius));
        }
    }
}
