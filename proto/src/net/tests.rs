//! Real sockets on the loopback.

use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::*;
use crate::message::{CameraPose, CloseCode, RejectCode};
use crate::recording::{Player, PlayerEvent, Reader, load_index};
use crate::sample::{SampleServer, recording};
use crate::session::{ClientEvent, SessionError};
use crate::{FrameType, HEADER_BYTES, Limits, StateHash};

const PATIENCE: Duration = Duration::from_secs(20);

async fn start(limits: Limits) -> (Hub, String, SampleServer) {
    let source = SampleServer::new().unwrap();
    let hub = Hub::new(source.scene().clone(), limits);
    let listener = Listener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    tokio::spawn(listener.run(hub.clone()));
    (hub, address, source)
}

/// Follows a server until it closes; the hashes of the frames, and the wire frames as they came.
async fn follow(address: String) -> (Vec<(u32, StateHash)>, u64) {
    let mut connection = connect(&address, Limits::default()).await.unwrap();
    let camera = CameraPose {
        eye: [0.0, 1.0, 5.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 60.0,
        aspect: 1.0,
    };
    let (mut hashes, mut tapped) = (Vec::new(), 0);
    while !connection.session().is_closed() {
        for event in
            connection.next_events_with(&mut |frame| tapped += frame.bytes.len() as u64).await.unwrap()
        {
            match event {
                ClientEvent::Accepted(_) => connection.session().set_view(&camera).unwrap(),
                ClientEvent::Applied(frame) => {
                    assert_eq!(connection.session().state().unwrap().full_hash(), frame.info.hash);
                    hashes.push((frame.info.frame.0, frame.info.hash));
                }
                _ => {}
            }
        }
    }
    assert_eq!(connection.session().stats().wire_bytes, tapped);
    (hashes, tapped)
}

/// A recorded stream is served from its file to two clients, one of them late; both end up with the recorded hashes.
#[tokio::test]
async fn a_recorded_stream_is_served() {
    let file = recording(8, 8).unwrap();
    assert_eq!(load_index(&file, Limits::default()).unwrap().len(), 8);
    let (hub, address, _) = start(Limits::default()).await;
    let early = tokio::spawn(follow(address.clone()));
    assert!(hub.wait_joined(1, PATIENCE).await);
    let mut late = None;
    let mut player = Player::new(&file, Limits::default()).unwrap();
    let mut expected = Vec::new();
    while let Some(event) = player.next_event() {
        let PlayerEvent::Frame(frame) = event else { continue };
        if frame.info.frame.0 == 5 {
            late = Some(tokio::spawn(follow(address.clone())));
            assert!(hub.wait_joined(2, PATIENCE).await);
        }
        let record = {
            let mut reader = Reader::new(&file).unwrap();
            reader.seek(frame.offset);
            reader.next().unwrap().unwrap()
        };
        let state = player.state().unwrap();
        let meta = psao_codec::frame::FrameMeta {
            kind: psao_codec::frame::FrameKind::Key,
            frame: frame.info.frame,
            time: frame.info.time,
            changed_points: 0,
        };
        let coder = psao_codec::block::BlockCoder::default();
        hub.broadcast(&frame.info, record.frame.payload(), || {
            psao_codec::stream::keyframe(state, meta, coder, &[])
        })
        .unwrap();
        assert!(
            hub.wait_acked(frame.info.frame, PATIENCE).await,
            "frame {} was not acknowledged",
            frame.info.frame
        );
        expected.push((frame.info.frame.0, frame.info.hash));
    }
    assert_eq!(hub.views().len(), 2);
    hub.close(CloseCode::DONE, "the recording is over", PATIENCE).await;
    assert_eq!(early.await.unwrap().0, expected);
    assert_eq!(late.unwrap().await.unwrap().0, expected[5..]);
    let events = hub.take_events();
    assert_eq!(events.iter().filter(|e| matches!(e, HubEvent::Joined { .. })).count(), 2);
    assert_eq!(events.iter().filter(|e| matches!(e, HubEvent::Left { error: None, .. })).count(), 2);
}

#[tokio::test]
async fn errors_say_what_to_do() {
    let taken = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let error = Listener::bind(&address).await.unwrap_err();
    assert!(matches!(error, NetError::InUse { .. }), "{error}");
    assert!(error.to_string().contains("choose another port"), "{error}");
    drop(taken);
    let error = connect(&address, Limits::default()).await.unwrap_err();
    assert!(matches!(error, NetError::Refused { .. }), "{error}");
    assert!(error.to_string().contains("is the server running"), "{error}");
    let error = connect("no port here", Limits::default()).await.unwrap_err();
    assert!(matches!(error, NetError::Connect { .. }), "{error}");
}

#[tokio::test]
async fn peers_that_speak_something_else_are_told_apart() {
    // A web browser at the server.
    let (hub, address, _) = start(Limits::default()).await;
    let mut browser = TcpStream::connect(&address).await.unwrap();
    browser.write_all(b"GET / HTTP/1.1\r\n\r\n").await.unwrap();
    let mut answer = Vec::new();
    browser.read_to_end(&mut answer).await.unwrap();
    assert!(answer.is_empty());
    drop(browser);
    let mut left = hub.take_events();
    while left.is_empty() {
        tokio::task::yield_now().await;
        left = hub.take_events();
    }
    assert!(
        matches!(&left[..], [HubEvent::Left { error: Some(SessionError::NotPsao { found: 0x4547 }), .. }]),
        "{left:?}"
    );

    // A client at a mail server.
    let mail = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = mail.local_addr().unwrap().to_string();
    tokio::spawn(async move {
        let (mut stream, _) = mail.accept().await.unwrap();
        stream.write_all(b"220 mail").await.unwrap();
        let _ = stream.read(&mut [0; 100]).await;
    });
    let mut connection = connect(&address, Limits::default()).await.unwrap();
    let error = connection.next_events().await.unwrap_err();
    assert!(error.to_string().contains("does not speak the psao protocol"), "{error}");
}

#[tokio::test]
async fn a_full_server_turns_clients_away() {
    let (_hub, address, _) = start(Limits { max_clients: 0, ..Limits::default() }).await;
    let mut connection = connect(&address, Limits::default()).await.unwrap();
    let error = connection.next_events().await.unwrap_err();
    let NetError::Session { source: SessionError::Rejected(reject), .. } = &error else { panic!("{error}") };
    assert_eq!(reject.code, RejectCode::BUSY);
}

#[tokio::test]
async fn a_server_that_goes_away_is_noticed() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let _ = stream.read(&mut [0; 200]).await;
        stream.write_all(&[0x50, 0xA0, FrameType::ACCEPT.0]).await.unwrap();
    });
    let mut connection = connect(&address, Limits::default()).await.unwrap();
    let error = loop {
        if let Err(error) = connection.next_events().await {
            break error;
        }
    };
    assert!(matches!(error, NetError::Disconnected { unfinished: 3, .. }), "{error}");
}

