//! The memory that a server reports, compared with the memory allocated for it.

#![expect(clippy::unwrap_used, reason = "this is a test, its helpers included")]

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::surface::Budget;
use psao_proto::Profile;
use psao_server::ao::AoSettings;
use psao_server::clock::NoClock;
use psao_server::points::PointSettings;
use psao_server::scene::Scene;
use psao_server::server::{Server, ServerMemory, ServerSettings};

/// Returns settings with few points and rays.
fn settings(scene: &Scene) -> ServerSettings {
    ServerSettings::default()
        .with_points(PointSettings::default().with_per_m2(32.0).with_minimum(64))
        .with_ao(AoSettings::default().with_rays(32).with_radius(scene.ao_radius_m()))
}

/// Runs a server for a few frames of a scene.
fn run(scene: &Arc<Scene>, settings: ServerSettings) -> Server {
    let mut server = Server::new(Arc::clone(scene), settings, Arc::new(|_| ())).unwrap();
    for number in 0..6 {
        let time = StreamTime(u64::from(number) * 100_000);
        let camera = scene.camera(f64::from(number) * 0.1);
        server.step(FrameIndex(number), time, &[camera], &NoClock).unwrap();
    }
    server
}

#[test]
fn a_server_holds_what_it_says() {
    // All work is on this thread, because only its allocations are counted.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().unwrap();
    let scenes = ["colonnade", "robot-lab"].map(|name| Arc::new(Scene::load(name).unwrap()));
    let [still, walkers] = &scenes;
    let usual = settings(walkers);
    let paper = usual.with_profile(Profile::PAPER).with_coder(BlockCoder::Lz4);
    let budget = usual.with_budget(Some(Budget::new(2_000).with_longest_age(9)));
    for (scene, settings) in [(still, settings(still)), (walkers, usual), (walkers, paper), (walkers, budget)]
    {
        // Make the allocations that happen only once before counting.
        drop(pool.install(|| run(scene, settings)));
        let mut server = None;
        let allocated = pool.install(|| allocation_counter::measure(|| server = Some(run(scene, settings))));
        let said = server.unwrap().memory();
        let held = allocated.bytes_current as f64;
        let share = said.total() as f64 / held;
        assert!(
            (0.95..1.05).contains(&share),
            "{}: {share:.3} of {held} B are said to be held: {said:?}",
            scene.name()
        );
        let ServerMemory { structures, points, rays, stream, .. } = said;
        assert!([structures, points, rays, stream].iter().all(|&part| part > 0), "{said:?}");
    }
}

#[test]
fn what_is_remembered_is_counted() {
    let scene = Arc::new(Scene::load("robot-lab").unwrap());
    let usual = settings(&scene);
    let [much, none] = [1 << 30, 0].map(|ray_memory| run(&scene, usual.with_ray_memory(ray_memory)).memory());
    assert!(much.remembered > 0 && none.remembered == 0, "{much:?} {none:?}");
    assert_eq!(much.total() - much.remembered, none.total(), "nothing else differs");
}
