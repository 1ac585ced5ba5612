//! `psao verify`: every check there is on a recording.

use psao_codec::envelope::FrameError;
use psao_proto::recording::{Player, PlayerEvent, StoredIndex, Summary};
use psao_proto::{FollowError, Limits};
use serde::Serialize;

use crate::analysis::load;
use crate::args::{Format, FormatArg, RecordingArg};
use crate::context::{progress, say, say_json};
use crate::error::{Exit, Failure, Outcome};
use crate::output::csv::Csv;
use crate::output::number;
use crate::output::table::Figures;

/// Check a recording: checksums, order, state hashes, index
///
/// Exit code 0: whole and correct. 3: not a recording. 4: damaged, but the rest is correct. 6: a state hash is wrong. A gap
/// that the recorder marked, because it could not keep up, is a note and no damage.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  psao verify a.psao")]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    #[command(flatten)]
    format: FormatArg,
}

/// All checks, for programs.
#[derive(Serialize)]
struct Document {
    schema: &'static str,
    frames: u64,
    keyframes: u64,
    checks: Vec<Row>,
}

/// A check and its outcome.
#[derive(Serialize)]
struct Row {
    check: String,
    /// `ok`, `note`, `DAMAGED` or `WRONG`.
    result: String,
    found: String,
}

/// What playing the whole recording showed.
#[derive(Default)]
struct Played {
    frames: u64,
    keyframes: u64,
    /// Hashes computed from scratch that differ from the running one.
    drifted: Vec<u32>,
    /// Frames whose hash says that client and server would disagree.
    mismatched: Vec<String>,
    /// Frames and messages that could not be used for another reason.
    unusable: Vec<String>,
    damages: Vec<String>,
    /// What the recorder says that it left out.
    gaps: Vec<String>,
    has_scene: bool,
    late: u64,
}

/// The outcome of one check.
enum Verdict {
    Pass(String),
    /// True, and worth knowing, but nothing is wrong.
    Note(String),
    LossError(String),
    Wrong(String),
}

pub(crate) fn run(args: &Args) -> Outcome {
    let path = &args.recording.file;
    let bytes = load(path)?;
    let refused = |error| Failure::input(format_args!("{}: {error}", path.display()));
    let summary = Summary::scan(&bytes, Limits::default()).map_err(refused)?;
    let mut player = Player::new(&bytes, Limits::default()).map_err(refused)?;
    let played = play(&mut player, summary.index().len() as u64);
    let checks = [
        ("checksums of all records", losses(&played.damages, "every byte is accounted for")),
        (
            "scene table",
            if played.has_scene {
                Verdict::Pass("whole".into())
            } else {
                Verdict::LossError("missing".into())
            },
        ),
        ("frames in order", in_order(&player)),
        (
            "gaps that the recorder marked",
            if played.gaps.is_empty() {
                Verdict::Pass("none".into())
            } else {
                Verdict::Note(played.gaps.join("\n"))
            },
        ),
        ("frame bodies", losses(&played.unusable, "all read and applied")),
        ("state hash after every frame", wrongs(&played.mismatched, played.frames)),
        ("hash from scratch at keyframes and the end", drift(&played.drifted)),
        (
            "arrival times",
            if played.late == 0 {
                Verdict::Pass("never go back".into())
            } else {
                Verdict::Note(format!("go back {}", number::counted(played.late, "time")))
            },
        ),
        ("index", index(summary.stored_index())),
        (
            "ending",
            match summary.close() {
                Some(close) => Verdict::Pass(format!("closed: {}", close.text)),
                None => {
                    Verdict::Note("no CLOSE: the recorder was stopped, or the file is cut at a frame".into())
                }
            },
        ),
    ];
    print(args.format.get(), &played, &checks)?;
    judge(path, &played, &checks)
}

