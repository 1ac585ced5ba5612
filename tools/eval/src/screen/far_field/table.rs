//! The table L of the obscurance estimator (Timonen, section 4, Eq. 3).
//!
//! L(a, b, c, d) is the weight of the part of a slice that one slab hides, from the zenith down to the angle a. The
//! paper tabulates it in four dimensions by casting rays. The integral separates, so two dimensions are enough, and the
//! angles c and d are exact.
//!
//! Let phi = c - theta be the angle between the slab and a ray. Then the slab is b / sin(phi) away, and
//! cos(theta - d) sin(theta) = (sin(d) + sin(2c - d) cos(2 phi) - cos(2c - d) sin(2 phi)) / 2. The table holds the
//! integrals of rho(b / sin(phi)) times 1, sin(2 phi) and cos(2 phi).

use glam::{Vec2, Vec3A};

use crate::screen::Falloff;

/// Cells over the angle phi, which runs from 0 to pi.
const ANGLES: usize = 192;

/// Cells over the distance b, which runs from 0 to the radius.
const DISTANCES: usize = 96;

/// Steps of the quadrature in each cell of angles.
const STEPS: usize = 16;

/// Integrals over phi from 0 of `rho(b / sin(phi))` times (1, sin 2 phi, cos 2 phi), for one radius and falloff.
///
/// Any falloff is possible; it need be neither smooth nor falling.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ObscuranceTable {
    radius: f32,
    values: Vec<Vec3A>,
}

impl ObscuranceTable {
    /// Integrates `falloff`, which ends at `radius` metres.
    pub(crate) fn new(radius: f32, falloff: &Falloff) -> Self {
        // For the midpoint of each step: the sine of its angle, and the three integrands times the width of the step.
        let steps: Vec<(f64, [f64; 3])> = (0..ANGLES)
            .flat_map(|cell| {
                let [from, to] = [cell, cell + 1].map(node_angle);
                let width = (to - from) / STEPS as f64;
                (0..STEPS).map(move |step| {
                    let phi = from + (step as f64 + 0.5) * width;
                    let (sin, cos) = (libm::sin(phi), libm::cos(phi));
                    (sin, [width, width * 2.0 * sin * cos, width * (cos * cos - sin * sin)])
                })
            })
            .collect();
        let mut values = Vec::with_capacity((ANGLES + 1) * (DISTANCES + 1));
        for row in 0..=DISTANCES {
            let distance = node_distance(row);
            let mut sum = [0.0_f64; 3];
            values.push(Vec3A::ZERO);
            for cell in steps.chunks_exact(STEPS) {
                for (sin, widths) in cell {
                    let weight = f64::from(falloff.weight((distance / sin) as f32));
                    for (sum, width) in sum.iter_mut().zip(widths) {
                        *sum += weight * width;
                    }
                }
                values.push(Vec3A::from(sum.map(|sum| sum as f32)));
            }
        }
        Self { radius, values }
    }

    /// Returns the distance in metres from which nothing counts.
    pub(crate) fn radius(&self) -> f32 {
        self.radius
    }

    /// Returns the size of the table on the heap in bytes.
    pub(crate) fn heap_bytes(&self) -> usize {
        self.values.len() * size_of::<Vec3A>()
    }

    /// Returns the part that a slab hides between two angles: L(high, ..) - L(low, ..) times the length of the
    /// projected normal.
    ///
    /// All vectors are (along the zenith, to the side). `slab` is the unit direction of the slab away from the eye, at
    /// the angle c. `normal` is the projected normal, at the angle d. `low` and `high` point at the lower and the upper
    /// end of the slab's visible part and may have any length; `low` is further from the zenith. `distance` is b in
    /// metres, at least 0 and below the radius. Rays past the slab's far end hit nothing.
    #[inline]
    pub(crate) fn hidden(&self, distance: f32, slab: Vec2, normal: Vec2, low: Vec2, high: Vec2) -> f32 {
        let row = distance_index(distance / self.radius);
        let below = (row as usize).min(DISTANCES - 1);
        let part = row - below as f32;
        let rows = &self.values[below * (ANGLES + 1)..(below + 2) * (ANGLES + 1)];
        let between = interpolate(rows, part, angle_index(slab, high))
            - interpolate(rows, part, angle_index(slab, low));
        let double = Vec2::new(slab.x * slab.x - slab.y * slab.y, 2.0 * slab.x * slab.y);
        let weights = Vec3A::new(
            normal.y,
            -(double.x * normal.x + double.y * normal.y),
            double.y * normal.x - double.x * normal.y,
        );
        0.5 * between.dot(weights)
    }
}

/// Interpolates between two rows of the table, `part` of the way to the second, at place `index` along them.
#[inline]
fn interpolate(rows: &[Vec3A], part: f32, index: f32) -> Vec3A {
    let cell = (index as usize).min(ANGLES - 1);
    let along = index - cell as f32;
    let near = rows[cell] + (rows[cell + 1] - rows[cell]) * along;
    let (second, third) = (rows[ANGLES + 1 + cell], rows[ANGLES + 2 + cell]);
    let far = second + (third - second) * along;
    near + (far - near) * part
}

