//! `psao client`: follows a server without drawing anything.

use psao_proto::Limits;
use psao_proto::message::{CameraPose, CloseCode};
use psao_proto::net::connect;
use psao_proto::session::ClientEvent;

use crate::args::{Format, Triple};
use crate::context::runtime;
use crate::error::{Exit, Failure, Outcome};
use crate::output::frames::FrameLog;

/// Follow a server: state hash and figures of every frame
///
/// Ends when the server does, after --frames, or with Ctrl-C. A frame whose hash differs is not applied; the client asks
/// for a keyframe, goes on, and ends with exit code 6.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Address of a server (`psao serve` or `psao replay --listen`)
    #[arg(value_name = "ADDR")]
    address: String,
    /// Leave after so many frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Look from here (metres): the server keeps what this camera sees up to date
    #[arg(long, value_name = "X,Y,Z", requires = "target")]
    eye: Option<Triple>,
    /// Look at this place
    #[arg(long, value_name = "X,Y,Z", requires = "eye")]
    target: Option<Triple>,
    /// How to print: table, json (a line per frame) or csv
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
    /// Totals alone
    #[arg(long)]
    quiet: bool,
}

pub(crate) fn run(args: &Args) -> Outcome {
    runtime()?.block_on(follow(args))
}

/// A network failure.
pub(crate) fn peer(error: impl std::fmt::Display) -> Failure {
    Failure::new(Exit::Peer, error)
}

fn view(args: &Args) -> Option<CameraPose> {
    let (eye, target) = (args.eye?.0, args.target?.0);
    Some(CameraPose { eye, target, up: [0.0, 1.0, 0.0], fov_y_deg: 60.0, aspect: 16.0 / 9.0 })
}

async fn follow(args: &Args) -> Outcome {
    let mut connection = connect(&args.address, Limits::default()).await.map_err(peer)?;
    let mut log = FrameLog::new(args.format, args.quiet)?;
    let mut mismatches = 0_u64;
    let mut goodbye = String::new();
    while !connection.session().is_closed() {
        for event in connection.next_events().await.map_err(peer)? {
            match event {
                ClientEvent::SceneReady(_) => {
                    if let Some(view) = view(args) {
                        connection.session().set_view(&view).map_err(Failure::usage)?;
                    }
                }
                ClientEvent::Applied(frame) => {
                    log.frame(&frame.info, frame.wire_bytes)?;
                    if args.frames == Some(log.frames) {
                        connection.session().close(CloseCode::DONE, "seen enough");
                        connection.flush().await.map_err(peer)?;
                        break;
                    }
                }
                ClientEvent::HashMismatch { frame, expected, found } => {
                    mismatches += 1;
                    eprintln!(
                        "psao: frame {}: the server's state hash is {:016x}, this client's would be {:016x}; \
                         asked for a keyframe",
                        frame.0, expected.0, found.0
                    );
                }
                ClientEvent::Unusable { header, reason } => {
                    eprintln!(
                        "psao: {} {} not applied: {reason}; asked for a keyframe",
                        header.kind, header.sequence.0
                    );
                }
                ClientEvent::Closed(close) => goodbye = format!("; the server says: {}", close.text),
                ClientEvent::Accepted(_) | ClientEvent::Report(_) => {}
            }
        }
    }
    log.finish(&goodbye)?;
    if mismatches > 0 {
        return Err(Failure::new(
            Exit::Check,
            format_args!("{mismatches} frame(s) had a state hash that differs"),
        ));
    }
    Ok(())
}
