//! Tests of patches, of blocks, and of a stream with lossless video.

use std::sync::Arc;

use glam::Vec3;
use proptest::prelude::*;
use psao_proto::message::CameraPose;
use psao_reconstruct::{Camera, Size, cast_view};
use psao_server::ao::AoSettings;
use psao_server::clock::NoClock;
use psao_server::scene::{InstanceId, Scene};
use psao_server::world::{Hit, SceneBvh};

use super::*;
use crate::adapter::SceneView;
use crate::metric::Comparison;
use crate::reference::reference;
use crate::shapes;

fn cube_on_floor() -> Arc<Scene> {
    let lists = [shapes::floor(2.0), shapes::cube(Vec3::new(0.0, 0.3, 0.0), 0.3)];
    Arc::new(Scene::from_triangles("cube on floor", &lists, 0.6).unwrap())
}

fn camera() -> CameraPose {
    CameraPose {
        eye: [1.1, 1.2, 1.6],
        target: [0.0, 0.2, 0.0],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 50.0,
        aspect: 1.5,
    }
}

#[test]
fn the_two_triangles_of_a_rectangle_share_a_patch() {
    let scene = cube_on_floor();
    let triangles: usize = scene.rests().iter().map(|rest| rest.triangles().len()).sum();
    assert_eq!(Patches::new(&scene).len() as usize, triangles, "half as many pairs, two sides each");
}

#[test]
fn what_does_not_pair_has_a_patch_of_its_own() {
    // A fold of 90 degrees, and a triangle on its own.
    let fold = vec![
        [Vec3::ZERO, Vec3::X, Vec3::Y],
        [Vec3::X, Vec3::ZERO, Vec3::Z],
        [Vec3::splat(5.0), Vec3::splat(5.0) + Vec3::X, Vec3::splat(5.0) + Vec3::Y],
    ];
    let scene = Arc::new(Scene::from_triangles("fold", &[fold], 0.6).unwrap());
    assert_eq!(Patches::new(&scene).len(), 6);
}

/// Goes from a hit to its patch and back.
fn round_trip(scene: &Arc<Scene>, patches: &Patches, world: &SceneBvh, hit: Hit, back: bool) {
    let at = patches.point(&hit, back);
    let (found, side) = patches.hit(&at).unwrap();
    assert_eq!((found.instance, side), (hit.instance, back));
    let place = |hit: &Hit| world.surface(hit).unwrap().position;
    let scale = scene
        .rests()
        .iter()
        .flat_map(|rest| rest.geometry().positions())
        .map(|p| p.length())
        .fold(1.0, f32::max);
    assert!((place(&found) - place(&hit)).length() < 1e-5 * scale, "{hit:?} {at:?} {found:?}");
}

proptest! {
    #[test]
    fn a_hit_is_found_again_by_its_place_on_a_patch(
        pick in any::<u32>(),
        a in 0.0_f32..1.0,
        b in 0.0_f32..1.0,
        back in any::<bool>(),
    ) {
        thread_local! {
            static SCENE: (Arc<Scene>, Patches, SceneBvh) = {
                let scene = Arc::new(Scene::load("robot-lab").unwrap());
                let world = SceneBvh::new(&scene, &scene.pose(0.7));
                (Arc::clone(&scene), Patches::new(&scene), world)
            };
        }
        SCENE.with(|(scene, patches, world)| {
            let instance = pick as usize % scene.instances().len();
            let triangles = scene.rest(&scene.instances()[instance]).triangles().len();
            let triangle = (pick / 7) % triangles as u32;
            let (u, v) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
            let hit = Hit { t: 0.0, instance: InstanceId(instance as u32), triangle, u, v };
            round_trip(scene, patches, world, hit, back);
        });
    }

    #[test]
    fn blocks_never_overlap(steps in prop::collection::vec((0_u32..40, 1_u8..=8, 1_u8..=8, any::<bool>()), 1..120)) {
        let mut atlas = Atlas::default();
        for (patch, across, down, stays) in steps {
            if stays {
                let block = atlas.place(Patch(patch), Extent { across, down }).unwrap();
                prop_assert_eq!(atlas.block(Patch(patch)), Some(block));
            } else {
                atlas.release(Patch(patch));
                prop_assert_eq!(atlas.block(Patch(patch)), None);
            }
        }
        let blocks: Vec<Block> = (0..40).filter_map(|patch| atlas.block(Patch(patch))).collect();
        for (number, a) in blocks.iter().enumerate() {
            prop_assert!(a.x + a.extent.width() <= Atlas::WIDTH && a.y + a.extent.height() <= atlas.rows());
            for b in &blocks[number + 1..] {
                let apart = a.x + a.extent.width() <= b.x
                    || b.x + b.extent.width() <= a.x
                    || a.y + a.extent.height() <= b.y
                    || b.y + b.extent.height() <= a.y;
                prop_assert!(apart, "{a:?} {b:?}");
            }
        }
    }
}