/// Returns the row of a distance over the radius. Rows are denser at both ends, where the integrals bend like a root.
#[inline]
fn distance_index(distance: f32) -> f32 {
    (distance.sqrt() - (1.0 - distance).max(0.0).sqrt() + 1.0) * (DISTANCES as f32 * 0.5)
}

/// Returns the distance over the radius of row `index`, for which [`distance_index`] returns that number.
fn node_distance(index: usize) -> f64 {
    let place = index as f64 / (DISTANCES as f64 * 0.5) - 1.0;
    let root = 0.5 * (place + (2.0 - place * place).sqrt());
    (root * root).min(1.0)
}

/// Returns the place along a row of the angle phi from `ray` to `slab`. It grows with the angle as
/// 1 - cos / (|cos| + sin), which needs no trigonometry. Rays past the slab's end count as along it.
#[inline]
fn angle_index(slab: Vec2, ray: Vec2) -> f32 {
    let sin = ray.perp_dot(slab);
    let cos = ray.dot(slab);
    if sin > 0.0 { (1.0 - cos / (cos.abs() + sin)) * (ANGLES as f32 * 0.5) } else { 0.0 }
}

/// Returns the angle at node `index` of a row, for which [`angle_index`] returns that number.
fn node_angle(index: usize) -> f64 {
    let cos = 1.0 - index as f64 / (ANGLES as f64 * 0.5);
    libm::atan2(1.0 - cos.abs(), cos)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn direction(angle: f32) -> Vec2 {
        Vec2::new(libm::cosf(angle), libm::sinf(angle))
    }

    /// Computes Eq. 3 directly, with rays in the slice one by one.
    fn cast(falloff: &Falloff, b: f32, c: f32, d: f32, high: f32, low: f32) -> f64 {
        let steps = 20_000;
        let width = f64::from(low - high) / f64::from(steps);
        (0..steps)
            .map(|step| {
                let theta = f64::from(high) + (f64::from(step) + 0.5) * width;
                let past = f64::from(c) - theta;
                let sin = libm::sin(past);
                let weight = if past > 0.0 { falloff.weight((f64::from(b) / sin) as f32) } else { 0.0 };
                f64::from(weight) * libm::cos(theta - f64::from(d)) * libm::sin(theta) * width
            })
            .sum()
    }

    #[test]
    fn distances_and_rows_are_each_others_inverse() {
        for index in 0..=DISTANCES {
            let found = distance_index(node_distance(index) as f32);
            assert!((found - index as f32).abs() < 0.02, "{index}: {found}");
        }
    }

    #[test]
    fn angles_and_places_in_a_row_are_each_others_inverse() {
        for index in 0..ANGLES {
            let angle = node_angle(index);
            // The slab straight down, the ray phi above it.
            let found = angle_index(Vec2::NEG_X, direction(std::f32::consts::PI - angle as f32));
            assert!((found - index as f32).abs() < 1e-3, "{index}: {found}");
        }
        assert_eq!(angle_index(Vec2::NEG_X, Vec2::ZERO), 0.0);
        assert_eq!(angle_index(direction(2.0), direction(2.5)), 0.0, "past the end of the slab");
    }

    #[test]
    fn without_falloff_a_wall_at_hand_hides_its_half_of_the_slice() {
        let table = ObscuranceTable::new(2.0, &Falloff::Binary);
        // The normal at the zenith: the integral of cos theta sin theta over a quarter turn.
        let found = table.hidden(0.0, Vec2::NEG_X, Vec2::X, Vec2::Y, Vec2::X);
        assert!((found - 0.5).abs() < 1e-5, "{found}");
        assert_eq!(table.hidden(2.0, Vec2::NEG_X, Vec2::X, Vec2::Y, Vec2::X), 0.0, "a radius away");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn the_table_is_the_integral(
            kind in 0..6,
            b in 0.0_f32..1.0,
            c in 1.0_f32..std::f32::consts::PI,
            d in -1.5_f32..1.5,
            angles in (0.0_f32..3.1, 0.0_f32..3.1),
            radius in 0.1_f32..10.0,
        ) {
            let falloff = match kind {
                0 => Falloff::Linear,
                1 => Falloff::Binary,
                2 => Falloff::Quadratic,
                3 => Falloff::Cubic,
                4 => Falloff::Exponential { decay: 5.0 },
                _ => Falloff::sampled(&[1.0, 0.9, 0.2, 0.2, 0.1]).unwrap(),
            };
            let (high, low) = (angles.0.min(angles.1), angles.0.max(angles.1));
            let table = ObscuranceTable::new(radius, &falloff);
            let found = table.hidden(b * radius, direction(c), direction(d), direction(low), direction(high));
            let want = cast(&falloff, b, c, d, high, low);
            // A step of the falloff lies inside a cell; all others are smooth.
            let bound = if kind == 1 || kind == 5 { 0.01 } else { 0.001 };
            prop_assert!((f64::from(found) - want).abs() < bound, "{falloff:?}: {found} against {want}");
        }
    }
}
