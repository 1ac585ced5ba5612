//! `psao lab sweep`: sweeps that are measured, kept and gone on with.

use std::collections::BTreeSet;
use std::path::Path;

use crate::{Run, command, fine, folder, psao, text};

/// A sweep of a moment: two densities, two profiles, one method.
const TINY: [&str; 22] = [
    "--points",
    "4,8",
    "--min-points",
    "32",
    "--bits",
    "32",
    "--rays",
    "8",
    "--threshold",
    "4",
    "--fps",
    "60",
    "--compress",
    "range",
    "--methods",
    "ssao-plus",
    "--size",
    "64x36",
    "--frames",
    "2",
    "--pictures",
    "1",
];
const CHEAP: [&str; 4] = ["--reference-rays", "32", "--repeats", "1"];

fn arguments<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["lab", "sweep", "colonnade"];
    arguments.extend(TINY);
    arguments.extend(CHEAP);
    arguments.extend(more);
    arguments
}

/// The tiny sweep of a scene with other options, which may not be given twice.
fn instead<'a>(scene: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let rest = TINY.chunks(2).chain(CHEAP.chunks(2)).filter(|pair| !more.contains(&pair[0])).flatten();
    ["lab", "sweep", scene].iter().chain(rest).chain(more).copied().collect()
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap()
}

