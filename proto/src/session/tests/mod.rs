//! Both ends against each other, and each against bad peers.

mod credentials;
mod datagrams;
mod slow;
mod time;

use psao_codec::envelope::FrameKind;

use super::*;
use crate::message::*;
use crate::sample::SampleServer;
use crate::*;

const NOW: Micros = Micros(0);

/// A server with one client, and the events of both.
struct Pair {
    source: SampleServer,
    server: ServerSession,
    client: ClientSession,
    seen: Vec<ClientEvent>,
    heard: Vec<ServerEvent>,
}

impl Pair {
    fn new() -> Self {
        Self::with_limits(Limits::default(), Limits::default())
    }

    fn with_limits(server: Limits, client: Limits) -> Self {
        Self::of(Profile::PAPER, server, client)
    }

    fn of(profile: Profile, server: Limits, client: Limits) -> Self {
        let source = SampleServer::of(profile).unwrap();
        let server = ServerSession::new(source.scene().clone(), Access::Open, server);
        Self { source, server, client: ClientSession::new(client), seen: vec![], heard: vec![] }
    }

    /// Carries bytes in both directions until none are left.
    fn settle(&mut self) {
        loop {
            let up = self.client.take_output();
            let down = self.server.take_output();
            if up.is_empty() && down.is_empty() {
                return;
            }
            self.heard.extend(self.server.handle(&up, NOW).unwrap());
            self.seen.extend(self.client.handle(&down, NOW).unwrap());
        }
    }

    /// Runs one frame of the server's loop.
    fn step(&mut self) {
        let made = self.source.step().unwrap();
        let body = SharedBody::new(&made.info, made.body, NOW);
        match self.server.demand() {
            Demand::Update { base } if body.kind == FrameKind::Delta && base.next() == Some(body.frame) => {
                self.server.send_update(&body, base).unwrap();
            }
            Demand::Nothing => {
                let base = FrameIndex(body.frame.0.saturating_sub(1));
                let sent = if body.kind == FrameKind::Key {
                    self.server.send_keyframe(&body)
                } else {
                    self.server.send_update(&body, base)
                };
                assert!(!sent.unwrap());
            }
            _ => assert!(self.server.send_keyframe(&self.keyframe()).unwrap()),
        }
    }

    /// Returns a keyframe of the source's state.
    fn keyframe(&self) -> SharedBody {
        body(&self.source.keyframe().unwrap())
    }

    fn applied(&self) -> Vec<u32> {
        let frame = |e: &ClientEvent| match e {
            ClientEvent::Applied(a) => Some(a.info.frame.0),
            _ => None,
        };
        self.seen.iter().filter_map(frame).collect()
    }

    fn assert_same_state(&self) {
        let (state, expected) = (self.client.state().unwrap(), self.source.state());
        assert_eq!(state.hash(), expected.hash());
        assert_eq!(state.full_hash(), expected.full_hash());
        assert!(self.client.is_current());
    }
}

/// Returns the shared body of encoded bytes.
fn body(bytes: &[u8]) -> SharedBody {
    let info = psao_codec::envelope::inspect(bytes, &Limits::default().codec).unwrap();
    SharedBody::new(&info, bytes, NOW)
}

/// Returns bytes that look like an update of frame 1.
fn update(bytes: &[u8]) -> SharedBody {
    let (kind, frame) = (FrameKind::Delta, FrameIndex(1));
    SharedBody { kind, frame, hash: StateHash(0), captured: NOW, bytes: bytes.into() }
}

fn frame(kind: FrameType, group: u32, sequence: u32, payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    write_frame(&mut out, kind, Group(group), Sequence(sequence), payload).unwrap();
    out
}

/// Returns a client that has applied frame 0, and its server.
fn joined() -> Pair {
    let mut pair = Pair::new();
    pair.settle();
    pair.step();
    pair.settle();
    pair
}