/// A silent peer is dropped at the handshake's deadline, on both sides. The clock is tokio's, and paused.
#[tokio::test(start_paused = true)]
async fn a_silent_peer_runs_into_the_deadline() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let mut connection = connect(&address, Limits::default()).await.unwrap();
    let error = loop {
        if let Err(error) = connection.next_events().await {
            break error;
        }
    };
    let timeout = matches!(&error, NetError::Session { source: SessionError::HandshakeTimeout { .. }, .. });
    assert!(timeout, "{error}");

    let (_hub, address, _) = start(Limits::default()).await;
    let mut silent = TcpStream::connect(&address).await.unwrap();
    let mut answer = Vec::new();
    silent.read_to_end(&mut answer).await.unwrap();
    assert_eq!(answer.get(2), Some(&FrameType::REJECT.0));
    assert!(answer.len() > HEADER_BYTES);
}

/// A client that joins and then takes nothing: what waits for it stays under the limit, and others are not held up.
#[tokio::test]
async fn a_stalled_client_costs_a_bounded_queue() {
    let limits = Limits { max_queue_bytes: 2000, ..Limits::default() };
    let (hub, address, mut source) = start(limits).await;
    let mut stalled = crate::session::ClientSession::new(Limits::default());
    let mut socket = TcpStream::connect(&address).await.unwrap();
    socket.write_all(&stalled.take_output()).await.unwrap();
    assert!(hub.wait_joined(1, PATIENCE).await);
    for _ in 0..300 {
        let frame = source.step().unwrap();
        // Without a pause between, the connection's task never runs: the queue alone must hold.
        hub.broadcast(&frame.info, &frame.body, || source.keyframe()).unwrap();
        assert!(hub.queued_bytes() <= 2000, "{} bytes wait", hub.queued_bytes());
    }
}
