//! Small handmade files: the meaning of every feature and the error for every fault.

mod cases;
mod extensions;
mod valid;

use std::fmt::Write;

use glam::{Vec2, Vec3};

use crate::scene::{GltfProblem, InstanceId, Motion, Needs, Scene, SceneError};

/// A glTF file under construction: one buffer, one view per accessor.
#[derive(Default)]
pub(crate) struct Doc {
    bin: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
}

pub(crate) fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0_u32, |w, b| w << 8 | u32::from(*b)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * i) & 63) as usize] as char;
            out.push(if i <= chunk.len() { digit } else { '=' });
        }
    }
    out
}

impl Doc {
    fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        let (offset, length) = (self.bin.len(), bytes.len());
        self.views.push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}}}"#));
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        let text =
            format!(r#"{{"bufferView":{view},"componentType":{component},"type":"{kind}","count":{count}}}"#);
        self.accessors.push(text);
        self.accessors.len() - 1
    }

    pub(crate) fn floats(&mut self, kind: &str, width: usize, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, 5126, kind, values.len() / width)
    }

    pub(crate) fn vectors(&mut self, values: &[[f32; 3]]) -> usize {
        self.floats("VEC3", 3, values.as_flattened())
    }

    pub(crate) fn scalars(&mut self, values: &[f32]) -> usize {
        self.floats("SCALAR", 1, values)
    }

    pub(crate) fn quads(&mut self, values: &[[f32; 4]]) -> usize {
        self.floats("VEC4", 4, values.as_flattened())
    }

    pub(crate) fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, 5123, "SCALAR", values.len())
    }

    pub(crate) fn bytes4(&mut self, values: &[[u8; 4]]) -> usize {
        self.accessor(values.as_flattened(), 5121, "VEC4", values.len())
    }

    /// The whole file; `rest` holds nodes, meshes and so on.
    pub(crate) fn text(&self, rest: &str) -> String {
        let mut out = String::new();
        let length = self.bin.len();
        let _ = write!(
            out,
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{length},"uri":"data:application/octet-stream;base64,{}"}}],
            "bufferViews":[{}],"accessors":[{}],{rest}}}"#,
            base64(&self.bin),
            self.views.join(","),
            self.accessors.join(",")
        );
        out
    }

    pub(crate) fn load(&self, rest: &str) -> Result<Scene, SceneError> {
        load_text(&self.text(rest))
    }
}

pub(crate) fn load_text(text: &str) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, text).unwrap();
    Scene::load(path.to_str().unwrap())
}

const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// A document with one triangle at accessor 0, and what follows "primitives".
fn triangle() -> Doc {
    let mut doc = Doc::default();
    doc.vectors(&TRIANGLE);
    doc
}

const PLAIN: &str = r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;

fn problem(result: Result<Scene, SceneError>) -> (String, GltfProblem) {
    match result {
        Err(SceneError::Gltf { place, problem, .. }) => (place, problem),
        other => panic!("expected an error at a place, got {other:?}"),
    }
}

#[test]
fn a_triangle_without_normals_is_flat() {
    let scene = triangle().load(PLAIN).unwrap();
    assert_eq!(scene.report().flat_normals, 1);
    let rest = &scene.rests()[0];
    assert_eq!(rest.geometry().normals(), [Vec3::Z; 3]);
    assert!((rest.area_m2() - 0.5).abs() < 1e-9);
    assert_eq!(scene.instances()[0].motion(), Motion::Static);
    assert_eq!(scene.needs().all(), Needs::NONE);
}

