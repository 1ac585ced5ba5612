//! Real sockets on the loopback.

use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::*;
use crate::message::{CameraPose, CloseCode, RejectCode, Token};
use crate::recording::{Player, PlayerEvent, Reader, Summary};
use crate::sample::{SampleServer, recording};
use crate::session::{Access, ClientEvent, ClientOptions, SessionError};
use crate::{FrameType, HEADER_BYTES, Limits, StateHash, WireFrame};

mod peers;
#[cfg(feature = "tls")]
mod tls;
#[cfg(unix)]
mod unix;

const PATIENCE: Duration = Duration::from_secs(20);

/// Returns a loopback address with a port that the system chooses.
fn local() -> Address {
    "127.0.0.1:0".parse().unwrap()
}

/// Connects without credentials.
async fn dial(address: &Address) -> Result<Connection, NetError> {
    connect(address, &ConnectOptions::default(), Limits::default()).await
}

/// Starts a listener that does not speak this protocol.
async fn stranger() -> (TcpListener, Address) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string().parse().unwrap();
    (listener, address)
}

async fn start(limits: Limits) -> (Hub, Address, SampleServer) {
    let source = SampleServer::new().unwrap();
    let hub = Hub::new(source.scene().clone(), source.coder(), Access::Open, limits);
    let listener = Listener::bind(&hub, &local(), &ListenOptions::default()).await.unwrap();
    let address = listener.address().clone();
    tokio::spawn(listener.run());
    (hub, address, source)
}

/// Follows a server until it closes. Returns the state hashes and the wire frames received.
async fn follow(address: Address) -> (Vec<(u32, StateHash)>, u64) {
    let mut connection = dial(&address).await.unwrap();
    let camera = CameraPose {
        eye: [0.0, 1.0, 5.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 60.0,
        aspect: 1.0,
    };
    let (mut hashes, mut tapped) = (Vec::new(), 0);
    let mut tap = |frame: &WireFrame<'_>| tapped += frame.bytes.len() as u64;
    while let Some(event) = connection.next_event_with(&mut tap).await.unwrap() {
        match event {
            ClientEvent::Accepted(_) => connection.session().set_view(&camera).unwrap(),
            ClientEvent::Applied(frame) => {
                assert_eq!(connection.session().state().unwrap().full_hash(), frame.info.hash);
                hashes.push((frame.info.frame.0, frame.info.hash));
            }
            _ => {}
        }
    }
    assert_eq!(connection.session().stats().wire_bytes, tapped);
    (hashes, tapped)
}

/// A recorded stream is served from its file to two clients, one of which joins late. Both reach the recorded hashes.
#[tokio::test]
async fn a_recorded_stream_is_served() {
    let file = recording(8, 8).unwrap();
    assert_eq!(Summary::scan(&file, Limits::default()).unwrap().frames().len(), 8);
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
        hub.broadcast(&frame.info, record.frame.payload().to_vec(), state.into(), hub.now()).unwrap();
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

/// Clients in the same process get the same bytes without a socket, and use the hub's token.
#[tokio::test]
async fn a_client_in_the_same_process_needs_no_address() {
    let mut source = SampleServer::new().unwrap();
    let token = Token::new(*b"a token for tests").unwrap();
    let hub = Hub::new(source.scene().clone(), source.coder(), Access::Token(token), Limits::default());
    let mut connection = connect_in_process(&hub, Limits::default());
    let following = tokio::spawn(async move {
        while connection.next_event().await.unwrap().is_some() {}
        connection.session().state().unwrap().hash()
    });
    assert!(hub.wait_joined(1, PATIENCE).await);
    for _ in 0..5 {
        let frame = source.step().unwrap();
        hub.broadcast(&frame.info, frame.body, source.state().into(), hub.now()).unwrap();
        assert!(hub.wait_acked(frame.info.frame, PATIENCE).await);
    }
    hub.close(CloseCode::DONE, "enough", PATIENCE).await;
    assert_eq!(following.await.unwrap(), source.state().hash());
    let events = hub.take_events();
    assert!(matches!(events[0], HubEvent::Joined { peer: Peer::InProcess, .. }), "{events:?}");
    assert!(matches!(events[1], HubEvent::Left { error: None, .. }), "{events:?}");
}

#[test]
fn a_token_leaves_this_machine_over_tls_or_on_purpose() {
    let token = Some(Token::new(*b"a token for tests").unwrap());
    let options = ConnectOptions::default().with_session(ClientOptions { token, ..ClientOptions::default() });
    for (to, harmless) in [
        ("127.0.0.1:1", true),
        ("[::1]:1", true),
        ("[::ffff:127.0.0.1]:1", true),
        ("192.0.2.1:1", false),
        ("[2001:db8::1]:1", false),
    ] {
        let to = to.parse().unwrap();
        assert_eq!(options.may_go_in_clear(&to), harmless, "{to}");
        assert!(options.clone().with_token_in_clear(true).may_go_in_clear(&to));
        assert!(ConnectOptions::default().may_go_in_clear(&to));
    }
}

#[tokio::test]
async fn errors_say_what_to_do() {
    let (hub, ..) = start(Limits::default()).await;
    let (taken, address) = stranger().await;
    let error = Listener::bind(&hub, &address, &ListenOptions::default()).await.unwrap_err();
    assert!(matches!(error, NetError::InUse { .. }), "{error}");
    assert!(error.to_string().contains("choose another address"), "{error}");
    drop(taken);
    let error = dial(&address).await.unwrap_err();
    assert!(matches!(error, NetError::Refused { .. }), "{error}");
    assert!(error.to_string().contains("is the server running"), "{error}");
    let error = dial(&"no-such-host.invalid:1".parse().unwrap()).await.unwrap_err();
    assert!(matches!(error, NetError::Connect { .. }), "{error}");
}

#[tokio::test]
async fn peers_that_speak_something_else_are_told_apart() {
    // A web browser at the server.
    let (hub, address, _) = start(Limits::default()).await;
    let mut browser = TcpStream::connect(address.to_string()).await.unwrap();
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
        matches!(
            &left[..],
            [HubEvent::Left { error: Some(PeerError::Session(SessionError::NotPsao { found: 0x4547 })), .. }]
        ),
        "{left:?}"
    );

    // A client at a mail server.
    let (mail, address) = stranger().await;
    tokio::spawn(async move {
        let (mut stream, _) = mail.accept().await.unwrap();
        stream.write_all(b"220 mail").await.unwrap();
        let _ = stream.read(&mut [0; 100]).await;
    });
    let mut connection = dial(&address).await.unwrap();
    let error = connection.next_event().await.unwrap_err();
    assert!(error.to_string().contains("does not speak the psao protocol"), "{error}");
}

#[tokio::test]
async fn a_full_server_turns_clients_away() {
    let (_hub, address, _) = start(Limits { max_clients: 0, ..Limits::default() }).await;
    let mut connection = dial(&address).await.unwrap();
    let error = connection.next_event().await.unwrap_err();
    let NetError::Session { source: SessionError::Rejected(reject), .. } = &error else { panic!("{error}") };
    assert_eq!(reject.code, RejectCode::BUSY);
}

#[tokio::test]
async fn a_server_that_goes_away_is_noticed() {
    let (listener, address) = stranger().await;
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let _ = stream.read(&mut [0; 200]).await;
        stream.write_all(&[0x50, 0xA0, FrameType::ACCEPT.0]).await.unwrap();
    });
    let mut connection = dial(&address).await.unwrap();
    let error = loop {
        if let Err(error) = connection.next_event().await {
            break error;
        }
    };
    assert!(matches!(error, NetError::Disconnected { unfinished: 3, .. }), "{error}");
}

