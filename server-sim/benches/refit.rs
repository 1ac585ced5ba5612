//! Trees of deforming bodies: steps of a scene from one pose to the next and back. Each step places every triangle,
//! refits every box and rebuilds the top-level tree. Rates are per deforming triangle.

use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use psao_server::scene::{Motion, Scene};
use psao_server::world::SceneBvh;

fn refit(criterion: &mut Criterion) {
    for name in ["colonnade", "robot-lab"] {
        let Ok(scene) = Scene::load(name) else { continue };
        let scene = Arc::new(scene);
        let poses = [scene.pose(0.0), scene.pose(1.0 / 60.0)];
        let deforming = scene.instances().iter().filter(|instance| instance.motion() == Motion::Deforming);
        let triangles: usize = deforming.map(|instance| scene.rest(instance).triangles().len()).sum();
        let mut world = SceneBvh::new(&scene, &poses[0]);
        // Check the answer first: something deforms, and an updated world equals a new one.
        assert!(triangles > 100, "{name}: {triangles} triangles deform");
        world.update(&poses[1]);
        assert_eq!(world.bounds(), SceneBvh::new(&scene, &poses[1]).bounds());
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(2 * triangles as u64));
        group.bench_function("refit, there and back", |bencher| {
            bencher.iter(|| poses.iter().for_each(|pose| world.update(pose)));
        });
        group.finish();
    }
}

criterion_group!(benches, refit);
criterion_main!(benches);
