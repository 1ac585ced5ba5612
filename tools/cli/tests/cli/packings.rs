//! Points of 24 and 16 bits, from the scene to the client.

use std::path::{Path, PathBuf};

use crate::live::Server;
use crate::{FRAMES, Profile, SMALL, fine, folder, hashes, psao, recording, text};

/// A recording of profile `paper` like [`recording`] with points of `bits` bits.
fn record(folder: &Path, bits: &str) -> PathBuf {
    let path = folder.join(format!("{bits}.psao"));
    let frames = FRAMES.to_string();
    let mut arguments = vec!["record", "--profile", "paper", "--scene", "colonnade", "--frames", &frames];
    arguments.extend(["--threshold", "2", "--bits", bits, "-o", text(&path)]);
    arguments.extend(SMALL);
    fine(&arguments);
    path
}

/// Bytes of all cell sections.
fn cell_bytes(path: &Path) -> u64 {
    let document: serde_json::Value =
        serde_json::from_str(&fine(&["inspect", text(path), "--format", "json"])).expect("JSON");
    let frames = document["frames"].as_array().unwrap();
    frames.iter().map(|frame| frame["parts"]["cells"].as_u64().unwrap()).sum()
}

#[test]
fn narrow_points_are_recorded_verified_replayed_and_drawn() {
    let folder = folder();
    let mut wider = cell_bytes(recording(Profile::Paper));
    for bits in ["24", "16"] {
        let path = record(folder.path(), bits);
        let printed = fine(&["inspect", text(&path)]);
        assert!(printed.contains(&format!("{bits} bit")), "{printed}");
        let bytes = cell_bytes(&path);
        assert!(bytes * 10 < wider * 9, "{bits} bits: {bytes} B of cells, the wider packing has {wider} B");
        wider = bytes;
        let verified = fine(&["verify", text(&path)]);
        assert!(verified.contains(&format!("{FRAMES} frames applied")), "{verified}");
        let recorded = hashes(&fine(&["inspect", text(&path), "--format", "csv"]));
        let replayed = psao(&["replay", text(&path), "--format", "csv"]);
        assert_eq!((replayed.code, hashes(&replayed.out)), (Some(0), recorded.clone()));
        let (server, address) = Server::start(&["replay", text(&path), "--quiet"]);
        let run = psao(&["client", &address, "--format", "csv"]);
        assert_eq!((run.code, hashes(&run.out)), (Some(0), recorded), "{}", run.err);
        assert_eq!(server.wait(), Some(0));
        let picture = folder.path().join("a.png");
        fine(&["reconstruct", text(&path), "--frame", "3", "--size", "64x36", "-o", text(&picture)]);
        assert!(picture.is_file());
    }
}

#[test]
fn a_live_server_sends_narrow_points() {
    let mut arguments = vec!["serve", "--profile", "paper", "--scene", "asteroids", "--fps", "20"];
    arguments.extend(["--bits", "24"]);
    arguments.extend(SMALL);
    let (_server, address) = Server::start(&arguments);
    let folder = folder();
    let path = folder.path().join("live.psao");
    let run = psao(&["record", "--from", &address, "--frames", "4", "-o", text(&path)]);
    assert_eq!(run.code, Some(0), "{}{}", run.out, run.err);
    assert!(fine(&["inspect", text(&path)]).contains("24 bit"));
    fine(&["verify", text(&path)]);
}

#[test]
fn the_demo_runs_with_narrow_points() {
    let folder = folder();
    let target = folder.path().join("demo");
    let mut arguments = vec!["demo", "--profile", "paper", "--scene", "asteroids", "--frames", "2"];
    arguments.extend(["--size", "64x36"]);
    arguments.extend(["--reference-rays", "8", "--bits", "16", "-o", text(&target)]);
    arguments.extend(SMALL);
    assert!(fine(&arguments).contains("PSNR"));
    assert!(fine(&["inspect", text(&target.join("demo.psao"))]).contains("16 bit"));
}