#[test]
fn a_client_joins_and_follows() {
    let mut pair = joined();
    assert!(matches!(pair.seen[0], ClientEvent::Accepted(Accept { version: 1, .. })));
    let ClientEvent::SceneReady(scene) = &pair.seen[1] else { panic!("{:?}", pair.seen[1]) };
    assert_eq!(**scene, **pair.source.scene());
    for _ in 1..6 {
        pair.step();
        pair.server.send_report(&pair.source.report(FrameIndex(1))).unwrap();
        pair.settle();
        pair.assert_same_state();
    }
    assert_eq!(pair.applied(), [0, 1, 2, 3, 4, 5]);
    let acks = pair.heard.iter().filter(|e| matches!(e, ServerEvent::Acked(_))).count();
    assert_eq!(acks, 6);
    assert!(matches!(pair.heard.last(), Some(ServerEvent::Acked(a)) if a.hash == pair.source.state().hash()));
    assert_eq!(pair.seen.iter().filter(|e| matches!(e, ClientEvent::Report(_))).count(), 5);
    assert_eq!(pair.client.stats().requests, 0);

    let camera = CameraPose {
        eye: [0.0, 1.0, 5.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 60.0,
        aspect: 1.0,
    };
    pair.client.set_view(&camera).unwrap();
    let edit = Edit { instance: 1, action: EditAction::Hide };
    pair.client.edit(&edit).unwrap();
    pair.settle();
    assert_eq!(pair.heard[pair.heard.len() - 2..], [ServerEvent::View(camera), ServerEvent::Edit(edit)]);

    pair.server.close(CloseCode::DONE, "over");
    assert_eq!(pair.server.send_update(&update(b""), FrameIndex(0)), Err(SendError::NotOpen));
    pair.settle();
    assert_eq!(pair.seen.last(), Some(&ClientEvent::Closed(Close::new(CloseCode::DONE, "over"))));
    assert!(pair.client.is_closed() && pair.client.state().is_some());
    assert_eq!(pair.client.set_view(&camera), Err(SendError::NotOpen));
    assert_eq!(pair.client.handle(b"whatever follows", NOW), Ok(vec![]));
}

#[test]
fn a_late_client_gets_the_scene_and_a_keyframe_first() {
    let mut pair = Pair::new();
    for _ in 0..4 {
        pair.step(); // no client has joined yet
    }
    assert_eq!(pair.server.stats().updates, 0);
    pair.settle();
    assert_eq!(pair.server.demand(), Demand::Keyframe);
    pair.step();
    pair.step();
    pair.settle();
    assert_eq!(pair.applied(), [4, 5]);
    pair.assert_same_state();
}

#[test]
fn any_chunking_gives_the_same_events() {
    let mut pair = Pair::new();
    let hello = pair.client.take_output();
    pair.server.handle(&hello, NOW).unwrap();
    let mut wire = pair.server.take_output();
    for _ in 0..3 {
        pair.step();
        wire.extend(pair.server.take_output());
    }
    let all = |chunk: usize| {
        let mut client = ClientSession::new(Limits::default());
        let mut events = Vec::new();
        for piece in wire.chunks(chunk) {
            events.extend(client.handle(piece, NOW).unwrap());
        }
        (events, client.take_output())
    };
    let whole = all(wire.len());
    assert_eq!(whole.0.len(), 5);
    for chunk in [1, 2, 3, 7, 19, 20, 21, 64] {
        assert_eq!(all(chunk), whole);
    }
}

#[test]
fn an_event_comes_with_the_state_that_it_speaks_of() {
    for profile in [Profile::PAPER, Profile::SURFACE] {
        let mut pair = Pair::of(profile, Limits::default(), Limits::default());
        let greeting = pair.client.take_output();
        pair.server.handle(&greeting, NOW).unwrap();
        let mut hashes = Vec::new();
        for _ in 0..6 {
            pair.step();
            hashes.push(pair.source.state().hash());
        }
        // All frames in one go, and behind them bytes that are no frame.
        let bytes = [pair.server.take_output(), b"garbage".to_vec()].concat();
        pair.client.push(&bytes, NOW).unwrap();
        let mut seen = Vec::new();
        let error = loop {
            match pair.client.next_event() {
                Ok(Some(ClientEvent::Applied(frame))) => {
                    let state = pair.client.state().unwrap();
                    assert_eq!((state.hash(), state.full_hash()), (frame.info.hash, frame.info.hash));
                    seen.push(frame.info.hash);
                }
                Ok(event) => assert!(event.is_some(), "an error comes at the end"),
                Err(error) => break error,
            }
        };
        assert_eq!(seen, hashes, "{profile:?}: one event, one state");
        assert!(pair.client.next_event() == Err(error.clone()) && pair.client.push(&[], NOW) == Err(error));
        assert_eq!(pair.client.state().map(psao_codec::State::hash), hashes.last().copied());
    }
}

#[test]
fn garbage_before_hello_is_told_apart() {
    let scene = SampleServer::new().unwrap().scene().clone();
    let mut server = ServerSession::new(scene.clone(), Access::Open, Limits::default());
    let error = server.handle(b"GET / HTTP/1.1\r\n", NOW).unwrap_err();
    assert_eq!(error, SessionError::NotPsao { found: 0x4547 });
    assert!(error.to_string().contains("does not speak the psao protocol"), "{error}");
    assert!(server.output().is_empty() && server.is_closed());
    assert_eq!(server.handle(b"more", NOW), Err(error));

    let mut server = ServerSession::new(scene, Access::Open, Limits::default());
    let error = server.handle(&frame(FrameType::ACK, 0, 0, &[0; 12]), NOW).unwrap_err();
    assert_eq!(error, SessionError::Unexpected { kind: FrameType::ACK, state: "waiting for HELLO" });
    let mut client = ClientSession::new(Limits::default());
    let told = client.handle(&server.take_output(), NOW).unwrap_err();
    assert!(matches!(&told, SessionError::Rejected(r) if r.code == RejectCode::BAD_HELLO), "{told}");

    let mut client = ClientSession::new(Limits::default());
    assert_eq!(client.handle(b"SSH-2.0", NOW), Err(SessionError::NotPsao { found: 0x5353 }));
}

#[test]
fn a_version_from_the_future_is_refused_with_words() {
    let scene = SampleServer::new().unwrap().scene().clone();
    let mut server = ServerSession::new(scene, Access::Open, Limits::default());
    // Only the first two fields of a future HELLO are known.
    let hello = [&2u16.to_le_bytes()[..], &9u16.to_le_bytes(), b"fields of the future"].concat();
    let error = server.handle(&frame(FrameType::HELLO, 0, 0, &hello), NOW).unwrap_err();
    let SessionError::BadHello(reject) = &error else { panic!("{error}") };
    assert_eq!(reject.code, RejectCode::VERSION);
    assert!(reject.text.as_str().contains("versions 2 to 9, this program 1"), "{}", reject.text);
    let mut client = ClientSession::new(Limits::default());
    let told = client.handle(&server.take_output(), NOW).unwrap_err();
    assert_eq!(told, SessionError::Rejected(reject.clone()));

    let limits = PeerLimits::from(&Limits::default());
    let accept = Accept { version: 2, profile: Profile::PAPER, limits, name: Text::default() };
    let mut client = ClientSession::new(Limits::default());
    let wire = frame(FrameType::ACCEPT, 0, 0, &accept.to_payload().unwrap());
    let error = client.handle(&wire, NOW).unwrap_err();
    assert_eq!(error, SessionError::Version { peer: "server", oldest: 2, newest: 2 });
}

#[test]
fn clients_that_cannot_hold_or_read_the_stream_are_refused() {
    let mut limits = Limits::default();
    limits.codec.max_cells = 15;
    let mut pair = Pair::with_limits(Limits::default(), limits);
    let hello = pair.client.take_output();
    let error = pair.server.handle(&hello, NOW).unwrap_err();
    assert!(matches!(&error, SessionError::BadHello(r) if r.code == RejectCode::LIMITS), "{error}");

    let good = Hello::from_payload(&hello[HEADER_BYTES..]).unwrap();
    for (hello, code) in [
        (Hello { profiles: ProfileSet(0), ..good.clone() }, RejectCode::PROFILE),
        (Hello { coders: CoderSet(1), ..good }, RejectCode::CODER),
    ] {
        let mut server = ServerSession::new(pair.source.scene().clone(), Access::Open, Limits::default());
        let wire = frame(FrameType::HELLO, 0, 0, &hello.to_payload().unwrap());
        let error = server.handle(&wire, NOW).unwrap_err();
        assert!(matches!(&error, SessionError::BadHello(r) if r.code == code), "{error}");
    }

    let mut limits = Limits::default();
    limits.codec.max_frame_bytes = 40;
    let mut pair = Pair::with_limits(Limits::default(), limits);
    pair.settle();
    let error =
        pair.server.send_keyframe(&SharedBody { kind: FrameKind::Key, ..update(&[0; 41]) }).unwrap_err();
    assert_eq!(error, SendError::OverPeerLimit { bytes: 41, limit: 40 });
}

#[test]
fn a_surface_stream_is_joined_early_and_late_and_followed() {
    let limits = Limits::default();
    let mut pair = Pair::of(Profile::SURFACE, limits, limits);
    pair.settle();
    for _ in 0..3 {
        pair.step();
        pair.settle();
        pair.assert_same_state();
    }
    let early = pair.applied();
    let mut late = Pair { source: pair.source, ..Pair::of(Profile::SURFACE, limits, limits) };
    late.settle();
    for _ in 3..6 {
        late.step();
        late.settle();
        late.assert_same_state();
    }
    assert_eq!((early, late.applied()), (vec![0, 1, 2], vec![3, 4, 5]));

    let mut small = Limits::default();
    small.codec.max_points = 23;
    let mut pair = Pair::of(Profile::SURFACE, limits, small);
    let error = pair.server.handle(&pair.client.take_output(), NOW).unwrap_err();
    assert!(matches!(&error, SessionError::BadHello(r) if r.code == RejectCode::LIMITS), "{error}");
    assert!(error.to_string().contains("24 points"), "{error}");
}

#[test]
fn a_gap_stops_updates_until_the_next_keyframe() {
    let mut pair = joined();
    pair.step();
    drop(pair.server.take_output()); // frame 1 never arrives
    let held = pair.client.state().unwrap().clone();
    pair.step();
    pair.step();
    let down = pair.server.take_output();
    let events = pair.client.handle(&down, NOW).unwrap();
    assert!(
        matches!(
            &events[0],
            ClientEvent::Unusable { reason: FollowError::Gap { found_sequence: Sequence(2), .. }, .. }
        ),
        "{events:?}"
    );
    assert!(matches!(&events[1], ClientEvent::Unusable { reason: FollowError::Waiting, .. }), "{events:?}");
    assert_eq!(pair.client.state(), Some(&held));
    assert!(!pair.client.is_current());
    assert_eq!(pair.client.stats().requests, 1, "one request until the keyframe comes");
    pair.settle();
    assert!(pair.heard.contains(&ServerEvent::KeyframeWanted(KeyframeReason::GAP)));
    pair.step();
    pair.settle();
    assert_eq!(pair.applied(), [0, 4]);
    pair.assert_same_state();
}

#[test]
fn a_hash_that_differs_asks_for_a_keyframe() {
    let mut pair = joined();
    // An update whose hash is another state's: flip a bit of the hash and mend the checksums.
    let mut body = pair.source.step().unwrap().body;
    body[16] ^= 1;
    body[24..28].fill(0);
    let crc = crc32c::crc32c(&body).to_le_bytes();
    body[24..28].copy_from_slice(&crc);
    pair.server.send_update(&update(&body), FrameIndex(0)).unwrap();
    let held = pair.client.state().unwrap().clone();
    pair.settle();
    let Some(ClientEvent::HashMismatch { frame, expected, found }) = pair.seen.last() else {
        panic!("{:?}", pair.seen.last())
    };
    assert_eq!((frame.0, expected.0), (1, found.0 ^ 1));
    assert_eq!(pair.client.state(), Some(&held));
    assert_eq!(pair.heard.last(), Some(&ServerEvent::KeyframeWanted(KeyframeReason::HASH)));
    pair.step();
    pair.settle();
    pair.assert_same_state();
    assert_eq!(pair.client.stats().hash_mismatches, 1);
}

#[test]
fn a_bad_body_keeps_the_state() {
    for bad in [&b"not a frame body"[..], b""] {
        let mut pair = joined();
        let held = pair.client.state().unwrap().clone();
        pair.server.send_update(&update(bad), FrameIndex(0)).unwrap();
        pair.settle();
        assert!(
            matches!(pair.seen.last(), Some(ClientEvent::Unusable { reason: FollowError::Body(_), .. })),
            "{:?}",
            pair.seen.last()
        );
        assert_eq!(pair.client.state(), Some(&held));
        assert_eq!(pair.heard.last(), Some(&ServerEvent::KeyframeWanted(KeyframeReason::BODY)));
        assert_eq!(pair.server.demand(), Demand::Keyframe);
    }
    // A keyframe's body does not pass as an update.
    let mut pair = joined();
    pair.server.send_update(&update(&pair.source.keyframe().unwrap()), FrameIndex(0)).unwrap();
    pair.settle();
    let reason = FollowError::Kind { frame: FrameType::UPDATE };
    assert!(matches!(pair.seen.last(), Some(ClientEvent::Unusable { reason: r, .. }) if *r == reason));
}

#[test]
fn what_waits_for_a_slow_client_stays_bounded() {
    let limits = Limits { max_queue_bytes: 600, ..Limits::default() };
    let mut pair = Pair::with_limits(limits, Limits::default());
    pair.settle();
    pair.step();
    pair.settle();
    for _ in 0..100 {
        pair.step(); // the client takes no bytes
        assert!(pair.server.queued_bytes() <= 600, "{}", pair.server.queued_bytes());
    }
    assert_eq!(pair.server.stats().lags, 1);
    assert!(
        pair.server.is_lagging() && pair.server.demand() == Demand::Nothing,
        "nothing more for a client that takes nothing"
    );
    pair.settle();
    assert_eq!(pair.server.demand(), Demand::Update { base: FrameIndex(1) }, "what it took stays");
    pair.step();
    pair.settle();
    pair.assert_same_state();
    let stats = pair.server.stats();
    assert!(stats.dropped > 90 && pair.client.stats().unusable == 0, "{stats:?}");
}

#[test]
fn an_update_that_was_begun_goes_out_whole() {
    let limits = Limits { max_queue_bytes: 400, ..Limits::default() };
    let mut pair = Pair::with_limits(limits, Limits::default());
    pair.settle();
    pair.step();
    pair.settle();
    pair.step();
    let begun = pair.server.output()[..5].to_vec();
    pair.server.advance(5);
    while !pair.server.is_lagging() {
        pair.step();
    }
    assert_eq!(pair.server.demand(), Demand::Nothing, "not before the rest is gone");
    pair.seen.extend(pair.client.handle(&begun, NOW).unwrap());
    pair.settle();
    assert_eq!(pair.applied(), [0, 1]);
    assert_eq!(pair.server.demand(), Demand::Update { base: FrameIndex(1) }, "what it took stays");
    pair.step();
    pair.settle();
    pair.assert_same_state();
}

#[test]
fn unknown_types_are_skipped_and_known_ones_out_of_place_are_not() {
    let mut pair = joined();
    let unknown = frame(FrameType(90), 1, 1, b"from a later version");
    assert_eq!(pair.client.handle(&unknown, NOW), Ok(vec![]));
    assert_eq!(pair.server.handle(&unknown, NOW), Ok(vec![]));
    assert_eq!((pair.client.stats().unknown, pair.server.stats().unknown), (1, 1));

    let error = pair.client.handle(&frame(FrameType::HELLO, 0, 0, b""), NOW).unwrap_err();
    assert_eq!(error, SessionError::Unexpected { kind: FrameType::HELLO, state: "following the stream" });
    let held = pair.client.state().map(psao_codec::State::hash);
    assert_eq!(held, Some(pair.source.state().hash()), "an error does not cost the state");
    let events = pair.server.handle(&pair.client.take_output(), NOW).unwrap();
    assert!(matches!(&events[..], [ServerEvent::Closed(c)] if c.code == CloseCode::PROTOCOL), "{events:?}");
}

#[test]
fn a_handshake_that_takes_too_long_fails() {
    let limits = Limits::default();
    let late = Micros(5).plus(limits.handshake).plus(Micros(1));
    let mut client = ClientSession::new(limits);
    client.tick(Micros(5)).unwrap();
    client.tick(Micros(5).plus(limits.handshake)).unwrap();
    assert!(matches!(client.tick(late), Err(SessionError::HandshakeTimeout { .. })));
    let mut server = ServerSession::new(SampleServer::new().unwrap().scene().clone(), Access::Open, limits);
    server.tick(Micros(5)).unwrap();
    let error = server.tick(late).unwrap_err();
    assert!(error.to_string().contains("after 10.0 s"), "{error}");
    let mut pair = joined();
    assert_eq!((pair.client.tick(late), pair.server.tick(late)), (Ok(()), Ok(())));
}

#[test]
fn a_damaged_scene_ends_the_session() {
    let mut pair = Pair::new();
    pair.server.handle(&pair.client.take_output(), NOW).unwrap();
    let wire = pair.server.take_output();
    let mut framer = Framer::new(Limits::default());
    framer.push(&wire);
    let mut frames = Vec::new();
    while let Some(f) = framer.next_frame().unwrap() {
        frames.push(f.bytes.to_vec());
    }
    // Instances before the info.
    let bytes = [&frames[0][..], &frames[2]].concat();
    let error = pair.client.handle(&bytes, NOW).unwrap_err();
    assert!(matches!(error, SessionError::Scene(SceneError::Order { .. })), "{error}");
    // The info twice.
    let mut client = ClientSession::new(Limits::default());
    let bytes = [&frames[0][..], &frames[1], &frames[1]].concat();
    let error = client.handle(&bytes, NOW).unwrap_err();
    assert!(matches!(error, SessionError::Scene(SceneError::Order { .. })), "{error}");
}
