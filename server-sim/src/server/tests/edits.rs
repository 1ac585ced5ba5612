//! Edits: the AO follows them, whatever was traced before, and clients follow the AO.

use psao_proto::message::{Edit, EditAction};

use super::*;
use crate::scene::{EditError, InstanceId};

/// Clips of these tests: every kind of view comes up with every kind of edit.
const FRAMES: u32 = 18;

pub(super) fn first(scene: &Scene, motion: Motion) -> Option<u32> {
    scene.instances().iter().position(|instance| instance.motion() == motion).map(|index| index as u32)
}

/// A place beside where an instance is at the start, turned.
fn beside(scene: &Scene, instance: u32, by: f32) -> EditAction {
    let at = scene.pose(0.0).instances()[instance as usize].frame().translation;
    EditAction::Move {
        translation: (at + Vec3::new(by, 0.1, 0.3)).to_array(),
        rotation: [0.0, 0.6, 0.0, 0.8],
    }
}

/// Edits that come before each frame: of two static instances, a rigid and a skinned one, as far as the scene has them.
fn script(scene: &Scene) -> Vec<(u32, Edit)> {
    use EditAction::{Hide, Release, Show};
    let of = |instance: Option<u32>| {
        move |frame, action| instance.map(|instance| (frame, Edit { instance, action }))
    };
    let moved = |instance: Option<u32>, by| instance.map_or(Release, |instance| beside(scene, instance, by));
    let mut still = (0..).zip(scene.instances()).filter(|(_, instance)| instance.motion() == Motion::Static);
    let a = still.next().map(|(index, _)| index);
    let b = still.nth(2).map(|(index, _)| index);
    let (rigid, skinned) = (first(scene, Motion::Rigid), first(scene, Motion::Deforming));
    [
        of(a)(0, Hide),
        of(b)(1, moved(b, 0.4)),
        of(rigid)(1, moved(rigid, -0.3)),
        of(skinned)(2, Hide),
        of(a)(3, Show),
        of(b)(4, moved(b, 2.5)),
        of(skinned)(5, moved(skinned, 0.6)),
        of(skinned)(6, Show),
        of(rigid)(7, Hide),
        of(a)(8, moved(a, 0.2)),
        of(b)(8, Release),
        of(rigid)(10, Release),
        of(rigid)(11, Show),
        of(b)(12, Hide),
        of(skinned)(13, Release),
        of(a)(14, Release),
        of(b)(15, Show),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Steps through the clip with the script's edits.
pub(super) fn edited(
    scene: &Arc<Scene>,
    settings: ServerSettings,
    mut check: impl FnMut(&Server, &StepOutput),
) {
    let script = script(scene);
    let mut server = server(scene, settings);
    for frame in 0..FRAMES {
        for (_, edit) in script.iter().filter(|(at, _)| *at == frame) {
            assert_eq!(server.trace_stage().edit(edit), Ok(true), "frame {frame}: {edit:?}");
        }
        let output = server.step(FrameIndex(frame), time(frame), &views(scene, frame), &NoClock).unwrap();
        check(&server, &output);
    }
    assert!(server.edits().is_empty());
}

#[test]
fn clients_follow_the_edits_and_are_never_off_by_the_threshold() {
    for (scene, profile) in scenes_by_profile() {
        let mut state: Option<State> = None;
        let mut decoder = Decoder::new();
        let mut checked = 0;
        edited(&scene, ServerSettings { threshold: 2, ..settings(profile, 8.0) }, |server, output| {
            let state = state.get_or_insert_with(|| State::new(server.layout()));
            decoder.decode(state, &output.body, &psao_codec::Limits::default()).unwrap();
            assert_eq!((state.hash(), state.full_hash()), (server.hash(), server.hash()));
            checked += check_bound(server, state, 2, output.info.frame);
            if let State::Paper(state) = &*state {
                for instance in 0..scene.instances().len() {
                    let frame = server.trace.state.pose.instances()[instance].frame();
                    let held = state.pose(instance as u32).unwrap();
                    assert_eq!(Vec3::from(held.translation), frame.translation, "instance {instance}");
                    assert_eq!(held.rotation, frame.rotation.to_array(), "instance {instance}");
                }
            }
        });
        assert!(checked > 10_000, "{profile}: {checked}");
    }
}

/// A floor with a box on it, both static. The box stands at x = -1.
fn box_on_floor() -> Arc<Scene> {
    let quad = |a: Vec3, b: Vec3, c: Vec3, d: Vec3| [[a, b, c], [a, c, d]];
    let floor = [[-2.0, -1.0], [-2.0, 1.0], [2.0, 1.0], [2.0, -1.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
    let [a, b, c, d] = floor;
    let cube = crate::bvh::reference::cube(0.25).into_iter().map(|[a, b, c]| {
        let outwards = (b - a).cross(c - a).dot(a) > 0.0;
        let turned = if outwards { [a, b, c] } else { [a, c, b] };
        turned.map(|corner| corner + Vec3::new(-1.0, 0.26, 0.0))
    });
    let lists = [quad(a, b, c, d).to_vec(), cube.collect()];
    Arc::new(Scene::from_triangles("box on a floor", &lists, 0.6).unwrap())
}

/// Mean AO byte of the floor's points within 0.5 m of the floor at this x.
fn shade(server: &Server, x: f32) -> f32 {
    let field = &server.trace.state.field;
    let local = field.placed().local(0);
    let near =
        field.chunks().iter().filter(|chunk| chunk.instance == 0).flat_map(|chunk| field.visible(chunk));
    let near = near.filter(|point| local[point.place.index()].position.distance(Vec3::X * x) < 0.5);
    let (sum, count) = near.fold((0.0, 0), |(sum, count), point| (sum + f32::from(point.ao), count + 1));
    assert!(count > 50, "{count} points near {x}");
    sum / count as f32
}

#[test]
fn the_shadow_goes_with_a_static_box_and_stays_nowhere() {
    let scene = box_on_floor();
    assert!(scene.instances().iter().all(|instance| instance.motion() == Motion::Static));
    let mut server = server(&scene, settings(Profile::SURFACE, 128.0));
    let mut frame = 0;
    let mut step = |server: &mut Server, action: Option<EditAction>| {
        if let Some(action) = action {
            assert_eq!(server.trace_stage().edit(&Edit { instance: 1, action }), Ok(true));
        }
        let output = server.step(FrameIndex(frame), time(frame), &[], &NoClock).unwrap();
        frame += 1;
        (shade(server, -1.0), shade(server, 1.0), output.stats.rays)
    };
    let (dark, open, _) = step(&mut server, None);
    assert!(dark + 20.0 < open, "{dark} {open}");
    let across = EditAction::Move { translation: [2.0, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0] };
    let (left, under, rays) = step(&mut server, Some(across));
    assert!((left - open).abs() < 1.0 && (under - dark).abs() < 10.0, "{left} {open}, {under} {dark}");
    assert!(rays > 0);
    assert!(!server.world().is_still(1) && server.world().is_still(0));
    let (_, gone, _) = step(&mut server, Some(EditAction::Hide));
    assert!(
        gone > under + 20.0 && server.world().closest(Vec3::new(1.0, 9.0, 0.0), Vec3::NEG_Y, 8.9).is_none()
    );
    let (_, again, _) = step(&mut server, Some(EditAction::Show));
    assert_eq!(again, under);
    let (back, left, _) = step(&mut server, Some(EditAction::Release));
    assert!((back - dark).abs() < 3.0 && (left - gone).abs() < 1.0, "{back} {dark}, {left} {gone}");
    assert!(!server.world().is_still(1), "it stays a body of its own");
    assert_eq!(step(&mut server, None), (back, left, 0), "and costs nothing while it rests");
}

#[test]
fn a_static_box_that_is_lifted_forgets_the_floor() {
    let mut server = server(&box_on_floor(), settings(Profile::SURFACE, 128.0));
    let darkest = |server: &Server| {
        let field = &server.trace.state.field;
        let own = field.chunks().iter().filter(|chunk| chunk.instance == 1);
        own.flat_map(|chunk| field.visible(chunk)).map(|point| point.ao).min().unwrap()
    };
    server.step(FrameIndex(0), time(0), &[], &NoClock).unwrap();
    assert!(darkest(&server) < 230, "it stands on the floor");
    let action = EditAction::Move { translation: [0.0, 5.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0] };
    server.trace_stage().edit(&Edit { instance: 1, action }).unwrap();
    server.step(FrameIndex(1), time(1), &[], &NoClock).unwrap();
    assert_eq!(darkest(&server), 255, "nothing is near");
}

#[test]
fn edits_far_out_and_in_thousands_make_finite_frames() {
    let scene = box_on_floor();
    for profile in PROFILES {
        let mut server = server(&scene, settings(profile, 16.0));
        let mut state = State::new(server.layout());
        for frame in 0..4 {
            for step in 0..5_002_u32 {
                let far = if (step / 2 + frame) % 2 == 0 { 1e9 } else { -1e9 };
                let rotation = [0.6, 0.0, 0.0, 0.8];
                let action = EditAction::Move { translation: [far, far, far * 0.5], rotation };
                assert_eq!(server.trace_stage().edit(&Edit { instance: step % 2, action }), Ok(true));
            }
            let bad = EditAction::Move { translation: [1e30, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0] };
            assert!(matches!(
                server.trace_stage().edit(&Edit { instance: 1, action: bad }),
                Err(EditError::TooFar { .. })
            ));
            let output = server.step(FrameIndex(frame), time(frame), &[], &NoClock).unwrap();
            apply(&mut state, &output.body, &psao_codec::Limits::default()).unwrap();
            assert_eq!(state.hash(), server.hash());
            assert_eq!(server.edits().iter().count(), 2);
            let at = server.world().placement(InstanceId(1));
            assert!(at.translation.is_finite() && at.translation.x.abs() == 1e9);
        }
    }
}

#[test]
fn what_is_hidden_costs_no_rays_even_where_it_walks() {
    let scene = Arc::new(Scene::load("robot-lab").unwrap());
    let mut server = server(&scene, settings(Profile::SURFACE, 4.0));
    for (instance, of) in (0..).zip(scene.instances()) {
        if of.motion() != Motion::Static {
            assert_eq!(server.trace_stage().edit(&Edit { instance, action: EditAction::Hide }), Ok(true));
        }
    }
    let first = server.step(FrameIndex(0), time(0), &[], &NoClock).unwrap();
    assert!(first.stats.visible < server.points().total());
    let next = server.step(FrameIndex(1), time(3), &[], &NoClock).unwrap();
    assert_eq!((next.stats.visible, next.stats.rays, next.stats.changed), (first.stats.visible, 0, 0));
}
