//! Scenes that nobody would make on purpose: a defined stream or a clear refusal, and never a number that is none.

use std::fmt::Write as _;

use super::*;
use crate::points::PointId;
use crate::scene::tests::Doc;
use crate::scene::{Geometry, InstanceId, SceneError};

/// Streams some frames of a scene in both profiles to a client, and looks at every number; points of the stream.
fn stream(what: &str, scene: &Arc<Scene>, radius: f32) -> u32 {
    let mut points = 0;
    let area: f64 = scene.instances().iter().map(|instance| scene.rest(instance).area_m2()).sum();
    for profile in PROFILES {
        let base = settings(profile, (500.0 / area).min(4.0) as f32);
        let settings = ServerSettings {
            points: PointSettings { minimum: 8, ..base.points },
            ao: AoSettings { rays: 8, radius, ..base.ao },
            ..base
        };
        let server = Server::build(Arc::clone(scene), settings, None, Arc::new(|_| {}), true);
        let mut server = server.unwrap_or_else(|error| panic!("{what}, {profile}: {error}"));
        points = server.points().total();
        let mut state = State::new(server.layout());
        for frame in 0..4 {
            let time = StreamTime(u64::from(frame) * 400_000);
            let views = views(scene, frame);
            let output = server.step(FrameIndex(frame), time, &views, &NoClock).unwrap();
            apply(&mut state, &output.body, &psao_codec::Limits::default()).unwrap();
            assert_eq!(state.full_hash(), server.hash(), "{what}, {profile}, frame {frame}");
            check_numbers(what, &server);
        }
    }
    points
}

/// Every point of the server is somewhere, looks somewhere, and has an AO.
fn check_numbers(what: &str, server: &Server) {
    let field = &server.trace.state.field;
    for chunk in field.chunks() {
        for place in &field.placed().local(chunk.instance)[chunk.points.clone()] {
            assert!(place.position.is_finite(), "{what}: {place:?}");
            assert!((place.normal.length() - 1.0).abs() < 1e-3, "{what}: {place:?}");
        }
        for point in (chunk.first.0..).take(chunk.points.len()).map(PointId) {
            let ao = field.exact(point).unwrap();
            assert!((0.0..=1.0).contains(&ao), "{what}: AO {ao}");
        }
    }
}

fn plate(size: f32, height: f32) -> Vec<[Vec3; 3]> {
    let at = |x: f32, z: f32| Vec3::new(x * size, height, z * size);
    vec![[at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)], [at(-1.0, -1.0), at(1.0, 1.0), at(1.0, -1.0)]]
}

#[test]
fn odd_meshes_make_finite_streams() {
    let nan = [Vec3::new(f32::NAN, 0.0, 0.0), Vec3::X, Vec3::Z];
    let infinite = [Vec3::ZERO, Vec3::X, Vec3::new(0.0, f32::INFINITY, 0.0)];
    let sliver = [Vec3::ZERO, Vec3::new(5.0, 0.0, 1e-9), Vec3::new(10.0, 0.0, 0.0)];
    let point = [Vec3::ONE; 3];
    let cube = crate::bvh::reference::cube(0.3);
    let cases: [(&str, Vec<Vec<[Vec3; 3]>>); 8] = [
        ("tiny", vec![plate(1e-6, 0.0), plate(1e-6, 1e-7)]),
        ("too small to have an area", vec![plate(1.0, 0.0), plate(1e-30, 0.1)]),
        ("huge", vec![plate(1.0, 0.0), plate(1e8, -1.0)]),
        ("far out", vec![plate(1.0, 0.0), plate(1.0, 9e8)]),
        ("not finite", vec![[vec![nan, infinite], plate(1.0, 0.0)].concat(), vec![nan]]),
        (
            "lines and points",
            vec![[vec![sliver, point], plate(1.0, 0.0)].concat(), vec![sliver], vec![point]],
        ),
        (
            "the same thing many times over",
            vec![plate(1.0, 0.0).repeat(40), plate(1.0, 0.0), plate(1.0, 0.0)],
        ),
        ("in itself", vec![[cube.clone(), cube.clone(), plate(1.0, 0.0)].concat(), cube]),
    ];
    for (what, lists) in cases {
        let scene = Arc::new(Scene::from_triangles(what, &lists, 0.6).unwrap());
        if what == "huge" {
            let refused = Server::new(Arc::clone(&scene), settings(Profile::SURFACE, 1.0), Arc::new(|_| {}));
            assert!(matches!(refused, Err(ServerError::Settings(SettingsError::Points(_)))), "{refused:?}");
        }
        for radius in [1e-6, 0.6, 1e6] {
            assert!(stream(what, &scene, radius) > 0, "{what}");
        }
    }
}