fn play(player: &mut Player<'_>, frames: u64) -> Played {
    let mut played = Played::default();
    let bar = progress("verifying", frames);
    let mut last_arrival = 0;
    while let Some(event) = player.next_event() {
        match event {
            PlayerEvent::Scene(_) => played.has_scene = true,
            PlayerEvent::Frame(frame) => {
                bar.inc(1);
                played.frames += 1;
                played.late += u64::from(frame.arrival.0 < last_arrival);
                last_arrival = frame.arrival.0;
                if frame.header.sequence.0 == 0 {
                    played.keyframes += 1;
                    check_from_scratch(player, frame.info.frame.0, &mut played);
                }
            }
            PlayerEvent::Unusable { offset, frame, reason, .. } => {
                let name = frame.map_or_else(|| "a frame".to_owned(), |frame| format!("frame {}", frame.0));
                let text = format!("{name} at offset {offset}: {reason}");
                if matches!(reason, FollowError::Body(FrameError::Hash { .. })) {
                    played.mismatched.push(text);
                } else {
                    played.unusable.push(text);
                }
            }
            PlayerEvent::BadMessage { offset, error } => {
                played.unusable.push(format!("message at offset {offset}: {error}"));
            }
            PlayerEvent::Damage(damage) => played.damages.push(damage.to_string()),
            PlayerEvent::Gap(gap) => played.gaps.push(gap.to_string()),
            PlayerEvent::Report(_)
            | PlayerEvent::Budget(_)
            | PlayerEvent::Closed(_)
            | PlayerEvent::Edit(_) => {}
        }
    }
    bar.finish_and_clear();
    if let Some(frame) = player.state().and_then(psao_codec::State::frame) {
        check_from_scratch(player, frame.0, &mut played);
    }
    played
}

fn check_from_scratch(player: &Player<'_>, frame: u32, played: &mut Played) {
    if player.state().is_some_and(|state| state.full_hash() != state.hash()) {
        played.drifted.push(frame);
    }
}

fn losses(places: &[String], fine: &str) -> Verdict {
    if places.is_empty() { Verdict::Pass(fine.to_owned()) } else { Verdict::LossError(places.join("\n")) }
}

fn wrongs(places: &[String], frames: u64) -> Verdict {
    if places.is_empty() {
        Verdict::Pass(format!("correct after each of {frames}"))
    } else {
        Verdict::Wrong(places.join("\n"))
    }
}

fn drift(frames: &[u32]) -> Verdict {
    if frames.is_empty() {
        Verdict::Pass("agrees with the running hash".to_owned())
    } else {
        Verdict::Wrong(format!("differs after frames {frames:?}"))
    }
}

fn in_order(player: &Player<'_>) -> Verdict {
    match player.stats().lost {
        0 => Verdict::Pass("none missing".to_owned()),
        lost => Verdict::LossError(format!("{lost} missing")),
    }
}

fn index(stored: StoredIndex) -> Verdict {
    match stored {
        StoredIndex::Agrees => Verdict::Pass("agrees with the file".to_owned()),
        StoredIndex::Missing => Verdict::Note("none; readers scan the file".to_owned()),
        StoredIndex::Differs => Verdict::LossError("does not fit the file; readers scan the file".to_owned()),
    }
}

fn print(format: Format, played: &Played, checks: &[(&str, Verdict)]) -> Outcome {
    let row = |(check, verdict): &'_ (&'_ str, Verdict)| {
        let (result, found) = match verdict {
            Verdict::Pass(text) => ("ok", text),
            Verdict::Note(text) => ("note", text),
            Verdict::LossError(text) => ("DAMAGED", text),
            Verdict::Wrong(text) => ("WRONG", text),
        };
        [(*check).to_owned(), result.to_owned(), found.clone()]
    };
    let rows = checks.iter().map(row);
    match format {
        Format::Table => {
            let mut table = Figures::new(["check", "result", "what was found"]).words(&[1, 2]);
            rows.for_each(|row| table.row(row));
            say(table)?;
            say(format_args!(
                "{} applied, with {}",
                number::counted(played.frames, "frame"),
                number::counted(played.keyframes, "keyframe")
            ))
        }
        Format::Json => say_json(&Document {
            schema: "psao-verify/1",
            frames: played.frames,
            keyframes: played.keyframes,
            checks: rows.map(|[check, result, found]| Row { check, result, found }).collect(),
        }),
        Format::Csv => {
            let mut csv = Csv::new(["check", "result", "found"])?;
            for row in rows {
                csv.row(row)?;
            }
            csv.finish()
        }
    }
}

/// Returns the failure that the checks stand for.
fn judge(path: &std::path::Path, played: &Played, checks: &[(&str, Verdict)]) -> Outcome {
    let failed = |wrong: bool| {
        checks
            .iter()
            .filter(|(_, verdict)| {
                if wrong {
                    matches!(verdict, Verdict::Wrong(_))
                } else {
                    matches!(verdict, Verdict::LossError(_))
                }
            })
            .map(|(name, _)| *name)
            .collect::<Vec<_>>()
            .join(", ")
    };
    let (wrong, lost) = (failed(true), failed(false));
    if !wrong.is_empty() {
        return Err(Failure::new(Exit::Check, format_args!("{}: wrong: {wrong}", path.display())));
    }
    if !lost.is_empty() {
        return Err(Failure::new(
            Exit::DataLoss,
            format_args!("{}: damaged: {lost}; {} frames can still be played", path.display(), played.frames),
        ));
    }
    Ok(())
}
