//! Extensions that change geometry, visibility, masks or animation.

use glam::{Vec2, Vec3};

use super::cases::bounds;
use super::{Doc, PLAIN, base64, checker, problem, triangle};
use crate::scene::{GltfProblem, Motion, Needs, Scene};

fn shorts(values: &[i16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn quantised_numbers_keep_their_value_or_are_scaled() {
    for (normalized, scale) in [(false, 1.0), (true, 1.0 / 32_767.0)] {
        let mut doc = Doc::default();
        doc.accessor(&shorts(&[0, 0, 0, 16_000, 0, 0, 0, -8_000, 0]), 5122, "VEC3", 3);
        doc.accessor(&[0, 0, 200, 0, 0, 50], 5121, "VEC2", 3);
        if normalized {
            doc.accessors[0] = doc.accessors[0].replace('{', r#"{"normalized":true,"#);
        }
        let image = checker();
        let rest = format!(
            r#""nodes":[{{"mesh":0}}],"extensionsRequired":["KHR_mesh_quantization"],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
            "materials":[{{"alphaMode":"MASK","pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,
            "extensions":{{"KHR_texture_transform":{{"scale":[0.01,0.02]}}}}}}}}}}],
            "textures":[{{"source":0}}],"images":[{{"uri":"{image}"}}]"#
        );
        let scene = doc.load(&rest).unwrap();
        let expected = [Vec3::new(0.0, -8_000.0, 0.0) * scale, Vec3::new(16_000.0, 0.0, 0.0) * scale];
        let found = bounds(&scene, 0, 0.0);
        assert!(
            (found[0] - expected[0]).length() + (found[1] - expected[1]).length() < 1e-3 * scale.max(1e-3)
        );
        let uvs = scene.meshes()[0].uvs().unwrap();
        assert!(
            (uvs[1] - Vec2::new(2.0, 0.0)).length() < 1e-6 && (uvs[2] - Vec2::new(0.0, 1.0)).length() < 1e-6
        );
    }
}

/// The texture coordinates of a masked triangle at (0, 0), (1, 0) and (0, 1), under a transform.
fn transformed(transform: &str) -> Vec<Vec2> {
    let mut doc = triangle();
    doc.floats("VEC2", 2, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    doc.floats("VEC2", 2, &[5.0, 5.0, 5.0, 5.0, 5.0, 5.0]);
    let image = checker();
    let rest = format!(
        r#""nodes":[{{"mesh":0}}],"textures":[{{"source":0}}],"images":[{{"uri":"{image}"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_1":2}},"material":0}}]}}],
        "materials":[{{"alphaMode":"MASK","pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,
        "extensions":{{"KHR_texture_transform":{{{transform}}}}}}}}}}}]"#
    );
    doc.load(&rest).unwrap().meshes()[0].uvs().unwrap().to_vec()
}

