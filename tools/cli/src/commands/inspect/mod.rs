//! `psao inspect`: where the bytes of a recording went.

mod csv;
mod json;
mod table;

use std::path::PathBuf;

pub(crate) use self::table::{PART_HEADS, part_rows, summary_lines};
use crate::analysis::{Analysis, PARTS};
use crate::args::{Format, FormatArg, RecordingArg};
use crate::error::{Exit, Failure, Outcome};
use crate::input;
use crate::output::number;
use crate::output::plot::{Bar, Plot};
use crate::output::target::{self, Content};

/// Show where the bytes of a recording went
///
/// Every byte of the file is counted once, in a part of a frame or as overhead. A damaged recording is read as far as it is
/// whole; the exit code is then 4. docs/inspect-json.md describes the JSON; CSV has a row for each frame.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao inspect a.psao
  psao inspect a.psao --per-frame --plot a.svg
  psao inspect a.psao --format json")]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// Print a row for every frame as well
    #[arg(long)]
    per_frame: bool,
    #[command(flatten)]
    format: FormatArg,
    /// Draw bytes per frame, stacked by part, into this SVG file; - for standard output
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let path = &args.recording.file;
    if let Some(place) = &args.plot {
        target::check(place, &Content::SVG)?;
    }
    let analysis = Analysis::of(path, &input::recording(path)?)?;
    if let Some(place) = &args.plot {
        let title = format!("Bytes per frame: {}", path.file_name().unwrap_or_default().to_string_lossy());
        target::write(place, plot(&analysis, title).svg().as_bytes())?;
    }
    if !args.plot.as_deref().is_some_and(target::is_standard) {
        match args.format.get() {
            Format::Table => table::print(&analysis, args.per_frame)?,
            Format::Json => json::print(&analysis)?,
            Format::Csv => csv::print(&analysis)?,
        }
    }
    loss(&analysis)
}

/// Returns the bandwidth plot of a recording.
pub(crate) fn plot(analysis: &Analysis, title: String) -> Plot {
    let used: Vec<usize> = used(analysis).collect();
    Plot {
        title,
        parts: used.iter().map(|&part| PARTS[part].to_owned()).collect(),
        bars: analysis
            .frames
            .iter()
            .map(|line| Bar {
                frame: line.frame,
                key: line.key,
                bytes: used.iter().map(|&part| line.parts[part]).collect(),
            })
            .collect(),
        fps: analysis.fps(),
    }
}

/// Returns a failure with exit code 4 when something was left out.
pub(crate) fn loss(analysis: &Analysis) -> Outcome {
    if analysis.is_whole() {
        return Ok(());
    }
    let places: Vec<String> =
        analysis.damages.iter().map(ToString::to_string).chain(analysis.unreadable.iter().cloned()).collect();
    Err(Failure::new(
        Exit::DataLoss,
        format_args!(
            "{} left out: {}",
            number::counted(places.len() as u64, "damaged place"),
            places.join("; ")
        ),
    ))
}

/// Returns the parts that some frame has.
fn used(analysis: &Analysis) -> impl Iterator<Item = usize> + '_ {
    (0..PARTS.len()).filter(|&part| analysis.frames.iter().any(|line| line.parts[part] > 0))
}