#[test]
fn strips_and_fans_keep_their_facing() {
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 2.0, 0.0]];
    let fan = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    for (mode, points, area) in [(5, square, 1.5), (6, fan, 1.5)] {
        let mut doc = Doc::default();
        doc.vectors(&points);
        let rest = format!(
            r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"mode":{mode},"attributes":{{"POSITION":0}}}}]}}]"#
        );
        let scene = doc.load(&rest).unwrap();
        let rest = &scene.rests()[0];
        assert_eq!(rest.triangles().len(), 3);
        assert!((rest.area_m2() - area).abs() < 1e-6);
        assert!(rest.geometry().normals().iter().all(|n| *n == Vec3::Z), "mode {mode}");
    }
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut doc = Doc::default();
    let at = doc.view(&[2]);
    let value: Vec<u8> = [0.0_f32, 3.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = doc.view(&value);
    let base: Vec<u8> = TRIANGLE.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let view = doc.view(&base);
    doc.accessors.push(format!(
        r#"{{"bufferView":{view},"componentType":5126,"type":"VEC3","count":3,"sparse":{{"count":1,
        "indices":{{"bufferView":{at},"componentType":5121}},"values":{{"bufferView":{values}}}}}}}"#
    ));
    let scene = doc.load(PLAIN).unwrap();
    assert!((scene.rests()[0].area_m2() - 1.5).abs() < 1e-6);
    // An index past the end.
    doc.bin[0] = 7;
    assert!(matches!(problem(doc.load(PLAIN)).1, GltfProblem::OutOfRange { index: 7, count: 3, .. }));
}

#[test]
fn degenerate_triangles_are_dropped_and_counted() {
    let mut doc = triangle();
    doc.indices(&[0, 1, 2, 0, 0, 1, 0, 1, 1]);
    let rest =
        r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]"#;
    let scene = doc.load(rest).unwrap();
    assert_eq!((scene.report().degenerate_triangles, scene.rests()[0].triangles().len()), (2, 1));
    let mut flat = Doc::default();
    flat.vectors(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    assert!(matches!(flat.load(PLAIN), Err(SceneError::NoTriangles { .. })));
}

#[test]
fn nothing_to_shade_is_an_error() {
    let points = r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"mode":0,"attributes":{"POSITION":0}}]}]"#;
    let gone =
        r#""nodes":[{"mesh":0,"scale":[1,0,0]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    let empty = r#""nodes":[{"name":"empty"}]"#;
    let unseen = r#""scene":0,"scenes":[{"nodes":[]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    for rest in [points, gone, empty, unseen] {
        assert!(matches!(triangle().load(rest), Err(SceneError::NoTriangles { .. })), "{rest}");
    }
}

#[test]
fn a_flattened_axis_keeps_its_surface() {
    let rest =
        r#""nodes":[{"mesh":0,"scale":[2,2,0]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    let scene = triangle().load(rest).unwrap();
    assert!((scene.rests()[0].area_m2() - 2.0).abs() < 1e-6);
    assert!(scene.rests()[0].geometry().normals().iter().all(|n| (*n - Vec3::Z).length() < 1e-6));
}

#[test]
fn numbers_that_are_not_finite_name_their_element() {
    let mut doc = Doc::default();
    doc.vectors(&[TRIANGLE[0], [1.0, f32::NAN, 0.0], TRIANGLE[2]]);
    assert_eq!(problem(doc.load(PLAIN)), ("accessors[0]".to_owned(), GltfProblem::NonFinite { element: 1 }));
    let mut doc = Doc::default();
    doc.vectors(&[TRIANGLE[0], [1e30, 0.0, 0.0], TRIANGLE[2]]);
    assert!(matches!(problem(doc.load(PLAIN)).1, GltfProblem::TooFar { .. }));
    let far = r#""nodes":[{"mesh":0,"scale":[1e9,1e9,1e9],"children":[]},{"children":[0],"scale":[1e9,1e9,1e9]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    assert!(matches!(triangle().load(far), Err(SceneError::TooFar { .. })));
}

