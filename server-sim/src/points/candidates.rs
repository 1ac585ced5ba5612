//! Random points on triangles of a mesh, uniform by area.

use glam::Vec3;

use super::SurfacePoint;
use crate::random::Random;

/// Draws random points from some triangles of a mesh.
pub(super) struct TriangleSampler<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    /// Numbers of the triangles to draw from.
    numbers: &'a [u32],
    /// Running sum of the triangles' areas, square metres.
    sums: Vec<f64>,
}

impl<'a> TriangleSampler<'a> {
    pub(super) fn new(positions: &'a [Vec3], triangles: &'a [[u32; 3]], numbers: &'a [u32]) -> Self {
        let mut sum = 0.0;
        let sums = numbers.iter().map(|&triangle| {
            let [a, b, c] = triangles[triangle as usize].map(|corner| positions[corner as usize].as_dvec3());
            let area = (b - a).cross(c - a).length() * 0.5;
            sum += if area.is_finite() { area } else { 0.0 };
            sum
        });
        Self { positions, triangles, numbers, sums: sums.collect() }
    }

    /// Returns the area of one side, square metres.
    pub(super) fn area(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// Draws `count` points on one side. The area is divided into `count` equal parts with one point in each, so that
    /// small triangles get their share. Points are uniform within a triangle.
    pub(super) fn draw(
        &self,
        count: usize,
        back: bool,
        random: &mut Random,
        mut take: impl FnMut(SurfacePoint, Vec3),
    ) {
        let area = self.area();
        if area <= 0.0 {
            return;
        }
        let mut place = 0;
        for part in 0..count {
            let at = (part as f64 + f64::from(random.unit())) / count as f64 * area;
            // A triangle without area adds nothing to the sum and is skipped.
            while place + 1 < self.sums.len() && self.sums[place] <= at {
                place += 1;
            }
            let triangle = self.numbers[place];
            let (mut u, mut v) = (random.unit(), random.unit());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let [a, b, c] = self.triangles[triangle as usize].map(|corner| self.positions[corner as usize]);
            let point = SurfacePoint { triangle, bary: [u, v], back };
            take(point, a + (b - a) * u + (c - a) * v);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_get_points_by_area_and_flat_ones_none() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::X * 3.0, Vec3::Z * 3.0];
        let triangles = [[0, 1, 2], [0, 1, 1], [0, 3, 4], [2, 2, 2]];
        let surface = TriangleSampler::new(&positions, &triangles, &[0, 1, 2, 3]);
        assert!((surface.area() - 5.0).abs() < 1e-9);
        let mut counts = [0; 4];
        let mut mean = Vec3::ZERO;
        surface.draw(10_000, false, &mut Random::new(3), |point, at| {
            counts[point.triangle as usize] += 1;
            assert!(point.bary.iter().sum::<f32>() <= 1.0 && point.bary.iter().all(|&b| b >= 0.0));
            mean += at / 10_000.0;
        });
        assert!((counts[0] - 1000i32).abs() < 5 && counts[1] == 0 && counts[3] == 0, "{counts:?}");
        // Centroids of the two triangles, weighted by area.
        let expected = (Vec3::new(1.0, 0.0, 1.0) / 3.0) * 0.1 + Vec3::new(1.0, 0.0, 1.0) * 0.9;
        assert!((mean - expected).length() < 0.03, "{mean}");
        let some = TriangleSampler::new(&positions, &triangles, &[2]);
        assert!((some.area() - 4.5).abs() < 1e-9);
        some.draw(100, true, &mut Random::new(3), |point, _| assert!(point.triangle == 2 && point.back));
        TriangleSampler::new(&positions, &[[0, 0, 0]], &[0])
            .draw(10, false, &mut Random::new(1), |_, _| panic!("no area"));
    }
}
