//! Whole files as other programs write them: a floor of 4 m with something on it.

use glam::{Vec2, Vec3};

use crate::scene::{Geometry, InstanceId, Motion, Scene, SceneError};

pub(super) fn path(name: &str) -> String {
    format!("{}/tests/gltf/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn load(name: &str) -> Scene {
    Scene::load(&path(name)).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns the bounds of an instance in the world.
pub(super) fn bounds(scene: &Scene, instance: usize, time_s: f64) -> [Vec3; 2] {
    let (pose, mut out) = (scene.pose(time_s), Geometry::default());
    scene.local_geometry(InstanceId(instance as u32), &pose, &mut out);
    let frame = pose.instances()[instance].frame();
    let points = out.positions().iter().map(|p| frame.point(*p));
    points.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

pub(super) fn near(a: [Vec3; 2], b: [Vec3; 2], tolerance: f32) -> bool {
    a.iter().zip(b).all(|(a, b)| (*a - b).abs().max_element() <= tolerance)
}

/// The box of 1 m in the middle of the floor.
const BOX: [Vec3; 2] = [Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 1.0, 0.5)];
const FLOOR: [Vec3; 2] = [Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 0.0, 2.0)];

fn floor_and_box(scene: &Scene, tolerance: f32) {
    assert_eq!(scene.instances().len(), 2);
    assert!(near(bounds(scene, 0, 0.0), FLOOR, tolerance), "{:?}", bounds(scene, 0, 0.0));
    assert!(near(bounds(scene, 1, 0.0), BOX, tolerance), "{:?}", bounds(scene, 1, 0.0));
    assert!((scene.rests()[0].area_m2() - 16.0).abs() < 16.0 * f64::from(tolerance) + 1e-6);
    assert!((scene.rests()[1].area_m2() - 6.0).abs() < 12.0 * f64::from(tolerance) + 1e-6);
    // Every face of the box looks outwards.
    let rest = &scene.rests()[1];
    let middle = (bounds(scene, 1, 0.0)[0] + bounds(scene, 1, 0.0)[1]) * 0.5;
    let pose = scene.pose(0.0);
    let frame = pose.instances()[1].frame();
    for triangle in rest.triangles() {
        let corners = triangle.map(|v| frame.point(rest.geometry().positions()[v as usize]));
        let outwards = (corners[0] + corners[1] + corners[2]) / 3.0 - middle;
        let normal = frame.vector(rest.geometry().normals()[triangle[0] as usize]);
        assert!(normal.dot(outwards) > 0.45, "{normal} at {outwards}");
        assert!((corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(outwards) > 0.0);
    }
}

#[test]
fn marks_and_padding_around_the_text_are_no_part_of_it() {
    for name in ["bom.gltf", "nul_padded.glb"] {
        let scene = load(name);
        floor_and_box(&scene, 0.0);
        assert!(scene.report().lines().is_empty());
    }
}

#[test]
fn a_buffer_without_data_to_which_nothing_refers_is_a_placeholder() {
    floor_and_box(&load("placeholder_buffer.glb"), 0.0);
}

#[test]
fn quantised_positions_and_normals_are_what_they_were() {
    let scene = load("mesh_quantization.gltf");
    floor_and_box(&scene, 1e-6);
    assert!(scene.report().lines().is_empty());
}

#[test]
fn compressed_meshes_are_what_they_were() {
    for (name, tolerance) in [
        ("draco_edgebreaker.glb", 4.0 / 16_384.0),
        ("draco_sequential.glb", 4.0 / 16_384.0),
        ("meshopt.glb", 1e-4),
    ] {
        let scene = load(name);
        floor_and_box(&scene, tolerance);
        assert!(scene.report().lines().is_empty(), "{name}");
    }
}

#[test]
fn damaged_compressed_meshes_are_errors_or_other_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bad.glb");
    for name in ["draco_edgebreaker.glb", "draco_sequential.glb", "meshopt.glb"] {
        let whole = std::fs::read(path(name)).unwrap();
        let json = u32::from_le_bytes([whole[12], whole[13], whole[14], whole[15]]) as usize;
        for at in 28 + json..whole.len() {
            for change in [1, 0x80, 0xff] {
                let mut bad = whole.clone();
                bad[at] ^= change;
                std::fs::write(&file, &bad).unwrap();
                match Scene::load(file.to_str().unwrap()) {
                    Ok(_) | Err(SceneError::Gltf { .. } | SceneError::NoTriangles { .. }) => {}
                    Err(SceneError::TooFar { .. }) => {}
                    Err(other) => panic!("{name}, byte {at}: {other}"),
                }
            }
        }
    }
}

#[test]
fn instances_stand_where_their_attributes_say() {
    let scene = load("gpu_instancing_optional.gltf");
    let names: Vec<&str> = scene.instances().iter().map(crate::scene::Instance::name).collect();
    assert_eq!(names, ["floor", "boxes#0", "boxes#1", "boxes#2"]);
    for (instance, x) in [(1, -1.3), (2, 0.0), (3, 1.3)] {
        let at = Vec3::new(x, 0.0, 0.0);
        let found = bounds(&scene, instance, 0.0);
        assert!(near(found, BOX.map(|corner| corner + at), 1e-6), "{instance}: {found:?}");
    }
    assert!(scene.instances()[1..].iter().all(|i| i.rest() == scene.instances()[1].rest()));
    assert!(scene.report().lines().is_empty());
}

#[test]
fn channels_without_a_node_are_ignored_and_counted() {
    let scene = load("channel_without_node.gltf");
    assert_eq!(scene.report().lines(), ["left out: 1 animation channel without a node"]);
    the_box_slides(&scene);
}

#[test]
fn animated_colours_are_ignored_and_counted() {
    let scene = load("animation_pointer_optional.gltf");
    assert_eq!(scene.report().lines(), ["left out: 1 animation channel that moves no surface"]);
    the_box_slides(&scene);
}

/// The box goes from x = -1 over 1 m to the right and back, in 2 s.
fn the_box_slides(scene: &Scene) {
    assert_eq!((scene.instances().len(), scene.duration_s()), (2, 2.0));
    assert_eq!(scene.instances()[1].motion(), Motion::Rigid);
    let x = |time_s| bounds(scene, 1, time_s)[0].x + 0.5;
    let found = [0.0, 0.5, 1.0].map(x);
    assert_eq!(found[1], (found[0] + found[2]) / 2.0, "{found:?}");
    assert!((found[2] - found[0]).abs() > 0.9, "{found:?}");
}

#[test]
fn what_is_left_of_an_incomplete_triangle_is_dropped_and_counted() {
    let scene = load("incomplete_triangle.gltf");
    let triangles: Vec<usize> =
        scene.instances().iter().map(|instance| scene.rest(instance).triangles().len()).collect();
    assert_eq!(triangles, [2, 12, 6], "20 indices are 6 triangles");
    assert_eq!(scene.report().lines(), ["left out: 1 incomplete last triangle of a primitive"]);
}

#[test]
fn a_texture_that_only_an_extension_has_is_read_from_there() {
    let scene = load("normal_map_webp_only.gltf");
    let leaf = scene.material(&scene.meshes()[1]);
    assert_eq!(leaf.normal_map().unwrap().texture().size(), [4, 4]);
    assert_eq!(scene.report().lines(), ["derived: 1 primitive's tangents"]);
}

/// Returns where the leaf exists: left and right half.
fn leaf(scene: &Scene) -> [bool; 2] {
    let mesh = &scene.meshes()[1];
    let (uvs, positions) = (mesh.uvs().unwrap(), mesh.base().positions());
    // The coordinates of the texture at a place of the leaf, which is a rectangle of -1..1 in x and z.
    let corner = |x: f32, z: f32| {
        let index = positions.iter().position(|p| p.x == x && p.z == z).unwrap();
        uvs[index]
    };
    let (low, right, up) = (corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0));
    let at = |x: f32| {
        let uv: Vec2 = low + (right - low) * x + (up - low) * 0.4;
        scene.material(mesh).is_opaque_at(uv)
    };
    [at(0.25), at(0.75)]
}

#[test]
fn a_shifted_mask_cuts_out_the_other_half() {
    assert_eq!(leaf(&load("texture_transform_mask_unshifted.gltf")), [false, true]);
    assert_eq!(leaf(&load("texture_transform_mask_shifted.gltf")), [true, false]);
}
