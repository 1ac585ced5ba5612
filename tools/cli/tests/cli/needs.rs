//! What is left out, as it is measured.

use crate::bad_input::refuses;
use crate::{SMALL, fine, folder, text};

/// A plate that lies, and one that is lifted off it.
const LIFTED: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
"nodes":[{"name":"floor","mesh":0},{"name":"plate","mesh":0,"translation":[0,0.2,0]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],"materials":[{"doubleSided":true}],
"animations":[{"channels":[{"sampler":0,"target":{"node":1,"path":"translation"}}],
"samplers":[{"input":1,"output":2,"interpolation":"LINEAR"}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,0,1]},
{"bufferView":1,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[2]},
{"bufferView":2,"componentType":5126,"count":2,"type":"VEC3"}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":8},
{"buffer":0,"byteOffset":44,"byteLength":24}],"buffers":[{"byteLength":68,"uri":"lifted.bin"}]}"#;

fn run(more: &[&str]) -> String {
    let folder = folder();
    let scene = folder.path().join("lifted.gltf");
    std::fs::write(&scene, LIFTED).unwrap();
    let numbers: [f32; 17] =
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.2, 0.0, 0.0, 5.0, 0.0];
    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    std::fs::write(folder.path().join("lifted.bin"), bytes).unwrap();
    let mut arguments = vec!["lab", "needs", text(&scene), "--frames", "4", "--fps", "4", "--all-visible"];
    arguments.extend(SMALL);
    if !more.contains(&"--rounds") {
        arguments.extend(["--rounds", "2"]);
    }
    arguments.extend(more);
    fine(&arguments)
}

#[test]
fn each_thing_left_out_is_measured_and_changes_no_frame() {
    let document: serde_json::Value = serde_json::from_str(&run(&["--json"])).unwrap();
    assert_eq!(document["schema"], "psao-needs/1");
    let has = |need: &str| {
        let all = document["has"].as_array().unwrap();
        let found = all.iter().find(|has| has["need"] == need).expect("a row");
        found["instances"].as_u64().unwrap()
    };
    assert_eq!([has("skin"), has("rigid motion"), has("double-sided"), has("a mover near")], [0, 1, 2, 1]);
    let groups = document["groups"].as_array().unwrap();
    let points: u64 = groups.iter().map(|group| group["points"].as_u64().unwrap()).sum();
    assert_eq!((groups.len(), points), (2, document["points"].as_u64().unwrap()));
    let rows = document["left_out"].as_array().unwrap();
    let row = |what: &str| rows.iter().find(|row| row["what"] == what).expect("a row");
    let equal: Vec<_> = rows.iter().filter(|row| !row["frames_equal"].is_null()).collect();
    assert_eq!(equal.len(), 9);
    assert!(equal.iter().all(|row| row["frames_equal"] == true && row["bytes"] == 0.0));
    // After a frame the plate has nothing near any more.
    assert!(row("rays of bodies that move alone")["traced"].as_f64().unwrap() > 0.0);
    assert!(row("positions and normals of points")["bytes_once"].as_i64().unwrap() > 0);
    assert!(row("pose tracks")["bytes"].as_f64().unwrap() > 0.0);
    let memory = document["memory"].as_object().unwrap();
    let bytes = |part: &str| memory[part].as_u64().unwrap();
    let parts = ["structures", "points", "rays", "remembered", "stream"].map(bytes);
    assert_eq!((memory.len(), bytes("total")), (6, parts.iter().sum()));
    assert!(parts[0] > 0 && parts[1] > 0 && parts[4] > 0, "{memory:?}");
    let backs = row("points on backs");
    assert!(backs["bytes"].is_null() && backs["note"].as_str().unwrap().starts_with("n/a"));
    let again: serde_json::Value = serde_json::from_str(&run(&["--json", "--geometry", "shared"])).unwrap();
    let first = |document: &serde_json::Value| document["frame"]["first_bytes"].as_i64().unwrap();
    let saved = row("positions and normals of points")["bytes_once"].as_i64();
    assert_eq!(Some(first(&document) - first(&again)), saved, "shared geometry is what is measured");
}

#[test]
fn the_table_says_the_same() {
    let out = run(&[]);
    for words in ["double-sided", "rigid motion", "pose tracks", "n/a", "frames equal", "State hash"] {
        assert!(out.contains(words), "{words}: {out}");
    }
    assert!(!out.contains("NO"), "{out}");
    assert!(out.contains(", 2 rounds;") && out.contains("The server holds"), "{out}");
    assert!(run(&["--rounds", "1"]).contains(", 1 round;"));
}

#[test]
fn what_cannot_be_measured_is_refused() {
    refuses(&["lab", "needs", "colonnade", "--exhaustive"], 2, &["--exhaustive"]);
    refuses(&["lab", "needs", "colonnade", "--frames", "1"], 2, &["frames"]);
    refuses(&["lab", "needs", "colonnade", "--rounds", "0"], 2, &["rounds"]);
    refuses(&["lab", "needs", "colonnade", "--radius", "0"], 2, &["radius"]);
    refuses(&["lab", "needs", "no-such-scene"], 3, &["no-such-scene", "colonnade"]);
}
