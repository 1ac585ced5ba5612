//! Poses against answers computed by hand, closed loops of the built-in scenes, and real files.

use std::path::PathBuf;

use glam::{Mat3, Quat, Vec3};

pub(crate) use super::gltf::tests::Doc;
use super::gltf::tests::load_text;
use super::*;

const QUAD: [[f32; 3]; 4] = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [-1.0, 2.0, 0.0]];

fn geometry(scene: &Scene, instance: u32, time_s: f64) -> (Vec<Vec3>, Vec<Vec3>) {
    let (pose, mut out) = (scene.pose(time_s), Geometry::default());
    scene.local_geometry(InstanceId(instance), &pose, &mut out);
    let frame = pose.instances()[instance as usize].frame();
    let world = out.positions().iter().map(|p| frame.point(*p)).collect();
    (world, out.normals().iter().map(|n| frame.vector(*n)).collect())
}

fn near(a: Vec3, b: Vec3) -> bool {
    (a - b).length() < 1e-5
}

/// Two bones along y: the lower joint at the origin, the upper at height 1; vertices at heights 0, 1 and 2.
fn arm() -> Scene {
    let mut doc = Doc::default();
    let positions = doc.vectors(&[[0.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 2.0, 0.0]]);
    let joints = doc.bytes4(&[[0, 1, 0, 0]; 3]);
    let weights = doc.quads(&[[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]);
    let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut lowered = identity;
    lowered[13] = -1.0;
    let binds = doc.floats("MAT4", 16, &[identity, lowered].concat());
    let times = doc.scalars(&[0.0, 1.0]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turns = doc.quads(&[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, half, half]]);
    let normals = doc.vectors(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
    doc.load(&format!(
        r#""nodes":[{{"mesh":0,"skin":0,"translation":[70,0,0]}},{{"translation":[10,0,0],"children":[2]}},{{"children":[3]}},{{"translation":[0,1,0]}}],
        "skins":[{{"joints":[2,3],"inverseBindMatrices":{binds}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{positions},"NORMAL":{normals},"JOINTS_0":{joints},"WEIGHTS_0":{weights}}}}}]}}],
        "animations":[{{"samplers":[{{"input":{times},"output":{turns}}}],"channels":[{{"sampler":0,"target":{{"node":3,"path":"rotation"}}}}]}}]"#
    ))
    .unwrap()
}

#[test]
fn a_two_bone_arm_bends_as_by_hand() {
    let scene = arm();
    let instance = &scene.instances()[0];
    assert_eq!((instance.motion(), instance.has_constant_frame()), (Motion::Deforming, true));
    assert!(instance.needs().contains(Needs::SKIN));
    // Just before the loop ends the upper bone has turned a quarter about z: up becomes -x. Its share of the middle
    // vertex (0.5, 1) goes to (0, 1.5). The mesh node's own transform is ignored.
    let (world, normals) = geometry(&scene, 0, 1.0 - 1e-9);
    assert!(near(world[0], Vec3::new(10.0, 0.0, 0.0)), "{world:?}");
    assert!(near(world[1], Vec3::new(10.25, 1.25, 0.0)), "{world:?}");
    assert!(near(world[2], Vec3::new(9.0, 1.0, 0.0)), "{world:?}");
    assert!(near(normals[2], Vec3::Y), "{normals:?}");
    // Half way: an eighth of a turn.
    let (world, _) = geometry(&scene, 0, 0.5);
    let s = std::f32::consts::FRAC_1_SQRT_2;
    assert!(near(world[2], Vec3::new(10.0 - s, 1.0 + s, 0.0)), "{world:?}");
    // The rest is the undeformed mesh.
    assert_eq!(scene.rests()[0].geometry().positions()[2], Vec3::new(0.0, 2.0, 0.0));
    // The animation loops with its own length.
    assert_eq!(geometry(&scene, 0, 0.25), geometry(&scene, 0, 7.25));
}

