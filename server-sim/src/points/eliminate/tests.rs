//! The result equals that of the heap for all kinds of sets, regions and threads.

use proptest::prelude::*;

use super::*;
use crate::points::reference;
use crate::random::Random;

/// Random points on the unit sphere, uniform by area.
pub(in crate::points) fn on_sphere(count: usize, seed: u64) -> Vec<Vec3> {
    let mut random = Random::new(seed);
    let point = |_| {
        let (z, angle) = (2.0 * random.unit() - 1.0, std::f32::consts::TAU * random.unit());
        let ring = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(ring * libm::cosf(angle), ring * libm::sinf(angle), z)
    };
    (0..count).map(point).collect()
}

/// Sets of several kinds, of area about 10.
fn points_of(kind: u32, count: usize, seed: u64) -> Vec<Vec3> {
    let mut random = Random::new(seed);
    let mut unit = move || random.unit();
    let sphere = on_sphere(count, seed);
    match kind {
        0 => sphere,
        // A plane, along each axis in turn.
        1 => {
            let flat = |mut point: Vec3| {
                point[seed as usize % 3] = 0.25;
                point
            };
            sphere.into_iter().map(flat).collect()
        }
        // A lattice: nearly all weights are equal.
        2 => {
            let side = (count as f32).sqrt().ceil();
            let at = |i: f32| Vec3::new((i % side).floor(), 0.0, (i / side).floor()) * (3.0 / side);
            (0..count).map(|i| at(i as f32)).collect()
        }
        // Clusters with some equal points.
        3 => {
            let mut around = |at: Vec3| (at * 3.0).round() + at * 0.02 * (unit() * 3.0).floor();
            sphere.into_iter().map(&mut around).collect()
        }
        // Every point several times.
        4 => sphere.iter().map(|at| (*at * 12.0).round() / 12.0).collect(),
        // A volume, so that points have many neighbours.
        5 => (0..count).map(|_| Vec3::new(unit(), unit(), unit())).collect(),
        // A long line of points with increasing density.
        6 => (0..count).map(|i| Vec3::X * (i as f32 / count as f32).powi(2) * 3.0).collect(),
        // Some points that are not finite.
        _ => {
            let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
            let lost = |(i, mut point): (usize, Vec3)| {
                if i % 7 == 3 {
                    point[i % 3] = odd[i / 7 % 3];
                }
                point
            };
            sphere.into_iter().enumerate().map(lost).collect()
        }
    }
}

fn on_threads<T: Send>(threads: usize, run: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(run)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]
    #[test]
    fn keeps_what_the_heap_keeps(
        kind in 0u32..8,
        count in 1usize..1200,
        share in 0.0f64..1.0,
        region in 1usize..400,
        crowding in 0.3f64..3.0,
        seed in any::<u64>(),
    ) {
        let points = points_of(kind, count, seed);
        let keep = (count as f64 * share) as usize;
        let radius = poisson_radius(10.0 * crowding, keep);
        let expected = reference::eliminate(&points, keep, radius);
        prop_assert_eq!(expected.len(), keep);
        prop_assert_eq!(&eliminate_in(&points, keep, radius, region), &expected);
        prop_assert_eq!(&eliminate_in(&points, keep, radius, usize::MAX / 2), &expected);
    }

    #[test]
    fn keys_order_as_weights_do_and_equal_ones_by_number(a in -1e9f32..1e9, b in -1e9f32..1e9, first in 0u32..99) {
        let (x, y) = (RemovalKey::new(a, first), RemovalKey::new(b, first + 1));
        prop_assert_eq!((x.weight(), x.point()), (a + 0.0, first));
        prop_assert_eq!(x > y, a >= b);
        prop_assert!(x < RemovalKey::FIRST && x > RemovalKey::NONE && !x.is_removed());
        prop_assert!(x.removed().is_removed() && x.removed() < RemovalKey::lowest_of(0) && x.removed() < y);
        prop_assert_eq!((x.removed().key_at_removal(), x.removed().weight()), (x, x.weight()));
        prop_assert!(RemovalKey::lowest_of(x.class()) <= x && RemovalKey::lowest_of(x.class() + 1) > x);
        prop_assert_eq!(RemovalKey::new(-0.0, first), RemovalKey::new(0.0, first));
    }
}

