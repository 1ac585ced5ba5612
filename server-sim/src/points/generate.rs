//! Generates the points of a scene.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::cache::{self, PointCache, PointKey};
use super::candidates::TriangleSampler;
use super::eliminate::{eliminate, poisson_radius};
use super::{MAX_POINTS, PointError, PointSet, PointSettings, ScenePoints, SurfacePoint};
use crate::random::{Random, substream};
use crate::scene::{PosedMesh, RestMesh, Scene};

/// Number of attempts on a masked surface, each with twice as many candidates, before it counts as empty.
const MASKED_ATTEMPTS: u32 = 6;
/// Fewest points of one side of a chart, and the largest factor by which a small chart gets more than its share for that.
const FEWEST_OF_CHART: f64 = 8.0;
const SMALL_CHART_FACTOR: f64 = 16.0;
/// Radius in metres of a mesh without points, so that its grid has a positive cell size.
const EMPTY_SET_RADIUS_M: f32 = 0.05;

/// Generates points on every mesh of the scene (paper, section 3.1). Each side of a [chart](psao_codec::surface::Charts)
/// gets twice as many random candidates as points, and weighted sample elimination halves them. Masked-out parts get no
/// points. Equal scenes and settings give equal points, whatever the number of threads.
///
/// `progress` is called from any thread with the number of points done and the total.
///
/// # Errors
/// Returns [`PointError`] for invalid settings, before anything is allocated.
pub fn generate(
    scene: &Scene,
    settings: &PointSettings,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<ScenePoints, PointError> {
    generate_cached(scene, settings, None, progress)
}

/// Generates the same points as [`generate`], but reads them from a cache if it has them and otherwise stores them
/// there.
///
/// # Errors
/// Returns the errors of [`generate`].
pub fn generate_cached(
    scene: &Scene,
    settings: &PointSettings,
    cache: Option<&dyn PointCache>,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<ScenePoints, PointError> {
    let total = point_count(scene, settings)?;
    let Some(cache) = cache else {
        return Ok(ScenePoints::new(scene, generate_sets(scene, settings, total, progress)));
    };
    let key = PointKey::new(scene, settings);
    if let Some(bytes) = cache.load(&key) {
        match cache::decode(&key, scene, &bytes) {
            Ok(sets) => {
                progress(total, total);
                return Ok(ScenePoints::new(scene, sets));
            }
            Err(reason) => cache.refused(&key, &reason),
        }
    }
    let sets = generate_sets(scene, settings, total, progress);
    cache.store(&key, &cache::encode(&key, &sets));
    Ok(ScenePoints::new(scene, sets))
}

/// Returns the number of points of all sets.
fn point_count(scene: &Scene, settings: &PointSettings) -> Result<u64, PointError> {
    if !(settings.per_m2.is_finite() && settings.per_m2 > 0.0) {
        return Err(PointError::Density { per_m2: settings.per_m2 });
    }
    if settings.minimum == 0 {
        return Err(PointError::Minimum);
    }
    let wanted: Vec<f64> =
        scene.rests().iter().map(|rest| MeshSampling::new(scene, rest, settings).points()).collect();
    let points: f64 = scene.instances().iter().map(|instance| wanted[instance.rest().index()]).sum();
    if points > MAX_POINTS as f64 {
        return Err(PointError::TooMany { points });
    }
    Ok(wanted.iter().sum::<f64>() as u64)
}

/// Generates the points of every mesh.
fn generate_sets(
    scene: &Scene,
    settings: &PointSettings,
    total: u64,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Vec<PointSet> {
    let done = AtomicU64::new(0);
    let sets = scene.rests().par_iter().enumerate().map(|(index, rest)| {
        let sampling = MeshSampling::new(scene, rest, settings);
        let set = sampling.generate(substream(settings.seed, index as u64));
        let share = sampling.points() as u64;
        progress(done.fetch_add(share, Ordering::Relaxed) + share, total);
        set
    });
    sets.collect()
}

impl ScenePoints {
    /// Creates the points from the sets of a scene's meshes.
    fn new(scene: &Scene, sets: Vec<PointSet>) -> Self {
        let mut offsets = vec![0u32];
        for instance in scene.instances() {
            let next = offsets[offsets.len() - 1] + sets[instance.rest().index()].points.len() as u32;
            offsets.push(next);
        }
        Self { sets, offsets }
    }
}

/// Generates the points of one mesh, chart by chart.
struct MeshSampling<'a> {
    posed: PosedMesh<'a>,
    /// Numbers of the triangles, those of a chart together.
    triangles: Vec<u32>,
    /// End of each chart's triangles in that list.
    ends: Vec<usize>,
    /// Points per square metre, and what they are at least because of the minimum of an instance.
    per_m2: f64,
    density: f64,
    sides: &'static [bool],
}

impl<'a> MeshSampling<'a> {
    fn new(scene: &'a Scene, rest: &'a RestMesh, settings: &PointSettings) -> Self {
        let posed = PosedMesh::at_rest(scene, rest);
        let sides: &[bool] = if posed.material.double_sided() { &[false, true] } else { &[false] };
        let charts = rest.charts();
        let mut triangles: Vec<u32> = (0..posed.triangles.len() as u32).collect();
        triangles.sort_by_key(|&triangle| charts.front(triangle));
        let runs = triangles.chunk_by(|&a, &b| charts.front(a) == charts.front(b));
        let ends = runs.scan(0, |end, run| {
            *end += run.len();
            Some(*end)
        });
        let minimum = f64::from(settings.minimum.div_ceil(sides.len() as u32));
        let (area, per_m2) = (rest.area_m2(), f64::from(settings.per_m2));
        let density = if area > 0.0 { per_m2.max(minimum / area) } else { per_m2 };
        Self { posed, ends: ends.collect(), triangles, per_m2, density, sides }
    }

    /// Returns the numbers of each chart's triangles.
    fn charts(&self) -> impl Iterator<Item = &[u32]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.triangles[start..end])
    }

    fn sampler<'s>(&'s self, triangles: &'s [u32]) -> TriangleSampler<'s> {
        TriangleSampler::new(self.posed.geometry.positions(), self.posed.triangles, triangles)
    }

    /// Returns the number of points of one side of a chart with this area, square metres. A fit needs some points, so
    /// small charts get more than their share, but the smallest ones do not.
    fn count(&self, area: f64) -> f64 {
        let fewest = (SMALL_CHART_FACTOR * area * self.per_m2).ceil().min(FEWEST_OF_CHART);
        (area * self.density).ceil().max(fewest)
    }

    /// Returns the number of points of the mesh without its mask.
    fn points(&self) -> f64 {
        self.sides.len() as f64
            * self.charts().map(|triangles| self.count(self.sampler(triangles).area())).sum::<f64>()
    }

    fn generate(&self, seed: u64) -> PointSet {
        let charts: Vec<&[u32]> = self.charts().collect();
        let mut set = PointSet::default();
        for &back in self.sides {
            let seed = substream(seed, u64::from(back));
            let parts = charts.par_iter().enumerate().map(|(chart, triangles)| {
                self.generate_chart(&self.sampler(triangles), back, substream(seed, chart as u64))
            });
            for (points, area) in parts.collect::<Vec<_>>() {
                set.points.extend(points);
                set.area += area;
            }
        }
        set.numbers = (0..set.points.len() as u32).collect();
        let radius = poisson_radius(set.area, set.points.len());
        set.radius = if radius.is_normal() { radius } else { EMPTY_SET_RADIUS_M };
        set
    }

    /// Generates the points of one side of a chart. Returns them with the area that they stand for, square metres.
    fn generate_chart(
        &self,
        sampler: &TriangleSampler<'_>,
        back: bool,
        seed: u64,
    ) -> (Vec<SurfacePoint>, f64) {
        if sampler.area() <= 0.0 {
            return (Vec::new(), 0.0);
        }
        let masked = self.posed.masked();
        let mut random = Random::new(seed);
        let mut count = 2 * self.count(sampler.area()) as usize;
        for _ in 0..MASKED_ATTEMPTS {
            let mut points = Vec::with_capacity(count);
            let mut positions = Vec::with_capacity(count);
            sampler.draw(count, back, &mut random, |point, at| {
                if !masked || self.posed.opaque(point.triangle, point.bary) {
                    points.push(point);
                    positions.push(at);
                }
            });
            let area = sampler.area() * points.len() as f64 / count as f64;
            let keep = self.count(area) as usize;
            if points.len() >= 2 * keep {
                return (select_points(&points, &positions, keep, area), area);
            }
            // Rounding alone may leave a masked mesh one point short of twice the number to keep.
            count = if points.len() + 8 >= 2 * keep { count + 16 } else { count * 2 };
        }
        (Vec::new(), 0.0)
    }
}

