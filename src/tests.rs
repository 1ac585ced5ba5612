//! A publisher and a subscriber, against each other.

#![expect(clippy::unwrap_used, reason = "helpers of tests say what they expected by panicking")]

use std::time::{Duration, Instant};

use psao_codec::envelope::{FrameIndex, FrameKind};

use super::*;

/// Points of a bar along x, 10 cm apart, in an order that is not the stream's.
fn bar(count: u16) -> Vec<RestPoint> {
    let mut points: Vec<_> = (0..count)
        .map(|i| RestPoint { position: [f32::from(i) * 0.1, 0.0, 0.5], normal: [0.0, 1.0, 0.0], chart: 0 })
        .collect();
    points.reverse();
    points.swap(1, 7);
    points
}

/// A stream of two bars of 100 points.
fn publisher() -> (Publisher, InstanceId, InstanceId) {
    let mut builder = Publisher::builder("two bars").threshold(2).fps(50.0);
    let mesh = builder.mesh(&bar(100), 0.25);
    let (left, right) = (builder.instance(mesh), builder.instance(mesh));
    (builder.build().unwrap(), left, right)
}

/// An accessibility for each point of a bar in each frame.
fn ao(frame: u16, point: usize) -> f32 {
    f32::from(frame * 7 % 50 + point as u16) / 200.0
}

/// Sends five frames; all points of the left bar change, and one of the right.
fn send(publisher: &mut Publisher, left: InstanceId, right: InstanceId) -> Vec<SentFrame> {
    let frame = |frame: u16| {
        let values: Vec<f32> = (0..100).map(|point| ao(frame, point)).collect();
        publisher.set_all(left, &values).unwrap();
        publisher.set_ao(right, 3, ao(frame, 3)).unwrap();
        publisher.send().unwrap()
    };
    (0..5).map(frame).collect()
}

/// Largest error of the AO that a state holds at the points of the left bar, in the caller's order.
fn error(state: &State, frame: u16) -> f32 {
    let state = state.as_surface().unwrap();
    let geometry = state.geometry(0).unwrap();
    let mut worst = 0.0_f32;
    for (number, value) in state.values(0).iter().enumerate() {
        let x = geometry.position(number)[0];
        let point = bar(100).iter().position(|point| (point.position[0] - x).abs() < 0.02).unwrap();
        worst = worst.max((f32::from(*value) / 255.0 - ao(frame, point)).abs());
    }
    worst
}

