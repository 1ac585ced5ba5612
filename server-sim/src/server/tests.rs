//! The loop as a whole, on scenes with static, rigid and skinned instances.

mod bad_scenes;
mod budget;
mod edits;
mod levels;
mod ray_scheduler;
mod shortcuts;

use std::collections::BTreeMap;

use glam::Vec3;
use psao_codec::envelope::FrameKind;
use psao_codec::paper::{self, Placement};
use psao_codec::surface::{self, BLOCK_POINTS, GeometrySource, NO_VALUE};
use psao_codec::{Decoder, State, apply};
use psao_proto::Profile;

use super::field::TracedPoint;
use super::*;
use crate::ao::{AoSettings, Occlusion};
use crate::clock::NoClock;
use crate::points::PointSettings;
use crate::scene::Motion;

const PROFILES: [Profile; 2] = [Profile::PAPER, Profile::SURFACE];

fn coder(profile: Profile) -> BlockCoder {
    if profile == Profile::PAPER { BlockCoder::Lz4 } else { BlockCoder::Range }
}

fn settings(profile: Profile, per_m2: f32) -> ServerSettings {
    ServerSettings {
        profile,
        points: PointSettings { per_m2, minimum: 32, seed: 3 },
        ao: AoSettings { rays: 24, radius: 0.6, ..AoSettings::default() },
        coder: coder(profile),
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

/// The cameras of a frame: along the camera path, at nothing, or none at all.
fn views(scene: &Scene, frame: u32) -> Vec<CameraPose> {
    let seen = camera(scene, time(frame).micros() as f64 * 1e-6);
    let (eye, target, up) = ([0.0, 1e6, 0.0], [0.0, 2e6, 0.0], [1.0, 0.0, 0.0]);
    match frame % 6 {
        0..=3 => vec![seen],
        4 => vec![CameraPose { eye, target, up, ..seen }],
        _ => Vec::new(),
    }
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
        let output = server.step(FrameIndex(frame), time(frame), &views(scene, frame), &NoClock).unwrap();
        check(&server, &output);
    }
}

/// Scenes with every profile.
fn scenes_by_profile() -> impl Iterator<Item = (Arc<Scene>, Profile)> {
    scenes().into_iter().flat_map(|scene| PROFILES.map(|profile| (Arc::clone(&scene), profile)))
}

#[test]
fn stages_that_work_side_by_side_write_the_same() {
    let budget = Some(surface::Budget::new(400).with_longest_age(9));
    for (profile, budget) in [(Profile::SURFACE, None), (Profile::SURFACE, budget), (Profile::PAPER, None)] {
        let scene = colonnade();
        let settings = ServerSettings { budget, ..settings(profile, 8.0) };
        let mut bodies = Vec::new();
        clip(&scene, settings, 12, |server, output| {
            bodies.push((output.body.clone(), output.stats, server.hash()));
        });
        let (mut trace, mut encode) = server(&scene, settings).into_stages();
        let (give, take) = std::sync::mpsc::sync_channel(1);
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for frame in 0..12 {
                    let traced = trace.trace(FrameIndex(frame), time(frame), &views(&scene, frame), &NoClock);
                    give.send(traced).unwrap();
                }
            });
            let written: Vec<_> = take
                .into_iter()
                .map(|traced| {
                    let output = encode.encode(traced, &NoClock).unwrap();
                    (output.body, output.stats, encode.state().hash())
                })
                .collect();
            assert!(written == bodies, "{profile}");
        });
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let scene = colonnade();
    for profile in PROFILES {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut bodies = Vec::new();
            pool.install(|| {
                clip(&scene, settings(profile, 8.0), 6, |_, output| bodies.push(output.body.clone()));
            });
            bodies
        };
        assert_eq!(run(1), run(5), "{profile}");
    }
}

/// What a client of `paper` holds for a point, by its place as last sent: AO bytes of the points packed alike. `None`
/// for a point that the tables have no slot for.
fn held_in_cells(server: &Server, state: &paper::State, instance: usize, place: usize) -> Option<u8> {
    let encoder = server.paper().unwrap();
    let number = server.trace.state.numbers(instance)[place];
    let id = server.points().offsets()[instance] + number;
    if encoder.placement(id) != Some(Placement::Stored) {
        return None;
    }
    let now = server.trace.state.field.placed().local(instance)[place];
    let sent = encoder.sent_place(id).unwrap_or((now.position.to_array(), now.normal.to_array()));
    let located = state.layout().instances()[instance].grid.locate(sent.0);
    let format = state.layout().format();
    let like = format.pack(located.frac, sent.1, 0);
    // Accessibility is in the low bits.
    let alike = |word: &u32| word >> format.split().ao == like >> format.split().ao;
    let words = state.lookup(instance as u32, located.cell).into_iter().flat_map(|cell| cell.packed(format));
    let held: Vec<u8> = words.filter(alike).map(|word| format.unpack(word).ao).collect();
    // What the server takes the client to hold is there.
    let sent = encoder.sent_ao(id).unwrap();
    assert!(held.contains(&sent), "point {id}: sent {sent}, client {held:?}");
    Some(sent)
}

