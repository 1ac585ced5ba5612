//! What glTF 2.0 allows, however odd, is read; what it says to ignore is ignored and counted.

use glam::Vec3;

use super::{PLAIN, TRIANGLE, base64, checker, load_text, problem, triangle};
use crate::scene::{GltfProblem, Scene, SceneError};

/// A binary file of chunks.
fn binary(version: u32, chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (kind, data) in chunks {
        body.extend((data.len() as u32).to_le_bytes());
        body.extend(*kind);
        body.extend(*data);
    }
    let mut file = b"glTF".to_vec();
    file.extend(version.to_le_bytes());
    file.extend((12 + body.len() as u32).to_le_bytes());
    file.extend(body);
    file
}

fn load_bytes(name: &str, bytes: &[u8]) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    Scene::load(path.to_str().unwrap())
}

/// The triangle with its bytes in the first buffer, as far as that has no URI.
fn json(buffers: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":{buffers},"bufferViews":[{{"buffer":0,"byteLength":36}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}}],{PLAIN}}}"#
    )
}

fn triangle_bytes() -> Vec<u8> {
    TRIANGLE.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn chunks_and_bytes_of_other_kinds_are_ignored() {
    let (json, bytes) = (json(r#"[{"byteLength":36}]"#), triangle_bytes());
    let chunks: [(&[u8; 4], &[u8]); 3] = [(b"JSON", json.as_bytes()), (b"BIN\0", &bytes), (b"MORE", b"more")];
    let mut file = binary(2, &chunks);
    file.extend(b"bytes after the end");
    assert_eq!(load_bytes("a.glb", &file).unwrap().rests()[0].triangles().len(), 1);
    // The contents tell the container, not the name.
    assert!(load_bytes("a.gltf", &file).is_ok());
    // A second chunk that is not the binary one leaves the buffer without data.
    let other = binary(2, &[(b"JSON", json.as_bytes()), (b"MORE", b"more"), (b"BIN\0", &bytes)]);
    let (place, found) = problem(load_bytes("a.glb", &other));
    assert_eq!((place.as_str(), found), ("buffers[0]", GltfProblem::Missing("its data (`uri`)")));
}

#[test]
fn buffers_that_nothing_refers_to_need_no_data() {
    let data = base64(&triangle_bytes());
    for other in ["{\"byteLength\":8}", "{\"byteLength\":8,\"uri\":\"gone.bin\"}"] {
        let buffers = format!(r#"[{{"byteLength":36,"uri":"data:;base64,{data}"}},{other}]"#);
        assert!(load_text(&json(&buffers)).is_ok(), "{other}");
    }
}

#[test]
fn files_beside_it_may_have_any_name() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("größe 1")).unwrap();
    std::fs::write(folder.path().join("größe 1/a:b.bin"), triangle_bytes()).unwrap();
    let path = folder.path().join("scene.gltf");
    for uri in ["größe 1/a:b.bin", "gr%C3%B6%C3%9Fe%201/a%3Ab.bin", "./größe%201/a:b.bin"] {
        std::fs::write(&path, json(&format!(r#"[{{"byteLength":36,"uri":"{uri}"}}]"#))).unwrap();
        assert!(Scene::load(path.to_str().unwrap()).is_ok(), "{uri}");
    }
}

#[test]
fn other_versions_are_refused_by_name() {
    let version = |result| match problem(result).1 {
        GltfProblem::Version(version) => version,
        other => panic!("{other}"),
    };
    // In glTF 1.0 the lists are objects, and the asset may be missing.
    let old = r#"{"asset":{"version":"1.0"},"meshes":{"a":{}},"scene":"main"}"#;
    assert_eq!(version(load_text(old)), "1.0");
    assert_eq!(version(load_text(r#"{"meshes":{"a":{}}}"#)), "1.0");
    assert_eq!(version(load_bytes("a.glb", &binary(1, &[]))), "1.0");
    assert_eq!(version(load_text(r#"{"asset":{"version":"2.1","minVersion":"2.1"}}"#)), "2.1");
    let text = problem(load_text(old)).1.to_string();
    assert!(text.contains("gltf-pipeline -i in.gltf -o out.glb"), "{text}");
    // A later version that a reader of 2.0 can read.
    let later = triangle().text(PLAIN).replace(r#""version":"2.0""#, r#""version":"2.7","minVersion":"2.0""#);
    assert!(load_text(&later).is_ok());
}

#[test]
fn text_in_another_encoding_is_named() {
    let utf16: Vec<u8> = "\u{feff}{}".encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert_eq!(problem(load_bytes("a.gltf", &utf16)).1, GltfProblem::Utf16);
}

#[test]
fn unknown_names_are_no_errors() {
    let rest = r#""nodes":[{"mesh":0,"light":3,"extras":[1],"extensions":{"X_y":{"a":[]}}}],"future":{"a":null},
        "extensions":{"X_y":1},"cameras":[{"type":"odd"}],"materials":[{"normalScale":"high","alphaMode":"LATER"}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"_HEAT":9,"COLOR_0":9,"TEXCOORD_7":9}}]}],
        "extensionsUsed":["X_y","KHR_materials_anything","KHR_lights_punctual"]"#;
    let scene = triangle().load(rest).unwrap();
    assert_eq!(scene.report().lines()[1], "extensions without effect here, as they are not known: X_y");
    let (place, found) = problem(triangle().load(&rest.replace("extensionsUsed", "extensionsRequired")));
    assert_eq!((place.as_str(), found), ("extensionsRequired", GltfProblem::Extension("X_y".to_owned())));
}

#[test]
fn scenes_and_lists_may_be_empty() {
    let rest = r#""scenes":[{},{"nodes":[0]}],"scene":1,"skins":[],"animations":[{"channels":[],"samplers":[]},{}],
        "nodes":[{"mesh":0,"children":[],"weights":[]},{"mesh":1}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"targets":[]}],"weights":[]},{"primitives":[]},{}]"#;
    assert_eq!(triangle().load(rest).unwrap().instances().len(), 1);
    // The first scene is used where none is named.
    assert!(matches!(
        triangle().load(&rest.replace(r#""scene":1,"#, "")),
        Err(SceneError::NoTriangles { .. })
    ));
}

#[test]
fn primitives_without_surface_are_left_out_and_counted() {
    let mut doc = triangle();
    doc.indices(&[0, 1]);
    doc.accessors.push(r#"{"componentType":5126,"type":"VEC3","count":0}"#.to_owned());
    let rest = r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}},
        {"attributes":{"POSITION":0},"mode":0},{"attributes":{},"mode":1},{"attributes":{"POSITION":0},"mode":3},
        {"attributes":{}},{"attributes":{"NORMAL":0},"indices":1},{"attributes":{"POSITION":2}},
        {"attributes":{"POSITION":0},"indices":1,"mode":5}]}]"#;
    let scene = doc.load(rest).unwrap();
    assert_eq!(scene.instances().len(), 1);
    assert_eq!(
        scene.report().lines()[0],
        "left out: 1 primitive of points, 2 primitives of lines, 2 primitives without positions, \
         1 incomplete last triangle of a primitive, 2 primitives without triangles"
    );
}

#[test]
fn accessors_without_a_view_are_zero() {
    let mut doc = triangle();
    doc.accessors.push(r#"{"componentType":5126,"type":"VEC3","count":3}"#.to_owned());
    let at = doc.view(&[1]);
    let values = doc.view(&[0.0_f32, 0.0, 1.0].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
    doc.accessors.push(format!(
        r#"{{"componentType":5126,"type":"VEC3","count":3,"sparse":{{"count":1,
        "indices":{{"bufferView":{at},"componentType":5121}},"values":{{"bufferView":{values}}}}}}}"#
    ));
    // A morph target of zeros, and one that lifts a single vertex; neither has to name positions.
    let rest = r#""nodes":[{"mesh":0}],"meshes":[{"weights":[1,1,1],"primitives":[{"attributes":{"POSITION":0},
        "targets":[{"POSITION":1},{"POSITION":2},{"NORMAL":1}]}]}]"#;
    let scene = doc.load(rest).unwrap();
    let found = super::cases::bounds(&scene, 0, 0.0);
    assert_eq!(found, [Vec3::ZERO, Vec3::ONE]);
}

