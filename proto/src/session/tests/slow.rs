//! Clients that fall behind, through the fan-out.

use super::*;

/// A stream, and clients that take its frames at different times.
struct Many {
    source: SampleServer,
    fanout: Fanout,
    clients: Vec<(ServerSession, ClientSession)>,
    offers: Vec<Delivery>,
    time: Micros,
}

impl Many {
    fn new(profile: Profile, count: usize, limits: Limits) -> Self {
        let source = SampleServer::of(profile).unwrap();
        let client = |_| {
            let server = ServerSession::new(source.scene().clone(), Access::Open, limits);
            (server, ClientSession::new(limits))
        };
        let clients = (0..count).map(client).collect();
        let fanout = Fanout::new(source.coder());
        Self { source, fanout, clients, offers: Vec::new(), time: NOW }
    }

    /// Creates the stream with `clients` clients, all joined.
    fn joined(profile: Profile, count: usize, limits: Limits) -> Self {
        let mut many = Self::new(profile, count, limits);
        (0..count).for_each(|client| many.settle(client));
        many
    }

    /// Gives one frame to all clients.
    fn step(&mut self) {
        let made = self.source.step().unwrap();
        self.time = self.time.plus(Micros(16_667));
        let state = self.source.state().into();
        self.fanout.advance(&made.info, made.body, state, self.time);
        let give = |(server, _): &mut (ServerSession, ClientSession)| {
            self.fanout.give(server, self.source.state().into()).unwrap()
        };
        self.offers = self.clients.iter_mut().map(give).collect();
    }

    /// Carries the bytes that wait for one client, and its answers.
    fn settle(&mut self, client: usize) {
        let (server, client) = &mut self.clients[client];
        for _ in 0..4 {
            server.handle(&client.take_output(), self.time).unwrap();
            for event in client.handle(&server.take_output(), self.time).unwrap() {
                assert!(!matches!(event, ClientEvent::Unusable { .. } | ClientEvent::HashMismatch { .. }));
            }
        }
    }

    fn assert_current(&self, client: usize) {
        let state = self.clients[client].1.state().unwrap();
        let expected = self.source.state();
        assert_eq!((state.hash(), state.frame()), (expected.hash(), expected.frame()));
        assert_eq!(state.full_hash(), expected.full_hash());
    }
}

#[test]
fn whoever_falls_behind_gets_the_newest_values_of_what_it_missed() {
    for (profile, expected) in [(Profile::SURFACE, Delivery::Patch), (Profile::PAPER, Delivery::Keyframe)] {
        let limits = Limits { max_unacked: 6, ..Limits::default() };
        let mut many = Many::joined(profile, 3, limits);
        for turn in 0..60 {
            many.step();
            many.settle(0);
            many.assert_current(0);
            // The second client pauses at times, the third takes no bytes for most of the time.
            if turn < 3 || turn % 10 < 5 {
                many.settle(1);
            }
            if turn < 3 || turn == 50 {
                many.settle(2);
            }
            let queued = many.clients[2].0.queued_bytes();
            assert!(queued < 3_000, "{queued} bytes wait for the third");
            if turn == 51 {
                assert_eq!(many.offers, [Delivery::Update, Delivery::Update, expected], "{profile:?}");
            }
        }
        for client in 0..3 {
            many.settle(client);
            many.step();
            many.settle(client);
            many.assert_current(client);
        }
        let stats = many.clients[2].0.stats();
        assert!(stats.lags > 0 && stats.updates > 0, "{stats:?}");
        assert_eq!(many.clients[0].0.stats().lags, 0);
        assert_eq!(many.clients[0].0.stats().keyframes, 1, "who keeps up never pays for the others");
    }
}

#[test]
fn joiners_share_a_keyframe_and_updates_follow() {
    let mut many = Many::new(Profile::SURFACE, 8, Limits::default());
    for client in 0..8 {
        for _ in 0..4 {
            many.step();
            (0..client).for_each(|early| many.settle(early));
            let early = many.offers[..client].iter().all(|offer| *offer == Delivery::Update);
            assert!(early, "{:?}", many.offers);
        }
        many.settle(client); // sends HELLO
        many.step();
        (0..=client).for_each(|here| many.settle(here));
        assert_eq!(many.offers[client], Delivery::Keyframe);
        (0..=client).for_each(|here| many.assert_current(here));
    }
}

#[test]
fn an_acknowledgement_with_another_hash_gets_a_keyframe() {
    let mut pair = joined();
    pair.step();
    let down = pair.server.take_output();
    pair.client.handle(&down, NOW).unwrap();
    drop(pair.client.take_output());
    let ack = Ack { frame: FrameIndex(1), hash: StateHash(5) };
    let wire = frame(FrameType::ACK, 0, 0, &ack.to_payload().unwrap());
    assert_eq!(pair.server.handle(&wire, NOW), Ok(vec![ServerEvent::Diverged(ack)]));
    assert_eq!((pair.server.demand(), pair.server.stats().diverged), (Demand::Keyframe, 1));
    // Hashes of frames that were never sent or already acknowledged are unknown.
    for number in [0, 1, 77] {
        let ack = Ack { frame: FrameIndex(number), hash: StateHash(5) };
        let wire = frame(FrameType::ACK, 0, 0, &ack.to_payload().unwrap());
        assert_eq!(pair.server.handle(&wire, NOW), Ok(vec![ServerEvent::Acked(ack)]));
    }
    pair.step();
    pair.settle();
    pair.assert_same_state();
}

#[test]
fn every_client_hears_of_the_edits_that_its_frames_have() {
    let mut many = Many::new(Profile::SURFACE, 2, Limits::default());
    let edit = |instance, action| Edit { instance, action };
    let at = |x| EditAction::Move { translation: [x, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0] };
    let mut heard = [vec![], vec![]];
    let mut collect = |many: &mut Many, client: usize| {
        let (server, session) = &mut many.clients[client];
        server.handle(&session.take_output(), NOW).unwrap();
        for event in session.handle(&server.take_output(), NOW).unwrap() {
            match event {
                ClientEvent::Edited(edit) => heard[client].push(edit),
                ClientEvent::Applied(_) => heard[client].push(edit(99, EditAction::Show)),
                _ => {}
            }
        }
        server.handle(&session.take_output(), NOW).unwrap();
    };
    let frame = edit(99, EditAction::Show);
    collect(&mut many, 0);
    for turn in 0..6 {
        match turn {
            1 => many.fanout.edit(&edit(0, at(1.0))),
            2 => many.fanout.edit(&edit(1, EditAction::Hide)),
            3 => [at(2.0), at(3.0)].iter().for_each(|action| many.fanout.edit(&edit(0, *action))),
            _ => {}
        }
        many.step();
        collect(&mut many, 0);
    }
    collect(&mut many, 1);
    many.step();
    collect(&mut many, 1);
    let (first, second, third) = (edit(0, at(1.0)), edit(1, EditAction::Hide), edit(0, at(3.0)));
    assert_eq!(heard[0], [frame, first, frame, second, frame, third, frame, frame, frame]);
    assert_eq!(heard[1][..2], [second, third], "who joins late hears what is in force, before any frame");
    assert!(heard[1][2..].iter().all(|one| *one == frame) && heard[1].len() > 2);
}