#[test]
fn indices_out_of_range_are_named() {
    let cases = [
        (r#""nodes":[{"mesh":3}],"meshes":[]"#, "mesh", 3),
        (r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":9}}]}]"#, "accessor", 9),
        (
            r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":2}]}]"#,
            "material",
            2,
        ),
        (
            r#""nodes":[{"mesh":0,"skin":4}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#,
            "skin",
            4,
        ),
        (
            r#""nodes":[{"mesh":0,"children":[5]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#,
            "node",
            5,
        ),
        (
            r#""scene":1,"scenes":[],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#,
            "scene",
            1,
        ),
    ];
    for (rest, requested, number) in cases {
        let (_, problem) = problem(triangle().load(rest));
        assert!(
            matches!(problem, GltfProblem::OutOfRange { what, index, .. } if what == requested && index == number),
            "{problem}"
        );
    }
    let mut doc = triangle();
    doc.indices(&[0, 1, 3]);
    let rest =
        r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]"#;
    assert_eq!(
        problem(doc.load(rest)),
        ("accessors[1]".to_owned(), GltfProblem::OutOfRange { what: "vertex", index: 3, count: 3 })
    );
}

#[test]
fn hierarchies_that_are_no_forests_are_refused() {
    let ring = r#""nodes":[{"mesh":0,"children":[1]},{"children":[2]},{"children":[1]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    assert_eq!(problem(triangle().load(ring)), ("nodes[1]".to_owned(), GltfProblem::TwoParents));
    let own =
        r#""nodes":[{"mesh":0},{"children":[1]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    assert_eq!(problem(triangle().load(own)), ("nodes[1]".to_owned(), GltfProblem::Cycle));
}

#[test]
fn bytes_out_of_range_are_refused_before_they_are_read() {
    let view = |start: u64, length: u64, count: u64, offset: u64, stride: u64| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":36,"uri":"data:;base64,{}"}}],
            "bufferViews":[{{"buffer":0,"byteOffset":{start},"byteLength":{length},"byteStride":{stride}}}],
            "accessors":[{{"bufferView":0,"byteOffset":{offset},"componentType":5126,"type":"VEC3","count":{count}}}],{PLAIN}}}"#,
            base64(&[0; 36])
        )
    };
    for text in [
        view(0, 37, 3, 0, 12),
        view(u64::MAX, 36, 3, 0, 12),
        view(0, 36, 4, 0, 12),
        view(0, 36, 3, 40, 12),
        view(0, 36, 3, u64::MAX, 12),
        view(0, 36, 3, 0, 16),
        view(0, 36, 3, 0, 4),
        view(0, 36, u64::MAX, 0, 12),
    ] {
        let (_, problem) = problem(load_text(&text));
        let known = matches!(
            problem,
            GltfProblem::OutOfBytes { .. } | GltfProblem::TooMany { .. } | GltfProblem::Invalid(_)
        );
        assert!(known, "{problem}");
    }
}

#[test]
fn a_huge_accessor_without_bytes_is_refused() {
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"accessors":[{{"componentType":5126,"type":"VEC3","count":4000000000}}],{PLAIN}}}"#
    );
    assert!(matches!(problem(load_text(&text)).1, GltfProblem::TooMany { .. }));
}

#[test]
fn wrong_types_say_what_they_should_be() {
    let mut doc = Doc::default();
    doc.quads(&[[0.0; 4]; 3]);
    let (place, problem) = problem(doc.load(PLAIN));
    assert_eq!(place, "accessors[0]");
    assert!(matches!(problem, GltfProblem::WrongType { expected: "VEC3 of floats", .. }), "{problem}");
}

#[test]
fn missing_and_invalid_files_are_named() {
    assert!(matches!(Scene::load("no-such-scene"), Err(SceneError::UnknownScene { .. })));
    assert!(matches!(Scene::load("/no/such/file.glb"), Err(SceneError::Io { .. })));
    assert!(matches!(load_text("this is no JSON"), Err(SceneError::NotGltf { .. })));
    let views = r#""bufferViews":[{"buffer":0,"byteLength":4}]"#;
    let missing =
        format!(r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":4,"uri":"gone.bin"}}],{views}}}"#);
    match load_text(&missing) {
        Err(SceneError::Io { path, .. }) => assert!(path.ends_with("gone.bin")),
        other => panic!("{other:?}"),
    }
    for uri in ["data:;base64,!!!", "http://example.org/a.bin", "%ff"] {
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":4,"uri":"{uri}"}}],{views}}}"#
        );
        assert!(matches!(problem(load_text(&text)).1, GltfProblem::Uri(_)), "{uri}");
    }
}

