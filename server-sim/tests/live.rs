//! The live loop, with a client in the same process and a recording, against a server that steps.

#![expect(clippy::unwrap_used, clippy::panic, reason = "this is a test, its helpers included")]

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use psao_codec::StateHash;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::surface::Budget;
use psao_proto::message::{Close, CloseCode, Edit, EditAction};
use psao_proto::net::{Hub, connect_in_process};
use psao_proto::recording::file::{Recorder, RecorderOptions, RecordingOutcome};
use psao_proto::recording::{Player, PlayerEvent};
use psao_proto::session::{Access, ClientEvent};
use psao_proto::sinks::Sinks;
use psao_proto::{Limits, Micros, Profile};
use psao_server::ao::AoSettings;
use psao_server::clock::NoClock;
use psao_server::points::PointSettings;
use psao_server::scene::Scene;
use psao_server::server::live::{Pipeline, PipelineError, PipelineSettings};
use psao_server::server::{Server, ServerSettings};

const FRAMES: u32 = 8;
/// The frame before which the scene is edited.
const EDITED: u32 = 3;
const EDIT: Edit = Edit { instance: 1, action: EditAction::Hide };
const PATIENCE: Duration = Duration::from_secs(60);

/// Few points and rays.
fn settings(scene: &Scene, profile: Profile) -> ServerSettings {
    ServerSettings::default()
        .with_profile(profile)
        .with_coder(if profile == Profile::PAPER { BlockCoder::Lz4 } else { BlockCoder::Range })
        .with_points(PointSettings::default().with_per_m2(8.0).with_minimum(32).with_seed(3))
        .with_ao(AoSettings::default().with_rays(16).with_radius(scene.ao_radius_m()))
}

fn scene() -> Arc<Scene> {
    Arc::new(Scene::load("colonnade").unwrap())
}

fn server(scene: &Arc<Scene>, settings: ServerSettings) -> Server {
    Server::new(Arc::clone(scene), settings, Arc::new(|_| ())).unwrap()
}

fn time(frame: u32) -> StreamTime {
    StreamTime(u64::from(frame) * 100_000)
}

/// Hashes of the frames that a server writes step by step.
fn stepped(scene: &Arc<Scene>, settings: ServerSettings, frames: u32, edits: bool) -> Vec<StateHash> {
    let mut server = server(scene, settings);
    let step = |frame: u32| {
        if edits && frame == EDITED {
            assert_eq!(server.trace_stage().edit(&EDIT), Ok(true));
        }
        server.step(FrameIndex(frame), time(frame), &[], &NoClock).unwrap().info.hash
    };
    (0..frames).map(step).collect()
}

/// What is in a recording: the hash of each frame, the number of frames before each edit, and how many gaps, budgets and
/// reports there are.
#[derive(Debug, Default)]
struct Recorded {
    frames: Vec<(u32, StateHash)>,
    edits: Vec<usize>,
    gaps: u64,
    budgets: usize,
    reports: usize,
    closed: Option<CloseCode>,
}

fn play(bytes: &[u8]) -> Recorded {
    let mut player = Player::new(bytes, Limits::default()).unwrap();
    let mut recorded = Recorded::default();
    while let Some(event) = player.next_event() {
        match event {
            PlayerEvent::Frame(frame) => recorded.frames.push((frame.info.frame.0, frame.info.hash)),
            PlayerEvent::Edit(edit) => {
                assert_eq!(edit, EDIT);
                recorded.edits.push(recorded.frames.len());
            }
            PlayerEvent::Gap(_) => recorded.gaps += 1,
            PlayerEvent::Budget(_) => recorded.budgets += 1,
            PlayerEvent::Report(report) => {
                assert_eq!(report.stages.len(), 6);
                recorded.reports += 1;
            }
            PlayerEvent::Closed(close) => recorded.closed = Some(close.code),
            PlayerEvent::Scene(_) => {}
            other => panic!("{other:?}"),
        }
    }
    recorded
}

fn end(sinks: Sinks) -> RecordingOutcome {
    sinks.finish(&Close::new(CloseCode::STOPPED, "the test is over")).unwrap().unwrap()
}

/// Runs a live server with a client and a recording; returns the hashes that the client had, and before how many of them the
/// scene was edited.
async fn serve(server: Server, path: &Path) -> (Vec<StateHash>, Vec<usize>) {
    let table = server.table().clone();
    let hub = Hub::new(table.clone(), server.coder(), Access::Open, Limits::default());
    let recorder = Recorder::create(path, RecorderOptions::default()).unwrap();
    let sinks = Sinks::new().with_hub(hub.clone()).with_recorder(recorder, &table).unwrap();
    let mut client = connect_in_process(&hub, Limits::default());
    let follow = tokio::spawn(async move {
        let (mut hashes, mut edits) = (Vec::new(), Vec::new());
        while let Some(event) = client.next_event().await.unwrap() {
            match event {
                ClientEvent::Applied(frame) => hashes.push(frame.info.hash),
                ClientEvent::Edited(_) => edits.push(hashes.len()),
                _ => {}
            }
        }
        (hashes, edits)
    });
    assert!(hub.wait_joined(1, PATIENCE).await);
    let settings = PipelineSettings::default().with_timings(true);
    let mut pipeline = Pipeline::new(server, sinks, settings).unwrap();
    for frame in 0..FRAMES {
        if frame == EDITED {
            assert_eq!(pipeline.edit(&EDIT), Ok(true));
            assert_eq!(pipeline.edit(&EDIT), Ok(false), "it is hidden already");
        }
        tokio::task::block_in_place(|| {
            pipeline.frame(FrameIndex(frame), time(frame), &[], hub.now()).unwrap();
        });
    }
    let (sinks, late) = tokio::task::block_in_place(|| pipeline.finish()).unwrap();
    assert_eq!(late.frames, 0, "there is no budget of rays");
    assert!(hub.wait_acked(FrameIndex(FRAMES - 1), PATIENCE).await);
    hub.close(CloseCode::STOPPED, "the test is over", PATIENCE).await;
    assert_eq!(end(sinks).bytes, path.metadata().unwrap().len());
    follow.await.unwrap()
}

