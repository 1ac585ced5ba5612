//! The loop as a whole, on scenes with static, rigid and skinned instances.

use std::collections::BTreeMap;

use glam::Vec3;
use psao_codec::frame::{State, apply};
use psao_codec::point::Packed32;
use psao_proto::message::CameraPose;

use super::*;
use crate::ao::{AoSettings, Occlusion};
use crate::clock::NoClock;
use crate::points::PointSettings;

fn settings(per_m2: f32) -> ServerSettings {
    ServerSettings {
        points: PointSettings { per_m2, minimum: 32, seed: 3 },
        ao: AoSettings { rays: 24, radius: 0.6, ..AoSettings::default() },
        coder: BlockCoder::Lz4,
        ..ServerSettings::default()
    }
}

fn server(scene: &Arc<Scene>, settings: ServerSettings) -> Server {
    Server::new(Arc::clone(scene), settings, Arc::new(|_| {})).unwrap()
}

fn colonnade() -> Arc<Scene> {
    Arc::new(Scene::load("colonnade").unwrap())
}

/// Scenes with static, rigid and skinned instances.
fn scenes() -> Vec<Arc<Scene>> {
    ["colonnade", "robot-lab"].map(|name| Arc::new(Scene::load(name).unwrap())).into()
}

fn camera(scene: &Scene, time_s: f64) -> CameraPose {
    let key = scene.camera_path().at(time_s);
    CameraPose {
        eye: key.eye.to_array(),
        target: key.target.to_array(),
        up: key.up.to_array(),
        fov_y_deg: scene.camera_path().fov_y_deg(),
        aspect: 16.0 / 9.0,
    }
}

fn time(frame: u32) -> StreamTime {
    StreamTime(u64::from(frame) * 100_000)
}

/// Steps through a clip that looks along the camera path, all around and nowhere in turns.
fn clip(
    scene: &Arc<Scene>,
    settings: ServerSettings,
    frames: u32,
    mut check: impl FnMut(&Server, &StepOutput),
) {
    let mut server = server(scene, settings);
    for frame in 0..frames {
        let seen = [camera(scene, time(frame).micros() as f64 * 1e-6)];
        let away =
            [CameraPose { eye: [0.0, 1e6, 0.0], target: [0.0, 2e6, 0.0], up: [1.0, 0.0, 0.0], ..seen[0] }];
        let views: &[CameraPose] = match frame % 6 {
            0..=3 => &seen,
            4 => &away,
            _ => &[],
        };
        let output = server.step(FrameIndex(frame), time(frame), views, &NoClock).unwrap();
        check(&server, &output);
    }
}

#[test]
fn tracing_everything_gives_the_same_bytes() {
    for (scene, kind) in scenes().iter().zip([Occlusion::Obscurance, Occlusion::Binary]) {
        let mut lazy = settings(12.0);
        lazy.ao.kind = kind;
        lazy.threshold = 2;
        let mut all = Vec::new();
        let mut rays = [0u64; 2];
        clip(scene, ServerSettings { exhaustive: true, ..lazy }, 24, |_, output| {
            rays[0] += output.stats.rays;
            all.push(output.body.clone());
        });
        let mut next = all.iter();
        clip(scene, lazy, 24, |_, output| {
            rays[1] += output.stats.rays;
            assert_eq!(Some(&output.body), next.next(), "frame {}", output.info.frame);
        });
        assert!(rays[1] * 4 < rays[0] * 3, "the skip saves rays: {rays:?}");
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let scene = colonnade();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut bodies = Vec::new();
        pool.install(|| clip(&scene, settings(8.0), 6, |_, output| bodies.push(output.body.clone())));
        bodies
    };
    assert_eq!(run(1), run(5));
}

/// Words of all points that a client finds in each cell, by instance and cell.
fn words(state: &State, instance: u32, cell: [u32; 3]) -> Vec<Packed32> {
    state.lookup(instance, cell).into_iter().flat_map(psao_codec::cells::Cell::points).collect()
}

/// What the client holds for a point, by its place as last sent: AO bytes of the points packed alike.
fn held(server: &Server, state: &State, point: u32) -> Vec<u8> {
    let instance = server.points.firsts().partition_point(|&first| first <= point) - 1;
    let index = (point - server.points.firsts()[instance]) as usize;
    let now = server.field.local(instance)[index];
    let sent = server.sent.places[instance].get(index).copied().unwrap_or((now.position, now.normal));
    let located = server.layout().instances()[instance].grid.locate(sent.0.to_array());
    let like = Packed32::pack(located.frac, sent.1.to_array(), 0);
    let alike = |word: &Packed32| {
        Packed32::pack(word.frac(), word.normal(), 0) == Packed32::pack(like.frac(), like.normal(), 0)
    };
    words(state, instance as u32, located.cell).into_iter().filter(alike).map(Packed32::ao).collect()
}

/// Checks every visible point that has a slot; how many that were.
fn check_bound(server: &Server, state: &State, frame: FrameIndex) -> u32 {
    let threshold = f32::from(server.settings.threshold);
    let mut checked = 0;
    for point in server.field.visible() {
        let Some(psao_codec::cells::Placement::Stored) = server.encoder.placement(point) else { continue };
        let ao = f32::from(server.field.byte(point));
        let held = held(server, state, point);
        // |client - server| < threshold + half a step: the server's byte is within half a step of its AO.
        let near = held.iter().any(|&byte| (f32::from(byte) - ao).abs() < threshold);
        assert!(near, "point {point} at frame {frame}: server {ao}, client {held:?}");
        checked += 1;
    }
    checked
}

