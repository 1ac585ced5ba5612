//! Bad peers over real sockets: each ends with the right message, is reported once, and does not affect a good client.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::watch;

use super::*;
use crate::message::{Close, Message as _, Reject, Token};
use crate::session::{ClientOptions, ClientSession};
use crate::{Framer, FramerError, Group, Micros, Sequence, WireFrameError, write_frame};

fn token() -> Token {
    Token::new(*b"a token for tests").unwrap()
}

fn with_token(token: Option<Token>) -> ClientOptions {
    ClientOptions { token, ..ClientOptions::default() }
}

/// Returns the first bytes of a client.
fn greeting(token: Option<Token>) -> Vec<u8> {
    ClientSession::with(Limits::default(), with_token(token)).take_output()
}

fn frame(kind: FrameType, payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    write_frame(&mut out, kind, Group(0), Sequence(0), payload).unwrap();
    out
}

/// Returns the first bytes of a client with only unknown protocol versions.
fn greeting_of_the_future() -> Vec<u8> {
    let mut framer = Framer::new(Limits::default());
    framer.push(&greeting(Some(token())));
    let mut out = Vec::new();
    while let Some(found) = framer.next_frame().unwrap() {
        let mut payload = found.payload().to_vec();
        if found.header.kind == FrameType::HELLO {
            payload[..4].copy_from_slice(&[0x84, 3, 0x85, 3]);
        }
        out.extend(frame(found.header.kind, &payload));
    }
    out
}

/// Returns a frame header that claims a payload of almost 4 GiB.
fn huge() -> Vec<u8> {
    let mut head = frame(FrameType::HELLO, &[]);
    head[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
    head
}

/// Returns the last frame of a server if it is a REJECT or CLOSE.
#[derive(Debug, PartialEq)]
enum LastWord {
    Nothing,
    Reject(RejectCode),
    Close(CloseCode),
}

fn last_word(bytes: &[u8]) -> LastWord {
    let mut framer = Framer::new(Limits::default());
    framer.push(bytes);
    let mut last = LastWord::Nothing;
    while let Some(found) = framer.next_frame().unwrap() {
        last = match found.header.kind {
            FrameType::REJECT => LastWord::Reject(Reject::from_payload(found.payload()).unwrap().code),
            FrameType::CLOSE => LastWord::Close(Close::from_payload(found.payload()).unwrap().code),
            _ => LastWord::Nothing,
        };
    }
    last
}

/// Sends `words` the given number of times and reads to the end. Returns the peer's address and the server's last
/// frame.
async fn attack(address: String, words: Vec<u8>, times: u32, hangs_up: bool) -> (SocketAddr, LastWord) {
    let stream = TcpStream::connect(&address).await.unwrap();
    let place = stream.local_addr().unwrap();
    let (mut from, mut to) = stream.into_split();
    let saying = async {
        for _ in 0..times {
            if to.write_all(&words).await.is_err() {
                break;
            }
        }
        if hangs_up {
            to.shutdown().await.unwrap();
        }
    };
    let mut heard = Vec::new();
    let hearing = from.read_to_end(&mut heard);
    // Bytes that arrived before a reset were read.
    let both = async { tokio::join!(saying, hearing) };
    tokio::time::timeout(PATIENCE * 10, both).await.map(drop).expect("the server ends the connection");
    drop(to);
    (place, last_word(&heard))
}

/// Returns the kind of an error, by which the peers differ.
fn kind(fault: &PeerError) -> &'static str {
    match fault {
        PeerError::TlsAtPlainPort => "tls",
        PeerError::Disconnected { unfinished } if *unfinished > 0 => "inside a frame",
        PeerError::Session(SessionError::HandshakeTimeout { .. }) => "timeout",
        PeerError::Session(SessionError::NotPsao { .. }) => "not psao",
        PeerError::Session(SessionError::BadHello(_)) => "rejected",
        PeerError::Session(SessionError::Unexpected { .. }) => "order",
        PeerError::Session(SessionError::Flood { .. }) => "flood",
        PeerError::Session(SessionError::Framer(FramerError {
            error: WireFrameError::TooLong { .. },
            ..
        })) => "too long",
        other => panic!("{other}"),
    }
}