#[test]
fn a_sweep_leaves_a_table_a_page_and_files_that_agree() {
    let folder = folder();
    let out = fine(&arguments(&["-o", text(folder.path()), "--recommend"]));
    let document: serde_json::Value = serde_json::from_str(&read(folder.path(), "results.json")).unwrap();
    assert_eq!(document["schema"], "psao-evaluate/1");
    let records = document["records"].as_array().unwrap();
    let streams: Vec<_> = records.iter().filter(|record| record["kind"] == "stream").collect();
    let names: Vec<_> = streams.iter().map(|record| record["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["surface", "surface", "paper"], "one axis at a time");
    assert!(records.len() > streams.len(), "methods, too");
    for record in records {
        assert!(out.contains(record["label"].as_str().unwrap()), "{record} is in the table: {out}");
        assert!(record["error"]["mae"].as_f64().unwrap() > 0.0 && record["error"]["ssim"].is_f64());
        assert!(record["error"]["lpips"].is_null(), "no weights were given");
    }
    assert!(out.contains("nothing that was measured fits"), "{out}");
    assert_eq!(read(folder.path(), "results.csv").lines().count(), records.len() + 1);
    assert_eq!(read(folder.path(), "results.jsonl").lines().count(), records.len());
    let page = read(folder.path(), "report.html");
    assert!(page.ends_with("</html>\n"));
    assert_eq!(
        page.matches("data:image/png;base64,").count(),
        1 + 3 * 2,
        "the reference, and each name and its error"
    );
    fine(&arguments(&["--out", text(folder.path()), "--resume", "--thumbnails", "1"]));
    let page = read(folder.path(), "report.html");
    assert_eq!(page.matches("data:image/png;base64,").count(), 1 + 2, "the best name alone");
}

#[test]
fn a_sweep_that_was_cut_off_goes_on_and_comes_to_the_same() {
    let folder = folder();
    let whole = |more: &[&str]| {
        let mut options = vec!["--out", text(folder.path()), "--json"];
        options.extend(more);
        let out = fine(&arguments(&options));
        serde_json::from_str::<serde_json::Value>(&out).unwrap()["records"].as_array().unwrap().clone()
    };
    let first = whole(&[]);
    let lines = read(folder.path(), "results.jsonl");
    let kept: String = lines.lines().take(2).map(|line| format!("{line}\n")).collect();
    std::fs::write(folder.path().join("results.jsonl"), kept).unwrap();
    let again = whole(&["--resume"]);
    assert_eq!(again.len(), first.len());
    for (number, (again, first)) in again.iter().zip(&first).enumerate() {
        if number < 2 {
            assert_eq!(again, first, "kept, times and all");
        }
        for same in ["key", "label", "error", "pictures", "memory"] {
            assert_eq!(again[same], first[same], "{same}");
        }
        assert_eq!(again["stream"]["later_bytes"], first["stream"]["later_bytes"]);
    }
    assert_eq!(read(folder.path(), "results.jsonl").lines().count(), first.len());
    // Another setting is another result.
    let other = whole(&["--resume", "--seed", "2"]);
    assert!(other.iter().zip(&first).all(|(other, first)| other["key"] != first["key"]));
}

#[test]
fn bad_input_is_refused_before_anything_is_measured() {
    let folder = folder();
    let weights = folder.path().join("weights");
    std::fs::write(&weights, [0; 9]).unwrap();
    for (more, code, says) in [
        (&["--methods", "nonesuch"][..], 2, "there are: "),
        (&["--methods", "all,ssao-plus"], 2, "not both"),
        (&["--methods", "none", "--no-streams"], 2, "nothing to measure"),
        (&["--bits", "20"], 2, "20"),
        (&["--methods", "texture-space", "--atlas", "0"], 2, "divisor"),
        (&["--crf", "52"], 2, "x264 takes 0 to 51"),
        (&["--crf", "64", "--video", "svt-av1"], 2, "svt-av1 takes 0 to 63"),
        (&["--video", "nonesuch"], 2, "svt-av1"),
        (&["--camera-lag", "late"], 2, "--camera-lag"),
        (&["--fps", "0"], 2, "above 0"),
        (&["--fps", "nan"], 2, "above 0"),
        (&["--radius", "0"], 2, "radius of 0 m"),
        (&["--radius", "nan"], 2, "radius of NaN m"),
        (&["--radius", "inf", "--table", "far-field"], 2, "radius of inf m"),
        (&["--guard", "4097"], 2, "4096"),
        (&["--size", "16384x1", "--guard", "1", "--reference-rays", "1"], 3, "guard band"),
        (&["--size", "0x1"], 2, "0x1"),
        (&["--radius", ""], 2, "--radius"),
        (&["--radius", "0.5,,1"], 2, "--radius"),
        (&["--radius", "0.5,nan"], 2, "radius of NaN"),
        (&["--radius", "0.5,0"], 2, "radius of 0 m"),
        (&["--radius", "0.5,1,0.50"], 2, "--radius has 0.5 twice"),
        (
            &["--radius", "0.1,9", "--table", "pyramid-hbao", "--methods", "all"],
            2,
            "9 m beside one of 0.1 m: hbao: directions",
        ),
        (&["--reference-rays", "0"], 2, "rays"),
        (&["--resume"], 2, "--output"),
        (&["--lpips-weights", text(&weights)], 3, "9 bytes"),
        (&["--lpips-weights", "nonesuch"], 3, "nonesuch"),
        (&["nonesuch-scene"], 3, "nonesuch-scene"),
    ] {
        let run = psao(&instead("colonnade", more));
        assert_eq!(run.code, Some(code), "{more:?}: {}{}", run.out, run.err);
        assert!(run.err.contains(says), "{more:?}: {}", run.err);
        assert_eq!(run.out, "", "{more:?}");
    }
}

#[test]
fn pictures_of_one_pixel_in_any_guard_band_are_shaded_by_all() {
    for guard in ["0", "9"] {
        let options = ["--size", "1x1", "--guard", guard, "--methods", "all", "--points", "4", "--json"];
        let run = psao(&instead("colonnade", &options));
        let coder = !run.err.contains("no ffmpeg with libx264");
        assert!(coder || std::env::var_os("PSAO_REQUIRE_FFMPEG").is_none(), "{}", run.err);
        assert_eq!((run.code, run.err.lines().count()), (Some(0), usize::from(!coder)), "{}", run.err);
        let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
        let records = document["records"].as_array().unwrap();
        let names = |kind: &str| {
            let found = records.iter().filter(|record| record["kind"] == kind);
            found.map(|record| record["name"].as_str().unwrap()).collect::<BTreeSet<_>>().len()
        };
        let counts = (names("stream"), names("screen"), names("texture"));
        assert_eq!(counts, (2, 9, usize::from(coder)), "both profiles, and every method: {document}");
        for record in records {
            let error = &record["error"];
            assert!((0.0..=1.0).contains(&error["mae"].as_f64().unwrap()), "{record}");
            assert!(error["ssim"].is_null() && error["flip"].is_f64(), "no window fits: {record}");
            assert_eq!(record["memory"]["server_bytes"].is_u64(), record["kind"] == "stream", "{record}");
        }
    }
}

#[test]
fn a_guard_band_wider_than_the_picture_changes_what_is_seen_and_no_stream() {
    let run = |guard| {
        let options = ["--size", "8x6", "--guard", guard, "--methods", "traced", "--points", "4", "--json"];
        let document: serde_json::Value =
            serde_json::from_str(&fine(&instead("colonnade", &options))).unwrap();
        assert_eq!(document["guard"].to_string(), guard);
        let errors = |kind: &str| -> Vec<serde_json::Value> {
            let records = document["records"].as_array().unwrap().iter();
            records.filter(|record| record["kind"] == kind).map(|record| record["error"].clone()).collect()
        };
        (errors("stream"), errors("screen"))
    };
    let (bare, wide) = (run("0"), run("64"));
    assert_eq!(bare.0, wide.0);
    assert_ne!(bare.1, wide.1);
}

#[test]
fn results_are_not_written_over_unasked() {
    let folder = folder();
    std::fs::write(folder.path().join("results.jsonl"), "{}\n").unwrap();
    let run = psao(&arguments(&["--out", text(folder.path())]));
    assert_eq!(run.code, Some(3));
    assert!(run.err.contains("--resume"), "{}", run.err);
    assert_eq!(read(folder.path(), "results.jsonl"), "{}\n");
}

#[test]
fn a_papers_table_has_its_own_axes_unless_they_are_given() {
    // The weight of what is hidden is by rays through the depth buffer; no streams.
    let size = ["--size", "48x27", "--frames", "2", "--pictures", "1", "--repeats", "1", "--warm-up", "0"];
    let table = |more: &[&str]| {
        let mut all = vec!["lab", "sweep", "colonnade", "--reference-rays", "8", "--json"];
        all.extend(size);
        all.extend(more);
        serde_json::from_str::<serde_json::Value>(&fine(&all)).unwrap()
    };
    let far = table(&["--table", "far-field", "--methods", "mipmap"]);
    assert_eq!(
        (&far["scenes"][0]["reference"], &far["scenes"][0]["radius_m"]),
        (&"screen".into(), &3.0.into())
    );
    assert_eq!(far["records"].as_array().unwrap().len(), 1);
    let options = [
        "--table",
        "psao-fig5",
        "--methods",
        "none",
        "--points",
        "4",
        "--fps",
        "30,60",
        "--rays",
        "8",
        "--min-points",
        "32",
    ];
    let streams = table(&options);
    assert_eq!(streams["scenes"][0]["reference"], "scene");
    let found: Vec<_> =
        streams["records"].as_array().unwrap().iter().map(|record| &record["setting"]).collect();
    assert_eq!(found.len(), 2 * 2, "two rates, two profiles: {found:?}");
    assert!(found.iter().all(|setting| setting["points_per_m2"] == 4.0 && setting["threshold"] == 8));
}

/// A run of a moment of texture-space alone; without a video coder where there is none to be found.
fn texture_space(more: &[&str], coder: bool) -> Run {
    let mut all = vec![
        "lab",
        "sweep",
        "colonnade",
        "--no-streams",
        "--size",
        "48x27",
        "--frames",
        "3",
        "--pictures",
        "1",
    ];
    all.extend(["--rays", "8", "--fps", "30", "--reference-rays", "16", "--repeats", "1", "--json"]);
    all.extend(more);
    let mut command = command(&all);
    if !coder {
        command.env("PATH", "");
    }
    command.output().unwrap().into()
}

#[test]
fn texture_space_is_measured_where_there_is_a_video_coder() {
    let methods = "texture-space,cloud-video,ssao-plus";
    let run = texture_space(&["--methods", methods, "--atlas", "16,64", "--camera-lag", "0,100"], true);
    if run.code == Some(1) && run.err.contains("no ffmpeg with libx264") {
        eprintln!("SKIPPED: {}", run.err);
        assert!(std::env::var_os("PSAO_REQUIRE_FFMPEG").is_none(), "{}", run.err);
        return;
    }
    assert_eq!((run.code, run.err.as_str()), (Some(0), ""), "{}", run.out);
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    assert!(document["machine"]["video"].as_str().unwrap().starts_with("ffmpeg "));
    let records = document["records"].as_array().unwrap();
    let textures: Vec<_> = records.iter().filter(|record| record["kind"] == "texture").collect();
    let labels = |kind: &str| -> Vec<&str> {
        let of_kind = records.iter().filter(|record| record["kind"] == kind);
        of_kind.map(|record| record["label"].as_str().unwrap()).collect()
    };
    let [exact, late] = ["8 rays, 30 Hz, x264 crf 23", "8 rays, 30 Hz, camera 100 ms late, x264 crf 23"];
    assert_eq!(
        labels("texture"),
        [format!("1/16, {exact}"), format!("1/64, {exact}"), format!("1/16, {late}")]
    );
    assert_eq!(labels("cloud"), [exact, late]);
    for record in &textures {
        let stream = &record["stream"];
        assert!(stream["wire_mbit_s"].as_f64().unwrap() >= stream["paper_mbit_s"].as_f64().unwrap());
        assert!(stream["first_state_bytes"].as_u64() > Some(0));
        assert_eq!((stream["frames"].as_u64(), record["stages"].as_array().unwrap().len()), (Some(3), 6));
    }
    assert!(textures[0]["stream"]["points"].as_u64() > textures[1]["stream"]["points"].as_u64());
    assert!(records.len() > textures.len(), "the method that was asked for, too");
}

#[test]
fn texture_space_without_a_video_coder_is_left_out_loudly() {
    let run = texture_space(&["--methods", "texture-space"], false);
    assert_eq!(run.code, Some(1), "{}", run.err);
    assert!(run.err.contains("texture-space: no ffmpeg with libx264"), "{}", run.err);
    let run = texture_space(&["--table", "psao-table1"], false);
    assert_eq!(run.code, Some(0), "{}", run.err);
    assert!(run.err.contains("texture-space is left out: no ffmpeg"), "{}", run.err);
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!(document["left_out"].as_array().unwrap().len(), 1);
    assert!(document["records"].as_array().unwrap().iter().all(|record| record["kind"] == "screen"));
}

#[test]
fn several_radii_have_references_and_sections_of_their_own() {
    let folder = folder();
    let out =
        fine(&arguments(&["--radius", "0.2,0.6", "--profile", "surface", "--out", text(folder.path())]));
    assert!(out.contains("rays of 0.2 m a pixel") && out.contains("rays of 0.6 m a pixel"), "{out}");
    let document: serde_json::Value = serde_json::from_str(&read(folder.path(), "results.json")).unwrap();
    let radii = |list: &str| -> Vec<f64> {
        let list = document[list].as_array().unwrap();
        list.iter().map(|item| item["radius_m"].as_f64().unwrap()).collect()
    };
    assert_eq!(radii("scenes"), [0.2, 0.6]);
    let (near, far): (Vec<_>, Vec<_>) =
        document["records"].as_array().unwrap().iter().partition(|record| record["radius_m"] == 0.2);
    assert_eq!(near.len(), far.len());
    let streams = near.iter().filter(|record| record["kind"] == "stream").count();
    assert_eq!(streams, 2, "two densities at each radius");
    for (near, far) in near.iter().zip(&far) {
        assert_eq!(near["label"], far["label"]);
        assert_ne!(near["key"], far["key"]);
        assert_ne!(near["error"]["mae"], far["error"]["mae"], "another reference");
    }
    let page = read(folder.path(), "report.html");
    assert!(page.contains("<h2>colonnade, R = 0.2 m</h2>") && page.contains("<h2>colonnade, R = 0.6 m</h2>"));
}

#[test]
fn the_table_of_pyramid_hbao_grows_with_the_radius() {
    let options = "lab sweep colonnade --table pyramid-hbao --radius 0.5,0.25 --size 64x36 --frames 2 --pictures 1 \
        --repeats 1 --warm-up 0 --reference-rays 8";
    let options: Vec<&str> = options.split_whitespace().collect();
    let out = fine(&options);
    assert_eq!(out.matches("rays of 0.5, 0.25 m a pixel").count(), 1, "one table: {out}");
    for name in ["pyramid-hbao", "hbao", "scalable"] {
        assert!(out.contains(&format!("{name}: ms ~ R^")), "{name}: {out}");
    }
    assert!(out.contains("hbao: ") && out.contains("samples ~ R^2.00"), "{out}");
    let json = fine(&[&options[..], &["--json", "--methods", "hbao,scalable"]].concat());
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    let records = document["records"].as_array().unwrap();
    let of = |record: &serde_json::Value| {
        let sampling = &record["sampling"];
        (
            record["name"].as_str().unwrap().to_owned(),
            sampling["directions"].as_u64(),
            sampling["along"].as_u64(),
        )
    };
    let hbao = |times: u64| ("hbao".to_owned(), Some(8 * times), Some(10 * times));
    let scalable = || ("scalable".to_owned(), None, None);
    assert_eq!(records.iter().map(of).collect::<Vec<_>>(), [hbao(2), scalable(), hbao(1), scalable()]);
    let reach = |index: usize| records[index]["reach_px"].as_f64().unwrap();
    assert!((reach(0) / reach(2) - 2.0).abs() < 1e-4, "twice as long");
}
