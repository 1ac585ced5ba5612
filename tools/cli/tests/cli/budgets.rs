//! Byte budgets, from the options to what is printed.

use crate::live::Server;
use crate::{FRAMES, Profile, SMALL, fine, folder, psao, record, recording, text};

fn json(arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&fine(arguments)).expect("JSON")
}

fn number(value: &serde_json::Value) -> u64 {
    value.as_u64().expect("a number")
}

#[test]
fn a_recording_says_what_its_budget_left_for_later() {
    let folder = folder();
    let [path, again] = ["a.psao", "b.psao"].map(|name| folder.path().join(name));
    for path in [&path, &again] {
        record("colonnade", Profile::Surface, &["--budget", "80B", "--longest-age", "3"], path);
    }
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&again).unwrap(), "same options, same bytes");
    fine(&["verify", text(&path)]);
    let document = json(&["inspect", text(&path), "--format", "json"]);
    let frames = document["frames"].as_array().unwrap();
    let mut postponed = 0;
    for frame in frames {
        let parts = frame["parts"].as_object().unwrap();
        assert!(number(&parts["budget"]) > 0);
        assert_eq!(parts.values().map(number).sum::<u64>(), number(&frame["wire_bytes"]));
        let budget = &frame["budget"];
        assert_eq!(number(&budget["bytes"]), 80);
        assert!(number(&budget["oldest"]) <= 3);
        assert!(number(&budget["used"]) <= 80 || number(&budget["forced"]) > 0 || frame["kind"] == "key");
        postponed += number(&budget["postponed"]);
    }
    let totals = &document["totals"]["budget"];
    assert_eq!((number(&totals["frames"]), number(&totals["postponed"])), (FRAMES.into(), postponed));
    assert!(postponed > 0);
    let table = fine(&["inspect", text(&path), "--per-frame"]);
    assert!(table.contains("Budget of 80 B a frame") && table.contains("forced"), "{table}");
    let csv = fine(&["inspect", text(&path), "--format", "csv"]);
    let columns = |line: &str| line.split(',').count();
    assert!(csv.lines().all(|line| columns(line) == columns(csv.lines().next().unwrap())), "{csv}");
    let free = fine(&["inspect", text(recording(Profile::Surface)), "--per-frame", "--format", "csv"]);
    assert!(free.lines().skip(1).all(|line| line.ends_with(",,,,")), "{free}");
}

#[test]
fn a_recording_with_few_rays_is_the_same_every_time_and_says_what_waited() {
    let folder = folder();
    let [path, again] = ["a.psao", "b.psao"].map(|name| folder.path().join(name));
    let mut arguments = vec!["record", "--scene", "robot-lab", "--frames", "12", "--ray-budget", "1000"];
    arguments.extend(SMALL);
    arguments.extend(["-o", text(&path)]);
    let summary = fine(&arguments);
    assert!(summary.contains("points a frame waited for rays"), "{summary}");
    *arguments.last_mut().unwrap() = text(&again);
    fine(&arguments);
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&again).unwrap(), "same options, same bytes");
    fine(&["verify", text(&path)]);
    assert!(!fine(&["inspect", text(&path)]).contains("trace"), "no times unless asked for");
    arguments.push("--timings");
    fine(&arguments);
    let table = fine(&["inspect", text(&again)]);
    assert!(table.contains("trace") && table.contains("95 of 100"), "{table}");
    assert_eq!(
        psao(&["record", "--scene", "robot-lab", "--ray-budget", "0", "-o", text(&path)]).code,
        Some(2)
    );
}

#[test]
fn a_client_hears_of_the_budget() {
    let mut arguments = vec!["serve", "--scene", "colonnade", "--frames", "4", "--budget", "100kbit/s"];
    arguments.extend(["--fps", "30", "--threshold", "1"]);
    arguments.extend(SMALL);
    let (server, address) = Server::start(&arguments);
    let run = psao(&["client", &address, "--quiet"]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    // 100,000 bits in 30 frames, less what is around a frame.
    assert!(run.out.contains(" B a frame") && run.out.contains("Budget of 3"), "{}", run.out);
    assert_eq!(server.wait(), Some(0));
}

#[test]
fn budgets_that_cannot_be_are_refused() {
    let folder = folder();
    let path = folder.path().join("a.psao");
    let refused = |more: &[&str]| {
        let mut arguments = vec!["record", "--scene", "colonnade", "--frames", "2", "-o", text(&path)];
        arguments.extend(SMALL);
        arguments.extend(more);
        let run = psao(&arguments);
        assert_eq!(run.code, Some(2), "{more:?}: {}", run.err);
        run.err
    };
    assert!(refused(&["--budget", "500B", "--profile", "paper"]).contains("choose profile surface"));
    assert!(refused(&["--budget", "63B"]).contains("64 B or more"));
    assert!(refused(&["--budget", "1kbit/s"]).contains("no such frame can be"));
    assert!(refused(&["--budget", "much"]).contains("500kbit/s"));
}

#[test]
fn less_budget_means_fewer_bytes_and_more_error() {
    // Exact, so that the order in which points arrive makes no difference.
    let mut arguments = vec!["lab", "budgets", "--scene", "colonnade", "--frames", "12", "--threshold", "1"];
    arguments.extend(["--shares", "100%,70%", "--format", "json"]);
    arguments.extend(SMALL);
    let rows = json(&arguments);
    let rows = rows.as_array().unwrap();
    let figures = |name: &str| rows.iter().map(|row| row[name].as_f64().unwrap()).collect::<Vec<_>>();
    assert_eq!(figures("share"), [0.0, 100.0, 70.0]);
    assert!(figures("bytes_a_frame").is_sorted_by(|a, b| a >= b), "{rows:?}");
    assert!(figures("mean").is_sorted() && figures("mean")[2] > figures("mean")[0], "{rows:?}");
    assert_eq!((number(&rows[0]["max"]), number(&rows[0]["budget"]["frames"])), (0, 0));
    // What is written without a budget is what is recorded.
    let folder = folder();
    let path = folder.path().join("a.psao");
    let mut arguments = vec!["record", "--scene", "colonnade", "--frames", "12", "-o", text(&path)];
    arguments.extend(["--threshold", "1", "--unseen-threshold", "1"]);
    arguments.extend(SMALL);
    fine(&arguments);
    let recorded = json(&["inspect", text(&path), "--format", "json"]);
    let parts = &recorded["totals"]["later_parts"];
    let bodies = number(&parts["changes"]) + number(&parts["header"]);
    let mean = bodies as f64 / f64::from(FRAMES - 1);
    assert!((figures("bytes_a_frame")[0] - mean).abs() < 1e-6, "{mean} {rows:?}");
}