#[test]
fn texture_transforms_scale_then_turn_then_shift() {
    let near = |found: &[Vec2], expected: [[f32; 2]; 3]| {
        found.iter().zip(expected).all(|(a, b)| (*a - Vec2::from_array(b)).length() < 1e-6)
    };
    assert!(near(&transformed(""), [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]));
    assert!(near(&transformed(r#""offset":[0.5,0]"#), [[0.5, 0.0], [1.5, 0.0], [0.5, 1.0]]));
    // A quarter counter-clockwise, on a picture whose v grows downwards: u goes up, v to the right.
    let turned = transformed(r#""offset":[0.1,0.2],"rotation":1.5707963,"scale":[2,3]"#);
    assert!(near(&turned, [[0.1, 0.2], [0.1, -1.8], [3.1, 0.2]]), "{turned:?}");
    assert!(near(&transformed(r#""texCoord":1"#), [[5.0, 5.0]; 3]));
}

#[test]
fn instances_turn_and_scale_and_count_against_the_limit() {
    let mut doc = triangle();
    let at = doc.vectors(&[[1.0, 0.0, 0.0], [0.0, 5.0, 0.0]]);
    // Turns as normalised shorts: none, and a half about z.
    let turns = doc.accessor(&shorts(&[0, 0, 0, 32_767, 0, 0, 32_767, 0]), 5122, "VEC4", 2);
    doc.accessors[turns] = doc.accessors[turns].replace('{', r#"{"normalized":true,"#);
    let scales = doc.vectors(&[[1.0, 1.0, 1.0], [2.0, 3.0, 1.0]]);
    let rest = format!(
        r#""nodes":[{{"mesh":0,"translation":[0,0,7],"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":
        {{"TRANSLATION":{at},"ROTATION":{turns},"SCALE":{scales},"_ID":0}}}}}}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"extensionsRequired":["EXT_mesh_gpu_instancing"]"#
    );
    let scene = doc.load(&rest).unwrap();
    let near = |a: [Vec3; 2], b: [Vec3; 2]| super::cases::near(a, b, 1e-5);
    assert!(near(bounds(&scene, 0, 0.0), [Vec3::new(1.0, 0.0, 7.0), Vec3::new(2.0, 1.0, 7.0)]));
    assert!(near(bounds(&scene, 1, 0.0), [Vec3::new(-2.0, 2.0, 7.0), Vec3::new(0.0, 5.0, 7.0)]));
    let uneven = rest.replace(&format!(r#""SCALE":{scales}"#), r#""SCALE":0"#);
    assert!(matches!(problem(doc.load(&uneven)).1, GltfProblem::CountMismatch { .. }));
    doc.accessors[at] = r#"{"componentType":5126,"type":"VEC3","count":30000000}"#.to_owned();
    assert!(matches!(problem(doc.load(&rest)).1, GltfProblem::TooMany { .. }));
}

#[test]
fn morph_weights_of_an_instanced_node_drive_all_instances() {
    let mut doc = triangle();
    let target = doc.vectors(&[[0.0, 0.0, 1.0]; 3]);
    let at = doc.vectors(&[[0.0; 3], [3.0, 0.0, 0.0]]);
    let (times, values) = (doc.scalars(&[0.0, 1.0]), doc.scalars(&[0.0, 1.0]));
    let scene = doc.load(&format!(
        r#""nodes":[{{"mesh":0,"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{"TRANSLATION":{at}}}}}}}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"targets":[{{"POSITION":{target}}}]}}]}}],
        "animations":[{{"samplers":[{{"input":{times},"output":{values}}}],
        "channels":[{{"sampler":0,"target":{{"node":0,"path":"weights"}}}}]}}]"#
    ));
    let scene = scene.unwrap();
    for instance in 0..2 {
        assert!((bounds(&scene, instance, 0.5)[0].z - 0.5).abs() < 1e-6);
    }
}

#[test]
fn hidden_nodes_hide_what_is_below_them() {
    let rest = r#""nodes":[{"mesh":0},{"children":[2],"extensions":{"KHR_node_visibility":{"visible":false}}},
        {"mesh":0,"extensions":{"KHR_node_visibility":{"visible":true}}},{"mesh":0,"extensions":{"KHR_node_visibility":{}}}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"extensionsRequired":["KHR_node_visibility"]"#;
    let scene = triangle().load(rest).unwrap();
    assert_eq!(scene.instances().len(), 2);
    assert_eq!(scene.report().lines()[0], "left out: 1 hidden instance");
}

/// A scene with one animation of pointers, each with its times and values.
fn pointed(doc: &mut Doc, rest: &str, channels: &[(&str, &[f32], usize)]) -> Scene {
    let (mut samplers, mut targets) = (Vec::new(), Vec::new());
    for (i, (pointer, times, output)) in channels.iter().enumerate() {
        let input = doc.scalars(times);
        samplers.push(format!(r#"{{"input":{input},"output":{output},"interpolation":"STEP"}}"#));
        targets.push(format!(
            r#"{{"sampler":{i},"target":{{"path":"pointer","extensions":{{"KHR_animation_pointer":{{"pointer":"{pointer}"}}}}}}}}"#
        ));
    }
    doc.load(&format!(
        r#"{rest},"extensionsRequired":["KHR_animation_pointer"],
        "animations":[{{"samplers":[{}],"channels":[{}]}}]"#,
        samplers.join(","),
        targets.join(",")
    ))
    .unwrap()
}

#[test]
fn visibility_can_be_animated() {
    let mut doc = triangle();
    let shown = doc.accessor(&[0, 1, 0], 5121, "SCALAR", 3);
    let rest = r#""nodes":[{"mesh":0,"children":[1]},{"mesh":0},{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    let pointer = "/nodes/0/extensions/KHR_node_visibility/visible";
    let scene = pointed(&mut doc, rest, &[(pointer, &[0.0, 1.0, 2.0], shown)]);
    let visible = |time_s| [0, 1, 2].map(|i: usize| scene.pose(time_s).instances()[i].visible());
    assert_eq!(visible(0.5), [false, false, true]);
    assert_eq!(visible(1.5), [true, true, true]);
    let motions: Vec<Motion> = scene.instances().iter().map(crate::scene::Instance::motion).collect();
    assert_eq!(motions, [Motion::Rigid, Motion::Rigid, Motion::Static]);
    assert!(scene.instances()[0].has_constant_frame());
    assert!(!scene.needs().all().contains(Needs::RIGID_MOTION));
}

#[test]
fn a_channel_that_always_hides_leaves_the_instance_out() {
    let mut doc = triangle();
    let never = doc.accessor(&[0, 0], 5121, "SCALAR", 2);
    let rest = r#""nodes":[{"mesh":0},{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    let pointer = "/nodes/1/extensions/KHR_node_visibility/visible";
    let scene = pointed(&mut doc, rest, &[(pointer, &[0.0, 1.0], never)]);
    assert_eq!((scene.instances().len(), scene.report().hidden_instances), (1, 1));
}

#[test]
fn pointers_move_nodes_and_weights() {
    let mut doc = triangle();
    let lift = doc.vectors(&[[0.0, 0.0, 1.0]; 3]);
    let push = doc.vectors(&[[1.0, 0.0, 0.0]; 3]);
    let places = doc.vectors(&[[0.0, 0.0, 0.0], [0.0, 9.0, 0.0]]);
    let one = doc.scalars(&[0.0, 2.0]);
    let both = doc.scalars(&[0.0, 0.0, 4.0, 5.0]);
    let rest = format!(
        r#""nodes":[{{"mesh":0,"weights":[0,0]}},{{"mesh":0}}],"meshes":[{{"weights":[0,0],"primitives":[
        {{"attributes":{{"POSITION":0}},"targets":[{{"POSITION":{lift}}},{{"POSITION":{push}}}]}}]}}]"#
    );
    let times = [0.0, 1.0];
    let scene = pointed(
        &mut doc,
        &rest,
        &[
            ("/nodes/0/translation", &times, places),
            ("/nodes/0/weights/1", &times, one),
            ("/meshes/0/weights", &times, both),
            ("/materials/0/emissiveFactor", &times, places),
            ("/nodes/0/weights/7", &times, one),
            ("/meshes/0/weights/18446744073709551615", &times, one),
        ],
    );
    // Just before the loop ends the first keys still hold; the last keys are at its very end, which is its start.
    let late = 1.0 - 1e-9;
    assert_eq!(bounds(&scene, 0, late)[0], Vec3::ZERO);
    let report = scene.report();
    assert_eq!((report.other_channels, report.idle_channels, report.overruled_channels), (1, 2, 0));
    // The node with weights of its own does not follow the mesh's.
    let needs: Vec<Needs> = scene.instances().iter().map(crate::scene::Instance::needs).collect();
    assert!(needs[0].contains(Needs::MORPH | Needs::RIGID_MOTION) && needs[1] == Needs::MORPH);
}

#[test]
fn a_pointer_to_one_weight_leaves_the_others() {
    let mut doc = triangle();
    let lift = doc.vectors(&[[0.0, 0.0, 1.0]; 3]);
    let push = doc.vectors(&[[1.0, 0.0, 0.0]; 3]);
    let one = doc.scalars(&[2.0, 2.0, 3.0]);
    let rest = format!(
        r#""nodes":[{{"mesh":0,"weights":[4,0]}}],"meshes":[{{"primitives":[
        {{"attributes":{{"POSITION":0}},"targets":[{{"POSITION":{lift}}},{{"POSITION":{push}}}]}}]}}]"#
    );
    let scene = pointed(&mut doc, &rest, &[("/nodes/0/weights/1", &[0.0, 1.0, 2.0], one)]);
    assert_eq!(bounds(&scene, 0, 0.5)[0], Vec3::new(2.0, 0.0, 4.0));
}

