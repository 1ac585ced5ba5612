//! Rays and points: the AO of a sample of a built-in scene's points, with nearest hits and with any hits, beside a
//! plain reference tracer. Single rays and point generation follow. Rates are per ray and per point.

use std::sync::Arc;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use psao_server::ao::{AoSettings, Occlusion, Ray, RayWorkload, ReferenceTracer, Scratch, Tracer};
use psao_server::points::{PointSettings, ScenePoints, generate};
use psao_server::scene::{InstanceId, Scene};
use psao_server::world::SceneBvh;

/// Interval of the points from which a single ray starts. It spreads the rays over the scene, but keeps neighbours
/// close enough to share memory.
const STRIDE: usize = 16;

/// Number of points whose rays are traced.
const SAMPLE: u32 = 1000;

/// Position and normal of some points, world space.
fn places(world: &SceneBvh, points: &ScenePoints) -> Vec<(glam::Vec3, glam::Vec3)> {
    let mut places = Vec::new();
    for (index, instance) in (0u32..).zip(world.scene().instances()) {
        let Some(posed) = world.posed(InstanceId(index)) else { continue };
        let at = world.placement(InstanceId(index));
        let set = points.sets()[instance.rest().index()].points();
        places.extend(set.iter().step_by(STRIDE).map(|point| {
            let placed = point.place_on(&posed);
            (at.point(placed.position), at.direction(placed.normal))
        }));
    }
    places
}

/// Traces all rays of a sample of points: as the server does, and one by one through the reference tracer.
fn rays(group: &mut BenchmarkGroup<'_, WallTime>, kind: Occlusion, workload: &RayWorkload) {
    let mut scratch = Scratch::default();
    let (rays, reference) = (workload.rays(), ReferenceTracer::new(&workload.triangles()));
    let any = kind == Occlusion::Binary;
    let hit = |ray: &Ray| if any { reference.occluded(ray) } else { reference.closest(ray).is_finite() };
    // Check the answer first: except for grazing rays, both hit the same.
    let distances = workload.distances(&mut scratch);
    let differ =
        distances.iter().zip(&rays).filter(|(distance, ray)| distance.is_finite() != hit(ray)).count();
    assert!(differ * 1000 < rays.len(), "{differ} rays differ");
    let hits = distances.iter().filter(|distance| distance.is_finite()).count();
    assert!(hits > rays.len() / 100 && hits < rays.len() * 4 / 5, "{hits} hits");
    group.throughput(Throughput::Elements(rays.len() as u64));
    group.bench_function(format!("{kind:?}"), |bencher| bencher.iter(|| workload.trace(&mut scratch)));
    group.bench_function(format!("{kind:?}, plain reference"), |bencher| {
        bencher.iter(|| rays.iter().filter(|ray| hit(ray)).count());
    });
}

fn trace(criterion: &mut Criterion) {
    for name in ["colonnade", "robot-lab"] {
        let Ok(scene) = Scene::load(name) else { continue };
        let scene = Arc::new(scene);
        let settings = PointSettings::default().with_per_m2(64.0).with_minimum(256).with_seed(1);
        let Ok(points) = generate(&scene, &settings, &|_, _| {}) else { continue };
        let world = SceneBvh::new(&scene, &scene.pose(0.0));
        let places = places(&world, &points);
        let mut group = criterion.benchmark_group(name);
        group.sample_size(10);
        for kind in [Occlusion::Obscurance, Occlusion::Binary] {
            let Ok(tracer) = Tracer::new(AoSettings::default().with_kind(kind)) else { continue };
            rays(&mut group, kind, &RayWorkload::new(&scene, &points, tracer, SAMPLE, 1));
        }
        group.throughput(Throughput::Elements(places.len() as u64));
        group.bench_function("single rays", |bencher| {
            bencher.iter(|| {
                let hits = places
                    .iter()
                    .filter(|&&(at, normal)| world.closest(at + normal * 0.01, normal, 100.0).is_some());
                hits.count()
            });
        });
        group.finish();
    }
}

fn points(criterion: &mut Criterion) {
    let Ok(scene) = Scene::load("colonnade") else { return };
    let settings = PointSettings::default().with_per_m2(256.0).with_minimum(1024).with_seed(1);
    let made = generate(&scene, &settings, &|_, _| {});
    let count: usize = made.map_or(0, |points| points.sets().iter().map(|set| set.points().len()).sum());
    assert!(count > 10_000);
    let mut group = criterion.benchmark_group("points");
    group.sample_size(10);
    group.throughput(Throughput::Elements(count as u64));
    group.bench_function("generate", |bencher| bencher.iter(|| generate(&scene, &settings, &|_, _| {})));
    group.finish();
}

criterion_group!(benches, trace, points);
criterion_main!(benches);
