//! `psao cut`: a piece of a recording that stands alone.

use psao_proto::recording::{Bounds, cut};
use psao_proto::{FrameIndex, Limits, StreamTime};

use super::recover::rewrite;
use crate::args::{OutputArg, RecordingArg};
use crate::error::{Failure, Outcome};
use crate::quantity::TimeSpan;

/// Cut a piece out of a recording: it stands alone and plays to the same hashes
///
/// The piece starts with the scene table, the edits that hold, and a keyframe of the state at its first frame; the frames
/// after it are as they were, byte for byte. Exit code 4: damage in the range was left out.
#[derive(clap::Args, Debug)]
#[command(group(clap::ArgGroup::new("range").required(true).multiple(true)))]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// Start at this time of the stream
    #[arg(long, value_name = "TIME", group = "range", conflicts_with_all = ["from_frame", "to_frame"])]
    from: Option<TimeSpan>,
    /// End at this time of the stream, itself included
    #[arg(long, value_name = "TIME", group = "range", conflicts_with_all = ["from_frame", "to_frame"])]
    to: Option<TimeSpan>,
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
    let from = args.from.map_or(StreamTime(0), TimeSpan::stream_time);
    let to = args.to.map_or(StreamTime(u64::MAX), TimeSpan::stream_time);
    if from > to {
        return Err(Failure::usage("the range is empty: --to is before --from"));
    }
    Ok(Bounds::Time(from, to))
}
