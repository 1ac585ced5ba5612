//! `psao client`: follows a server without drawing anything.

use std::path::PathBuf;

use psao_proto::message::{CameraPose, CloseCode, Edit, EditAction};
use psao_proto::net::Address;
use psao_proto::session::{ClientEvent, ClientOptions};
use psao_server::scene::Scene;

use crate::args::{FormatArg, Triple};
use crate::context::runtime;
use crate::edit_script::EditScript;
use crate::error::{Exit, Failure, Outcome};
use crate::network::{ConnectArgs, peer, stop};
use crate::output::frames::FrameLog;
use crate::output::latency::Latencies;
use crate::output::number;

/// Follow a server, and print figures and a checksum of each frame
///
/// The client ends when the server does, after --frames, or with Ctrl-C. It does not apply a frame whose state hash
/// differs; it asks for a keyframe, goes on, and ends with exit code 6. At the end it prints percentiles of latency: from the
/// server's scene to the frame sent, received and applied, measured by the server's clock.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao client 127.0.0.1:4700
  psao client 127.0.0.1:4700 --frames 60 --format csv")]
pub(crate) struct Args {
    /// Address of a server (`psao serve` or `psao replay --listen`): host:port, tls:host:port or unix:PATH
    #[arg(value_name = "ADDR")]
    address: Address,
    #[command(flatten)]
    network: ConnectArgs,
    /// Refuse a stream of any other scene: built-in name (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE")]
    scene: Option<String>,
    /// Script of edits, as for `psao record --edits`; each is sent once the client has the frame that it names
    #[arg(long, value_name = "SCRIPT", requires = "scene")]
    edits: Option<PathBuf>,
    /// Stop after this number of frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Camera position in metres; the server keeps what this camera sees up to date
    #[arg(long, value_name = "X,Y,Z", requires = "target")]
    eye: Option<Triple>,
    /// Point that the camera looks at, in metres
    #[arg(long, value_name = "X,Y,Z", requires = "eye")]
    target: Option<Triple>,
    /// Up direction of its picture [default: 0,1,0; 0,0,-1 for a camera that looks straight up or down]
    #[arg(long, value_name = "X,Y,Z", requires = "eye", allow_hyphen_values = true)]
    up: Option<Triple>,
    #[command(flatten)]
    format: FormatArg,
    /// Print the totals only
    #[arg(long)]
    quiet: bool,
}

pub(crate) fn run(args: &Args) -> Outcome {
    runtime()?.block_on(follow(args))
}

fn view(args: &Args) -> Option<CameraPose> {
    let (eye, target) = (args.eye?.0, args.target?.0);
    let up = args.up.map_or_else(|| CameraPose::usual_up(eye, target), |up| up.0);
    Some(CameraPose { eye, target, up, fov_y_deg: 60.0, aspect: 16.0 / 9.0 })
}

/// What the client has of the scene: its digest, and when to change it.
fn session(args: &Args) -> Outcome<(ClientOptions, EditScript)> {
    let mut options = ClientOptions::default().with_stamps(true);
    let mut script = EditScript::default();
    if let Some(scene) = &args.scene {
        let scene = Scene::load(scene).map_err(Failure::input)?;
        options.scene = Some(*scene.digest());
        if let Some(path) = &args.edits {
            script = EditScript::load(path, &scene, None)?;
        }
    }
    Ok((options, script))
}

async fn follow(args: &Args) -> Outcome {
    let (options, mut script) = session(args)?;
    let mut connection = args.network.connect(&args.address, options).await?;
    let mut log = FrameLog::new(args.format.get(), args.quiet)?;
    let mut latencies = Latencies::default();
    let mut mismatches = 0_u64;
    let mut goodbye = String::new();
    let stop = stop();
    tokio::pin!(stop);
    loop {
        let event = tokio::select! {
            event = connection.next_event() => event.map_err(peer)?,
            () = &mut stop => {
                connection.session().close(CloseCode::DONE, "the client stops");
                // A server that is gone does not mind.
                let _ = connection.flush().await;
                break;
            }
        };
        let Some(event) = event else { break };
        let now = connection.now();
        latencies.take(connection.session(), &event, now);
        match event {
            ClientEvent::SceneReady(_) => {
                if let Some(view) = view(args) {
                    connection.session().set_view(&view).map_err(Failure::usage)?;
                }
            }
            ClientEvent::Applied(frame) => {
                log.frame(&frame.info, frame.wire_bytes)?;
                for edit in script.take_until(frame.info.frame.0) {
                    connection.session().edit(&edit).map_err(Failure::input)?;
                }
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
            ClientEvent::Budget(budget) => log.budget(&budget),
            ClientEvent::Edited(edit) => eprintln!("psao: {}", describe(&edit)),
            ClientEvent::Accepted(_) | ClientEvent::Report(_) => {}
        }
    }
    log.finish(&goodbye)?;
    if let Some(summary) = latencies.summary(connection.session()) {
        log.latency(&summary)?;
    }
    if mismatches > 0 {
        return Err(Failure::new(
            Exit::Check,
            format_args!("{} with a state hash that differs", number::counted(mismatches, "frame")),
        ));
    }
    Ok(())
}

fn describe(edit: &Edit) -> String {
    let what = match edit.action {
        EditAction::Move { translation: [x, y, z], .. } => format!("was moved to {x} {y} {z}"),
        EditAction::Release => "follows its animation again".to_owned(),
        EditAction::Show => "is shown".to_owned(),
        EditAction::Hide => "is hidden".to_owned(),
    };
    format!("instance {} {what}", edit.instance)
}