#[test]
fn broken_binary_files_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let json = br#"{"asset":{"version":"2.0"}}  "#;
    let mut whole = b"glTF\x02\0\0\0".to_vec();
    whole.extend((12 + 8 + json.len() as u32).to_le_bytes());
    whole.extend((json.len() as u32).to_le_bytes());
    whole.extend(b"JSON");
    whole.extend(json);
    // Every prefix and every claimed length gives an error, never a panic.
    for end in 0..=whole.len() {
        std::fs::write(&path, &whole[..end]).unwrap();
        assert!(Scene::load(path.to_str().unwrap()).is_err());
    }
    for at in 0..whole.len() {
        for bit in 0..8 {
            let mut bad = whole.clone();
            bad[at] ^= 1 << bit;
            std::fs::write(&path, &bad).unwrap();
            assert!(Scene::load(path.to_str().unwrap()).is_err());
        }
    }
}

#[test]
fn every_cut_of_a_file_is_an_error() {
    let mut doc = triangle();
    doc.indices(&[0, 1, 2]);
    let text = doc.text(
        r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]"#,
    );
    assert!(load_text(&text).is_ok());
    for end in 0..text.len() {
        assert!(load_text(&text[..end]).is_err(), "cut at {end}");
    }
}

/// A PNG of 2 by 2 texels: alpha 255, 0 / 0, 255.
fn checker() -> String {
    let image = image::RgbaImage::from_fn(2, 2, |x, y| {
        image::Rgba([9, 9, 9, if (x + y) % 2 == 0 { 255 } else { 0 }])
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    format!("data:image/png;base64,{}", base64(bytes.get_ref()))
}

#[test]
fn masks_follow_texture_factor_cutoff_wrap_and_set() {
    let mut doc = triangle();
    doc.floats("VEC2", 2, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let image = checker();
    let rest = format!(
        r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_1":1}},"material":0}}]}}],
        "materials":[{{"alphaMode":"MASK","alphaCutoff":0.4,"doubleSided":true,"pbrMetallicRoughness":
        {{"baseColorFactor":[1,1,1,0.5],"baseColorTexture":{{"index":0,"texCoord":1}}}}}}],
        "textures":[{{"source":0,"sampler":0}}],"samplers":[{{"magFilter":9728,"wrapS":33648,"wrapT":33071}}],
        "images":[{{"uri":"{image}"}}]"#
    );
    let scene = doc.load(&rest).unwrap();
    let mesh = &scene.meshes()[0];
    let material = scene.material(mesh);
    assert_eq!(mesh.uvs().unwrap()[1], Vec2::X);
    assert_eq!(scene.needs().all(), Needs::MASKED | Needs::DOUBLE_SIDED);
    let there = |u: f32, v: f32| material.is_opaque_at(Vec2::new(u, v));
    assert!(there(0.2, 0.2) && !there(0.7, 0.2) && there(0.7, 0.7));
    assert!(!there(1.2, 0.2) && there(1.7, 0.2), "mirrored along u");
    assert!(!there(0.2, 5.0) && there(0.7, 5.0), "clamped along v");
    // A factor below the cutoff removes everything.
    let gone = rest.replace("[1,1,1,0.5]", "[1,1,1,0.3]");
    assert!(matches!(doc.load(&gone), Err(SceneError::NoTriangles { .. })));
    // The image is required, so it must be readable.
    let broken = rest.replace(&image, "data:image/png;base64,AAAA");
    assert!(matches!(doc.load(&broken), Err(SceneError::Image { .. })));
    // Without a mask the image is never opened.
    let opaque = broken.replace("MASK", "OPAQUE");
    assert_eq!(doc.load(&opaque).unwrap().needs().all(), Needs::DOUBLE_SIDED);
}

#[test]
fn tangents_are_derived_for_normal_maps() {
    let mut doc = triangle();
    doc.floats("VEC2", 2, &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
    doc.vectors(&[[0.0, 0.0, 1.0]; 3]);
    let rest = format!(
        r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1,"NORMAL":2}},"material":0}}]}}],
        "materials":[{{"normalTexture":{{"index":0,"scale":1.0}}}}],"textures":[{{"source":0}}],"images":[{{"uri":"{}"}}]"#,
        checker()
    );
    let scene = doc.load(&rest).unwrap();
    assert_eq!((scene.report().generated_tangents, scene.needs().all()), (1, Needs::NORMAL_MAP));
    // u grows along x, v against y: the tangent is x, and the bitangent (green, up in the picture) y.
    for t in scene.rests()[0].geometry().tangents() {
        assert!((t.truncate() - Vec3::X).length() < 1e-6 && t.w == 1.0, "{t}");
    }
}