/// Selects `keep` evenly spread points and orders them along a Morton curve.
fn select_points(points: &[SurfacePoint], positions: &[Vec3], keep: usize, area: f64) -> Vec<SurfacePoint> {
    let kept = eliminate(positions, keep, poisson_radius(area, keep));
    let low = positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    // The largest coordinate is in the middle of the last cell, so that rounding does not move it to the one before.
    let scale = 1023.5 / (high - low).max_element().max(f32::MIN_POSITIVE);
    let code = |at: Vec3| {
        let [x, y, z] = ((at - low) * scale).to_array().map(|axis| spread_bits(axis as u32));
        x | (y << 1) | (z << 2)
    };
    let mut order: Vec<(u32, u32)> = kept.into_iter().map(|i| (code(positions[i as usize]), i)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| points[i as usize]).collect()
}

/// Returns the ten low bits with two zeros after each: one axis of a Morton code.
fn spread_bits(value: u32) -> u32 {
    let value = value.min(1023);
    let value = (value | (value << 16)) & 0x0300_00FF;
    let value = (value | (value << 8)) & 0x0300_F00F;
    let value = (value | (value << 4)) & 0x030C_30C3;
    (value | (value << 2)) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_codes_interleave() {
        assert_eq!(spread_bits(0b11_1111_1111), 0x0924_9249);
        assert_eq!(spread_bits(0b10_0000_0101), (1 << 27) | (1 << 6) | 1);
    }

    fn colonnade() -> Scene {
        Scene::load("colonnade").unwrap()
    }

    fn points(per_m2: f32, minimum: u32, seed: u64) -> Result<ScenePoints, PointError> {
        generate(&colonnade(), &PointSettings { per_m2, minimum, seed }, &|_, _| {})
    }

    #[test]
    fn settings_that_make_no_points_are_refused() {
        assert!(matches!(points(f32::NAN, 10, 1), Err(PointError::Density { .. })));
        assert!(matches!(points(-1.0, 10, 1), Err(PointError::Density { .. })));
        assert!(matches!(points(0.0, 10, 1), Err(PointError::Density { .. })));
        assert_eq!(points(1.0, 0, 1).unwrap_err(), PointError::Minimum);
        assert!(matches!(points(1e12, 1, 1), Err(PointError::TooMany { .. })));
        assert!(matches!(points(1.0, u32::MAX, 1), Err(PointError::TooMany { .. })));
    }

    #[test]
    fn every_instance_has_its_points_by_area_and_never_too_few() {
        let scene = colonnade();
        let made = points(20.0, 100, 1).unwrap();
        assert_eq!(made.sets().len(), scene.rests().len());
        for (instance, range) in scene.instances().iter().zip(made.offsets().windows(2)) {
            let set = &made.sets()[instance.rest().index()];
            assert_eq!((range[1] - range[0]) as usize, set.points().len());
            let wanted = (set.area() * 20.0).max(100.0);
            let found = set.points().len() as f64;
            let rest = scene.rest(instance);
            let most = wanted + 8.0 * f64::from(rest.charts().count(true));
            assert!(found >= wanted && found <= most, "{}: {found} of {wanted}", instance.name());
            let mut counts = vec![0; rest.charts().fronts() as usize];
            set.points().iter().for_each(|point| counts[rest.charts().front(point.triangle) as usize] += 1);
            assert!(counts.iter().all(|&count| count >= 1), "{}: {counts:?}", instance.name());
            assert!(set.radius() > 0.0);
        }
        assert_eq!(made.total(), *made.offsets().last().unwrap());
    }

    #[test]
    fn points_do_not_depend_on_threads_but_on_the_seed() {
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let one = pool(1).install(|| points(5.0, 64, 7).unwrap());
        let many = pool(7).install(|| points(5.0, 64, 7).unwrap());
        assert_eq!(one.sets(), many.sets());
        assert_ne!(one.sets(), points(5.0, 64, 8).unwrap().sets());
    }

    #[test]
    fn progress_ends_at_the_total() {
        let last = AtomicU64::new(0);
        generate(&colonnade(), &PointSettings { per_m2: 1.0, minimum: 16, seed: 1 }, &|done, total| {
            assert!(done <= total);
            last.fetch_max(done * 1000 / total, Ordering::Relaxed);
        })
        .unwrap();
        assert_eq!(last.into_inner(), 1000);
    }
}