/// Both ends drop a silent peer at the deadline of the handshake. The test pauses tokio's clock.
#[tokio::test(start_paused = true)]
async fn a_silent_peer_runs_into_the_deadline() {
    let (_listener, address) = stranger().await;
    let mut connection = dial(&address).await.unwrap();
    let error = loop {
        if let Err(error) = connection.next_event().await {
            break error;
        }
    };
    let timeout = matches!(&error, NetError::Session { source: SessionError::HandshakeTimeout { .. }, .. });
    assert!(timeout, "{error}");

    let (_hub, address, _) = start(Limits::default()).await;
    let mut silent = TcpStream::connect(address.to_string()).await.unwrap();
    let mut answer = Vec::new();
    silent.read_to_end(&mut answer).await.unwrap();
    assert_eq!(answer.get(2), Some(&FrameType::REJECT.0));
    assert!(answer.len() > HEADER_BYTES);
}

/// The bytes that wait for a client that takes none stay under the limit, and other clients are not delayed.
#[tokio::test]
async fn a_stalled_client_costs_a_bounded_queue() {
    let limits = Limits { max_queue_bytes: 2000, ..Limits::default() };
    let (hub, address, mut source) = start(limits).await;
    let mut stalled = crate::session::ClientSession::new(Limits::default());
    let mut socket = TcpStream::connect(address.to_string()).await.unwrap();
    socket.write_all(&stalled.take_output()).await.unwrap();
    assert!(hub.wait_joined(1, PATIENCE).await);
    for _ in 0..300 {
        let frame = source.step().unwrap();
        // Without a pause the connection's task never runs, so only the queue's limit applies.
        hub.broadcast(&frame.info, frame.body, source.state().into(), hub.now()).unwrap();
        assert!(hub.queued_bytes() <= 2000, "{} bytes wait", hub.queued_bytes());
    }
}