/// What a client of `surface` holds for a point.
fn held_on_surface(state: &surface::State, instance: usize, place: usize) -> u8 {
    assert!(state.is_present(instance as u32, place / BLOCK_POINTS), "a visible point was never sent");
    state.values(instance as u32)[place]
}

/// Checks every visible point that has a slot; how many that were.
fn check_bound(server: &Server, state: &State, threshold: u8, index: FrameIndex) -> u32 {
    let half_step = state.as_paper().map_or(0, |state| state.layout().format().max_ao_error());
    let unseen = server.surface().map_or(threshold, |_| server.trace.state.thresholds.unseen);
    let mut checked = 0;
    let field = &server.trace.state.field;
    for chunk in field.chunks() {
        for TracedPoint { place, id: point, ao, buried, seen } in field.visible(chunk) {
            let place = place.index();
            let held = match state {
                State::Paper(state) => held_in_cells(server, state, chunk.instance, place),
                State::Surface(state) => Some(held_on_surface(state, chunk.instance, place)),
            };
            let Some(held) = held else { continue };
            let mut ao = ao;
            if matches!(state, State::Surface(_)) {
                // An AO of 0 is sent as 1.
                ao = ao.max(NO_VALUE + 1);
                assert_eq!(held == NO_VALUE, buried, "point {point}, frame {index}: held as {held}");
                if buried {
                    continue;
                }
            }
            // |client - server| < threshold + half a step: the server's byte is within half a step of its AO.
            let off = held.abs_diff(ao);
            let own = server.surface().and_then(|encoder| encoder.threshold(point.0));
            // The finest points may be off by twice as much, and unseen ones by more.
            let most = if seen { 2 * threshold - 1 } else { unseen.max(2 * threshold - 1) };
            let threshold = own.unwrap_or(threshold);
            assert!(threshold <= most, "point {point}, frame {index}: {threshold}");
            assert!(off < threshold || off <= half_step, "point {point}, frame {index}: {ao} held as {held}");
            checked += 1;
        }
    }
    checked
}

#[test]
fn clients_are_never_off_by_the_threshold_or_more() {
    let all = [(2, 32), (8, 32), (2, 24), (1, 16), (8, 16)];
    for ((scene, profile), (threshold, bits)) in
        scenes_by_profile().flat_map(|each| all.map(|settings| (each.clone(), settings)))
    {
        let mut state: Option<State> = None;
        let mut decoder = Decoder::new();
        let mut checked = 0;
        clip(&scene, ServerSettings { threshold, bits, ..settings(profile, 8.0) }, 14, |server, output| {
            let state = state.get_or_insert_with(|| State::new(server.layout()));
            decoder.decode(state, &output.body, &psao_codec::Limits::default()).unwrap();
            assert_eq!((state.hash(), state.full_hash()), (server.hash(), server.hash()));
            checked += check_bound(server, state, threshold, output.info.frame);
        });
        assert!(checked > 10_000, "{profile}: {checked}");
    }
}

#[test]
fn a_still_scene_is_sent_once_in_every_packing() {
    let scene = colonnade();
    for bits in [24, 16] {
        // A threshold below the step of the packing must not send what cannot be held any better.
        let mut server =
            server(&scene, ServerSettings { threshold: 1, bits, ..settings(Profile::PAPER, 4.0) });
        let first = server.step(FrameIndex(0), time(5), &[], &NoClock).unwrap();
        assert_eq!(first.info.packing, server.layout().as_paper().unwrap().format().packing());
        let again = server.step(FrameIndex(1), time(5), &[], &NoClock).unwrap();
        assert_eq!((again.stats.changed, again.info.sections.len()), (0, 0), "{bits} bits");
    }
}