#[test]
fn skins_may_lack_their_matrices() {
    let mut doc = triangle();
    doc.bytes4(&[[0; 4]; 3]);
    doc.bytes4(&[[255, 0, 0, 0]; 3]);
    doc.accessors[2] = doc.accessors[2].replace('{', r#"{"normalized":true,"#);
    let scene = doc.load(
        r#""nodes":[{"mesh":0,"skin":0,"translation":[9,9,9]},{"translation":[0,0,2]}],"skins":[{"joints":[1]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}}]}]"#,
    );
    assert_eq!(super::cases::bounds(&scene.unwrap(), 0, 0.0), [Vec3::Z * 2.0, Vec3::new(1.0, 1.0, 2.0)]);
}

#[test]
fn channels_that_move_nothing_are_ignored_and_counted() {
    let mut doc = triangle();
    let times = doc.scalars(&[0.0, 1.0]);
    let values = doc.vectors(&[[0.0; 3], [1.0; 3]]);
    doc.accessors.push(r#"{"componentType":5126,"type":"SCALAR","count":0}"#.to_owned());
    doc.accessors.push(r#"{"componentType":5126,"type":"VEC3","count":0}"#.to_owned());
    let rest = format!(
        r#"{PLAIN},"animations":[{{"samplers":[{{"input":{times},"output":{values}}},{{"input":3,"output":4}}],"channels":[
        {{"sampler":0,"target":{{"path":"rotation"}}}},{{"sampler":0,"target":{{"node":0,"path":"colour"}}}},
        {{"sampler":0,"target":{{"node":0,"path":"weights"}}}},{{"sampler":1,"target":{{"node":0,"path":"scale"}}}},
        {{"sampler":0,"target":{{"node":0,"path":"translation"}}}}]}}]"#
    );
    let scene = doc.load(&rest).unwrap();
    assert_eq!(
        scene.report().lines()[0],
        "left out: 1 animation channel without a node, 1 animation channel that moves no surface, \
         1 animation channel of nothing visible, 1 animation channel without keys"
    );
    assert_eq!(super::cases::bounds(&scene, 0, 0.5)[0], Vec3::splat(0.5));
}

