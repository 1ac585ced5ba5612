//! Moving scenes against a scan of every triangle of a real scene.

use std::sync::Arc;

use glam::Vec3;

use psao_proto::message::{Edit, EditAction};

use super::SceneBvh;
use crate::bvh::{BlasHit, reference};
use crate::random::Random;
use crate::scene::{Edits, InstanceId, Scene};

/// Returns all visible triangles in world space, and the first triangle of each instance.
fn triangles(world: &SceneBvh) -> (Vec<[Vec3; 3]>, Vec<usize>) {
    let (mut all, mut starts) = (Vec::new(), Vec::new());
    for index in 0..world.scene().instances().len() {
        starts.push(all.len());
        if !world.is_present(index) {
            continue;
        }
        let posed = world.posed(InstanceId(index as u32)).unwrap();
        let at = world.placement(InstanceId(index as u32));
        all.extend(
            (0..posed.triangles.len() as u32).map(|t| posed.corners(t).map(|corner| at.point(corner))),
        );
    }
    (all, starts)
}

fn direction(random: &mut Random) -> Vec3 {
    let one = |random: &mut Random| 2.0 * random.unit() - 1.0;
    Vec3::new(one(random), one(random), one(random)).normalize_or(Vec3::X)
}

/// Compares rays through a scene with its plain triangles. Returns the number of hits.
fn check(world: &SceneBvh, random: &mut Random) -> u32 {
    let (all, starts) = triangles(world);
    let (low, size) = (world.bounds().min(), world.bounds().size());
    let mut hits = 0;
    for _ in 0..100 {
        let origin = low + size * Vec3::new(random.unit(), random.unit(), random.unit());
        let along = direction(random);
        let opaque = |hit: &BlasHit| {
            let instance = starts.partition_point(|&start| start <= hit.triangle as usize) - 1;
            let posed = world.posed(InstanceId(instance as u32)).unwrap();
            let [_, u, v] = hit.intersection.barycentric();
            posed.opaque(hit.triangle - starts[instance] as u32, [u, v])
        };
        let slow = reference::nearest_of(&all, origin, along, 5.0, opaque);
        let fast = world.closest(origin, along, 5.0);
        assert_eq!(world.occluded(origin, along, 5.0), fast.is_some());
        let (Some(slow), Some(fast)) = (slow, fast) else {
            assert!(slow.is_none() && fast.is_none(), "{slow:?} {fast:?}");
            continue;
        };
        hits += 1;
        // Rays are traced in a body's own space, so the distance may round differently.
        assert!((slow.intersection.t - fast.t).abs() < 1e-4, "{slow:?} {fast:?}");
        let surface = world.surface(&fast).unwrap();
        assert!((surface.position - (origin + along * fast.t)).length() < 1e-3);
        assert!((surface.normal.length() - 1.0).abs() < 1e-4);
        let index = starts[fast.instance.index()] + fast.triangle as usize;
        assert!(reference::nearest(&all[index..=index], origin, along, 5.1).is_some());
    }
    hits
}

#[test]
fn a_moving_world_is_hit_like_its_plain_triangles() {
    for name in ["colonnade", "robot-lab"] {
        let scene = Arc::new(Scene::load(name).unwrap());
        let mut world = SceneBvh::new(&scene, &scene.pose(0.0));
        let mut random = Random::new(5);
        let steps = (0..4).map(|step| {
            world.update(&scene.pose(0.37 * f64::from(step)));
            check(&world, &mut random)
        });
        assert!(steps.sum::<u32>() > 50);
    }
}

#[test]
fn an_edited_world_is_hit_like_its_plain_triangles_and_like_one_made_that_way() {
    for name in ["colonnade", "robot-lab"] {
        let scene = Arc::new(Scene::load(name).unwrap());
        let count = scene.instances().len() as u32;
        let mut world = SceneBvh::new(&scene, &scene.pose(0.0));
        let mut edits = Edits::new(count);
        let (mut random, mut hits) = (Random::new(9), 0);
        for step in 0..6_u32 {
            for instance in (step..count).step_by(5) {
                let translation = [random.unit() * 3.0, random.unit(), random.unit() * 3.0];
                let action = match (instance + step) % 4 {
                    0 => EditAction::Hide,
                    1 => EditAction::Show,
                    2 => EditAction::Release,
                    _ => EditAction::Move { translation, rotation: [0.0, 0.6, 0.0, 0.8] },
                };
                edits.apply(&Edit { instance, action }).unwrap();
            }
            let mut pose = scene.pose(0.37 * f64::from(step));
            pose.apply(&edits);
            world.update(&pose);
            let hidden = (0..count as usize).filter(|&instance| !pose.instances()[instance].visible());
            assert!(hidden.clone().all(|instance| !world.is_present(instance)));
            for world in [&world, &SceneBvh::new(&scene, &pose)] {
                assert_eq!(
                    (0..count as usize).filter(|&i| !world.is_present(i)).count(),
                    hidden.clone().count()
                );
                hits += check(world, &mut random);
            }
        }
        assert!(hits > 100, "{hits}");
    }
}

#[test]
fn nothing_changes_when_time_stands_still() {
    let scene = Arc::new(Scene::load("robot-lab").unwrap());
    let mut world = SceneBvh::new(&scene, &scene.pose(1.0));
    world.update(&scene.pose(1.0));
    assert!(world.changes().iter().all(|change| change.swept().is_none()));
    world.update(&scene.pose(1.1));
    assert!(world.changes().iter().any(|change| change.swept().is_some()));
}
