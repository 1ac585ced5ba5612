//! Tokens, digests of scenes, and peers that say too much.

use super::*;

fn token(secret: &[u8; 16]) -> Token {
    Token::new(*secret).unwrap()
}

/// Returns the answer of a server that requires a token. It reveals nothing about the scene.
fn refused(client: Option<Token>) -> (SessionError, SessionError) {
    let scene = SampleServer::new().unwrap().scene().clone();
    let access = Access::Token(token(b"the right secret"));
    let mut server = ServerSession::new(scene, access, Limits::default());
    let options = ClientOptions { token: client, ..ClientOptions::default() };
    let mut client = ClientSession::with(Limits::default(), options);
    let error = server.handle(&client.take_output(), NOW).unwrap_err();
    (error, client.handle(&server.take_output(), NOW).unwrap_err())
}

#[test]
fn only_the_right_token_opens_a_server_that_wants_one() {
    for wrong in [None, Some(token(b"the wrong secret")), Some(Token::new([0; 17]).unwrap())] {
        let (error, told) = refused(wrong);
        let SessionError::BadHello(reject) = &error else { panic!("{error}") };
        assert_eq!(reject.code, RejectCode::CREDENTIAL);
        assert_eq!(told, SessionError::Rejected(reject.clone()));
        assert!(!format!("{error} {error:?} {told} {told:?}").contains("secret"), "{error}");
    }
    for (access, given) in [
        (Access::Token(token(b"the right secret")), Some(token(b"the right secret"))),
        (Access::Open, Some(token(b"nobody asked me!"))),
        (Access::Open, None),
    ] {
        let source = SampleServer::new().unwrap();
        let mut server = ServerSession::new(source.scene().clone(), access, Limits::default());
        let options = ClientOptions { token: given, ..ClientOptions::default() };
        let mut client = ClientSession::with(Limits::default(), options);
        server.handle(&client.take_output(), NOW).unwrap();
        assert!(server.is_joined());
        client.handle(&server.take_output(), NOW).unwrap();
        assert!(client.state().is_some());
    }
}

#[test]
fn a_token_comes_once_and_before_the_hello() {
    let auth = |secret| Auth { token: token(secret) }.to_payload().unwrap();
    let auths =
        [b"the right secret", b"the right secret"].map(|secret| frame(FrameType::AUTH, 0, 0, &auth(secret)));
    let scene = SampleServer::new().unwrap().scene().clone();
    let mut server = ServerSession::new(scene, Access::Open, Limits::default());
    let error = server.handle(&auths.concat(), NOW).unwrap_err();
    assert_eq!(error, SessionError::Unexpected { kind: FrameType::AUTH, state: "waiting for HELLO" });
    let mut pair = joined();
    let error = pair.server.handle(&auths[0], NOW).unwrap_err();
    assert_eq!(error, SessionError::Unexpected { kind: FrameType::AUTH, state: "serving the client" });
}

#[test]
fn a_stream_of_another_scene_is_refused() {
    let mut pair = Pair::new();
    let found = pair.source.scene().info().digest;
    let mut expected = found;
    expected[31] ^= 1;
    let options = ClientOptions { scene: Some(expected), ..ClientOptions::default() };
    pair.client = ClientSession::with(Limits::default(), options);
    pair.server.handle(&pair.client.take_output(), NOW).unwrap();
    let error = pair.client.handle(&pair.server.take_output(), NOW).unwrap_err();
    assert_eq!(error, SessionError::OtherScene { name: "sample".into(), expected, found });
    let events = pair.server.handle(&pair.client.take_output(), NOW).unwrap();
    assert!(
        matches!(events.last(), Some(ServerEvent::Closed(c)) if c.code == CloseCode::SCENE),
        "{events:?}"
    );

    let options = ClientOptions { scene: Some(found), ..ClientOptions::default() };
    let mut pair = Pair { client: ClientSession::with(Limits::default(), options), ..Pair::new() };
    pair.settle();
    assert!(pair.client.state().is_some());
}

#[test]
fn a_client_that_says_too_much_is_closed_and_told_why() {
    let view = frame(FrameType::PONG, 0, 0, &[0; 24]);
    let mut pair = joined();
    let limits = Limits::default();
    // The largest allowed burst, then one frame more.
    let at_once = 4 * limits.max_frames_per_s as usize;
    let (mut sent, mut refused) = (0, None);
    while refused.is_none() && sent <= 2 * at_once {
        sent += 1;
        refused = pair.server.handle(&view, NOW).err();
    }
    assert_eq!(refused, Some(SessionError::Flood { what: "frames", limit: limits.max_frames_per_s }));
    assert!((at_once - 3..=at_once + 1).contains(&sent), "{sent}");
    let events = pair.client.handle(&pair.server.take_output(), NOW).unwrap();
    assert!(
        matches!(events.last(), Some(ClientEvent::Closed(c)) if c.code == CloseCode::FLOOD),
        "{events:?}"
    );

    let mut pair = joined();
    let big = frame(FrameType(99), 0, 0, &[0; 60_000]);
    let refused = (0..).find_map(|_| pair.server.handle(&big, NOW).err());
    assert_eq!(refused, Some(SessionError::Flood { what: "bytes", limit: limits.max_bytes_per_s }));
}

#[test]
fn answers_to_pings_do_not_pile_up_for_who_takes_none() {
    let limits = Limits { max_queue_bytes: 2_000, ..Limits::default() };
    let mut pair = Pair::with_limits(limits, limits);
    pair.settle();
    pair.step();
    pair.settle();
    let ping = frame(FrameType::PING, 0, 0, &Ping { sent: NOW }.to_payload().unwrap());
    for _ in 0..1_000 {
        pair.server.handle(&ping, NOW).unwrap();
    }
    assert!(pair.server.queued_bytes() < 2_100, "{}", pair.server.queued_bytes());
}