#[test]
fn the_first_frame_is_a_keyframe_with_every_point() {
    let scene = colonnade();
    for profile in PROFILES {
        let mut server = server(&scene, ServerSettings { quality: 0.0, ..settings(profile, 4.0) });
        let away = CameraPose {
            eye: [0.0, 1e6, 0.0],
            target: [0.0, 2e6, 0.0],
            up: [1.0, 0.0, 0.0],
            ..camera(&scene, 0.0)
        };
        let first = server.step(FrameIndex(0), time(0), &[away], &NoClock).unwrap();
        assert_eq!((first.info.profile, first.info.kind), (profile, FrameKind::Key));
        assert_eq!(first.stats.changed, server.points().total());
        assert_eq!(first.stats.occupancy.is_some(), profile == Profile::PAPER);
        if let Some(counts) = first.stats.occupancy {
            assert_eq!(counts.points_stored + counts.unplaced(), server.points().total());
            assert_eq!(counts.outside_grid, 0);
            assert!(counts.unplaced() < counts.points_stored, "{counts:?}");
        }
        let next = server.step(FrameIndex(1), time(1), &[away], &NoClock).unwrap();
        assert_eq!((next.stats.visible, next.stats.rays, next.stats.changed), (0, 0, 0));
        // A client that joins now gets the same state.
        let body = server.keyframe(FrameIndex(1), time(1), coder(profile)).unwrap();
        let mut late = State::new(server.layout());
        apply(&mut late, &body, &psao_codec::Limits::default()).unwrap();
        assert_eq!((late.hash(), late.full_hash()), (server.hash(), server.hash()));
    }
}

#[test]
fn a_scene_that_stands_still_costs_no_rays_and_sends_nothing() {
    let scene = colonnade();
    for profile in PROFILES {
        let mut server = server(&scene, settings(profile, 4.0));
        server.step(FrameIndex(0), time(5), &[], &NoClock).unwrap();
        let again = server.step(FrameIndex(1), time(5), &[], &NoClock).unwrap();
        let stats = again.stats;
        assert_eq!((stats.visible, stats.rays, stats.changed), (server.points().total(), 0, 0));
        assert!(again.info.sections.is_empty(), "{profile}: {:?}", again.info.sections);
    }
}

#[test]
fn points_of_deforming_instances_stay_inside_their_grids() {
    let scene = Arc::new(Scene::load("robot-lab").unwrap());
    assert!(scene.instances().iter().any(|instance| instance.motion() == Motion::Deforming));
    clip(&scene, settings(Profile::PAPER, 4.0), 12, |_, output| {
        assert_eq!(output.stats.occupancy.unwrap().outside_grid, 0);
    });
}

/// AO bytes of all points by the number they were made with, for comparison between orders.
fn by_number(tracing: &TraceState) -> Vec<Option<u8>> {
    let mut found = vec![None; tracing.points.total() as usize];
    for chunk in tracing.field.chunks() {
        let base = tracing.points.offsets()[chunk.instance];
        for TracedPoint { place, ao, .. } in tracing.field.visible(chunk) {
            found[(base + tracing.numbers(chunk.instance)[place.index()]) as usize] = Some(ao);
        }
    }
    found
}

#[test]
fn both_profiles_trace_the_same_ao_and_see_the_same_points() {
    for scene in scenes() {
        let uniform = |profile| ServerSettings { quality: 0.0, ..settings(profile, 8.0) };
        let [mut paper, mut surface] = PROFILES.map(|profile| server(&scene, uniform(profile)));
        let orders = [&paper, &surface].map(|server| server.points().sets().to_vec());
        assert_ne!(orders[0], orders[1], "the orders differ, or this shows nothing");
        for frame in 0..4 {
            let seen = [camera(&scene, time(frame).micros() as f64 * 1e-6)];
            for server in [&mut paper, &mut surface] {
                server.step(FrameIndex(frame), time(frame), &seen, &NoClock).unwrap();
            }
            assert_eq!(by_number(&paper.trace.state), by_number(&surface.trace.state), "frame {frame}");
        }
    }
}

