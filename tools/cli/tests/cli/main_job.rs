//! Record, inspect, replay, draw, verify.

use std::path::Path;

use crate::{FRAMES, Profile, SMALL, fine, folder, hashes, psao, record, recording, text};

fn json(arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&fine(arguments)).expect("JSON")
}

fn sum(parts: &serde_json::Value) -> u64 {
    parts.as_object().expect("an object").values().map(|bytes| bytes.as_u64().expect("bytes")).sum()
}

#[test]
fn a_camera_straight_above_has_a_picture() {
    let folder = folder();
    let whole = text(recording(Profile::Surface));
    let draw = |name: &str, up: &[&str]| {
        let path = folder.path().join(name);
        let camera = ["--frame", "0", "--size", "48x48", "--camera", "0,9,0,0,0,0", "-o", text(&path)];
        fine(&[&["reconstruct", whole], &camera[..], up].concat());
        std::fs::read(&path).unwrap()
    };
    let usual = draw("usual.png", &[]);
    assert_eq!(usual, draw("north.png", &["--up", "0,0,-1"]), "as a plan");
    assert_ne!(usual, draw("east.png", &["--up", "1,0,0"]));
}

#[test]
fn every_byte_of_a_recording_is_counted_once() {
    for profile in Profile::ALL {
        let path = recording(profile);
        let document = json(&["inspect", text(path), "--format", "json"]);
        assert_eq!(document["schema"], "psao-inspect/1");
        assert_eq!(document["stream"]["profile"], profile.name());
        let file_bytes = std::fs::metadata(path).unwrap().len();
        assert_eq!(document["file_bytes"], file_bytes);
        let frames = document["frames"].as_array().unwrap();
        assert_eq!(frames.len(), FRAMES as usize);
        let mut wire = 0;
        for frame in frames {
            assert_eq!(sum(&frame["parts"]), frame["wire_bytes"].as_u64().unwrap());
            assert_eq!(frame["parts"]["other"], 0);
            wire += frame["wire_bytes"].as_u64().unwrap();
        }
        let overhead = document["overhead_bytes"].as_u64().unwrap();
        assert_eq!(sum(&document["overhead"]), overhead);
        assert_eq!(wire + overhead, file_bytes);
        assert_eq!(frames[0]["kind"], "key");
        let stored = frames[0]["report"]["stored"].as_u64().unwrap();
        assert_eq!(stored > 0, profile == Profile::Paper, "only the paper has tables");
        let parts = match profile {
            Profile::Paper => ["cells", "buckets"],
            Profile::Surface => ["geometry", "values"],
        };
        assert!(parts.iter().all(|part| frames[0]["parts"][part].as_u64().unwrap() > 0));
        let changed = frames[1..].iter().any(|frame| frame["changed_points"].as_u64().unwrap() > 0);
        assert!(changed, "boulders roll");
    }
}

#[test]
fn the_same_options_give_the_same_bytes_and_another_seed_gives_others() {
    let folder = folder();
    let again = folder.path().join("again.psao");
    for profile in Profile::ALL {
        record("colonnade", profile, &[], &again);
        let same = std::fs::read(recording(profile)).unwrap() == std::fs::read(&again).unwrap();
        assert!(same, "same options, same bytes");
    }
    let other = folder.path().join("other.psao");
    let frames = FRAMES.to_string();
    let mut arguments =
        vec!["record", "--scene", "colonnade", "--frames", &frames, "--seed", "2", "-o", text(&other)];
    arguments.extend(SMALL);
    fine(&arguments);
    assert!(std::fs::read(&again).unwrap() != std::fs::read(&other).unwrap());
}

#[test]
fn brute_force_gives_the_same_stream() {
    let folder = folder();
    let path = folder.path().join("exhaustive.psao");
    let listing = |path| hashes(&fine(&["inspect", text(path), "--format", "csv"]));
    for profile in Profile::ALL {
        record("colonnade", profile, &["--exhaustive"], &path);
        assert_eq!(listing(recording(profile)), listing(&path));
    }
}

#[test]
fn replay_applies_the_recorded_states_from_any_time() {
    for profile in Profile::ALL {
        let recorded = hashes(&fine(&["inspect", text(recording(profile)), "--format", "csv"]));
        let replayed = |more: &[&str]| {
            let mut arguments = vec!["replay", text(recording(profile)), "--format", "csv"];
            arguments.extend(more);
            let run = psao(&arguments);
            assert_eq!(run.code, Some(0), "{}", run.err);
            hashes(&run.out)
        };
        assert_eq!(replayed(&[]), recorded);
        assert_eq!(replayed(&["--pace", "step"]), recorded);
        assert_eq!(replayed(&["--pace", "wall", "--speed", "4"]), recorded);
        assert_eq!(replayed(&["--from", "0.05s", "--to", "0.1s"]), recorded[3..=6], "60 frames a second");
    }
}