#[test]
fn a_released_place_is_used_again_and_an_atlas_has_an_end() {
    let mut atlas = Atlas::default();
    let large = Extent { across: 8, down: 8 };
    let first = atlas.place(Patch(0), large).unwrap();
    atlas.release(Patch(0));
    assert_eq!(atlas.place(Patch(1), large), Ok(first));
    let many = Atlas::WIDTH / 256 * (Atlas::MAX_ROWS / 256);
    assert!((2..=many).all(|patch| atlas.place(Patch(patch), large).is_ok()));
    assert_eq!(atlas.place(Patch(many + 1), large), Err(AtlasFullError));
    assert_eq!(atlas.place(Patch(many + 1), Extent { across: 1, down: 1 }), Err(AtlasFullError));
}

/// Returns the error of a picture whose atlas was sent without loss.
fn error(settings: TextureSettings) -> Comparison {
    let (scene, ao) = (cube_on_floor(), AoSettings::default().with_rays(64));
    let patches = Arc::new(Patches::new(&scene));
    let mut server = TextureServer::new(&scene, &patches, settings, &ao).unwrap();
    let stats = server.step(0.0, &camera(), &NoClock).unwrap();
    // The floor and three faces of the cube.
    assert_eq!(stats.patches, 4);
    assert!(stats.placement_bytes >= 4 && stats.texels > 0, "{stats:?}");
    let again = server.step(0.1, &camera(), &NoClock).unwrap();
    assert_eq!((again.placement_bytes, again.texels), (0, stats.texels), "nothing moves");

    let size = Size::new(96, 64).unwrap();
    let world = SceneBvh::new(&scene, &scene.pose(0.0));
    let seen = SceneView::new(&world);
    let view = cast_view(&seen, &camera(), size).unwrap();
    let truth = reference(&seen, &view, &ao.with_rays(256)).unwrap();
    let looked = patch_lookup(&world, &patches, &Camera::new(&camera()).unwrap(), size);
    let (picture, missing) = server.block_map().picture(server.texels(), &looked).unwrap();
    assert_eq!(missing, 0.0);
    Comparison::new(&truth, &picture).unwrap()
}

#[test]
fn more_texels_come_closer_to_the_reference() {
    let errors = [4, 16, 128].map(|divisor| error(TextureSettings::new(divisor, 64, 30.0)).mae);
    assert!(errors[0] < 0.02 && errors.is_sorted(), "{errors:?}");
    assert!(errors[2] > 2.0 * errors[0], "a few texels cannot show the shadow of the cube: {errors:?}");
}

#[test]
fn what_was_never_placed_is_open_and_counted() {
    let scene = cube_on_floor();
    let patches = Arc::new(Patches::new(&scene));
    let server =
        TextureServer::new(&scene, &patches, TextureSettings::new(8, 16, 30.0), &AoSettings::default())
            .unwrap();
    let world = SceneBvh::new(&scene, &scene.pose(0.0));
    let looked = patch_lookup(&world, &patches, &Camera::new(&camera()).unwrap(), Size::new(12, 8).unwrap());
    assert!(looked.points.iter().any(Option::is_some));
    let (picture, missing) = server.block_map().picture(server.texels(), &looked).unwrap();
    assert_eq!(missing, 1.0);
    assert!(picture.values().iter().all(|&ao| ao == 1.0));
}

#[test]
fn settings_out_of_range_are_refused() {
    let good = TextureSettings::new(8, 64, 30.0);
    assert_eq!(good.validate(), Ok(()));
    for bad in [
        TextureSettings { divisor: 0, ..good },
        TextureSettings { most: 1, ..good },
        TextureSettings { most: 48, ..good },
        TextureSettings { most: 512, ..good },
        TextureSettings { fps: f32::NAN, ..good },
        TextureSettings { lines: 0, ..good },
    ] {
        assert!(bad.validate().is_err(), "{bad:?}");
    }
}
