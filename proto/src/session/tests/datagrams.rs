//! Updates as datagrams that get lost.

use super::*;

#[test]
fn lost_datagrams_cost_nothing_but_their_own_frames() {
    let limits = Limits::default();
    let mut source = SampleServer::of(Profile::SURFACE).unwrap();
    let mut fanout = Fanout::new(source.coder());
    let mut server = ServerSession::new(source.scene().clone(), Access::Open, limits);
    let options = ClientOptions { datagrams: Some(64), ..ClientOptions::default() };
    let mut client = ClientSession::with(limits, options);
    let (mut applied, mut pieces) = (0, 0);
    for turn in 0..200_u32 {
        let now = Micros(u64::from(turn) * 16_667);
        server.handle(&client.take_output(), now).unwrap();
        let made = source.step().unwrap();
        fanout.advance(&made.info, made.body, source.state().into(), now);
        fanout.give(&mut server, source.state().into()).unwrap();
        let mut events = client.handle(&server.take_output(), now).unwrap();
        let mut datagrams = Vec::new();
        while let Some(datagram) = server.take_datagram() {
            assert!(datagram.len() <= 64);
            datagrams.push(datagram);
        }
        pieces += datagrams.len();
        // Two of three frames lose a piece. Pieces arrive in reverse order, some twice, with invalid datagrams between.
        if turn % 3 > 0 {
            datagrams.pop();
        }
        for datagram in datagrams.iter().rev().chain(datagrams.first()) {
            events.extend(client.handle_datagram(datagram, now));
            assert_eq!(client.handle_datagram(b"rubbish", now), []);
        }
        for event in events {
            if let ClientEvent::Applied(frame) = event {
                applied += 1;
                assert_eq!(frame.info.frame.0, turn, "a frame that is whole is current at once");
                let state = client.state().unwrap();
                assert_eq!((state.hash(), state.full_hash()), (source.state().hash(), source.state().hash()));
            }
        }
        // Every other acknowledgement is lost.
        if let Some(ack) = client.take_datagram().filter(|_| turn % 2 == 0) {
            assert!(matches!(server.handle_datagram(&ack, now), Some(ServerEvent::Acked(_))));
        }
    }
    // At a loss of two in three frames, the window shrinks at times.
    assert!((40..=68).contains(&applied), "{applied} frames of 200");
    assert!(pieces > 200, "{pieces} pieces");
    assert_eq!((server.stats().keyframes, client.stats().hash_mismatches), (1, 0));
    assert!(client.stats().bad_datagrams > 200);
    assert_eq!(server.handle_datagram(b"rubbish", NOW), None);
    assert_eq!(server.stats().bad_datagrams, 1);
}

#[test]
fn a_body_too_large_for_datagrams_comes_as_a_keyframe() {
    let limits = Limits { max_datagram_body: 10, ..Limits::default() };
    let mut pair = Pair::of(Profile::SURFACE, limits, limits);
    pair.client =
        ClientSession::with(limits, ClientOptions { datagrams: Some(64), ..ClientOptions::default() });
    let mut fanout = Fanout::new(pair.source.coder());
    for _ in 0..6 {
        pair.settle();
        let made = pair.source.step().unwrap();
        fanout.advance(&made.info, made.body, pair.source.state().into(), NOW);
        fanout.give(&mut pair.server, pair.source.state().into()).unwrap();
        pair.settle();
        assert_eq!(pair.server.take_datagram(), None);
    }
    assert!(pair.applied().len() >= 3, "{:?}", pair.applied());
    assert_eq!(pair.client.stats().hash_mismatches, 0);
}

#[test]
fn updates_that_follow_datagrams_on_the_connection_start_with_a_patch() {
    let mut pair = Pair::of(Profile::SURFACE, Limits::default(), Limits::default());
    let options = ClientOptions { datagrams: Some(64), ..ClientOptions::default() };
    pair.client = ClientSession::with(Limits::default(), options);
    let mut fanout = Fanout::new(pair.source.coder());
    let mut step = |pair: &mut Pair, large: bool| {
        let made = pair.source.step().unwrap();
        fanout.advance(&made.info, made.body, pair.source.state().into(), NOW);
        if let (true, Demand::Datagrams { base }) = (large, pair.server.demand()) {
            // A body of too many datagrams for all of them to arrive.
            let body = SharedBody { frame: made.info.frame, ..update(&[0; 1000]) };
            assert_eq!(pair.server.send_datagrams(&body, base), Ok(false));
        }
        let demand = pair.server.demand();
        let delivery = fanout.give(&mut pair.server, pair.source.state().into()).unwrap();
        while let Some(datagram) = pair.server.take_datagram() {
            pair.client.handle_datagram(&datagram, NOW);
        }
        pair.settle();
        // The delay is so short that each frame is acknowledged before the next is made.
        while let Some(ack) = pair.client.take_datagram() {
            pair.server.handle_datagram(&ack, NOW);
        }
        (demand, delivery)
    };
    pair.settle();
    step(&mut pair, false);
    pair.assert_same_state();
    assert_eq!(step(&mut pair, false), (Demand::Datagrams { base: FrameIndex(0) }, Delivery::Patch));
    assert_eq!(step(&mut pair, true), (Demand::Patch { base: FrameIndex(1) }, Delivery::Patch));
    pair.assert_same_state();
    assert_eq!(step(&mut pair, false), (Demand::Update { base: FrameIndex(2) }, Delivery::Update));
    pair.assert_same_state();
    assert_eq!((pair.client.stats().requests, pair.server.stats().keyframes), (0, 1));
}
