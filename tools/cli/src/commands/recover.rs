//! `psao recover`: what is whole of a damaged recording.

use std::path::Path;

use psao_proto::Limits;
use psao_proto::recording::{RewriteError, RewriteOutcome, recover};

use crate::args::{OutputArg, RecordingArg};
use crate::error::{Exit, Failure, Outcome};
use crate::input;
use crate::output::number;
use crate::output::target::{self, Target};

/// Copy the undamaged part of a broken recording, with a new index
///
/// Damage is dropped, and with it the frames that build on what is lost, so the copy plays without an error. A mark in the
/// copy shows where something is missing, and every loss is listed. Exit code 0: nothing was lost. 4: something was.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  psao recover broken.psao -o whole.psao")]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// Also keep undamaged frames that cannot be applied because of damage before them
    #[arg(long)]
    keep_all: bool,
    #[command(flatten)]
    output: OutputArg,
}

pub(crate) fn run(args: &Args) -> Outcome {
    rewrite(&args.recording.file, &args.output.output, |bytes, put| {
        recover(bytes, args.keep_all, Limits::default(), put)
    })
}

/// Makes a recording from another. `make` gets the bytes of the one, and a function that takes those of the other.
pub(crate) fn rewrite(
    path: &Path,
    output: &Path,
    make: impl FnOnce(&[u8], &mut dyn FnMut(&[u8]) -> Outcome) -> Result<RewriteOutcome, RewriteError<Failure>>,
) -> Outcome {
    let bytes = input::recording(path)?;
    let mut out = Target::create(output, &[path.to_owned()])?;
    let mut length = 0;
    let mut put = |bytes: &[u8]| {
        length += bytes.len() as u64;
        out.put(bytes)
    };
    let done = make(&bytes, &mut put).map_err(|error| refused(path, error))?;
    out.finish()?;
    target::note(
        output,
        format_args!(
            "wrote {}: {}, {}",
            target::name(output),
            number::counted(done.frames, "frame"),
            number::bytes(length)
        ),
    )?;
    ended(&[(path, done)])
}

/// Returns the failure to make a recording from this one.
pub(crate) fn refused(path: &Path, error: RewriteError<Failure>) -> Failure {
    let exit = match error {
        RewriteError::Put(failure) => return failure,
        RewriteError::Reader(_) | RewriteError::Range(_) => Exit::Input,
        _ => Exit::System,
    };
    Failure::new(exit, format_args!("{}: {error}", path.display()))
}

/// Most places that are listed for a recording.
const LISTED: usize = 20;

/// Prints what the recordings have lost; returns a failure with exit code 4 if anything is.
pub(crate) fn ended(parts: &[(&Path, RewriteOutcome)]) -> Outcome {
    let (mut frames, mut bytes, mut places) = (0, 0, 0);
    for (path, part) in parts {
        for loss in part.losses.iter().take(LISTED) {
            eprintln!("psao: {}: {loss}", path.display());
        }
        if part.losses.len() > LISTED {
            eprintln!("psao: {}: and {} more places", path.display(), part.losses.len() - LISTED);
        }
        frames += part.lost_frames;
        bytes += part.lost_bytes;
        places += part.losses.len();
    }
    if places == 0 && frames == 0 {
        return Ok(());
    }
    Err(Failure::new(
        Exit::DataLoss,
        format_args!(
            "left out {} at {}, {} as far as known",
            number::bytes(bytes),
            number::counted(places as u64, "place"),
            number::counted(frames, "frame")
        ),
    ))
}
