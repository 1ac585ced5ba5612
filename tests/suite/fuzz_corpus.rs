//! Replays every file of the committed fuzz corpora through its target's body.

use std::fs;
use std::path::Path;

/// Body of a fuzz target, which takes the bytes of a file.
type Body = fn(&[u8]);

/// Targets of `fuzz/` and their bodies.
const TARGETS: [(&str, Body); 7] = [
    ("frame", psao_codec::fuzzing::decode),
    ("round_trip", psao_codec::fuzzing::round_trip),
    ("framer", psao_proto::fuzzing::framer),
    ("recording", psao_proto::fuzzing::recording),
    ("session", psao_proto::fuzzing::session),
    ("surface_decode", psao_codec::fuzzing::surface_decode),
    ("surface_round_trip", psao_codec::fuzzing::surface_round_trip),
];

fn fuzz() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz"))
}

/// Returns the sorted names in a folder of `fuzz/`.
fn names(folder: &str) -> Vec<String> {
    let entries = fs::read_dir(fuzz().join(folder)).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn every_corpus_file_passes_its_target() {
    for (target, body) in TARGETS {
        let files = names(&format!("corpus/{target}"));
        assert!(!files.is_empty(), "the corpus of {target} is empty");
        for file in files {
            let bytes = fs::read(fuzz().join("corpus").join(target).join(&file)).unwrap();
            println!("{target}/{file}");
            body(&bytes);
        }
    }
}

#[test]
fn every_target_has_a_corpus_and_is_replayed() {
    let mut expected: Vec<String> = TARGETS.iter().map(|(target, _)| (*target).to_owned()).collect();
    expected.sort();
    assert_eq!(names("corpus"), expected);
    let sources: Vec<String> = expected.iter().map(|target| format!("{target}.rs")).collect();
    assert_eq!(names("fuzz_targets"), sources);
}

/// The committed seeds equal those that `cargo run -p psao-proto --features testing --example corpus -- fuzz/corpus`
/// writes.
#[test]
fn the_seeds_are_up_to_date() {
    for seed in psao_proto::fuzzing::seeds().unwrap() {
        let path = fuzz().join("corpus").join(seed.target).join(seed.name);
        assert_eq!(fs::read(&path).unwrap(), seed.bytes, "{} is old: write the seeds again", path.display());
    }
}