#[test]
fn nodes_that_share_a_mesh_share_their_rest() {
    let rest = r#""nodes":[{"mesh":0},{"mesh":0,"translation":[5,0,0],"rotation":[0,0.6,0,0.8]},{"mesh":0,"scale":[2,2,2]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    let scene = triangle().load(rest).unwrap();
    let rests: Vec<u32> = scene.instances().iter().map(|i| i.rest().0).collect();
    assert_eq!((scene.meshes().len(), rests), (1, vec![0, 0, 1]));
    let pose = scene.pose(0.0);
    let world = pose.instances()[1].frame().point(scene.rests()[0].geometry().positions()[1]);
    // A turn of 73.74 degrees about y takes x to (0.28, 0, -0.96).
    assert!((world - Vec3::new(5.28, 0.0, -0.96)).length() < 1e-5, "{world}");
}

#[test]
fn animation_faults_are_named() {
    let base = |times: &[f32], values: &[[f32; 3]], node: usize, sampler: usize| {
        let mut doc = triangle();
        doc.scalars(times);
        doc.vectors(values);
        doc.load(&format!(
            r#"{PLAIN},"animations":[{{"samplers":[{{"input":1,"output":2}}],"channels":[{{"sampler":{sampler},
            "target":{{"node":{node},"path":"translation"}}}}]}}]"#
        ))
    };
    assert!(base(&[0.0, 1.0], &[[0.0; 3], [1.0; 3]], 0, 0).is_ok());
    let (place, found) = problem(base(&[0.0, -1.0], &[[0.0; 3], [1.0; 3]], 0, 0));
    assert_eq!((place.as_str(), found), ("accessors[1]", GltfProblem::TimeGoesBack { element: 1 }));
    assert!(matches!(problem(base(&[0.0, 1.0], &[[0.0; 3]], 0, 0)).1, GltfProblem::CountMismatch { .. }));
    assert!(matches!(
        problem(base(&[0.0, 1.0], &[[0.0; 3]; 2], 8, 0)).1,
        GltfProblem::OutOfRange { what: "node", .. }
    ));
    assert!(matches!(
        problem(base(&[0.0, 1.0], &[[0.0; 3]; 2], 0, 8)).1,
        GltfProblem::OutOfRange { what: "sampler", .. }
    ));
}

#[test]
fn joints_out_of_range_are_refused_unless_they_weigh_nothing() {
    let skinned = |joint: u8, weight: f32| {
        let mut doc = triangle();
        doc.bytes4(&[[0, joint, 0, 0]; 3]);
        doc.quads(&[[1.0 - weight, weight, 0.0, 0.0]; 3]);
        doc.load(
            r#""nodes":[{"mesh":0,"skin":0},{}],"skins":[{"joints":[1]}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}}]}]"#,
        )
    };
    assert!(matches!(
        problem(skinned(1, 0.5)).1,
        GltfProblem::OutOfRange { what: "joint", index: 1, count: 1 }
    ));
    let scene = skinned(200, 0.0).unwrap();
    assert_eq!(scene.instances()[0].motion(), Motion::Static, "nothing moves its joint");
    let (pose, mut geometry) = (scene.pose(0.0), crate::scene::Geometry::default());
    scene.local_geometry(InstanceId(0), &pose, &mut geometry);
    assert_eq!(geometry.positions().len(), 3);
}

#[test]
fn too_many_nodes_or_joints_are_refused() {
    let nodes = vec!["{}"; crate::scene::limits::MAX_NODES + 1].join(",");
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{nodes}]}}"#);
    assert!(matches!(problem(load_text(&text)).1, GltfProblem::TooMany { what: "nodes", .. }));
    let joints = vec!["0"; crate::scene::limits::MAX_JOINTS + 1].join(",");
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{{}}],"skins":[{{"joints":[{joints}]}}]}}"#);
    assert!(matches!(problem(load_text(&text)).1, GltfProblem::TooMany { what: "joints", .. }));
}
