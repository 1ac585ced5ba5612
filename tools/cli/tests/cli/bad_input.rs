//! What is wrong is said in one clear sentence, with the place and the remedy, and ends with the documented code.

use std::path::Path;

use crate::{FRAMES, Profile, SMALL, folder, psao, recording, text};

/// Runs and expects an exit code and words on standard error.
pub(crate) fn refuses(arguments: &[&str], code: i32, words: &[&str]) {
    let run = psao(arguments);
    assert_eq!(run.code, Some(code), "psao {arguments:?}: {}{}", run.out, run.err);
    for word in words {
        assert!(run.err.contains(word), "psao {arguments:?} does not say \"{word}\": {}", run.err);
    }
    assert!(!run.err.contains("panicked"), "{}", run.err);
}

/// As [`refuses`], for `record --scene`.
fn refuses_scene(scene: &str, words: &[&str]) {
    let folder = folder();
    let target = folder.path().join("out.psao");
    refuses(&["record", "--scene", scene, "-o", text(&target)], 3, words);
    assert!(!target.exists(), "nothing is left behind");
}

#[test]
fn scenes_that_are_not_there_or_not_scenes() {
    let folder = folder();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    refuses_scene("no-such-scene", &["no-such-scene", "colonnade"]);
    refuses_scene("/nowhere/a.glb", &["/nowhere/a.glb"]);
    refuses_scene(text(&write("a.glb", b"this is not a glTF file")), &["a.glb"]);
    refuses_scene(text(&write("b.gltf", br#"{"asset":{"version":"2.0"}}"#)), &["b.gltf"]);
    refuses_scene(text(&write("c.toml", b"[scene]\nname = \"c\"\ncolour = 3\n")), &["c.toml", "colour"]);
}

#[test]
fn options_that_make_no_sense() {
    let folder = folder();
    let target = folder.path().join("out.psao");
    for (options, words) in [
        (&["--points", "0"][..], &["points"][..]),
        (&["--points", "nan"], &["points"]),
        (&["--min-points", "0"], &["points"]),
        (&["--rays", "0"], &["rays"]),
        (&["--radius", "0"], &["radius"]),
        (&["--radius", "inf"], &["radius"]),
        (&["--fps", "0"], &["fps"]),
        (&["--threshold", "0"], &["threshold"]),
        (&["--threshold", "256"], &["threshold"]),
        (&["--frames", "0"], &["frames"]),
        (&["--compress", "gzip"], &["gzip", "zstd"]),
        (&["--bits", "31"], &["bits is 31", "32, 24 or 16"]),
        (&["--bits", "7"], &["32, 24 or 16"]),
        (&["--profile", "cells"], &["cells", "surface", "paper"]),
        (&["--profile", "paper", "--compress", "range"], &["range", "surface"]),
        (&["--geometry", "none"], &["none", "sent", "shared"]),
        (&["--profile", "paper", "--geometry", "shared"], &["--geometry shared", "surface"]),
        (&["--view-margin", "0"], &["view_margin"]),
        (&["--slots-per-cell=-1"], &["slots"]),
        (&["--kernel", "9"], &["kernel"]),
    ] {
        let mut arguments = vec!["record", "--scene", "colonnade", "-o", text(&target)];
        arguments.extend(options);
        refuses(&arguments, 2, words);
        assert!(!target.exists(), "{options:?} leaves nothing behind");
    }
    refuses(&["record", "-o", text(&target)], 2, &["--scene"]);
    refuses(&["replay", text(recording(Profile::Surface)), "--speed", "0"], 2, &["--speed"]);
    refuses(&["replay", text(recording(Profile::Surface)), "--from", "2s", "--to", "1s"], 2, &["--to"]);
    refuses(
        &["reconstruct", text(recording(Profile::Surface)), "--frame", "0", "--size", "0x9", "-o", "x.png"],
        2,
        &["0x9"],
    );
    refuses(&["lab", "stress", "--only", "no such case"], 2, &["no case", "no such case", "open-plane"]);
}

#[test]
fn options_that_do_not_fit_the_input() {
    let folder = folder();
    let [target, picture] = ["out.psao", "out.png"].map(|name| folder.path().join(name));
    let whole = text(recording(Profile::Surface));
    // Possible for a smaller scene, another recording, another machine or another folder.
    for density in ["1e9", "1e30"] {
        let arguments = ["record", "--scene", "colonnade", "--points", density, "-o", text(&target)];
        refuses(&arguments, 3, &["points", "lower the density"]);
        assert!(!target.exists());
    }
    refuses(&["lab", "rays", "--scene", "colonnade", "--points", "1e30"], 3, &["lower the density"]);
    refuses(&["lab", "rays", "--scene", "colonnade", "--instructions", "abacus"], 3, &["abacus"]);
    refuses(&["reconstruct", whole, "--frame", "99", "-o", text(&picture)], 3, &["99"]);
    let weights = ["--lpips-weights", whole, "-o", text(&picture)];
    refuses(&[&["reconstruct", whole, "--frame", "0"], &weights[..]].concat(), 3, &["colonnade.psao"]);
    refuses(&["client", "127.0.0.1:1", "--scene", "no-such-scene"], 3, &["no-such-scene"]);
    refuses(&["replay", whole, "--from", "100s"], 3, &["--from 100s"]);
    refuses(&["cut", whole, "--from-frame", "99", "-o", text(&target)], 3, &["99"]);
    // Wrong for any.
    refuses(&["lab", "rays", "--scene", "colonnade", "--points", "0"], 2, &["points"]);
    refuses(&["lab", "rays", "--scene", "colonnade", "--radius", "0"], 2, &["radius"]);
    refuses(&["lab", "rays", "--scene", "colonnade", "--rays", "0"], 2, &["rays"]);
    let down = ["--camera", "0,5,0,0,0,0", "--up", "0,1,0", "-o", text(&picture)];
    refuses(&[&["reconstruct", whole, "--frame", "0"], &down[..]].concat(), 2, &["--up", "line of sight"]);
    let nowhere = ["--camera", "0,5,0,0,5,0", "-o", text(&picture)];
    refuses(&[&["reconstruct", whole, "--frame", "0"], &nowhere[..]].concat(), 2, &["camera"]);
    refuses(&["keys", text(&folder.path().join("keys")), "--name", "\u{e9}"], 2, &["certificates"]);
}

#[test]
fn nothing_is_written_over_what_is_read_or_holds_something_else() {
    let folder = folder();
    let [scene, plot, picture] =
        ["scene.gltf", "plot.svg", "picture.png"].map(|name| folder.path().join(name));
    std::fs::write(&scene, "{}").unwrap();
    std::fs::write(&plot, "not a plot").unwrap();
    std::fs::copy(recording(Profile::Surface), &picture).unwrap();
    let before = [&scene, &plot, &picture].map(|path| std::fs::read(path).unwrap());
    let whole = text(recording(Profile::Surface));
    let record = ["record", "--scene", text(&scene), "--frames", "1", "-o", text(&scene)];
    refuses(&record, 3, &["exists and is not a recording"]);
    let serve = ["serve", "--scene", "colonnade", "--record", text(&scene)];
    refuses(&serve, 3, &["exists and is not a recording"]);
    refuses(&["cut", whole, "--from", "0", "-o", text(&scene)], 3, &["exists and is not a recording"]);
    refuses(&["inspect", whole, "--plot", text(&plot)], 3, &["exists and is not an SVG plot"]);
    refuses(&["inspect", whole, "--plot", whole], 2, &["call it", ".svg"]);
    let draw =
        |file: &str, output: &str| ["reconstruct", file, "--frame", "0", "-o", output].map(str::to_owned);
    let jpeg = folder.path().join("a.jpg");
    for (arguments, code, says) in [
        (draw(text(&picture), text(&picture)), 3, "exists and is not a PNG picture"),
        (draw(whole, text(&jpeg)), 2, "a.png"),
    ] {
        refuses(&arguments.each_ref().map(String::as_str), code, &[says]);
    }
    assert_eq!([&scene, &plot, &picture].map(|path| std::fs::read(path).unwrap()), before);
    assert!(!jpeg.exists());
}

#[test]
fn places_that_cannot_be_written() {
    let mut arguments =
        vec!["record", "--scene", "asteroids", "--frames", "1", "-o", "/nowhere/at/all/a.psao"];
    arguments.extend(SMALL);
    refuses(&arguments, 1, &["/nowhere/at/all/a.psao"]);
}

#[test]
fn recordings_that_are_none() {
    let folder = folder();
    let [path, picture] = ["a.psao", "a.png"].map(|name| folder.path().join(name));
    for command in ["inspect", "verify", "replay"] {
        refuses(&[command, text(&path)], 3, &["a.psao"]);
    }
    for bytes in [&b""[..], b"\x89PNG\r\n\x1a\n something else entirely, long enough to have had a header"] {
        std::fs::write(&path, bytes).unwrap();
        for command in ["inspect", "verify", "replay"] {
            refuses(&[command, text(&path)], 3, &["a.psao", "not a psao recording"]);
        }
    }
    refuses(
        &["reconstruct", text(recording(Profile::Surface)), "--frame", "99", "-o", text(&picture)],
        3,
        &["no frame 99; frames 0 to 11 can be drawn\n"],
    );
    refuses(
        &[
            "reconstruct",
            text(recording(Profile::Surface)),
            "--frame",
            "0",
            "--scene",
            "asteroids",
            "-o",
            text(&picture),
        ],
        3,
        &["asteroids", "colonnade"],
    );
}

fn damaged(folder: &Path, profile: Profile, change: impl FnOnce(&mut Vec<u8>)) -> std::path::PathBuf {
    let path = folder.join("damaged.psao");
    let mut bytes = std::fs::read(recording(profile)).unwrap();
    change(&mut bytes);
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn a_recording_cut_short_is_read_up_to_the_cut() {
    let folder = folder();
    // Cut inside the last frames, which are small beside the first.
    let path = damaged(folder.path(), Profile::Paper, |bytes| bytes.truncate(bytes.len() * 19 / 20));
    for command in ["inspect", "verify", "replay"] {
        let run = psao(&[command, text(&path)]);
        assert_eq!(run.code, Some(4), "{command}: {}{}", run.out, run.err);
    }
    let run = psao(&["inspect", text(&path), "--format", "json"]);
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    let frames = document["frames"].as_array().unwrap();
    assert!(!frames.is_empty() && frames.len() < FRAMES as usize, "{} frames", frames.len());
    let wire: u64 = frames.iter().map(|frame| frame["wire_bytes"].as_u64().unwrap()).sum();
    let overhead = document["overhead_bytes"].as_u64().unwrap();
    assert_eq!(wire + overhead, std::fs::metadata(&path).unwrap().len());
}

#[test]
fn a_changed_byte_anywhere_is_found() {
    let folder = folder();
    for profile in Profile::ALL {
        let length = std::fs::metadata(recording(profile)).unwrap().len() as usize;
        for place in (0..24).map(|part| part * (length - 1) / 23) {
            let path = damaged(folder.path(), profile, |bytes| bytes[place] ^= 0x10);
            let run = psao(&["verify", text(&path)]);
            assert_eq!(run.code, Some(4), "byte {place} of {length}: {}{}", run.out, run.err);
        }
    }
}