#[test]
fn a_frame_becomes_a_picture_with_its_reference() {
    for profile in Profile::ALL {
        let (folder, recording) = (folder(), text(recording(profile)));
        let path = folder.path().join("a.png");
        let mut arguments = vec!["reconstruct", recording, "--frame", "3", "--size", "64x36"];
        arguments.extend(["--reference", "--reference-rays", "16", "-o", text(&path)]);
        let printed = fine(&arguments);
        for figure in ["PSNR", "dB", "SSIM", "FLIP", "within 5 %"] {
            assert!(printed.contains(figure), "{figure}: {printed}");
        }
        assert!(!printed.contains("LPIPS"), "no weights were given: {printed}");
        arguments.push("--json");
        let found = json(&arguments);
        let error = &found["reference"]["error"];
        for figure in ["mae", "rmse", "psnr_db", "bias", "p99", "max", "within_5", "ssim", "flip"] {
            assert!(error[figure].is_f64(), "{figure}: {found}");
        }
        assert!(error["lpips"].is_null() && found["files"].as_array().unwrap().len() == 4, "{found}");
        let mae = format!("mean error {:.5},", error["mae"].as_f64().unwrap());
        let ssim = format!("SSIM {:.4}, ", error["ssim"].as_f64().unwrap());
        assert!(printed.contains(&mae) && printed.contains(&ssim), "{mae} {ssim} {printed}");
        for name in ["a.png", "a.reference.png", "a.difference.png", "a.side-by-side.png"] {
            let bytes = std::fs::read(folder.path().join(name)).unwrap();
            assert!(bytes.starts_with(b"\x89PNG"), "{name}");
        }
        let mut arguments = vec!["reconstruct", recording, "--frame", "0", "--size", "32x18"];
        arguments.extend(["-o", text(&path), "--camera", "-2,1.7,3,0,1,0,70"]);
        fine(&arguments);
    }
}

#[test]
fn verify_passes_what_was_recorded() {
    for profile in Profile::ALL {
        let printed = fine(&["verify", text(recording(profile))]);
        assert!(printed.contains(&format!("{FRAMES} frames applied")), "{printed}");
        assert!(!printed.contains("WRONG") && !printed.contains("DAMAGED"), "{printed}");
    }
}

#[test]
fn scenes_are_listed_with_what_they_need() {
    let printed = fine(&["scenes"]);
    for scene in ["colonnade", "robot-lab", "asteroids"] {
        assert!(printed.contains(scene), "{printed}");
    }
    let listed = json(&["scenes", "robot-lab", "--format", "json"]);
    assert!(listed[0]["deforming"].as_u64().unwrap() >= 20, "at least 20 skinned walkers");
}

/// A triangle of 1 m, once as a surface and once as three points.
const WITH_POINTS: &str = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"extensionsUsed":["VENDOR_\u001b"],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}},{"attributes":{"POSITION":0},"mode":0}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"bufferViews":[{"buffer":0,"byteLength":36}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAIA/AACAPwAAAAAAAAAA"}]}"#;

#[test]
fn what_is_left_out_of_a_scene_file_is_printed() {
    let folder = folder();
    let (scene, recording) = (folder.path().join("points.gltf"), folder.path().join("points.psao"));
    std::fs::write(&scene, WITH_POINTS).unwrap();
    let mut record = vec!["record", "--scene", text(&scene), "--frames", "1", "-o", text(&recording)];
    record.extend(SMALL);
    for arguments in [&["scenes", text(&scene)][..], &record] {
        let printed = fine(arguments);
        assert!(printed.contains("left out: 1 primitive of points\n"), "{printed}");
        assert!(printed.contains(r"not known: VENDOR_\u{1b}"), "{printed}");
    }
    let listed = json(&["scenes", text(&scene), "--format", "json"]);
    assert_eq!(listed[0]["report"][0], "left out: 1 primitive of points");
    assert!(fine(&["scenes", text(&scene), "--format", "csv"]).contains("left out: 1 primitive of points; "));
}

#[test]
fn inspect_draws_a_plot() {
    let folder = folder();
    let path = folder.path().join("plot.svg");
    for profile in Profile::ALL {
        let recording = text(recording(profile));
        let printed = fine(&["inspect", recording, "--per-frame", "--plot", text(&path)]);
        let part = if profile == Profile::Paper { "buckets" } else { "changes" };
        let svg = std::fs::read_to_string(&path).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("keyframe") && svg.contains(part), "{svg}");
        assert!(printed.contains(part) && printed.contains(profile.name()), "{printed}");
    }
}

#[test]
fn the_demo_leaves_its_folder() {
    let folder = folder();
    let target = folder.path().join("demo");
    for profile in Profile::ALL {
        demo(&target, profile);
    }
}

fn demo(target: &Path, profile: Profile) {
    let mut arguments = vec!["demo", "--scene", "asteroids", "--frames", "3", "--profile", profile.name()];
    arguments.extend(["--size", "64x36", "--reference-rays", "8", "-o", text(target)]);
    arguments.extend(SMALL);
    let printed = fine(&arguments);
    for word in ["points", "Mbit/s", "trace rays", "PSNR"] {
        assert!(printed.contains(word), "{word}: {printed}");
    }
    for name in ["demo.psao", "report.html", "bandwidth.svg", "frame-1.png", "frame-2.side-by-side.png"] {
        assert!(target.join(name).is_file(), "{name}");
    }
    let page = std::fs::read_to_string(target.join("report.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && !page.contains("src=\"http"));
}