#[test]
fn morph_weights_add_up() {
    let mut doc = Doc::default();
    let base = doc.vectors(&QUAD);
    let normals = doc.vectors(&[[0.0, 0.0, 1.0]; 4]);
    let (up, out) = (doc.vectors(&[[0.0, 1.0, 0.0]; 4]), doc.vectors(&[[0.0, 0.0, 2.0]; 4]));
    let bent = doc.vectors(&[[1.0, 0.0, -1.0]; 4]);
    let times = doc.scalars(&[0.0, 2.0]);
    let weights = doc.scalars(&[0.0, 0.5, 1.0, 0.5]);
    let indices = doc.indices(&[0, 1, 2, 0, 2, 3]);
    let rest = format!(
        r#""nodes":[{{"mesh":0,"scale":[1,3,1]}}],"meshes":[{{"weights":[0.25,0],"primitives":[{{"attributes":{{"POSITION":{base},"NORMAL":{normals}}},
        "indices":{indices},"targets":[{{"POSITION":{up},"NORMAL":{bent}}},{{"POSITION":{out}}}]}}]}}],
        "animations":[{{"samplers":[{{"input":{times},"output":{weights}}}],"channels":[{{"sampler":0,"target":{{"node":0,"path":"weights"}}}}]}}]"#
    );
    let scene = doc.load(&rest).unwrap();
    assert_eq!(scene.instances()[0].needs(), Needs::MORPH);
    let (world, normal) = geometry(&scene, 0, 1.0);
    assert!(near(world[0], Vec3::new(-1.0, 1.5, 1.0)), "{world:?}");
    let slant = Vec3::new(0.5, 0.0, 0.5).normalize();
    assert!(near(normal[0], slant), "{normal:?}");
    // The rest has the default weights.
    assert!(near(scene.rests()[0].geometry().positions()[0], Vec3::new(-1.0, 0.75, 0.0)));
    // Without the animation the default weights are part of the rest, and the instance does not deform.
    let still = rest.split(r#""animations""#).next().unwrap().trim_end().trim_end_matches(',');
    let scene = doc.load(still).unwrap();
    assert_eq!((scene.instances()[0].motion(), scene.needs().all()), (Motion::Static, Needs::NONE));
    assert!(near(scene.rests()[0].geometry().positions()[0], Vec3::new(-1.0, 0.75, 0.0)));
}

/// One animated parent around a child with a mesh.
fn nested(parent: &str, child: &str, path: &str, values: &[&[f32]]) -> Scene {
    let mut doc = Doc::default();
    let positions = doc.vectors(&QUAD);
    let indices = doc.indices(&[0, 1, 2, 0, 2, 3]);
    let times: Vec<f32> = (0..values.len()).map(|i| i as f32).collect();
    let times = doc.scalars(&times);
    let width = values[0].len();
    let output = doc.floats(if width == 3 { "VEC3" } else { "VEC4" }, width, &values.concat());
    doc.load(&format!(
        r#""nodes":[{{"children":[1]{parent}}},{{"mesh":0{child}}},{{"mesh":0,"translation":[0,0,9]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{positions}}},"indices":{indices}}}]}}],
        "animations":[{{"samplers":[{{"input":{times},"output":{output}}}],"channels":[{{"sampler":0,"target":{{"node":0,"path":"{path}"}}}}]}}]"#
    ))
    .unwrap()
}

const QUARTER: [f32; 4] = [0.0, std::f32::consts::FRAC_1_SQRT_2, 0.0, std::f32::consts::FRAC_1_SQRT_2];
const UNTURNED: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