/// A floor, and a plate at a node with this transform.
fn placed(transform: &str) -> Result<Scene, SceneError> {
    let mut doc = Doc::default();
    let positions =
        doc.vectors(plate(1.0, 0.0).as_flattened().iter().map(Vec3::to_array).collect::<Vec<_>>().as_slice());
    doc.load(&format!(
        r#""nodes":[{{"mesh":0}},{{"children":[2],"translation":[0,0.2,0],{transform}}},{{"mesh":0,"rotation":[0,0.6,0,0.8]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{positions}}}}}]}}]"#
    ))
}

#[test]
fn odd_transforms_make_finite_streams_or_no_instance() {
    for (transform, instances) in [
        (r#""scale":[0,0,0]"#, 1),
        (r#""scale":[0,0,2]"#, 1),
        (r#""scale":[1,0,1]"#, 2),
        (r#""scale":[1e-30,1e-30,1e-30]"#, 1),
        (r#""scale":[-1,1,1]"#, 2),
        (r#""scale":[-2,3,-0.5]"#, 2),
        (r#""scale":[1e4,1e-4,1]"#, 2),
        (r#""matrix":[1,0,0,0, 1,1,0,0, 0,0,1,0, 0,0.2,0,1]"#, 2),
        (r#""matrix":[1,0,0,0, 1,0,0,0, 0,0,1,0, 0,0.2,0,1]"#, 1),
        (r#""matrix":[0,0,0,0, 0,0,0,0, 0,0,0,0, 0,0,0,1]"#, 1),
    ] {
        let transform = if transform.contains("matrix") {
            transform.to_owned()
        } else {
            format!(r#""rotation":[0.1,0.2,0.3,0.9273618],{transform}"#)
        };
        let text = placed(&transform);
        let scene = Arc::new(text.unwrap_or_else(|error| panic!("{transform}: {error}")));
        assert_eq!(scene.instances().len(), instances, "{transform}");
        assert_eq!(scene.report().collapsed_instances, 2 - instances, "{transform}");
        assert!(stream(&transform, &scene, 0.6) > 0);
    }
}

/// A strip of three joints at `heights`, the last of which turns by the keys given; `binds` are the inverse bind
/// matrices' scales.
fn strip(heights: [f32; 3], binds: [f32; 3], keys: &[(f32, [f32; 4])]) -> Result<Scene, SceneError> {
    let mut doc = Doc::default();
    let positions = doc.vectors(&[[0.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 2.0, 0.0]]);
    let joints = doc.bytes4(&[[0, 1, 2, 0]; 3]);
    let weights = doc.quads(&[[1.0, 0.0, 0.0, 0.0], [0.2, 0.3, 0.5, 0.0], [0.0, 0.0, 1.0, 0.0]]);
    let matrix = |s: f32| [s, 0.0, 0.0, 0.0, 0.0, s, 0.0, 0.0, 0.0, 0.0, s, 0.0, 0.0, 0.0, 0.0, 1.0];
    let binds = doc.floats("MAT4", 16, &binds.map(matrix).concat());
    let times = doc.scalars(&keys.iter().map(|(time, _)| *time).collect::<Vec<_>>());
    let turns = doc.quads(&keys.iter().map(|(_, turn)| *turn).collect::<Vec<_>>());
    let mut nodes = r#"{"mesh":0,"skin":0}"#.to_owned();
    for (joint, height) in (1..).zip(heights) {
        let children = if joint < 3 { format!(r#","children":[{}]"#, joint + 1) } else { String::new() };
        write!(nodes, r#",{{"translation":[0,{height},0]{children}}}"#).unwrap();
    }
    doc.load(&format!(
        r#""nodes":[{nodes}],"skins":[{{"joints":[1,2,3],"inverseBindMatrices":{binds}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{positions},"JOINTS_0":{joints},"WEIGHTS_0":{weights}}}}}]}}],
        "animations":[{{"samplers":[{{"input":{times},"output":{turns}}}],"channels":[{{"sampler":0,"target":{{"node":3,"path":"rotation"}}}}]}}]"#
    ))
}

#[test]
fn odd_skins_and_animations_make_finite_streams() {
    let still = [0.0, 0.0, 0.0, 1.0];
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turned = [0.0, 0.0, half, half];
    let both: &[(f32, [f32; 4])] = &[(0.0, still), (1.0, turned)];
    for (what, heights, binds, keys, motion) in [
        ("as it should be", [0.0, 1.0, 1.0], [1.0; 3], both, Motion::Deforming),
        ("bones without length", [0.0; 3], [1.0; 3], both, Motion::Deforming),
        ("a bind that flattens", [0.0, 1.0, 1.0], [1.0, 0.0, 1.0], both, Motion::Deforming),
        ("a bind that mirrors", [0.0, 1.0, 1.0], [1.0, -1.0, 1.0], both, Motion::Deforming),
        ("one key", [0.0, 1.0, 1.0], [1.0; 3], &[(0.5, turned)], Motion::Static),
        ("one key at nothing", [0.0, 1.0, 1.0], [1.0; 3], &[(0.0, [0.0; 4])], Motion::Static),
        ("two keys at once", [0.0, 1.0, 1.0], [1.0; 3], &[(0.5, still), (0.5, turned)], Motion::Static),
        (
            "a turn through nothing",
            [0.0, 1.0, 1.0],
            [1.0; 3],
            &[(0.0, turned), (1.0, turned.map(|v| -v))],
            Motion::Static,
        ),
    ] {
        let scene = Arc::new(strip(heights, binds, keys).unwrap_or_else(|error| panic!("{what}: {error}")));
        let found = scene.instances()[0].motion();
        assert!(found == motion || motion == Motion::Static, "{what}: {found:?}");
        assert!(stream(what, &scene, 0.6) > 0, "{what}");
        let mut geometry = Geometry::default();
        for step in 0..9 {
            let pose = scene.pose(f64::from(step) * 0.25);
            scene.local_geometry(InstanceId(0), &pose, &mut geometry);
            assert!(geometry.positions().iter().all(|at| at.is_finite()), "{what}");
        }
    }
    let nothing = strip([0.0; 3], [0.0; 3], both);
    assert!(matches!(nothing, Err(SceneError::NoTriangles { .. })), "{nothing:?}");
}

#[test]
fn as_many_tiny_instances_as_there_may_be_are_streamed() {
    let most = crate::scene::limits::MAX_INSTANCES as u32;
    let shards = (0..most).map(|number| {
        let at = Vec3::new((number % 256) as f32, 0.0, (number / 256) as f32) * 0.01;
        vec![[Vec3::ZERO, Vec3::Z, Vec3::X].map(|corner| at + corner * 0.005)]
    });
    let scene = Arc::new(Scene::from_triangles("shards", &shards.collect::<Vec<_>>(), 0.01).unwrap());
    let base = settings(Profile::SURFACE, 1.0);
    let points = PointSettings { minimum: 1, ..base.points };
    let ao = AoSettings { rays: 1, radius: 0.01, ..base.ao };
    let mut server = server(&scene, ServerSettings { points, ao, ..base });
    let first = server.step(FrameIndex(0), time(0), &[], &NoClock).unwrap();
    assert_eq!((first.stats.changed, server.points().total()), (most, most));
    let next = server.step(FrameIndex(1), time(1), &[], &NoClock).unwrap();
    assert_eq!((next.stats.rays, next.stats.changed), (0, 0));
}
