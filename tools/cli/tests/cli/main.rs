//! Whole runs of the `psao` command, as a person or a script makes them.
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test says what it expected by panicking"
)]

mod bad_input;
mod budgets;
mod cache;
mod command_line;
mod crashes;
mod edits;
mod lab_network;
mod live;
mod main_job;
mod needs;
mod network;
mod packings;
mod profiles;
mod rays;
mod recordings;
mod sweep;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// What a run printed and how it ended.
#[derive(Debug)]
pub struct Run {
    /// Exit code; none after a signal.
    pub code: Option<i32>,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl From<Output> for Run {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// The command with these arguments.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_psao"));
    command.args(arguments).env_remove("PSAO_TOKEN");
    // One cache for the tests, none of the user's own.
    static CACHE: OnceLock<tempfile::TempDir> = OnceLock::new();
    command.env("XDG_CACHE_HOME", CACHE.get_or_init(folder).path()).env_remove("HOME");
    command
}

/// Runs it to its end.
pub fn psao(arguments: &[&str]) -> Run {
    command(arguments).output().expect("psao starts").into()
}

/// Runs it and expects success.
pub fn fine(arguments: &[&str]) -> String {
    let run = psao(arguments);
    assert_eq!(run.code, Some(0), "psao {arguments:?}: {}{}", run.out, run.err);
    assert_eq!(run.err, "", "quiet off a terminal: {arguments:?}");
    run.out
}

/// Options that make a stream small enough to be traced in a moment.
pub const SMALL: [&str; 6] = ["--points", "4", "--min-points", "32", "--rays", "8"];
/// Frames of [`recording`].
pub const FRAMES: u32 = 12;

/// A folder for a test, removed when it is dropped.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Text of a path.
pub fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are UTF-8")
}

/// `--profile`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// The paper's cells and buckets.
    Paper,
    /// Points at rest; the default.
    Surface,
}

impl Profile {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Surface];

    /// As it is typed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Surface => "surface",
        }
    }
}

/// A recording of `colonnade` that the tests share.
pub fn recording(profile: Profile) -> &'static Path {
    static SHARED: [OnceLock<(tempfile::TempDir, PathBuf)>; 2] = [const { OnceLock::new() }; 2];
    let (_, path) = SHARED[profile as usize].get_or_init(|| {
        let folder = folder();
        let path = folder.path().join("colonnade.psao");
        record("colonnade", profile, &[], &path);
        (folder, path)
    });
    path
}

/// Records a small stream.
pub fn record(scene: &str, profile: Profile, more: &[&str], path: &Path) {
    let frames = FRAMES.to_string();
    let mut arguments = vec!["record", "--scene", scene, "--profile", profile.name(), "--frames", &frames];
    arguments.extend(["--threshold", "2", "--unseen-threshold", "2", "-o", text(path)]);
    arguments.extend(SMALL);
    arguments.extend(more);
    fine(&arguments);
}

/// `(frame, state hash)` of every line of a CSV listing.
pub fn hashes(csv: &str) -> Vec<(String, String)> {
    let mut lines = csv.lines();
    let heads: Vec<&str> = lines.next().expect("a head line").split(',').collect();
    let column = |name: &str| heads.iter().position(|head| *head == name).expect("the column is there");
    let (frame, hash) = (column("frame"), column("state_hash"));
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            (cells[frame].to_owned(), cells[hash].to_owned())
        })
        .collect()
}
