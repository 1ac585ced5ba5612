//! `psao netlab`: rows, JSON, and what is wrong on the command line.

use serde_json::Value;

use super::{FRAMES, Profile, fine, psao, recording, text};

const ROUGH: [&str; 12] = [
    "lab",
    "network",
    "--loss",
    "0,5%",
    "--delay",
    "40ms",
    "--jitter",
    "5ms",
    "--reset",
    "3s",
    "--seconds",
    "6",
];

#[test]
fn a_row_for_each_combination_and_the_same_twice() {
    let json = [&ROUGH[..], &["--format", "json", "--clients", "2"]].concat();
    let first = fine(&json);
    assert_eq!(first, fine(&json));
    let document: Value = serde_json::from_str(&first).unwrap();
    assert_eq!(document["schema"], "psao-netlab/1");
    let rows = document["rows"].as_array().unwrap();
    let order: Vec<_> =
        rows.iter().map(|row| (row["conditions"]["loss"].as_u64(), row["mode"].as_str())).collect();
    let [stream, datagram] = [Some("stream"), Some("datagram")];
    assert_eq!(
        order,
        [(Some(0), stream), (Some(0), datagram), (Some(50_000), stream), (Some(50_000), datagram)]
    );
    for row in rows {
        assert_eq!(
            (&row["report"]["wrong_hashes"], &row["faults"][0]["reset"]["at"]),
            (&0.into(), &3_000_000.into())
        );
        for client in row["report"]["clients"].as_array().unwrap() {
            assert_eq!((&client["reconnects"], &client["unrecovered"]), (&1.into(), &0.into()));
        }
    }
    let seeds = [&json[..], &["--seed", "2"]].concat();
    assert_ne!(first, fine(&seeds));

    let table = fine(&ROUGH);
    assert_eq!(table.lines().filter(|line| line.contains("/360 ")).count(), 4, "{table}");
}

#[test]
fn a_recording_is_replayed_to_its_end() {
    for profile in Profile::ALL {
        let file = text(recording(profile));
        let json = fine(&["lab", "network", file, "--mode", "stream", "--delay", "1ms", "--format", "json"]);
        let document: Value = serde_json::from_str(&json).unwrap();
        let report = &document["rows"][0]["report"];
        assert_eq!(report["frames"], FRAMES);
        assert!(
            report["applied"].as_u64().is_some_and(|applied| applied >= u64::from(FRAMES) - 2),
            "{report}"
        );
        assert_eq!(report["wrong_hashes"], 0);
    }
}

#[test]
fn nonsense_is_refused_with_words() {
    for (arguments, says) in [
        (["--loss", "120%"], "at most 100%"),
        (["--delay", "40"], "40ms or 40s"),
        (["--rate", "2"], "2Mbit/s"),
        (["--stall", "3s"], "3s@10s"),
        (["--mtu", "20B"], "20 bytes"),
        (["--queue", "100B"], "queue of 100"),
        (["--fps", "0"], "--fps 0"),
    ] {
        let run = psao(&[&["lab", "network"], &arguments[..]].concat());
        assert!(run.code == Some(2) && run.err.contains(says), "{arguments:?}: {:?} {}", run.code, run.err);
    }
    let run = psao(&["lab", "network", "Cargo.toml"]);
    assert!(run.code == Some(3) && run.err.contains("Cargo.toml"), "{}", run.err);
}
