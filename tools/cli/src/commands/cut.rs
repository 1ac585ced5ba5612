//! `psao cut`: a piece of a recording that stands alone.

use psao_proto::recording::{Bounds, cut};
use psao_proto::{FrameIndex, Limits, StreamTime};

use super::recover::rewrite;
use crate::args::{OutputArg, RecordingArg};
use crate::error::{Failure, Outcome};
use crate::quantity::TimeSpan;

/// Copy a range of a recording into a file that stands alone
///
/// The copy starts with the scene table, the edits in force, and a keyframe of the state at its first frame. Later frames
/// are copied byte for byte, so it plays to the same state hashes. Exit code 4 means that damage in the range was left out.
#[derive(clap::Args, Debug)]
#[command(
    override_usage = "psao cut <FILE> -o <FILE> [--from <TIME>] [--to <TIME>]\n       psao cut <FILE> -o <FILE> [--from-frame <N>] [--to-frame <N>]"
)]
#[command(group(clap::ArgGroup::new("range").required(true).multiple(true)))]
#[command(after_help = "Examples:
  psao cut a.psao --from 1s --to 3s -o piece.psao
  psao cut a.psao --from-frame 60 -o rest.psao")]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// Start at this time of the stream
    #[arg(long, value_name = "TIME", group = "range", conflicts_with_all = ["from_frame", "to_frame"])]
    from: Option<TimeSpan>,
    /// End at this time of the stream, itself included
    #[arg(long, value_name = "TIME", group = "range", conflicts_with_all = ["from_frame", "to_frame"])]
    to: Option<TimeSpan>,
    /// Start at this frame
    #[arg(long, value_name = "N", group = "range")]
    from_frame: Option<u32>,
    /// End at this frame, itself included
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
    let from = args.from.map_or(StreamTime(0), TimeSpan::stream_time);
    let to = args.to.map_or(StreamTime(u64::MAX), TimeSpan::stream_time);
    if from > to {
        return Err(Failure::usage("the range is empty: --to is before --from"));
    }
    Ok(Bounds::Time(from, to))
}
