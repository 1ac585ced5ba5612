//! `--cache` and `--no-cache`: nothing of a stream depends on them.

use std::path::PathBuf;

use crate::{SMALL, command, fine, folder, psao, text};

#[test]
fn a_stream_is_the_same_with_points_that_were_kept() {
    let place = folder();
    let cache = place.path().join("cache");
    let record = |name: &str, options: &[&str]| {
        let out = place.path().join(name);
        let head = ["record", "--scene", "robot-lab", "--frames", "2", "-o", text(&out)];
        let run = psao(&[&head[..], &SMALL, options].concat());
        assert_eq!(run.code, Some(0), "{}", run.err);
        (std::fs::read(out).unwrap(), run.err)
    };
    let kept = || -> Vec<PathBuf> {
        std::fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().path()).collect()
    };
    let (expected, _) = record("none.psao", &["--no-cache"]);
    assert!(!cache.exists());
    let on = ["--cache", text(&cache)];
    for name in ["made.psao", "found.psao"] {
        assert_eq!(record(name, &on), (expected.clone(), String::new()), "{name}");
        assert_eq!(kept().len(), 1);
    }
    // The other profile and fewer rays have the same points.
    record("paper.psao", &[&on[..], &["--profile", "paper"]].concat());
    assert_eq!(kept().len(), 1);

    let file = &kept()[0];
    let good = std::fs::read(file).unwrap();
    for bad in [&good[..good.len() / 2], b"", b"something else"] {
        std::fs::write(file, bad).unwrap();
        let (found, said) = record("again.psao", &on);
        assert!(said.contains("is not used") && said.contains(text(file)), "{said}");
        assert_eq!((found, std::fs::read(file).unwrap()), (expected.clone(), good.clone()));
    }
}

#[test]
fn a_folder_that_cannot_be_written_costs_a_note_and_no_more() {
    let place = folder();
    let file = place.path().join("file");
    std::fs::write(&file, "no folder").unwrap();
    let out = place.path().join("a.psao");
    let head = ["record", "--scene", "colonnade", "--frames", "1", "-o", text(&out), "--cache", text(&file)];
    let run = psao(&[&head[..], &SMALL].concat());
    assert_eq!(run.code, Some(0), "{}", run.err);
    assert!(run.err.contains("--no-cache"), "{}", run.err);
    fine(&["verify", text(&out)]);
}

#[test]
fn the_environment_names_the_folder() {
    let place = folder();
    let out = place.path().join("a.psao");
    let head = ["record", "--scene", "colonnade", "--frames", "1", "-o", text(&out)];
    let run = command(&[&head[..], &SMALL].concat()).env("XDG_CACHE_HOME", place.path()).output().unwrap();
    assert!(run.status.success());
    assert_eq!(std::fs::read_dir(place.path().join("psao")).unwrap().count(), 1);
}
