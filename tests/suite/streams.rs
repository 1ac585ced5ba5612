//! Streams of every scene, from the server over the wire to the client.

use std::path::Path;
use std::sync::Arc;

use psao_codec::{Decoder, Limits, State};
use psao_eval::adapter::SceneView;
use psao_proto::Profile;
use psao_reconstruct::{Size, cast_view, reconstruct};
use psao_server::scene::Scene;
use psao_server::server::Server;

use psao_tests::{fast_settings, server, shared, step};

/// Streams the first frames of a scene into a client in both profiles, and draws the last one.
fn stream(name: &str, frames: u32) {
    let scene = Arc::new(Scene::load(name).unwrap());
    for profile in [Profile::PAPER, Profile::SURFACE] {
        stream_as(profile, name, &scene, frames);
    }
}

fn stream_as(profile: Profile, name: &str, scene: &Arc<Scene>, frames: u32) {
    let mut server = server(scene, fast_settings(scene, 2).with_profile(profile)).unwrap();
    let mut state = State::new(server.layout());
    let mut decoder = Decoder::new();
    for number in 0..frames {
        let frame = step(&mut server, number).unwrap();
        decoder.decode(&mut state, &frame.body, &Limits::default()).unwrap();
        assert_eq!(state.hash(), server.hash(), "{name}, {profile}, frame {number}");
    }
    assert_eq!(state.full_hash(), state.hash(), "{name}, {profile}");
    if let Some(encoder) = server.paper() {
        let counts = encoder.counts();
        let left_out = counts.bucket_full + counts.cell_full + counts.no_cell + counts.id_collisions;
        assert_eq!(
            counts.points_stored + left_out,
            server.points().total(),
            "{name}: every point is stored or counted"
        );
        // At this low density, cells are large and full.
        assert!(counts.points_stored * 2 > server.points().total(), "{name}: {counts:?}");
    }
    draw(name, scene, &server, &state);
}

fn draw(name: &str, scene: &Scene, server: &Server, state: &State) {
    let view = SceneView::new(server.world());
    let size = Size::new(64, 36).unwrap();
    let buffer = cast_view(&view, &scene.camera(3.0 / 60.0), size).unwrap();
    assert!(buffer.covered() > size.pixels() / 32, "{name}: the camera sees the scene");
    let drawn = match state {
        State::Paper(state) => reconstruct::cells(state, &buffer).unwrap(),
        State::Surface(state) => reconstruct::surface(state, &buffer).unwrap(),
    };
    assert!(drawn.image.values().iter().all(|ao| (0.0..=1.0).contains(ao)), "{name}");
    assert!(drawn.image.values().iter().any(|&ao| ao < 0.9), "{name}: something is near something");
}

#[test]
fn built_in_scenes() {
    for name in Scene::builtin_names() {
        stream(name, 4);
    }
}

#[test]
fn real_scenes() {
    let Some(folder) = shared("scenes") else { return };
    for name in [
        "apartment_people",
        "arcade",
        "asteroid_drones",
        "littlest_tokyo",
        "mech_arena",
        "robot_lab",
        "sponza_life",
    ] {
        stream(file(&folder, name).as_str(), 2);
    }
}

fn file(folder: &Path, name: &str) -> String {
    folder.join(name).join(format!("{name}.toml")).to_str().unwrap().to_owned()
}