#[test]
fn both_profiles_at_once_write_what_each_writes_alone() {
    for scene in scenes() {
        let paper = ServerSettings { threshold: 2, quality: 0.0, ..settings(Profile::PAPER, 8.0) };
        let alone = PROFILES.map(|profile| {
            let mut bodies = Vec::new();
            clip(&scene, ServerSettings { profile, coder: coder(profile), ..paper }, 8, |_, output| {
                bodies.push(output.body.clone());
            });
            bodies
        });
        let mut both =
            BothProfiles::new(Arc::clone(&scene), &paper, BlockCoder::Range, None, Arc::new(|_| {})).unwrap();
        let mut clients = [&both.tables().paper, &both.tables().surface].map(|t| State::new(t.layout()));
        let mut errors = PerProfile::<AoErrorStats>::default();
        for frame in 0..8 {
            let outputs = both.step(FrameIndex(frame), time(frame), &views(&scene, frame), &NoClock).unwrap();
            assert!(outputs.paper.body == alone[0][frame as usize], "paper, frame {frame}");
            assert!(outputs.surface.body == alone[1][frame as usize], "surface, frame {frame}");
            for (client, output) in clients.iter_mut().zip([&outputs.paper, &outputs.surface]) {
                apply(client, &output.body, &psao_codec::Limits::default()).unwrap();
            }
            let found = both.errors(clients[1].as_surface().unwrap());
            // Points inside solids have no value in profile `surface`.
            let visible = u64::from(outputs.surface.stats.visible);
            assert_eq!(found.surface.lost, 0);
            let needed = found.paper.points + found.paper.lost;
            assert!(found.surface.points <= needed && needed <= visible, "{found:?}");
            assert!(found.surface.points * 2 >= needed, "{found:?}");
            errors.paper.merge(&found.paper);
            errors.surface.merge(&found.surface);
        }
        // The finest points may be off by twice as much.
        let bounds = [paper.threshold, 2 * paper.threshold - 1];
        for (found, bound) in [errors.paper, errors.surface].into_iter().zip(bounds) {
            assert!(found.max < f64::from(bound) + 0.5 + 1e-3, "{found:?}");
            assert!(
                found.mean() > 0.1 && found.mean() <= found.rms() && found.rms() <= found.max,
                "{found:?}"
            );
        }
    }
}

#[test]
fn what_is_in_view_comes_first() {
    let scene = colonnade();
    let server = server(&scene, settings(Profile::SURFACE, 8.0));
    let tracing = &server.trace.state;
    let seen = [camera(&scene, 0.0)];
    let order = traced_frame::in_view_first(tracing, &seen);
    let mut sorted = order.clone();
    sorted.sort_unstable();
    let chunks = tracing.field.chunks();
    assert_eq!(sorted, (0..chunks.len()).collect::<Vec<_>>(), "every chunk once");
    let eye = Vec3::from(seen[0].eye);
    let views = tracing.views(&seen).unwrap();
    let ranks = order.iter().map(|&chunk| {
        let bounds = tracing.field.bounds(&tracing.world, &chunks[chunk]);
        let middle = (bounds.min() + bounds.max()) * 0.5;
        let outside =
            views.overlap(middle, bounds.size().length() * 0.5) == crate::visibility::Overlap::Outside;
        (outside, if outside { chunk as f32 } else { bounds.distance_squared(eye) })
    });
    let ranks: Vec<(bool, f32)> = ranks.collect();
    assert!(ranks.is_sorted() && ranks[0].0 != ranks[ranks.len() - 1].0, "{ranks:?}");
    assert_eq!(traced_frame::in_view_first(tracing, &[]), sorted);
}

#[test]
fn geometry_that_is_shared_is_not_sent_and_fits_the_layout() {
    let scene = Arc::new(Scene::load("robot-lab").unwrap());
    let sent = settings(Profile::SURFACE, 4.0);
    let shared = ServerSettings { geometry: GeometrySource::Shared, ..sent };
    let mut sizes = Vec::new();
    for settings in [sent, shared] {
        let mut server = server(&scene, settings);
        let frame = server.step(FrameIndex(0), time(0), &[], &NoClock).unwrap();
        sizes.push(frame.body.len());
        let mut state = State::new(server.layout());
        apply(&mut state, &frame.body, &psao_codec::Limits::default()).unwrap();
        let found = state.clone();
        crate::points::make_shared_geometry(&scene, server.table().info(), state.as_surface_mut().unwrap())
            .unwrap();
        let sets = server.layout().as_surface().unwrap().sets().len() as u32;
        for set in 0..sets {
            let held = found.as_surface().unwrap().geometry(set);
            assert_eq!(held.is_some(), settings.geometry == GeometrySource::Sent);
            let made = state.as_surface().unwrap().geometry(set).unwrap();
            assert!(held.is_none_or(|held| held == made), "set {set}");
        }
    }
    assert!(sizes[1] < sizes[0] / 2, "{sizes:?}");
}

#[test]
fn bad_settings_are_refused_before_anything_is_made() {
    let scene = colonnade();
    let refuse = |settings| Server::new(Arc::clone(&scene), settings, Arc::new(|_| {})).unwrap_err();
    let good = settings(Profile::PAPER, 4.0);
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
    let mut server = Server::new(scene, settings(Profile::SURFACE, 2.0), Arc::new(progress)).unwrap();
    server.step(FrameIndex(0), time(0), &[], &NoClock).unwrap();
    server.step(FrameIndex(1), time(1), &[], &NoClock).unwrap();
    let heard = heard.lock().unwrap();
    assert_eq!(heard.len(), 2);
    assert!(heard.values().all(|&(done, total)| done == total && total > 0));
    assert_ne!(Vec3::ZERO, server.world().bounds().size());
}
