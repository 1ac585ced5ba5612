//! Tests of all crates together: from a scene through a server's frame to a picture, compared with the reference.

use std::sync::Arc;

use glam::Vec3;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::{Limits, State, apply};
use psao_proto::Profile;
use psao_proto::message::CameraPose;
use psao_reconstruct::reconstruct::{self, Reconstruction};
use psao_reconstruct::{AoImage, GBuffer, Size, cast_view};
use psao_server::ao::{AoSettings, Occlusion};
use psao_server::clock::NoClock;
use psao_server::points::PointSettings;
use psao_server::scene::Scene;
use psao_server::server::{Server, ServerSettings};
use psao_server::world::SceneBvh;

use crate::adapter::SceneView;
use crate::metric::Comparison;
use crate::reference::{reference, reference_by_single_rays};
use crate::shapes;

struct Seen {
    view: GBuffer,
    reference: AoImage,
    found: Reconstruction,
}

const PROFILES: [Profile; 2] = [Profile::PAPER, Profile::SURFACE];

/// Serves and reconstructs a cube on a floor, with points of this density.
fn cube_on_floor(profile: Profile, per_m2: f32) -> Seen {
    let lists = [shapes::floor(2.0), shapes::cube(Vec3::new(0.0, 0.3, 0.0), 0.3)];
    let scene = Arc::new(Scene::from_triangles("cube on floor", &lists, 0.6).unwrap());
    let ao = AoSettings::default().with_rays(64);
    let settings = ServerSettings::default()
        .with_points(PointSettings::default().with_per_m2(per_m2).with_minimum(64).with_seed(1))
        .with_ao(ao)
        .with_profile(profile)
        .with_coder(BlockCoder::Stored);
    let mut server = Server::new(scene, settings, Arc::new(|_| ())).unwrap();
    let frame = server.step(FrameIndex(0), StreamTime(0), &[], &NoClock).unwrap();
    let mut state = State::new(server.layout());
    apply(&mut state, &frame.body, &Limits::default()).unwrap();

    let pose = CameraPose {
        eye: [1.1, 1.2, 1.6],
        target: [0.0, 0.2, 0.0],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 50.0,
        aspect: 1.5,
    };
    let scene = SceneView::new(server.world());
    let view = cast_view(&scene, &pose, Size::new(96, 64).unwrap()).unwrap();
    let reference = reference(&scene, &view, &ao.with_rays(256)).unwrap();
    let found = match &state {
        State::Paper(state) => reconstruct::cells(state, &view).unwrap(),
        State::Surface(state) => reconstruct::surface(state, &view).unwrap(),
    };
    Seen { view, reference, found }
}

#[test]
fn the_picture_comes_close_to_the_reference_and_closer_with_more_points() {
    for profile in PROFILES {
        let [coarse, fine] = [256.0, 2048.0].map(|per_m2| {
            let seen = cube_on_floor(profile, per_m2);
            assert!(seen.found.statistics.unsupported_share() < 0.02, "{:?}", seen.found.statistics);
            Comparison::new(&seen.reference, &seen.found.image).unwrap()
        });
        assert!(coarse.psnr > 24.0, "{profile}: {coarse:?}");
        assert!(fine.psnr > coarse.psnr + 2.0, "{profile}: {coarse:?} {fine:?}");
        assert!(fine.psnr > 30.0 && fine.mae < 0.015, "{profile}: {fine:?}");
    }
}

#[test]
fn it_is_dark_where_the_cube_stands_and_open_far_from_it() {
    for profile in PROFILES {
        let seen = cube_on_floor(profile, 2048.0);
        let (mut contact, mut open) = (0, 0);
        for (pixel, &ao) in seen.found.image.values().iter().enumerate() {
            let Some(fragment) = seen.view.fragment(pixel).filter(|fragment| fragment.instance == 0) else {
                continue;
            };
            let away = fragment.position.abs().max_element() - 0.3;
            if away < 0.03 {
                contact += 1;
                assert!(ao < 0.85, "{profile}: {ao} at {}", fragment.position);
            } else if away > 0.75 {
                open += 1;
                assert_eq!(ao, 1.0, "{profile}: at {}", fragment.position);
            }
        }
        assert!(contact > 20 && open > 200, "{contact} {open}");
    }
}

#[test]
fn rays_traced_together_agree_with_single_ones() {
    let lists = [shapes::floor(2.0), shapes::cube(Vec3::new(0.0, 0.3, 0.0), 0.3)];
    let scene = Arc::new(Scene::from_triangles("cube on floor", &lists, 0.6).unwrap());
    let world = SceneBvh::new(&scene, &scene.pose(0.0));
    let scene = SceneView::new(&world);
    let pose = CameraPose {
        eye: [1.1, 1.2, 1.6],
        target: [0.0, 0.2, 0.0],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 50.0,
        aspect: 1.5,
    };
    let view = cast_view(&scene, &pose, Size::new(48, 32).unwrap()).unwrap();
    for kind in [Occlusion::Obscurance, Occlusion::Binary] {
        let settings = AoSettings::default().with_rays(1024).with_kind(kind);
        let together = reference(&scene, &view, &settings).unwrap();
        let single = reference_by_single_rays(&scene, &view, &settings).unwrap();
        let difference = Comparison::new(&single, &together).unwrap();
        // Both are estimates from 1,024 rays; only their noise may differ.
        assert!(difference.mae < 0.002 && difference.max < 0.03, "{kind:?}: {difference:?}");
        assert!(difference.bias.abs() < 5e-4, "{kind:?}: {difference:?}");
    }
}
