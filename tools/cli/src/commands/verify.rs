//! `psao verify`: every check there is on a recording.

use std::fmt;

use psao_codec::envelope::FrameError;
use psao_proto::recording::{Player, PlayerEvent, StoredIndex, Summary};
use psao_proto::{FollowError, FrameIndex, Limits};
use serde::Serialize;

use crate::args::{Format, FormatArg, RecordingArg};
use crate::context::{progress, say, say_json};
use crate::error::{Exit, Failure, Outcome};
use crate::input;
use crate::output::csv::Csv;
use crate::output::number;
use crate::output::table::Figures;

/// Check a recording: checksums, order, state hashes, index
///
/// Exit code 0: whole and correct. 3: not a recording. 4: damaged, also where parity repairs it, but the rest is
/// correct. 6: a state hash is wrong. A gap that the recorder marked, because it could not keep up, is a note and no
/// damage.
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
    /// Messages that could not be read.
    bad_messages: Vec<String>,
    /// Frames that could not be used for another reason.
    unusable: Vec<UnusableFrames>,
    damages: Vec<String>,
    /// What the recorder says that it left out.
    gaps: Vec<String>,
    has_scene: bool,
    late: u64,
}

/// Frames in a row that could not be used for the same reason.
struct UnusableFrames {
    /// Number of the first and the last, if their bodies could be parsed.
    frames: Option<(u32, u32)>,
    count: u64,
    /// Offset of the first in the file.
    offset: u64,
    reason: FollowError,
}

impl UnusableFrames {
    /// Returns whether a frame goes on where these end.
    fn go_on(&self, frame: Option<FrameIndex>, reason: &FollowError) -> bool {
        let follows = self.frames.zip(frame).is_some_and(|((_, last), next)| next.0 == last.wrapping_add(1));
        follows && std::mem::discriminant(&self.reason) == std::mem::discriminant(reason)
    }
}

impl fmt::Display for UnusableFrames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.frames {
            Some((first, last)) if first != last => {
                write!(f, "{} frames, {first} to {last}, from offset {}", self.count, self.offset)?;
            }
            Some((frame, _)) => write!(f, "frame {frame} at offset {}", self.offset)?,
            None => write!(f, "a frame at offset {}", self.offset)?,
        }
        write!(f, ": {}", self.reason)
    }
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
    let (bytes, repaired) = input::recording_with_repairs(path)?;
    let refused = |error| Failure::input(format_args!("{}: {error}", path.display()));
    let summary = Summary::scan(&bytes, Limits::default()).map_err(refused)?;
    let mut player = Player::new(&bytes, Limits::default()).map_err(refused)?;
    let played = play(&mut player, summary.frames().len() as u64);
    let repairs = input::repairs(&repaired);
    let checks = [
        ("checksums of all records", checksums(&played.damages, repairs.as_deref())),
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
        ("frame bodies", bodies(&played)),
        ("a damaged byte would cost", Verdict::Pass(cost(&summary))),
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
                let frames = frame.map(|frame| (frame.0, frame.0));
                let unusable = UnusableFrames { frames, count: 1, offset, reason };
                if matches!(unusable.reason, FollowError::Body(FrameError::Hash { .. })) {
                    played.mismatched.push(unusable.to_string());
                } else {
                    played.unusable(unusable, frame);
                }
            }
            PlayerEvent::BadMessage { offset, error } => {
                played.bad_messages.push(format!("message at offset {offset}: {error}"));
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

impl Played {
    /// Counts a frame, with those before it where it goes on.
    fn unusable(&mut self, unusable: UnusableFrames, frame: Option<FrameIndex>) {
        match self.unusable.last_mut() {
            Some(last) if last.go_on(frame, &unusable.reason) => {
                last.count += 1;
                last.frames = last.frames.zip(frame).map(|((first, _), next)| (first, next.0));
            }
            _ => self.unusable.push(unusable),
        }
    }
}

fn checksums(damages: &[String], repairs: Option<&str>) -> Verdict {
    let places: Vec<&str> = damages.iter().map(String::as_str).chain(repairs).collect();
    if places.is_empty() {
        Verdict::Pass("every byte is accounted for".to_owned())
    } else {
        Verdict::LossError(places.join("\n"))
    }
}

fn bodies(played: &Played) -> Verdict {
    let unusable = played.unusable.iter().map(ToString::to_string);
    let mut places: Vec<String> = unusable.chain(played.bad_messages.iter().cloned()).collect();
    if played.frames == 0 {
        places.push("no frame can be played".to_owned());
    }
    if places.is_empty() {
        Verdict::Pass("all read and applied".to_owned())
    } else {
        Verdict::LossError(places.join("\n"))
    }
}

/// Returns what one damaged byte would cost, in words.
fn cost(summary: &Summary) -> String {
    let frames = summary.frames();
    let covered = frames.iter().take_while(|frame| frame.offset < summary.parity_end()).count();
    let group = frames.chunk_by(|_, next| !next.keyframe).map(<[_]>::len).max().unwrap_or(0) as u64;
    let group = format!("up to {}, to the next keyframe", number::counted(group, "frame"));
    match covered {
        0 => format!("{group}; all in the scene table"),
        covered if covered == frames.len() => "nothing: parity covers every frame".to_owned(),
        covered => format!(
            "nothing in the first {}, by parity; then {group}",
            number::counted(covered as u64, "frame")
        ),
    }
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
            format_args!(
                "{}: damaged: {lost}; {} can still be played",
                path.display(),
                number::counted(played.frames, "frame")
            ),
        ));
    }
    Ok(())
}