#[test]
fn a_recording_holds_what_was_published() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bars.psao");
    let (mut publisher, left, right) = publisher();
    publisher.record(&path).unwrap();
    let sent = send(&mut publisher, left, right);
    assert!(matches!(publisher.record(&path), Err(PublishError::Begun)));
    assert_eq!(
        sent.iter().map(|frame| frame.info.time.0).collect::<Vec<_>>(),
        [0, 20_000, 40_000, 60_000, 80_000]
    );
    publisher.finish("over").unwrap();

    let mut subscriber = Subscriber::open(&path).unwrap();
    subscriber.track_changes();
    let (mut hashes, mut changed, mut closed) = (Vec::new(), Vec::new(), false);
    while let Some(event) = subscriber.next_event().unwrap() {
        match event {
            Event::Scene(scene) => assert_eq!((scene.point_count(), scene.instance_count()), (200, 2)),
            Event::Frame(info) => {
                hashes.push(info.hash);
                assert!(error(subscriber.state().unwrap(), info.frame.0 as u16) <= 2.5 / 255.0);
                if let Some(base) = info.frame.0.checked_sub(1) {
                    let points = subscriber.changed_since(FrameIndex(base)).map(Iterator::collect::<Vec<_>>);
                    changed.push(points.unwrap());
                }
            }
            Event::Closed(_) => closed = true,
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(hashes, sent.iter().map(|frame| frame.info.hash).collect::<Vec<_>>());
    assert!(closed && subscriber.is_over());
    for points in changed {
        assert_eq!(points.iter().filter(|point| point.instance == left.0).count(), 100);
        assert_eq!(points.iter().filter(|point| point.instance == right.0).count(), 1);
        assert!(points.iter().all(|point| point.point < 100));
    }
}

#[test]
fn a_client_follows_a_publisher_and_both_say_goodbye() {
    let (mut publisher, left, right) = publisher();
    let address = publisher.listen("127.0.0.1:0").unwrap().to_string();
    let client = std::thread::spawn(move || {
        let mut subscriber = Subscriber::connect(&address).unwrap();
        let (mut frames, mut last) = (Vec::new(), None);
        while let Some(event) = subscriber.next_event().unwrap() {
            match event {
                Event::Frame(info) => frames.push((info.frame.0, info.kind)),
                Event::Closed(close) => last = Some(close.text.to_string()),
                _ => {}
            }
        }
        assert!(subscriber.is_over() && subscriber.poll().unwrap().is_none());
        (frames, last, subscriber.state().unwrap().hash())
    });
    assert!(publisher.wait_for_clients(1, Duration::from_secs(20)).unwrap());
    send(&mut publisher, left, right);
    let hash = publisher.state().hash();
    publisher.finish("the bars are gone").unwrap();
    let (frames, last, found) = client.join().unwrap();
    assert_eq!(frames.first(), Some(&(0, FrameKind::Key)));
    assert_eq!((frames.last().map(|frame| frame.0), last.as_deref()), (Some(4), Some("the bars are gone")));
    assert_eq!(found, hash);
}

#[test]
fn polling_never_waits_and_misses_nothing() {
    let (mut publisher, left, right) = publisher();
    let address = publisher.listen("127.0.0.1:0").unwrap().to_string();
    let mut subscriber = Subscriber::connect(&address).unwrap();
    let started = Instant::now();
    let mut polled = 0;
    while publisher.hub().unwrap().joined() == 0 {
        polled += usize::from(subscriber.poll().unwrap().is_some());
        assert!(started.elapsed() < Duration::from_secs(20));
    }
    send(&mut publisher, left, right);
    while subscriber.state().and_then(State::frame) != Some(FrameIndex(4)) {
        polled += usize::from(subscriber.poll().unwrap().is_some());
        assert!(started.elapsed() < Duration::from_secs(20), "{polled} events came");
    }
    assert_eq!(subscriber.state().map(State::hash), Some(publisher.state().hash()));
}

#[test]
fn edits_reach_the_publisher_and_come_back_to_clients() {
    use psao_proto::message::{Edit, EditAction};
    use psao_proto::net::HubEvent;

    let (mut publisher, left, right) = publisher();
    let address = publisher.listen("127.0.0.1:0").unwrap().to_string();
    let mut subscriber = Subscriber::connect(&address).unwrap();
    let wanted = Edit { instance: right.0, action: EditAction::Hide };
    let started = Instant::now();
    let (mut sent, mut asked) = (false, None);
    let mut seen = false;
    while !seen {
        assert!(started.elapsed() < Duration::from_secs(20));
        if let Some(event) = subscriber.poll().unwrap() {
            seen = event == Event::Edit(wanted);
        }
        if !sent && subscriber.state().is_some() {
            subscriber.edit(&wanted).unwrap();
            sent = true;
        }
        for event in publisher.take_events() {
            if let HubEvent::Edit { edit, .. } = event {
                asked = Some(edit);
                publisher.announce_edit(&edit).unwrap();
            }
        }
        send(&mut publisher, left, right);
    }
    assert_eq!(asked, Some(wanted));
}

#[test]
fn a_client_with_a_scene_takes_a_stream_that_names_none() {
    let (mut publisher, left, right) = publisher();
    let address = publisher.listen("127.0.0.1:0").unwrap().to_string();
    let session = psao_proto::session::ClientOptions::default().with_scene(Some([7; 32]));
    let options = psao_proto::net::ConnectOptions::default().with_session(session);
    let mut subscriber = Subscriber::connect_with(&address, &options, Limits::default()).unwrap();
    while subscriber.state().and_then(State::frame).is_none() {
        subscriber.poll().unwrap();
        send(&mut publisher, left, right);
    }
}

#[test]
fn what_makes_no_stream_is_refused_by_name() {
    let refused = |builder: PublisherBuilder| builder.build().unwrap_err().to_string();
    let text = refused(Publisher::builder("x").fps(f32::NAN));
    assert!(text.contains("fps"), "{text}");
    let text = refused(Publisher::builder("x").threshold(0));
    assert!(text.contains("threshold"), "{text}");
    let mut builder = Publisher::builder("x");
    builder.instance(MeshId(3));
    let text = refused(builder);
    assert!(text.contains("mesh 3"), "{text}");
    for radius in [0.0, -1.0, f32::NAN] {
        let mut builder = Publisher::builder("x");
        let mesh = builder.mesh(&bar(10), radius);
        builder.instance(mesh);
        assert!(matches!(builder.build(), Err(PublishError::Scene(_))), "{radius}");
    }
    let (mut publisher, left, _) = publisher();
    assert!(matches!(publisher.set_ao(left, 100, 1.0), Err(PublishError::NoPoint { point: 100, .. })));
    assert!(matches!(publisher.set_ao(InstanceId(2), 0, 1.0), Err(PublishError::NoPoint { .. })));
    let few = publisher.set_all(left, &[1.0; 99]);
    assert!(matches!(few, Err(PublishError::Values { points: 100, found: 99, .. })));
    assert!(publisher.listen("nowhere").is_err() && publisher.listen("0.0.0.0:0").is_err());
    assert!(matches!(Subscriber::open("no such file"), Err(SubscribeError::Read { .. })));
    assert!(matches!(Subscriber::open(file!()), Err(SubscribeError::Recording { .. })));
}

#[test]
fn values_and_meshes_of_any_kind_make_a_stream() {
    let mut builder = Publisher::builder(&"long ".repeat(50)).fps(1e-3);
    let empty = builder.mesh(&[], 0.1);
    let same = builder.mesh(&[RestPoint { position: [1e6; 3], normal: [0.0; 3], chart: 0 }; 70], 1e-6);
    let instances = [empty, same].map(|mesh| builder.instance(mesh));
    let mut publisher = builder.build().unwrap();
    for value in [f32::NAN, f32::INFINITY, -1.0, 2.0, 0.5] {
        publisher.set_all(instances[0], &[]).unwrap();
        publisher.set_all(instances[1], &[value; 70]).unwrap();
        publisher.send().unwrap();
    }
    let half = publisher.state();
    let StateRef::Surface(state) = half else { panic!("of profile surface") };
    assert!(state.values(1).iter().all(|value| value.abs_diff(128) < 8));
}

#[test]
fn the_sample_of_the_examples_plays_and_is_what_the_example_records() {
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/wall.psao");
    let mut subscriber = Subscriber::open(sample).unwrap();
    let mut frames = 0;
    while let Some(event) = subscriber.next_event().unwrap() {
        match event {
            Event::Frame(info) => {
                assert_eq!(info.frame.0, frames);
                frames += 1;
            }
            Event::Scene(_) | Event::Closed(_) => {}
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(frames, 90);
}

/// Removes the indentation that all lines share.
fn flush_left(text: &str) -> String {
    let indent = |line: &str| line.len() - line.trim_start().len();
    let least = text.lines().filter(|line| !line.trim().is_empty()).map(indent).min().unwrap_or(0);
    let lines = text.lines().map(|line| line.get(least..).unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn the_readme_quotes_the_examples() {
    let folder = env!("CARGO_MANIFEST_DIR");
    let readme = std::fs::read_to_string(format!("{folder}/README.md")).unwrap();
    let mut quoted = std::collections::BTreeSet::new();
    for part in readme.split("<!-- examples/").skip(1) {
        let (name, rest) = part.split_once(" -->\n```rust\n").unwrap();
        let quote = rest.split_once("\n```").unwrap().0;
        let example = std::fs::read_to_string(format!("{folder}/examples/{name}")).unwrap();
        let lines: Vec<&str> = example.lines().collect();
        let stands = |window: &[&str]| flush_left(&window.join("\n")) == quote;
        assert!(lines.windows(quote.lines().count()).any(stands), "{name} does not have: {quote}");
        quoted.insert(name.to_owned());
    }
    for entry in std::fs::read_dir(format!("{folder}/examples")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if let Some(path) = name.strip_suffix(".rs") {
            assert!(quoted.contains(&name), "{path} is not in the README");
            let lines = std::fs::read_to_string(format!("{folder}/examples/{name}")).unwrap().lines().count();
            assert!(lines < 60, "{name} has {lines} lines");
        }
    }
}
