//! Weighted sample elimination on the unit sphere from twice as many candidates: by the heap, and by the real
//! implementation on one thread and on two.
//!
//! Before the benchmark it prints the spread of the points, and median times over rounds in which the variants
//! alternate. So other load on the machine affects all variants alike.

use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use psao_server::points::{eliminate, poisson_radius, reference};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Number of rounds in which the variants alternate.
const ROUNDS: usize = 15;

/// A set of candidates to reduce.
struct Set {
    candidates: Vec<Vec3>,
    keep: usize,
    radius: f32,
}

impl Set {
    /// Random points, uniform by area.
    fn new(keep: usize) -> Self {
        let unit = |number: usize| {
            let mut bits = (number as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((bits ^ (bits >> 31)) >> 40) as f32 / 16_777_216.0
        };
        let point = |number| {
            let z = 2.0 * unit(2 * number) - 1.0;
            let (sine, cosine) = (std::f32::consts::TAU * unit(2 * number + 1)).sin_cos();
            let ring = (1.0 - z * z).max(0.0).sqrt();
            Vec3::new(ring * cosine, ring * sine, z)
        };
        let radius = poisson_radius(4.0 * std::f64::consts::PI, keep);
        Self { candidates: (0..2 * keep).map(point).collect(), keep, radius }
    }

    fn heap(&self) -> Vec<u32> {
        reference::eliminate(&self.candidates, self.keep, self.radius)
    }

    fn eliminate_on(&self, pool: &ThreadPool) -> Vec<u32> {
        pool.install(|| eliminate(&self.candidates, self.keep, self.radius))
    }

    /// Returns the smallest and the mean distance to the nearest neighbour, relative to twice the largest possible
    /// Poisson-disk radius.
    fn spread(&self, kept: &[u32]) -> (f32, f32) {
        let mut points: Vec<Vec3> = kept.iter().map(|&number| self.candidates[number as usize]).collect();
        points.sort_unstable_by(|a, b| a.z.total_cmp(&b.z));
        let distance = |index: usize| {
            let before = nearest(points[index], points[..index].iter().rev());
            before.min(nearest(points[index], points[index + 1..].iter())) / (2.0 * self.radius)
        };
        let nearest: Vec<f32> = (0..points.len()).map(distance).collect();
        let mean = nearest.iter().sum::<f32>() / nearest.len() as f32;
        (nearest.into_iter().fold(f32::MAX, f32::min), mean)
    }
}

/// Returns the distance to the nearest of points sorted by their distance from `at` along z.
fn nearest<'a>(at: Vec3, others: impl Iterator<Item = &'a Vec3>) -> f32 {
    let mut least = f32::MAX;
    for other in others {
        if (other.z - at.z).abs() >= least {
            break;
        }
        least = least.min(at.distance(*other));
    }
    least
}

fn pool(threads: usize) -> Option<ThreadPool> {
    ThreadPoolBuilder::new().num_threads(threads).build().ok()
}

/// Returns the median time of each variant over rounds in which they alternate.
fn alternate(variants: &[&dyn Fn() -> Vec<u32>]) -> Vec<Duration> {
    let mut times = vec![Vec::new(); variants.len()];
    for _ in 0..ROUNDS {
        for (times, variant) in times.iter_mut().zip(variants) {
            let start = Instant::now();
            let kept = variant();
            times.push(start.elapsed());
            assert!(!kept.is_empty());
        }
    }
    let median = |mut times: Vec<Duration>| {
        times.sort_unstable();
        times[ROUNDS / 2]
    };
    times.into_iter().map(median).collect()
}

fn elimination(criterion: &mut Criterion) {
    let (Some(one), Some(two)) = (pool(1), pool(2)) else { return };
    for keep in [20_000, 200_000] {
        let set = Set::new(keep);
        // Check the answer first.
        let kept = set.heap();
        assert_eq!(kept.len(), keep);
        assert!(
            set.eliminate_on(&one) == kept && set.eliminate_on(&two) == kept,
            "not the points that the heap keeps"
        );
        let (least, mean) = set.spread(&kept);
        let times = alternate(&[&|| set.heap(), &|| set.eliminate_on(&one), &|| set.eliminate_on(&two)]);
        println!(
            "{keep} kept: nearest neighbour {least:.3} (least), {mean:.3} (mean); heap {:.1?}, one thread {:.1?}, two {:.1?}",
            times[0], times[1], times[2]
        );
        let mut group = criterion.benchmark_group("elimination");
        group.sample_size(10);
        group.throughput(Throughput::Elements(keep as u64));
        group.bench_function(BenchmarkId::new("heap", keep), |bencher| bencher.iter(|| set.heap()));
        for (name, pool) in [("one thread", &one), ("two threads", &two)] {
            group.bench_function(BenchmarkId::new(name, keep), |bencher| {
                bencher.iter(|| set.eliminate_on(pool));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, elimination);
criterion_main!(benches);