#[test]
fn clients_are_never_off_by_the_threshold_or_more() {
    for (scene, threshold) in scenes().iter().flat_map(|scene| [(scene, 2), (scene, 8)]) {
        let mut state: Option<State> = None;
        let mut checked = 0;
        clip(scene, ServerSettings { threshold, ..settings(8.0) }, 14, |server, output| {
            let state = state.get_or_insert_with(|| State::new(Arc::clone(server.layout())));
            apply(state, &output.body, &psao_codec::Limits::default()).unwrap();
            assert_eq!(state.hash(), server.encoder.state().hash());
            checked += check_bound(server, state, output.info.frame);
        });
        assert!(checked > 10_000, "{checked}");
    }
}

#[test]
fn the_first_frame_is_a_keyframe_with_every_point() {
    let scene = colonnade();
    let mut server = server(&scene, settings(4.0));
    let away = CameraPose {
        eye: [0.0, 1e6, 0.0],
        target: [0.0, 2e6, 0.0],
        up: [1.0, 0.0, 0.0],
        ..camera(&scene, 0.0)
    };
    let first = server.step(FrameIndex(0), time(0), &[away], &NoClock).unwrap();
    assert_eq!(first.info.kind, FrameKind::Key);
    assert_eq!(first.stats.changed, server.points().total());
    let counts = first.stats.occupancy;
    assert_eq!(counts.points_stored + counts.homeless(), server.points().total());
    assert_eq!(counts.outside_grid, 0);
    assert!(counts.homeless() < counts.points_stored, "{counts:?}");
    let next = server.step(FrameIndex(1), time(1), &[away], &NoClock).unwrap();
    assert_eq!((next.stats.visible, next.stats.rays, next.stats.changed), (0, 0, 0));
    // A client that joins now gets the same state.
    let body = server.keyframe(FrameIndex(1), time(1), BlockCoder::Lz4).unwrap();
    let mut late = State::new(Arc::clone(server.layout()));
    apply(&mut late, &body, &psao_codec::Limits::default()).unwrap();
    assert_eq!(&late, server.encoder().state());
}

#[test]
fn a_scene_that_stands_still_costs_no_rays_and_sends_nothing() {
    let scene = colonnade();
    let mut server = server(&scene, settings(4.0));
    server.step(FrameIndex(0), time(5), &[], &NoClock).unwrap();
    let again = server.step(FrameIndex(1), time(5), &[], &NoClock).unwrap();
    assert_eq!((again.stats.visible, again.stats.rays, again.stats.changed), (server.points().total(), 0, 0));
    assert!(again.info.sections.iter().all(|section| section.records == 0));
}

#[test]
fn points_of_deforming_instances_stay_inside_their_grids() {
    let scene = Arc::new(Scene::load("robot-lab").unwrap());
    assert!(scene.instances().iter().any(|instance| instance.motion() == Motion::Deforming));
    clip(&scene, settings(4.0), 12, |_, output| assert_eq!(output.stats.occupancy.outside_grid, 0));
}

#[test]
fn bad_settings_are_refused_before_anything_is_made() {
    let scene = colonnade();
    let refuse = |settings| Server::new(Arc::clone(&scene), settings, Arc::new(|_| {})).unwrap_err();
    let good = settings(4.0);
    let points = PointSettings { per_m2: f32::INFINITY, ..good.points };
    assert!(matches!(
        refuse(ServerSettings { points, ..good }),
        ServerError::Settings(SettingsError::Points(_))
    ));
    let ao = AoSettings { radius: f32::NAN, ..good.ao };
    assert!(matches!(refuse(ServerSettings { ao, ..good }), ServerError::Settings(SettingsError::Ao(_))));
    let mut server = server(&scene, good);
    server.step(FrameIndex(4), time(0), &[], &NoClock).unwrap();
    let late = server.step(FrameIndex(4), time(1), &[], &NoClock).unwrap_err();
    assert!(matches!(late, ServerError::Encode(_)));
    server.step(FrameIndex(5), time(1), &[], &NoClock).unwrap();
}

#[test]
fn progress_covers_both_long_stages() {
    let scene = colonnade();
    let heard = Arc::new(std::sync::Mutex::new(BTreeMap::new()));
    let sink = Arc::clone(&heard);
    let progress = move |p: Progress| {
        assert!(p.done <= p.total);
        let mut heard = sink.lock().unwrap();
        let last = heard.entry(p.work == Work::Points).or_insert((0, 0));
        *last = (last.0.max(p.done), p.total);
    };
    let mut server = Server::new(scene, settings(2.0), Arc::new(progress)).unwrap();
    server.step(FrameIndex(0), time(0), &[], &NoClock).unwrap();
    server.step(FrameIndex(1), time(1), &[], &NoClock).unwrap();
    let heard = heard.lock().unwrap();
    assert_eq!(heard.len(), 2);
    assert!(heard.values().all(|&(done, total)| done == total && total > 0));
    assert_ne!(Vec3::ZERO, server.world().bounds().size());
}