#[test]
fn textures_without_an_image_leave_the_rest_of_the_material() {
    let mut doc = triangle();
    doc.floats("VEC2", 2, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let rest = r#""nodes":[{"mesh":0}],"textures":[{}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}]}],
        "materials":[{"alphaMode":"MASK","doubleSided":true,"normalTexture":{"index":0},
        "pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}]"#;
    let scene = doc.load(rest).unwrap();
    let material = scene.material(&scene.meshes()[0]);
    assert!(material.double_sided() && material.mask().is_some() && material.normal_map().is_none());
    assert_eq!(
        scene.report().lines()[0],
        "left out: 1 texture of a mask without image, 1 normal map that cannot be decoded"
    );
    // The images of materials that no surface has are never opened.
    let unused = rest.replace(r#","material":0"#, "").replace(r#""textures":[{}]"#, r#""textures":[]"#);
    assert!(doc.load(&unused).is_ok());
}

#[test]
fn normals_against_their_face_are_counted() {
    let mut doc = triangle();
    doc.vectors(&[[0.0, 0.0, -1.0]; 3]);
    let scene = doc
        .load(r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1}}]}]"#)
        .unwrap();
    assert_eq!(
        scene.report().lines(),
        ["read in another way: 1 triangle with normals against its face (kept)"]
    );
}

#[test]
fn images_may_be_in_a_view() {
    let image = checker();
    let data = image.strip_prefix("data:image/png;base64,").unwrap();
    let png = base64::Engine::decode(&base64::engine::general_purpose::STANDARD, data).unwrap();
    let mut doc = triangle();
    doc.floats("VEC2", 2, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let view = doc.view(&png);
    let rest = format!(
        r#""nodes":[{{"mesh":0}}],"textures":[{{"source":0}}],"images":[{{"bufferView":{view},"mimeType":"image/x"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
        "materials":[{{"alphaMode":"MASK","pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}]"#
    );
    let scene = doc.load(&rest).unwrap();
    assert_eq!(scene.material(&scene.meshes()[0]).mask().unwrap().texture().unwrap().size(), [2, 2]);
}

#[test]
fn the_same_bytes_over_and_over_do_not_fill_the_memory() {
    let mut doc = triangle();
    doc.accessors.push(r#"{"componentType":5126,"type":"VEC3","count":30000000}"#.to_owned());
    let targets = vec![r#"{"POSITION":1}"#; 1_000].join(",");
    let rest = format!(
        r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"targets":[{targets}]}}]}}]"#
    );
    assert!(matches!(problem(doc.load(&rest)).1, GltfProblem::CountMismatch { .. }));
    let primitives = vec![r#"{"attributes":{"POSITION":0}}"#; 400].join(",");
    let nodes = vec![r#"{"mesh":0}"#; 400].join(",");
    let rest = format!(r#""nodes":[{nodes}],"meshes":[{{"primitives":[{primitives}]}}]"#);
    assert!(matches!(problem(triangle().load(&rest)).1, GltfProblem::TooMany { what: "instances", .. }));
}

#[test]
fn integers_may_have_a_decimal_point_and_the_last_of_equal_keys_counts() {
    let rest = PLAIN.replace("\"mesh\":0", "\"mesh\":7,\"mesh\":0.0");
    let text = triangle().text(&rest).replace("5126", "5.126e3").replace("\"count\":3", "\"count\":3.0");
    assert_eq!(load_text(&text).unwrap().rests()[0].triangles().len(), 1);
    // A fraction is no index, and the message says where it is.
    let bad = load_text(&text.replace("\"count\":3.0", "\"count\":3.5")).unwrap_err().to_string();
    assert!(bad.contains("line"), "{bad}");
}
