//! What the two profiles share, and what only one of them has.

use crate::{FRAMES, Profile, SMALL, fine, folder, psao, record, recording, text};

fn json(arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&fine(arguments)).expect("JSON")
}

#[test]
fn shared_geometry_is_not_sent_and_made_again_to_draw() {
    let folder = folder();
    let path = folder.path().join("shared.psao");
    record("colonnade", Profile::Surface, &["--geometry", "shared"], &path);
    let [sent, shared] = [recording(Profile::Surface), &path].map(|path| {
        let document = json(&["inspect", text(path), "--format", "json"]);
        let geometry = document["frames"][0]["parts"]["geometry"].as_u64().unwrap();
        (document["stream"]["geometry"].as_str().unwrap().to_owned(), geometry)
    });
    assert!(sent.0 == "sent" && sent.1 > 0, "{sent:?}");
    assert_eq!(shared, ("shared".to_owned(), 0));
    // Without the scene: hashes, checks, playing.
    fine(&["verify", text(&path)]);
    assert_eq!(psao(&["replay", text(&path), "--quiet"]).code, Some(0));
    // With it: the picture is that of the points that were sent, if both streams are exact.
    let exact = ["sent", "shared"].map(|geometry| {
        let path = folder.path().join(geometry);
        let mut arguments = vec!["record", "--scene", "colonnade", "--frames", "6", "--geometry", geometry];
        arguments.extend(["--threshold", "1", "--unseen-threshold", "1", "-o", text(&path)]);
        arguments.extend(SMALL);
        fine(&arguments);
        path
    });
    let pictures = exact.each_ref().map(|path| {
        let picture = folder.path().join("a.png");
        fine(&["reconstruct", text(path), "--frame", "5", "--size", "96x54", "-o", text(&picture)]);
        std::fs::read(picture).unwrap()
    });
    assert!(pictures[0] == pictures[1]);
}

/// Options of a small comparison that are those of [`record`].
fn compare(more: &[&str]) -> Vec<String> {
    let frames = FRAMES.to_string();
    let mut arguments =
        vec!["lab", "profiles", "--scene", "colonnade", "--frames", &frames, "--threshold", "2"];
    arguments.extend(["--unseen-threshold", "2"]);
    arguments.extend(SMALL);
    arguments.extend(more);
    arguments.into_iter().map(str::to_owned).collect()
}

#[test]
fn a_comparison_counts_the_bytes_that_recordings_have() {
    let arguments = compare(&["--json"]);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let document = json(&arguments);
    let folder = folder();
    assert_eq!(document["schema"], "psao-compare-profiles/1");
    for profile in Profile::ALL {
        let figures = &document[profile.name()];
        // The comparison has all points of both profiles.
        let path = folder.path().join(profile.name());
        record("colonnade", profile, &["--quality", "0"], &path);
        let recorded = json(&["inspect", text(&path), "--format", "json"]);
        let totals = &recorded["totals"];
        // A recording has a report about its last frame, which is nobody's payload.
        let report = totals["later_parts"]["report"].as_u64().unwrap();
        let later: u64 =
            totals["later_parts"].as_object().unwrap().values().map(|bytes| bytes.as_u64().unwrap()).sum();
        let compared: u64 =
            figures["later_parts"].as_object().unwrap().values().map(|bytes| bytes.as_u64().unwrap()).sum();
        assert_eq!(compared, later - report, "{profile:?}");
        assert_eq!(figures["changed_points"], totals["changed_points"], "{profile:?}");
        // Stream times are whole microseconds, and the last frame is at 183,337.
        let rate = |document: &serde_json::Value| document["paper_mbit_s"].as_f64().unwrap();
        assert!((rate(figures) / rate(totals) - 1.0).abs() < 1e-5, "{profile:?}");
        assert_eq!(figures["scene_table_bytes"], recorded["overhead"]["scene"], "{profile:?}");
        let error = &figures["error"];
        assert!(error["points"].as_u64().unwrap() > 1000, "{error}");
        // The threshold and half a step of the byte.
        assert!(error["max"].as_f64().unwrap() < 2.5 + 1e-3, "{error}");
    }
    assert_eq!(document["surface"]["error"]["lost"], 0);
    assert!(document["paper_over_surface"]["wire_mbit_s"].as_f64().unwrap() > 1.0, "{document}");
}

#[test]
fn a_comparison_draws_both_and_says_what_is_out_of_range() {
    let folder = folder();
    let pictures = folder.path().join("pictures");
    let mut more = vec!["--pictures", "0,3", "--size", "64x36", "--reference-rays", "8"];
    more.extend(["--geometry", "shared", "-o", text(&pictures)]);
    let arguments = compare(&more);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let printed = fine(&arguments);
    for word in ["cells", "changes", "Mbit/s", "error", "PSNR", "frame 3"] {
        assert!(printed.contains(word), "{word}: {printed}");
    }
    for name in
        ["frame-0.paper.png", "frame-3.surface.png", "frame-3.reference.png", "frame-3.side-by-side.png"]
    {
        assert!(pictures.join(name).is_file(), "{name}");
    }
    for (more, word) in [(["--pictures", "12"], "raise --frames"), (["--paper-compress", "range"], "surface")]
    {
        let arguments = compare(&more);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let run = psao(&arguments);
        assert_eq!(run.code, Some(2), "{}", run.err);
        assert!(run.err.contains(word), "{}", run.err);
    }
}
