//! `psao cut`: a piece of a recording that stands alone.

use psao_proto::recording::{Bounds, cut};
use psao_proto::{FrameIndex, Limits, StreamTime};

use super::recover::rewrite;
use crate::args::{OutputArg, RecordingArg};
use crate::error::{Failure, Outcome};

/// Cut a piece out of a recording: it stands alone and plays to the same hashes
///
/// The piece starts with the scene table, the edits that hold, and a keyframe of the state at its first frame; the frames
/// after it are as they were, byte for byte. Exit code 4: damage in the range was left out.
#[derive(clap::Args, Debug)]
#[command(group(clap::ArgGroup::new("range").required(true).multiple(true)))]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// From this time of the stream on, in seconds
    #[arg(long, value_name = "T", group = "range", conflicts_with_all = ["from_frame", "to_frame"])]
    from: Option<f64>,
    /// Up to this time of the stream, in seconds, itself included
    #[arg(long, value_name = "T", group = "range", conflicts_with_all = ["from_frame", "to_frame"])]
    to: Option<f64>,
    /// From this frame on
    #[arg(long, value_name = "N", group = "range")]
    from_frame: Option<u32>,
    /// Up to this frame, itself included
    #[arg(long, value_name = "N", group = "range")]
    to_frame: Option<u32>,
    #[command(flatten)]
    output: OutputArg,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let bounds = bounds(args)?;
    rewrite(&args.recording.file, &args.output.output, |bytes, put| {
        cut(bytes, &bounds, Limits::default(), put)
    })
}

fn bounds(args: &Args) -> Outcome<Bounds> {
    if args.from_frame.is_some() || args.to_frame.is_some() {
        let (from, to) = (args.from_frame.unwrap_or(0), args.to_frame.unwrap_or(u32::MAX));
        if from > to {
            return Err(Failure::usage(format_args!(
                "the range is empty: --to-frame {to} is before --from-frame {from}"
            )));
        }
        return Ok(Bounds::Frames(FrameIndex(from), FrameIndex(to)));
    }
    let from = args.from.map_or(Ok(StreamTime(0)), |from| stream_time("--from", from))?;
    let to = args.to.map_or(Ok(StreamTime(u64::MAX)), |to| stream_time("--to", to))?;
    if from > to {
        return Err(Failure::usage("the range is empty: --to is before --from"));
    }
    Ok(Bounds::Time(from, to))
}

/// Seconds as they are typed.
pub(crate) fn stream_time(name: &str, seconds: f64) -> Outcome<StreamTime> {
    if !(seconds.is_finite() && seconds >= 0.0) {
        return Err(Failure::usage(format_args!("{name} {seconds} is not a time in seconds, 0 or later")));
    }
    Ok(StreamTime((seconds * 1e6).round() as u64))
}