#[test]
fn clients_and_the_recording_get_what_a_server_writes_that_steps() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let scene = scene();
    let surface = settings(&scene, Profile::SURFACE);
    let budget = surface.with_budget(Some(Budget::new(4_000).with_longest_age(9)));
    for settings in [surface, budget, settings(&scene, Profile::PAPER)] {
        let path = folder.path().join("live.psao");
        let expected = stepped(&scene, settings, FRAMES, true);
        let (hashes, edits) = runtime.block_on(serve(server(&scene, settings), &path));
        assert_eq!(hashes, expected);
        assert_eq!(edits, [EDITED as usize]);
        let recorded = play(&std::fs::read(&path).unwrap());
        assert_eq!(recorded.frames, (0..).zip(expected).collect::<Vec<_>>());
        assert_eq!((recorded.edits, recorded.gaps), (vec![EDITED as usize], 0));
        assert_eq!(recorded.reports, FRAMES as usize);
        assert_eq!(recorded.budgets, if settings.budget.is_some() { FRAMES as usize } else { 0 });
        assert_eq!(recorded.closed, Some(CloseCode::STOPPED));
    }
}

/// A pipe that nobody reads stands for a disk that is slow.
#[cfg(unix)]
#[test]
fn a_keyframe_ends_a_gap_of_the_recording() {
    use std::io::Read as _;

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let scene = scene();
    for profile in [Profile::SURFACE, Profile::PAPER] {
        // The first frame is longer than a pipe holds.
        let settings = settings(&scene, profile);
        let points = settings.points.with_per_m2(200.0);
        let settings = settings.with_points(points).with_ao(settings.ao.with_rays(1));
        let server = server(&scene, settings);
        let (start, wait) = std::sync::mpsc::channel();
        let place = path.clone();
        let (read, progress) = std::sync::mpsc::channel();
        let reader = std::thread::spawn(move || {
            let mut pipe = std::fs::File::open(place).unwrap();
            wait.recv().unwrap();
            let (mut bytes, mut chunk) = (Vec::new(), vec![0; 1 << 16]);
            loop {
                match pipe.read(&mut chunk).unwrap() {
                    0 => return bytes,
                    count => bytes.extend_from_slice(&chunk[..count]),
                }
                let _ = read.send(bytes.len());
            }
        });
        let table = server.table().clone();
        let options = RecorderOptions::default().with_buffer_bytes(1);
        let recorder = Recorder::create(&path, options).unwrap();
        let sinks = Sinks::new().with_recorder(recorder, &table).unwrap();
        let mut pipeline = Pipeline::new(server, sinks, PipelineSettings::default()).unwrap();
        let mut frame = |number: u32| {
            pipeline.frame(FrameIndex(number), time(number), &[], Micros(0)).unwrap();
        };
        (0..4).for_each(&mut frame);
        start.send(()).unwrap();
        // Until all of the first frame is read, and the pipe is empty for a while.
        while progress.recv_timeout(Duration::from_millis(500)).is_ok() {}
        (4..FRAMES).for_each(|number| {
            frame(number);
            while progress.recv_timeout(Duration::from_millis(100)).is_ok() {}
        });
        let missing = end(pipeline.finish().unwrap().0).missing;
        let recorded = play(&reader.join().unwrap());
        assert!(missing.frames > 0, "{missing:?}");
        assert_eq!(recorded.gaps, missing.gaps);
        assert_eq!(recorded.frames.len() as u64 + missing.frames, u64::from(FRAMES));
        let expected = stepped(&scene, settings, FRAMES, false);
        for (frame, hash) in &recorded.frames {
            assert_eq!(*hash, expected[*frame as usize], "{profile}, frame {frame}");
        }
        assert_eq!(recorded.frames.last().unwrap().0, FRAMES - 1, "it went on after the gap");
    }
}

#[test]
fn rays_follow_from_the_frame_time() {
    let scene = scene();
    let settings = PipelineSettings::default().with_frame_time(Some(Micros(1)));
    let server = server(&scene, self::settings(&scene, Profile::SURFACE));
    let mut pipeline = Pipeline::new(server, Sinks::new(), settings).unwrap();
    for frame in 0..FRAMES {
        pipeline.frame(FrameIndex(frame), time(frame), &[], Micros(0)).unwrap();
    }
    let late = pipeline.late_points();
    assert!(late.frames > 0 && late.points > 0 && late.oldest > 0, "{late:?}");
    assert_eq!(pipeline.finish().unwrap().1, late);
}

#[test]
fn a_frame_that_cannot_be_encoded_stops_the_pipeline_and_is_named_at_the_end() {
    let scene = scene();
    let server = server(&scene, settings(&scene, Profile::SURFACE));
    let mut pipeline = Pipeline::new(server, Sinks::new(), PipelineSettings::default()).unwrap();
    // The numbers of frames must grow.
    let mut frames = (0..100).map(|_| pipeline.frame(FrameIndex(0), time(0), &[], Micros(0)));
    assert!(matches!(frames.find_map(Result::err), Some(PipelineError::Stopped)));
    assert!(matches!(pipeline.finish(), Err(PipelineError::Server(_))));
}
