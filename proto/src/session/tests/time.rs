//! Keep-alives, silence, stalls, clocks and stamps, in virtual time.

use super::*;

/// Calls both ends at each of their deadlines until `end`.
fn pass_time(pair: &mut Pair, from: Micros, end: Micros, mut carry: impl FnMut(&mut Pair, Micros)) {
    let mut now = from;
    while now <= end {
        let ticked = pair.server.tick(now).and(pair.client.tick(now));
        if ticked.is_err() {
            return;
        }
        carry(pair, now);
        let next = [pair.server.next_deadline(), pair.client.next_deadline()].into_iter().flatten().min();
        let Some(next) = next else { return };
        assert!(next > now, "a deadline that has passed was announced again");
        now = next;
    }
}

#[test]
fn two_ends_with_nothing_to_say_stay_together() {
    let mut pair = joined();
    let mut turns = 0;
    let end = Micros::from_secs(120);
    pass_time(&mut pair, NOW, end, |pair, now| {
        turns += 1;
        let up = pair.client.take_output();
        pair.server.handle(&up, now).unwrap();
        let down = pair.server.take_output();
        pair.client.handle(&down, now).unwrap();
    });
    assert!(!pair.server.is_closed() && !pair.client.is_closed());
    assert!((60..130).contains(&turns), "{turns} turns in two minutes");
    pair.step();
    pair.server.tick(end).unwrap();
    let events = pair.client.handle(&pair.server.take_output(), end).unwrap();
    assert!(events.iter().any(|event| matches!(event, ClientEvent::Applied(_))), "{events:?}");
}

#[test]
fn an_end_that_falls_silent_is_given_up() {
    let mut pair = joined();
    pass_time(&mut pair, NOW, Micros::from_secs(40), |pair, _| {
        drop((pair.client.take_output(), pair.server.take_output()));
    });
    let late = Micros::from_secs(31);
    let error = pair.server.tick(late).unwrap_err();
    assert_eq!(error, SessionError::Silent { waited: Micros(30_000_001) });
    assert!(error.to_string().contains("for 30.0 s"), "{error}");
    assert!(matches!(pair.client.tick(late), Err(SessionError::Silent { .. })));
    let events = joined().client.handle(&pair.server.take_output(), NOW).unwrap();
    assert!(
        matches!(events.last(), Some(ClientEvent::Closed(c)) if c.code == CloseCode::TIMEOUT),
        "{events:?}"
    );
}

#[test]
fn a_client_that_talks_but_takes_nothing_is_given_up() {
    let mut pair = joined();
    pair.step(); // waits from here on
    let ping = frame(FrameType::PING, 0, 0, &Ping { sent: NOW }.to_payload().unwrap());
    let error = (0..).find_map(|second| pair.server.handle(&ping, Micros::from_secs(second)).err());
    assert_eq!(error, Some(SessionError::Stalled { waited: Micros::from_secs(61) }));
    assert_eq!(pair.server.next_deadline(), None);
}

#[test]
fn times_of_frames_are_those_of_the_servers_clock() {
    const AHEAD: u64 = 1_000_000_000;
    let mut pair = Pair::of(Profile::SURFACE, Limits::default(), Limits::default());
    let options = ClientOptions { stamps: true, ..ClientOptions::default() };
    pair.client = ClientSession::with(Limits::default(), options);
    // 20 ms there, 20 ms back; the server's clock is ahead.
    for turn in 0..4 {
        let now = turn * 40_000;
        let up = pair.client.take_output();
        pair.server.handle(&up, Micros(now + 20_000 + AHEAD)).unwrap();
        let made = pair.source.step().unwrap();
        let captured = Micros(now + 15_000 + AHEAD);
        if pair.server.is_joined() && turn > 0 {
            let keyframe = SharedBody { captured, ..pair.keyframe() };
            match pair.server.demand() {
                Demand::Update { base } => {
                    let update = SharedBody::new(&made.info, made.body, captured);
                    pair.server.send_update(&update, base).unwrap();
                }
                _ => drop(pair.server.send_keyframe(&keyframe).unwrap()),
            }
        }
        let down = pair.server.take_output();
        pair.client.tick(Micros(now)).unwrap();
        pair.seen.extend(pair.client.handle(&down, Micros(now + 40_000)).unwrap());
    }
    let clock = pair.client.clock().expect("the server has answered");
    assert_eq!((clock.offset, clock.round_trip), (AHEAD as i64, Micros(40_000)));
    let ages = pair.seen.iter().filter_map(|event| match event {
        ClientEvent::Applied(frame) => {
            let stamp = frame.stamp.expect("asked for");
            assert_eq!(stamp.frame, frame.info.frame);
            Some([stamp.captured, stamp.sent].map(|at| clock.elapsed(at, frame.received)))
        }
        _ => None,
    });
    assert_eq!(ages.collect::<Vec<_>>(), [[25_000, 20_000]; 3]);
    assert_eq!(joined().client.clock().map(|clock| clock.round_trip), Some(NOW), "known from the start");
}