#[test]
fn rigid_movers_keep_their_rest_and_still_nodes_their_bits() {
    let scene = nested("", r#","scale":[2,1,0.5]"#, "rotation", &[&UNTURNED, &QUARTER]);
    let motions: Vec<Motion> = scene.instances().iter().map(Instance::motion).collect();
    assert_eq!(motions, [Motion::Rigid, Motion::Static]);
    let first = scene.pose(0.0);
    for i in 0..40 {
        let pose = scene.pose(f64::from(i) * 0.173);
        assert_eq!(pose.instances()[1], first.instances()[1]);
        assert_eq!(*pose.instances()[0].deformation(), Deformation::Rest);
        let frame = pose.instances()[0].frame();
        assert!((frame.rotation.length() - 1.0).abs() < 1e-6);
    }
    // A quarter about y takes x to -z; the scale is in the rest.
    let (world, _) = geometry(&scene, 0, 1.0 - 1e-9);
    assert!(near(world[1], Vec3::new(0.0, 0.0, -2.0)), "{world:?}");
}

#[test]
fn shear_that_changes_deforms() {
    // A turning child under a parent that is scaled unevenly shears differently at each time.
    let scene = nested("", "", "rotation", &[&UNTURNED, &QUARTER]);
    assert_eq!(scene.instances()[0].motion(), Motion::Rigid);
    let mut doc = Doc::default();
    let positions = doc.vectors(&QUAD);
    let indices = doc.indices(&[0, 1, 2, 0, 2, 3]);
    let (times, output) = (doc.scalars(&[0.0, 1.0]), doc.quads(&[UNTURNED, QUARTER]));
    let scene = doc
        .load(&format!(
            r#""nodes":[{{"children":[1],"scale":[3,1,1]}},{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{positions}}},"indices":{indices}}}]}}],
            "animations":[{{"samplers":[{{"input":{times},"output":{output}}}],"channels":[{{"sampler":0,"target":{{"node":1,"path":"rotation"}}}}]}}]"#
        ))
        .unwrap();
    assert_eq!(scene.instances()[0].motion(), Motion::Deforming);
    assert!(scene.needs().all().contains(Needs::ANIMATED_SCALE));
    let (world, _) = geometry(&scene, 0, 0.0);
    assert!(near(world[1], Vec3::new(3.0, 0.0, 0.0)));
    let (world, normals) = geometry(&scene, 0, 1.0 - 1e-9);
    assert!(near(world[1], Vec3::new(0.0, 0.0, -1.0)), "{world:?}");
    assert!(near(normals[0], Vec3::X), "{normals:?}");
}

#[test]
fn a_scale_that_grows_from_nothing_is_hidden_at_first() {
    let scene = nested("", "", "scale", &[&[0.0; 3], &[2.0, 2.0, 2.0]]);
    assert_eq!(scene.instances()[0].motion(), Motion::Deforming);
    assert!(!scene.pose(0.0).instances()[0].visible());
    assert!(scene.pose(0.5).instances()[0].visible());
    let (world, normals) = geometry(&scene, 0, 0.5);
    assert!(near(world[2], Vec3::new(1.0, 2.0, 0.0)), "{world:?}");
    assert!(near(normals[2], Vec3::Z));
    let (world, normals) = geometry(&scene, 0, 0.0);
    assert!(world.iter().chain(&normals).all(|v| v.is_finite()));
}

#[test]
fn mirrored_nodes_keep_their_outside_outside() {
    let scene = nested(r#","scale":[-1,1,1]"#, "", "translation", &[&[0.0; 3], &[1.0, 0.0, 0.0]]);
    let rest = scene.rest(&scene.instances()[0]);
    assert!(rest.mirrored());
    let pose = scene.pose(0.5);
    let frame = pose.instances()[0].frame();
    assert!(Mat3::from_quat(frame.rotation).determinant() > 0.0);
    for &triangle in rest.triangles() {
        let [a, b, c] = triangle.map(|v| frame.point(rest.geometry().positions()[v as usize]));
        let normal = frame.vector(rest.geometry().normals()[triangle[0] as usize]);
        assert!(near((b - a).cross(c - a).normalize(), normal), "wound to its normal");
        assert!(near(normal, Vec3::Z), "a mirror across x leaves z alone");
    }
}

#[test]
fn unused_and_overruled_channels_are_counted() {
    let mut doc = Doc::default();
    let positions = doc.vectors(&QUAD[..3]);
    let (times, output) = (doc.scalars(&[0.0, 1.0]), doc.vectors(&[[0.0; 3], [1.0; 3]]));
    let channel = |node| format!(r#"{{"sampler":0,"target":{{"node":{node},"path":"translation"}}}}"#);
    let animation = |node| {
        format!(r#"{{"samplers":[{{"input":{times},"output":{output}}}],"channels":[{}]}}"#, channel(node))
    };
    let scene = doc
        .load(&format!(
            r#""nodes":[{{"mesh":0}},{{}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":{positions}}}}}]}}],
            "animations":[{},{},{}]"#,
            animation(0),
            animation(1),
            animation(0)
        ))
        .unwrap();
    assert_eq!((scene.report().idle_channels, scene.report().overruled_channels), (1, 1));
}

#[test]
fn builtin_scenes_close_and_stay_clean() {
    for name in Scene::builtin_names() {
        let scene = Scene::load(name).unwrap();
        let (start, end) = (scene.pose(0.0), scene.pose(scene.duration_s()));
        let before = scene.pose(scene.duration_s() - 1e-7);
        let mut geometries = [Geometry::default(), Geometry::default()];
        for (i, instance) in scene.instances().iter().enumerate() {
            for other in [&end, &before] {
                let (a, b) = (start.instances()[i].frame(), other.instances()[i].frame());
                assert!((a.translation - b.translation).length() < 1e-3, "{name}: {} jumps", instance.name());
                assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 1e-5, "{name}: {} turns", instance.name());
                scene.local_geometry(InstanceId::at(i), &start, &mut geometries[0]);
                scene.local_geometry(InstanceId::at(i), other, &mut geometries[1]);
                let [a, b] = &geometries;
                let moved = a.positions().iter().zip(b.positions()).map(|(a, b)| (*a - *b).length());
                assert!(moved.fold(0.0, f32::max) < 2e-3, "{name}: {} deforms", instance.name());
            }
        }
        let triangles: usize = scene.instances().iter().map(|i| scene.rest(i).triangles().len()).sum();
        assert!((20_000..100_000).contains(&triangles), "{name}: {triangles} triangles");
        assert!(scene.report().lines().is_empty(), "{:?}", scene.report());
        assert!(scene.camera(3.0).is_valid());
        assert_eq!(scene.digest(), Scene::load(name).unwrap().digest());
    }
}

#[test]
fn builtin_scenes_exercise_what_they_are_for() {
    let colonnade = Scene::load("colonnade").unwrap();
    let requested = Needs::SKIN | Needs::MORPH | Needs::RIGID_MOTION | Needs::MASKED | Needs::DOUBLE_SIDED;
    assert!(colonnade.needs().all().contains(requested));
    let lab = Scene::load("robot-lab").unwrap();
    let walkers: Vec<&Instance> =
        lab.instances().iter().filter(|i| i.needs().contains(Needs::SKIN)).collect();
    assert!(walkers.len() >= 20);
    assert!(walkers.iter().all(|w| w.rest() == walkers[0].rest()), "walkers share one rest");
    let asteroids = Scene::load("asteroids").unwrap();
    assert_eq!(asteroids.needs().all(), Needs::RIGID_MOTION | Needs::DOUBLE_SIDED);
}

/// Lowest and highest corner of an instance in the world.
fn bounds(scene: &Scene, pose: &ScenePose, instance: usize) -> (Vec3, Vec3) {
    let mut geometry = Geometry::default();
    scene.local_geometry(InstanceId::at(instance), pose, &mut geometry);
    let (frame, turn) = (pose.instances()[instance].frame(), pose.instances()[instance].frame().matrix());
    geometry.positions().iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| {
        let world = turn * *p + frame.translation;
        (low.min(world), high.max(world))
    })
}

#[test]
fn walkers_and_boulders_touch_the_floor() {
    for (name, part, slack) in [("robot-lab", "walker", 0.02), ("colonnade", "boulder", 0.004)] {
        let scene = Scene::load(name).unwrap();
        for step in 0..24 {
            let pose = scene.pose(f64::from(step) * 0.631);
            for (i, instance) in
                scene.instances().iter().enumerate().filter(|(_, i)| i.name().starts_with(part))
            {
                let (low, high) = bounds(&scene, &pose, i);
                assert!(low.y.abs() < slack, "{} at {}: lowest {}", instance.name(), pose.time_s(), low.y);
                assert!(low.x.min(low.z) > -7.5 && high.x.max(high.z) < 7.5);
            }
        }
    }
}

#[test]
fn asteroids_keep_their_distance() {
    let scene = Scene::load("asteroids").unwrap();
    let gap = |a: (Vec3, Vec3), b: (Vec3, Vec3)| {
        let apart = (a.0 - b.1).max(b.0 - a.1).max(Vec3::ZERO);
        apart.length()
    };
    for step in 0..6 {
        let pose = scene.pose(f64::from(step) * 2.5);
        let boxes: Vec<_> = (0..scene.instances().len()).map(|i| bounds(&scene, &pose, i)).collect();
        for (i, instance) in scene.instances().iter().enumerate().filter(|(_, i)| i.motion() == Motion::Rigid)
        {
            for (j, other) in boxes.iter().enumerate().filter(|(j, _)| *j != i) {
                // Boxes are closer than bodies: bodies 2 m apart may have boxes about half of that apart.
                assert!(gap(boxes[i], *other) > 0.5, "{} near {j}", instance.name());
            }
        }
    }
}

#[test]
fn posing_again_into_used_memory_gives_the_same_bits() {
    let scene = Scene::load("colonnade").unwrap();
    let mut pose = scene.pose(3.0);
    scene.pose_into(9.7, &mut pose);
    assert_eq!(pose, scene.pose(9.7));
}

fn scene_file(text: &str) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let mut doc = Doc::default();
    doc.vectors(&QUAD[..3]);
    let model = doc.text(r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#);
    std::fs::write(folder.path().join("a.gltf"), model).unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).unwrap();
    Scene::load(path.to_str().unwrap())
}

const SCENE_FILE: &str = r#"
[scene]
name = "test"
duration_s = 4.0
ao_radius_m = 0.5
[[part]]
file = "a.gltf"
[[part]]
file = "a.gltf"
translation = [0, 1, 0]
rotation = [0, 1, 0, 0]
scale = [2, 2.5, 2]
[camera]
fov_y_deg = 60
[[camera.key]]
time_s = 0
eye = [0, 1, 5]
target = [0, 0, 0]
"#;

#[test]
fn scene_files_place_their_parts() {
    let scene = scene_file(SCENE_FILE).unwrap();
    assert_eq!((scene.name(), scene.duration_s(), scene.ao_radius_m()), ("test", 4.0, 0.5));
    assert_eq!((scene.meshes().len(), scene.rests().len(), scene.instances().len()), (1, 2, 2));
    let (world, _) = geometry(&scene, 1, 0.0);
    assert!(near(world[2], Vec3::new(-2.0, 6.0, 0.0)), "{world:?}");
    assert_eq!(scene.camera(2.0).eye, [0.0, 1.0, 5.0]);
    assert_eq!(scene.pose(0.0).instances()[0].frame().rotation, Quat::IDENTITY);
}

#[test]
fn scene_files_name_what_is_wrong() {
    let cases = [
        ("speed_x = 1\n[camera]", "[camera]", "speed_x"),
        ("fov_y_deg = 0", "fov_y_deg = 60", "camera.fov_y_deg"),
        ("duration_s = -1.0", "duration_s = 4.0", "scene.duration_s"),
        ("duration_s = nan", "duration_s = 4.0", "scene.duration_s"),
        ("rotation = [0, 0, 0, 0]", "rotation = [0, 1, 0, 0]", "part[1].rotation"),
        ("scale = \"big\"", "scale = [2, 2.5, 2]", "scale"),
        ("scale = 0", "scale = [2, 2.5, 2]", "part[1].scale"),
        ("eye = [0, 0, 0]", "eye = [0, 1, 5]", "camera.key[0].up"),
        ("animation = \"run\"\n[camera]", "[camera]", "no animation `run`"),
        ("animation = 3\n[camera]", "[camera]", "no animation `3`"),
        ("name = 5", "name = \"test\"", "line 3"),
    ];
    for (new, old, named) in cases {
        let text = scene_file(&SCENE_FILE.replacen(old, new, 1)).unwrap_err().to_string();
        assert!(text.contains(named), "`{named}` is not in: {text}");
    }
    let missing = scene_file(&SCENE_FILE.replace("a.gltf", "b.gltf")).unwrap_err();
    assert!(matches!(missing, SceneError::Io { path, .. } if path.ends_with("b.gltf")));
}

#[test]
fn a_lone_model_gets_a_camera_that_sees_it() {
    let mut doc = Doc::default();
    doc.vectors(&QUAD[..3]);
    let text = doc.text(r#""nodes":[{"mesh":0,"translation":[50,0,0]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#);
    let camera = load_text(&text).unwrap().camera(0.0);
    assert!(camera.is_valid() && (camera.target[0] - 50.0).abs() < 1.0);
}

/// The folder with real scenes, which is no part of the repository.
fn shared() -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let folder = std::env::var_os("PSAO_SHARED").map_or(beside, PathBuf::from).join("scenes");
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("PSAO_REQUIRE_SHARED").is_none(), "no real scenes at {}", folder.display());
    eprintln!("SKIPPED: no real scenes at {}; set PSAO_SHARED to test with them", folder.display());
    None
}

