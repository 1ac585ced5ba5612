//! `psao cat`: recordings one after the other.

use std::path::PathBuf;

use psao_proto::Limits;
use psao_proto::recording::Concatenation;

use super::recover::{ended, refused};
use crate::args::OutputArg;
use crate::error::Outcome;
use crate::input;
use crate::output::number;
use crate::output::target::{self, Target};

/// Join recordings, one after the other
///
/// Frames keep their numbers and times; arrival times continue after the last one. A scene table is repeated only where it
/// differs. Exit code 4 means that damage was left out.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  psao cat a.psao b.psao -o both.psao")]
pub(crate) struct Args {
    /// Recordings made by `psao record`, in order; - reads standard input
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    output: OutputArg,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let mut out = Target::create(&args.output.output, &args.files)?;
    let mut length = 0;
    let put = |bytes: &[u8]| {
        length += bytes.len() as u64;
        out.put(bytes)
    };
    let target = args.output.output.as_path();
    let mut all = Concatenation::new(Limits::default(), put).map_err(|error| refused(target, error))?;
    let mut parts = Vec::new();
    for path in &args.files {
        // One at a time: only the one being read is in memory.
        let bytes = input::recording(path)?;
        parts.push((path.as_path(), all.add(&bytes).map_err(|error| refused(path, error))?));
    }
    all.finish().map_err(|error| refused(target, error))?;
    out.finish()?;
    target::note(
        target,
        format_args!(
            "wrote {}: {} of {}, {}",
            target::name(target),
            number::counted(parts.iter().map(|(_, part)| part.frames).sum(), "frame"),
            number::counted(parts.len() as u64, "recording"),
            number::bytes(length)
        ),
    )?;
    ended(&parts)
}