/// Sends a frame whenever the good client has applied the one before, until it is stopped. Returns the number of
/// frames.
async fn frames(
    hub: Hub,
    mut source: SampleServer,
    done: Arc<AtomicBool>,
    mut held: watch::Receiver<u32>,
) -> u32 {
    let mut sent = 0;
    while !done.load(Ordering::Relaxed) {
        let made = source.step().unwrap();
        hub.broadcast(&made.info, made.body, source.state().into(), hub.now()).unwrap();
        sent += 1;
        held.wait_for(|&held| held >= sent).await.unwrap();
        // Acknowledgements count, too: at most a thousand a second.
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    hub.close(CloseCode::DONE, "enough", PATIENCE).await;
    sent
}

/// Follows the stream to its end and returns the number of frames applied.
async fn good_client(address: Address, held: watch::Sender<u32>) -> Vec<u32> {
    let options = ConnectOptions::default().with_session(with_token(Some(token())));
    let mut connection = connect(&address, &options, Limits::default()).await.unwrap();
    let mut applied = Vec::new();
    while let Some(event) = connection.next_event().await.unwrap() {
        if let ClientEvent::Applied(frame) = event {
            applied.push(frame.info.frame.0);
            held.send_replace(applied.len() as u32);
        }
    }
    applied
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn each_bad_peer_is_told_once_and_costs_a_good_client_nothing() {
    let source = SampleServer::new().unwrap();
    let limits = Limits { handshake: Micros::from_secs(2), ..Limits::default() };
    let hub = Hub::new(source.scene().clone(), source.coder(), Access::Token(token()), limits);
    let listener = Listener::bind(&hub, &local(), &ListenOptions::default()).await.unwrap();
    let address = listener.address().clone();
    tokio::spawn(listener.run());
    let (held, holds) = watch::channel(0);
    let good = tokio::spawn(good_client(address.clone(), held));
    assert!(hub.wait_joined(1, PATIENCE).await);
    let done = Arc::new(AtomicBool::new(false));
    let sending = tokio::spawn(frames(hub.clone(), source, done.clone(), holds));

    let mut expected = BTreeMap::new();
    let mut attacks = Vec::new();
    for (words, times, hangs_up, word, fault) in bad_peers() {
        let attack = tokio::spawn(attack(address.to_string(), words, times, hangs_up));
        attacks.push((attack, word, fault));
    }
    for (attack, word, fault) in attacks {
        let (place, heard) = attack.await.unwrap();
        assert_eq!(heard, word, "{fault}");
        expected.insert(place, fault);
    }
    let mut told = BTreeMap::new();
    while told.len() < expected.len() {
        for event in hub.take_events() {
            let HubEvent::Left { peer: Peer::Tcp(place), error: Some(error), .. } = event else { continue };
            assert_eq!(told.insert(place, kind(&error)), None, "told twice");
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    assert_eq!(told, expected);
    assert_eq!(hub.joined(), 1, "the good one stays");
    done.store(true, Ordering::Relaxed);
    let sent = sending.await.unwrap();
    assert_eq!(good.await.unwrap(), (0..sent).collect::<Vec<_>>());
}

/// For each bad peer: its bytes, their repetitions, whether it then disconnects, the server's last frame, and the
/// error.
fn bad_peers() -> Vec<(Vec<u8>, u32, bool, LastWord, &'static str)> {
    let joined = greeting(Some(token()));
    let then = |more: &[u8]| [&joined[..], more].concat();
    let tiny = frame(FrameType(200), &[]);
    let wrong = Token::new(*b"a token for tezts").unwrap();
    let (reject, close) = (LastWord::Reject, LastWord::Close);
    vec![
        (vec![], 1, false, reject(RejectCode::BAD_HELLO), "timeout"),
        (b"GET / HTTP/1.1\r\n\r\n".to_vec(), 1, false, LastWord::Nothing, "not psao"),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".to_vec(), 1, false, LastWord::Nothing, "tls"),
        (greeting_of_the_future(), 1, false, reject(RejectCode::VERSION), "rejected"),
        (greeting(None), 1, false, reject(RejectCode::CREDENTIAL), "rejected"),
        (greeting(Some(wrong)), 1, false, reject(RejectCode::CREDENTIAL), "rejected"),
        (frame(FrameType::VIEW, &[0; 44]), 1, false, reject(RejectCode::BAD_HELLO), "order"),
        (then(&joined), 1, false, close(CloseCode::PROTOCOL), "order"),
        (huge(), 1, false, reject(RejectCode::BAD_HELLO), "too long"),
        (then(&huge()), 1, false, close(CloseCode::PROTOCOL), "too long"),
        (then(&tiny[..7]), 1, true, close(CloseCode::FAILED), "inside a frame"),
        (then(&tiny.repeat(10_000)), 1, false, close(CloseCode::FLOOD), "flood"),
        (tiny.repeat(1_000), 1_000, false, reject(RejectCode::BAD_HELLO), "order"),
    ]
}

/// A client that is silent after its handshake is closed with a reason. The test pauses tokio's clock.
#[tokio::test(start_paused = true)]
async fn a_client_that_falls_silent_is_given_up() {
    let (hub, address, _) = start(Limits::default()).await;
    let (_, heard) = attack(address.to_string(), greeting(None), 1, false).await;
    assert_eq!(heard, LastWord::Close(CloseCode::TIMEOUT));
    let mut left = Vec::new();
    while left.is_empty() {
        left = hub.take_events();
        left.retain(|event| matches!(event, HubEvent::Left { .. }));
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let fault = PeerError::Session(SessionError::Silent { waited: Micros(0) });
    let HubEvent::Left { error: Some(error), .. } = &left[0] else { panic!("{left:?}") };
    assert_eq!(std::mem::discriminant(error), std::mem::discriminant(&fault), "{error}");
    assert!(error.to_string().starts_with("nothing came from the other end for 30."), "{error}");
}

/// Both ends stay connected for an hour in which no frame is sent.
#[tokio::test(start_paused = true)]
async fn two_ends_with_nothing_to_say_stay_connected() {
    let (hub, address, mut source) = start(Limits::default()).await;
    let mut connection = dial(&address).await.unwrap();
    let client = tokio::spawn(async move {
        let mut applied = 0;
        while let Some(event) = connection.next_event().await.unwrap() {
            applied += usize::from(matches!(event, ClientEvent::Applied(_)));
        }
        applied
    });
    assert!(hub.wait_joined(1, PATIENCE).await);
    tokio::time::sleep(Duration::from_secs(3600)).await;
    let made = source.step().unwrap();
    hub.broadcast(&made.info, made.body, source.state().into(), hub.now()).unwrap();
    assert!(hub.wait_acked(made.info.frame, PATIENCE).await);
    hub.close(CloseCode::DONE, "enough", PATIENCE).await;
    assert_eq!(client.await.unwrap(), 1);
}

/// A client that takes no bytes is closed after the stall limit. Its waiting bytes do not delay others.
#[tokio::test]
async fn a_client_that_takes_nothing_is_given_up() {
    let limits = Limits { stall: Micros(300_000), max_unacked: u32::MAX, ..Limits::default() };
    let (hub, address, mut source) = start(limits).await;
    let mut stalled = TcpStream::connect(address.to_string()).await.unwrap();
    stalled.write_all(&greeting(None)).await.unwrap();
    assert!(hub.wait_joined(1, PATIENCE).await);
    let error = loop {
        let made = source.step().unwrap();
        hub.broadcast(&made.info, made.body, source.state().into(), hub.now()).unwrap();
        tokio::task::yield_now().await;
        let left = hub.take_events().into_iter().find_map(|event| match event {
            HubEvent::Left { error, .. } => error,
            _ => None,
        });
        if let Some(error) = left {
            break error;
        }
    };
    assert!(matches!(error, PeerError::Session(SessionError::Stalled { .. })), "{error}");
}

/// Connections over the limit are told that the server is full. Many more at once are dropped and counted.
#[tokio::test]
async fn what_is_turned_away_or_dropped_is_counted() {
    let (hub, address, _) = start(Limits { max_clients: 1, ..Limits::default() }).await;
    let mut flood = Vec::new();
    for _ in 0..200 {
        flood.push(TcpStream::connect(address.to_string()).await.unwrap());
    }
    let (mut dropped, mut turned_away) = (0, 0);
    let mut hearing = true;
    while dropped + turned_away < 199 {
        if hearing && dropped > 0 {
            // Connections that close make room and are reported.
            flood.clear();
            hearing = false;
        }
        for event in hub.take_events() {
            match event {
                HubEvent::Dropped { connections } => dropped += connections,
                HubEvent::Left { error: Some(PeerError::TurnedAway { limit: 1 }), .. } => turned_away += 1,
                HubEvent::Left { error: Some(PeerError::Disconnected { unfinished: 0 }), .. } => {}
                other => panic!("{other:?}"),
            }
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    assert!(turned_away >= 64 && dropped > 0, "{turned_away} turned away, {dropped} dropped");
}

/// A client whose limit is below a frame's length is closed, and both ends report the reason.
#[tokio::test]
async fn a_client_that_cannot_take_the_frames_is_told_of() {
    let (hub, address, mut source) = start(Limits::default()).await;
    let mut limits = Limits::default();
    limits.codec.max_frame_bytes = 40;
    let mut connection = connect(&address, &ConnectOptions::default(), limits).await.unwrap();
    let following = tokio::spawn(async move {
        while let Some(event) = connection.next_event().await.unwrap() {
            if let ClientEvent::Closed(close) = event {
                return close.code;
            }
        }
        panic!("the session is closed without a word");
    });
    assert!(hub.wait_joined(1, PATIENCE).await);
    let made = source.step().unwrap();
    hub.broadcast(&made.info, made.body, source.state().into(), hub.now()).unwrap();
    assert_eq!(following.await.unwrap(), CloseCode::FAILED);
    hub.close(CloseCode::DONE, "enough", PATIENCE).await;
    let events = hub.take_events();
    let left = matches!(events[..], [_, HubEvent::Left { error: Some(PeerError::Unservable(_)), .. }]);
    assert!(left, "{events:?}");
}