/// Returns every scene and model in the folder; none without the folder.
pub(crate) fn shared_files() -> Vec<PathBuf> {
    let Some(folder) = shared() else { return Vec::new() };
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(&folder).unwrap().flatten().filter(|e| e.path().is_dir()) {
        let inside = std::fs::read_dir(entry.path()).unwrap().flatten().map(|e| e.path());
        let requested = if entry.file_name() == "models" { "glb" } else { "toml" };
        files.extend(inside.filter(|path| path.extension().is_some_and(|e| e == requested)));
    }
    assert!(!files.is_empty());
    files
}

#[test]
fn real_files_load_and_stay_finite() {
    for file in shared_files() {
        let scene = Scene::load(file.to_str().unwrap()).unwrap_or_else(|error| panic!("{error}"));
        let mut out = Geometry::default();
        for time in [0.0, scene.duration_s() * 0.37] {
            let pose = scene.pose(time);
            for (i, instance) in scene.instances().iter().enumerate() {
                scene.local_geometry(InstanceId::at(i), &pose, &mut out);
                let all = out.positions().iter().chain(out.normals());
                assert!(all.clone().all(|v| v.is_finite()), "{}: {}", scene.name(), instance.name());
                assert!(out.normals().iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
                assert_eq!(
                    out.positions().len(),
                    scene.meshes()[instance.mesh().index()].base().positions().len()
                );
            }
        }
    }
}

#[test]
fn the_authors_scene_is_classified_as_it_is() {
    let Some(folder) = shared() else { return };
    let scene = Scene::load(folder.join("arcade/arcade.toml").to_str().unwrap()).unwrap();
    let skinned: Vec<&Instance> =
        scene.instances().iter().filter(|i| i.needs().contains(Needs::SKIN)).collect();
    assert_eq!(skinned.len(), 5);
    assert!(skinned.iter().all(|w| w.rest() == skinned[0].rest()), "five walkers, one rest");
    let area = scene.rest(skinned[0]).area_m2();
    assert!((1.0..3.0).contains(&area), "a body has about 1.5 m^2, not {area}");
    assert!(scene.needs().all().contains(Needs::NORMAL_MAP | Needs::RIGID_MOTION));
}