/// A masked triangle whose texture is as given.
fn masked(texture: &str, image: &str) -> Result<Scene, crate::scene::SceneError> {
    let mut doc = triangle();
    doc.floats("VEC2", 2, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    doc.load(&format!(
        r#""nodes":[{{"mesh":0}}],"textures":[{texture}],"images":[{{"uri":"{image}"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
        "materials":[{{"alphaMode":"MASK","pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}]"#
    ))
}

#[test]
fn masks_in_webp_are_read() {
    let image = image::RgbaImage::from_fn(4, 2, |x, _| image::Rgba([9, 9, 9, if x < 2 { 255 } else { 0 }]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::WebP).unwrap();
    let uri = format!("data:image/webp;base64,{}", base64(bytes.get_ref()));
    let scene = masked(r#"{"extensions":{"EXT_texture_webp":{"source":0}}}"#, &uri).unwrap();
    let material = scene.material(&scene.meshes()[0]);
    assert!(material.is_opaque_at(Vec2::new(0.25, 0.5)) && !material.is_opaque_at(Vec2::new(0.75, 0.5)));
}

#[test]
fn masks_in_other_formats_are_refused_with_the_command_that_converts_them() {
    for (extension, command) in
        [("KHR_texture_basisu", "ktxdecompress"), ("EXT_texture_avif", "png"), ("MSFT_texture_dds", "png")]
    {
        let texture = format!(r#"{{"extensions":{{"{extension}":{{"source":0}}}}}}"#);
        let (place, found) = problem(masked(&texture, "data:,"));
        assert_eq!((place.as_str(), &found), ("materials[0]", &GltfProblem::ImageFormat(extension)));
        let text = found.to_string();
        assert!(text.contains(&format!("@gltf-transform/cli {command} in.glb out.glb")), "{text}");
        // The same image as the core's own has no better chance.
        let bytes: &[u8] = match extension {
            "KHR_texture_basisu" => b"\xabKTX 20\xbb\r\n\x1a\n",
            "EXT_texture_avif" => b"\0\0\0\x20ftypavif",
            _ => b"DDS |",
        };
        let uri = format!("data:;base64,{}", base64(bytes));
        assert_eq!(problem(masked(r#"{"source":0}"#, &uri)).1, GltfProblem::ImageFormat(extension));
        // With an image of the core beside it, that one is read.
        let both = texture.replace(r#"{"extensions"#, r#"{"source":0,"extensions"#);
        assert!(masked(&both, &checker()).is_ok());
    }
}

#[test]
fn specular_glossiness_has_the_mask_of_its_diffuse_colour() {
    let rest = r#""nodes":[{"mesh":0},{"mesh":1}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]},
        {"primitives":[{"attributes":{"POSITION":0}}]}],
        "materials":[{"alphaMode":"MASK","extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[1,1,1,0.2]}}}]"#;
    let scene = triangle().load(rest).unwrap();
    assert_eq!((scene.instances().len(), scene.report().masked_out_primitives), (1, 1));
}

#[test]
fn compressed_views_that_contradict_themselves_are_errors() {
    let text = |view: &str, packed: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":8,"uri":"data:,12345678"}},{{"byteLength":36}}],
            "bufferViews":[{{"buffer":1,{view},"extensions":{{"EXT_meshopt_compression":{{"buffer":0,{packed}}}}}}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}}],{PLAIN}}}"#
        )
    };
    let fail = |view: &str, packed: &str| problem(super::load_text(&text(view, packed))).1;
    let packed = r#""byteLength":8,"byteStride":12,"count":3,"mode":"ATTRIBUTES""#;
    assert!(matches!(fail(r#""byteLength":36"#, packed), GltfProblem::Compressed { .. }));
    let uneven = fail(r#""byteLength":40"#, packed).to_string();
    assert!(uneven.contains("count times byteStride is not byteLength"), "{uneven}");
    let large = packed.replace(r#""count":3"#, r#""count":18446744073709551615"#);
    assert!(matches!(fail(r#""byteLength":36"#, &large), GltfProblem::Compressed { .. }));
    let beyond = packed.replace(r#""byteLength":8"#, r#""byteLength":9"#);
    assert!(matches!(fail(r#""byteLength":36"#, &beyond), GltfProblem::OutOfBytes { .. }));
}