#[test]
fn large_sets_are_those_of_the_heap_on_any_number_of_threads() {
    for (kind, share) in [(0, 0.5), (1, 0.5), (5, 0.4), (6, 0.5)] {
        let points = points_of(kind, 30_000, 5);
        let keep = (points.len() as f64 * share) as usize;
        let radius = poisson_radius(12.0, keep);
        let expected = reference::eliminate(&points, keep, radius);
        for threads in [1, 2, 5] {
            assert!(on_threads(threads, || eliminate(&points, keep, radius)) == expected, "kind {kind}");
            let small = on_threads(threads, || eliminate_in(&points, keep, radius, 500));
            assert!(small == expected, "kind {kind}, small regions");
        }
    }
}

/// Returns the smallest and the mean distance to the nearest neighbour.
fn spread(points: &[Vec3]) -> (f32, f32) {
    let mut nearest = vec![f32::MAX; points.len()];
    let grid = Grid::new(points, 0.1);
    let weighting = Weighting { reach: 0.1, nearest: 0.0 };
    for cells in grid.cell_ranges(usize::MAX / 2) {
        let links = grid.links_ahead(&cells, weighting);
        let at = |point: usize| points[grid.number(point as u32) as usize];
        for point in 0..points.len() {
            for link in links.of(point) {
                let distance = at(point).distance(at(link.to as usize));
                for end in [point, link.to as usize] {
                    nearest[end] = nearest[end].min(distance);
                }
            }
        }
    }
    (nearest.iter().copied().fold(f32::MAX, f32::min), nearest.iter().sum::<f32>() / points.len() as f32)
}

#[test]
fn spreads_as_it_should_on_the_unit_sphere() {
    for seed in 1..4 {
        let (candidates, keep) = (on_sphere(40_000, seed), 20_000);
        let radius = poisson_radius(4.0 * std::f64::consts::PI, keep);
        let kept = eliminate(&candidates, keep, radius);
        let kept: Vec<Vec3> = kept.into_iter().map(|i| candidates[i as usize]).collect();
        let (least, mean) = spread(&kept);
        let (least, mean) = (least / (2.0 * radius), mean / (2.0 * radius));
        assert!(least >= 0.53 && mean >= 0.70, "{least} {mean}");
    }
}

#[test]
fn awkward_inputs_are_fine() {
    assert!(eliminate(&[], 0, 1.0).is_empty());
    assert!(eliminate(&[Vec3::ONE; 9], 0, 1.0).is_empty());
    assert_eq!(eliminate(&[Vec3::ONE; 3], 3, 1.0), [0, 1, 2]);
    assert_eq!(eliminate(&[Vec3::ONE; 3], 5, 1.0), [0, 1, 2]);
    assert_eq!(eliminate(&[Vec3::NAN; 4], 2, 1.0), [2, 3]);
    let line: Vec<Vec3> = (0..1000).map(|i| Vec3::X * (i as f32) * 1e6).collect();
    for (points, keep, radius) in [
        (&[Vec3::ONE; 100][..], 50, 0.1),
        (&[Vec3::ONE; 10], 5, 0.0),
        (&line, 500, 1e-7),
        (&[Vec3::MAX, Vec3::MIN, Vec3::ZERO, Vec3::ONE], 2, 0.5),
    ] {
        let kept = eliminate(points, keep, radius);
        assert_eq!(kept.len(), keep);
        assert_eq!(kept, reference::eliminate(points, keep, radius));
    }
}
