//! Bodies of the fuzz targets, and the seeds of their corpora.
//!
//! With any input, a body must not panic or allocate more than the limits allow, and its assertions must hold. The
//! targets under `fuzz/` only call these functions. `cargo test` runs them over the committed corpora.

use crate::message::{
    Accept, Ack, Auth, Budget, CameraPose, Close, CloseCode, Edit, EditAction, Gap, Hello, KeyframeReason,
    Message, Ping, Pong, Reject, RejectCode, Report, Request, Scene, Stamp, Token, View,
};
use crate::recording::{
    Bounds, Player, PlayerEvent, Reader, Summary, Writer, cut, load_index, recover, repair,
};
use crate::sample::{Error, SampleServer, recording as sample_recording, recording_of};
use crate::session::{Access, ClientSession, ServerSession, SharedBody};
use crate::{
    FrameIndex, FrameType, Framer, Group, Limits, Micros, Numbering, Profile, Sequence, StateHash,
    write_frame,
};

/// Returns small limits, so that a target that exceeds them runs out of memory soon.
fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.codec.max_instances = 64;
    limits.codec.max_buckets = 1 << 10;
    limits.codec.max_cells = 1 << 10;
    limits.codec.max_points = 1 << 10;
    limits.codec.max_block_bytes = 1 << 20;
    limits.codec.max_frame_bytes = 1 << 20;
    limits
}

/// Sizes of chunks, taken from the data itself.
fn chunks(data: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = data;
    let mut turn = 0;
    std::iter::from_fn(move || {
        let size = 1 + usize::from(data.get(turn % data.len().max(1))? % 64);
        turn += 1;
        let (chunk, after) = rest.split_at(size.min(rest.len()));
        rest = after;
        (!chunk.is_empty()).then_some(chunk)
    })
}

/// Returns frames with right checksums, made from any bytes: one byte each for type, group and sequence, two for the
/// length, then the payload. A fuzzer need not look for damage that a checksum would find.
fn framed(data: &[u8]) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    let mut rest = data;
    while let Some((&[kind, group, sequence, low, high], after)) = rest.split_first_chunk() {
        let (payload, after) = after.split_at(after.len().min(u16::from_le_bytes([low, high]).into()));
        rest = after;
        let mut frame = Vec::new();
        let (kind, group, sequence) = (FrameType(kind), Group(group.into()), Sequence(sequence.into()));
        if write_frame(&mut frame, kind, group, sequence, payload).is_ok() {
            frames.push(frame);
        }
    }
    frames
}

/// Checks frames and messages of a byte stream: chunking has no effect, and everything that is read is written back
/// equal.
///
/// The bytes are also read as one message, of the type in their first byte.
pub fn framer(data: &[u8]) {
    if let Some((&kind, payload)) = data.split_first() {
        message(FrameType(kind), payload);
    }
    let mut whole = Framer::new(limits());
    whole.push(data);
    let mut pieces = Framer::new(limits());
    let mut feed = chunks(data);
    loop {
        let frame = whole.next_frame();
        let piece = loop {
            match pieces.next_frame().map(|f| f.map(|f| f.bytes.to_vec())) {
                Ok(None) => match feed.next() {
                    Some(chunk) => pieces.push(chunk),
                    None => break Ok(None),
                },
                found => break found,
            }
        };
        assert_eq!(frame.map(|f| f.map(|f| f.bytes.to_vec())), piece, "chunking changed the frames");
        let Ok(Some(frame)) = frame else { return };
        let mut again = Vec::new();
        let header = frame.header;
        let written = write_frame(&mut again, header.kind, header.group, header.sequence, frame.payload());
        assert!(written.is_ok() && again == frame.bytes, "a frame changed when it was written again");
        message(header.kind, frame.payload());
    }
}

fn message(kind: FrameType, payload: &[u8]) {
    fn check<M: Message>(payload: &[u8]) {
        if let Ok(message) = M::from_payload(payload) {
            assert_eq!(
                message.to_payload().as_deref(),
                Ok(payload),
                "{} changed when written again",
                M::NAME
            );
        }
    }
    match kind {
        FrameType::HELLO => check::<Hello>(payload),
        FrameType::ACCEPT => check::<Accept>(payload),
        FrameType::REJECT => check::<Reject>(payload),
        FrameType::SCENE => check::<Scene>(payload),
        FrameType::VIEW => check::<View>(payload),
        FrameType::EDIT => check::<Edit>(payload),
        FrameType::REQUEST => check::<Request>(payload),
        FrameType::REPORT => check::<Report>(payload),
        FrameType::CLOSE => check::<Close>(payload),
        FrameType::ACK => check::<Ack>(payload),
        FrameType::AUTH => check::<Auth>(payload),
        FrameType::PING => check::<Ping>(payload),
        FrameType::PONG => check::<Pong>(payload),
        FrameType::STAMP => check::<Stamp>(payload),
        FrameType::BUDGET => check::<Budget>(payload),
        FrameType::GAP => check::<Gap>(payload),
        _ => {}
    }
}

/// Checks a whole file: every byte belongs to a record, a damage, the file header or a footer, and every played state
/// has the right hash. Bytes that are not a recording are first made into the frames of one.
pub fn recording(data: &[u8]) {
    if Reader::with_limits(data, limits()).is_ok() {
        return read_and_play(data);
    }
    let (mut writer, mut file) = Writer::new(limits());
    for (arrival, frame) in (0..).zip(framed(data)) {
        // A frame over the limits is refused and has no effect.
        file.extend(writer.append(Micros(arrival), &frame).unwrap_or_default());
    }
    read_and_play(&file);
}

fn read_and_play(data: &[u8]) {
    let Ok(reader) = Reader::with_limits(data, limits()) else { return };
    let mut end = 0;
    for item in reader {
        let (start, bytes) = match item {
            Ok(record) => (record.offset(), record.record_bytes()),
            Err(damage) => (damage.offset, damage.lost_bytes),
        };
        assert!(start >= end && bytes > 0, "items overlap at {start}");
        // Only a file header and footers, 16 bytes each, are skipped.
        assert_eq!((start - end) % 16, 0, "bytes before {start} were passed over");
        end = start + bytes;
    }
    assert!(end <= data.len() as u64, "an item reaches beyond the file");
    let summary = Summary::scan(data, limits());
    let index = load_index(data, limits());
    assert!(summary.is_ok() && index.is_ok(), "a file that can be read cannot be scanned");
    let Ok(mut player) = Player::new(data, limits()) else { return };
    while let Some(event) = player.next_event() {
        if let (PlayerEvent::Frame(frame), Some(state)) = (event, player.state()) {
            assert_eq!((state.hash(), state.full_hash()), (frame.info.hash, frame.info.hash));
        }
    }
    rewritten(data, player.stats().applied);
    repaired(data);
}

/// Checks that repairing changes nothing but what it says.
fn repaired(data: &[u8]) {
    let mut file = data.to_vec();
    let stretches = repair(&mut file, limits());
    let said = |at: usize| stretches.iter().any(|s| (s.offset..s.offset + s.bytes).contains(&(at as u64)));
    for (at, (before, after)) in data.iter().zip(&file).enumerate() {
        assert!(before == after || said(at), "byte {at} was changed without a word");
    }
}

/// Checks that a recovered file and a cut file play without errors, and that recovery loses no playable frame.
fn rewritten(data: &[u8], playable: u64) {
    let frames = |file: &[u8]| {
        let mut player = Player::new(file, limits()).ok()?;
        while player.next_event().is_some() {}
        let stats = player.stats();
        assert_eq!((stats.damages, stats.unusable, stats.bad_messages), (0, 0, 0));
        Some(stats.applied)
    };
    let mut file = Vec::new();
    let mut put = |bytes: &[u8]| {
        file.extend_from_slice(bytes);
        Ok::<(), std::convert::Infallible>(())
    };
    assert!(recover(data, false, limits(), &mut put).is_ok(), "a file that can be read cannot be recovered");
    assert_eq!(frames(&file), Some(playable));
    file.clear();
    let bounds = Bounds::Frames(FrameIndex(1), FrameIndex(u32::MAX));
    let put = |bytes: &[u8]| {
        file.extend_from_slice(bytes);
        Ok::<(), std::convert::Infallible>(())
    };
    if let Ok(done) = cut(data, &bounds, limits(), put) {
        assert_eq!(frames(&file), Some(done.frames));
    }
}

/// Gives bytes in chunks to one end of a session. The bits of the first byte select: 0, the server's end; 1, a
/// completed handshake before the bytes; 2, bytes made into frames with right checksums; 3, profile `surface`.
pub fn session(data: &[u8]) {
    let Some((&mode, data)) = data.split_first() else { return };
    let profile = if mode & 8 == 0 { Profile::PAPER } else { Profile::SURFACE };
    let Ok(source) = SampleServer::of(profile) else { return };
    let mut server = ServerSession::new(source.scene().clone(), Access::Open, limits());
    let mut client = ClientSession::new(limits());
    if mode & 2 != 0 {
        let events = server.handle(&client.take_output(), Micros(0));
        let ready = client.handle(&server.take_output(), Micros(0));
        assert!(events.is_ok() && ready.is_ok(), "a good handshake failed");
    }
    let made = framed(data);
    let pieces: Vec<&[u8]> =
        if mode & 4 == 0 { chunks(data).collect() } else { made.iter().map(Vec::as_slice).collect() };
    for chunk in pieces {
        let over = if mode & 1 == 0 {
            client.handle(chunk, Micros(0)).is_err()
        } else {
            server.handle(chunk, Micros(0)).is_err()
        };
        // The same bytes must be harmless as a datagram, too.
        client.handle_datagram(chunk, Micros(0));
        server.handle_datagram(chunk, Micros(0));
        if over {
            break;
        }
    }
    if let Some(state) = client.state() {
        assert_eq!(state.hash(), state.full_hash(), "hash and content disagree");
    }
}

/// A file of a corpus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seed {
    /// Its fuzz target.
    pub target: &'static str,
    /// Name of the file.
    pub name: &'static str,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// Returns the corpus seeds of all targets, including those of `psao_codec::fuzzing` (`frame`, `round_trip`,
/// `surface_*`).
///
/// # Errors
/// None is expected; see [`Error`].
pub fn seeds() -> Result<Vec<Seed>, Error> {
    let file = sample_recording(3, 2)?;
    let mut cut = file.clone();
    cut.truncate(file.len() - 40);
    let mut damaged = file.clone();
    if let Some(byte) = damaged.get_mut(700) {
        *byte ^= 0x10;
    }
    let (up, down) = conversation(Profile::PAPER)?;
    let (_, surface_down) = conversation(Profile::SURFACE)?;
    let surface = recording_of(Profile::SURFACE, 3, 2)?;
    let surface_unframed = unframed(&surface)?;
    let behind = |mode: u8, bytes: &[u8]| [&[mode][..], bytes].concat();
    let frames: Vec<u8> = Reader::new(&file)?
        .flatten()
        .filter(|r| r.frame.header.kind != FrameType::SCENE)
        .flat_map(|r| r.frame.bytes.to_vec())
        .collect();
    let unframed = unframed(&file)?;
    let seed = |target, name, bytes| Seed { target, name, bytes };
    let key = SampleServer::new()?.step()?.body;
    // Multiples of an odd number, so that the bytes have no pattern that a decoder knows.
    let mixed = |seed: u32, count: u32| -> Vec<u8> {
        (0..count).map(|n| ((n + seed).wrapping_mul(0x9E37_79B1) >> 24) as u8).collect()
    };
    Ok(vec![
        seed("frame", "plain", behind(0, &key)),
        seed("frame", "changed-delta", vec![2, 40, 1, 45, 255]),
        seed("frame", "changed-plain-delta", vec![4, 60, 3, 90, 1]),
        seed("frame", "changed-plain-key", vec![5, 50, 7, 120, 64]),
        seed("round_trip", "short", mixed(1, 48)),
        seed("round_trip", "long", mixed(7, 700)),
        // One change to a frame of every kind and coder; one section of noise; noise.
        seed("surface_decode", "changed-key-range", vec![0, 60, 0, 1]),
        seed("surface_decode", "changed-arrivals-range", vec![1, 70, 0, 64]),
        seed("surface_decode", "changed-delta-range", vec![2, 40, 0, 8]),
        seed("surface_decode", "changed-late-range", vec![3, 0, 4, 16]),
        seed("surface_decode", "changed-key-plain", vec![4, 0, 2, 1]),
        seed("surface_decode", "changed-delta-plain", vec![6, 50, 0, 2]),
        seed("surface_decode", "changed-late-lz4", vec![11, 90, 0, 3]),
        seed("surface_decode", "changed-arrivals-zstd", vec![13, 90, 0, 3]),
        seed("surface_decode", "changed-patch-range", vec![0x80, 40, 0, 1]),
        seed("surface_decode", "changed-patch-stored", vec![0x85, 36, 0, 2]),
        seed("surface_decode", "changed-patch-context", vec![0x82, 90, 1, 3]),
        seed("surface_decode", "section-of-patch", [&[0xA0, 8, 3, 20, 0, 60, 0][..], &mixed(5, 40)].concat()),
        seed("surface_decode", "section-of-changes", [&[34, 6, 3, 20, 0, 60, 0][..], &mixed(3, 40)].concat()),
        seed(
            "surface_decode",
            "section-of-geometry",
            [&[32, 4, 3, 150, 0, 118, 6][..], &mixed(5, 90)].concat(),
        ),
        seed("surface_decode", "frame", behind(0x30, &key)),
        seed("surface_round_trip", "short", surface_operations(8, 0)),
        seed("surface_round_trip", "shared", surface_operations(3, 1)),
        seed("surface_round_trip", "budget", surface_operations(2, 0x6A)),
        seed("surface_round_trip", "noise", [&[2, 0][..], &mixed(9, 120)].concat()),
        seed("framer", "client", up.clone()),
        seed("framer", "server", down.clone()),
        seed("recording", "whole", file),
        seed("recording", "cut", cut),
        seed("recording", "damaged", damaged),
        seed("session", "client", behind(0, &down)),
        seed("session", "server", behind(1, &up)),
        seed("session", "frames", behind(2, &frames)),
        seed("session", "unframed", behind(6, &unframed)),
        seed("recording", "unframed", unframed),
        seed("framer", "surface", surface_down.clone()),
        seed("recording", "surface", surface),
        seed("recording", "surface-unframed", surface_unframed.clone()),
        seed("session", "surface", behind(8, &surface_down)),
        seed("session", "surface-unframed", behind(14, &surface_unframed)),
    ])
}

/// Returns the frames of a recording as [`framed`] takes them.
fn unframed(file: &[u8]) -> Result<Vec<u8>, Error> {
    let mut unframed = Vec::new();
    for record in Reader::new(file)?.flatten() {
        let header = record.frame.header;
        unframed
            .extend([u32::from(header.kind.0), header.group.0, header.sequence.0].map(|value| value as u8));
        unframed.extend((header.length as u16).to_le_bytes());
        unframed.extend_from_slice(record.frame.payload());
    }
    Ok(unframed)
}

/// Returns operations for `surface_round_trip`: a moving shadow with every coder, late points, a joining client, a
/// failed frame, and a keyframe.
fn surface_operations(threshold: u8, source: u8) -> Vec<u8> {
    let mut operations = vec![threshold, source, 4, 0, 150, 200, 0, 15];
    for frame in 0..8 {
        let coder = (frame % 4) << 4;
        operations.extend([4, 20 * frame, 40, 120 + frame, 3, 9 | coder]);
        match frame {
            2 => operations.extend([4, 140, 155, 90, 1]),
            3 => operations.extend([7 | coder, 1]),
            5 => operations.push(8),
            6 => operations.push(15 | coder),
            _ => {}
        }
    }
    operations
}

/// Returns every message of a client, and every message of a server.
fn conversation(profile: Profile) -> Result<(Vec<u8>, Vec<u8>), Error> {
    let mut source = SampleServer::of(profile)?;
    let mut client = ClientSession::new(Limits::default());
    let mut server = ServerSession::new(source.scene().clone(), Access::Open, Limits::default());
    let mut up = client.take_output();
    server.handle(&up, Micros(0))?;
    let mut next = || source.step().map(|frame| SharedBody::new(&frame.info, frame.body, Micros(0)));
    server.send_keyframe(&next()?)?;
    server.send_update(&next()?, FrameIndex(0))?;
    server.send_report(&source.report(FrameIndex(1)))?;
    server.close(CloseCode::DONE, "");
    let mut down = server.take_output();
    let mut plain = Numbering::default();
    down.extend(plain.message(&Reject::new(RejectCode::BUSY, "full"))?);
    down.extend(plain.update(b"no body")?);
    write_frame(&mut down, FrameType(99), Group(1), Sequence(2), b"later")?;
    let camera = CameraPose {
        eye: [0.0, 1.0, 5.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 60.0,
        aspect: 1.5,
    };
    up.extend(plain.message(&View { camera })?);
    let action = EditAction::Move { translation: [1.0, 2.0, 3.0], rotation: [0.0, 0.0, 0.0, 1.0] };
    up.extend(plain.message(&Edit { instance: 1, action })?);
    up.extend(plain.message(&Request::Keyframe { reason: KeyframeReason::ASKED })?);
    up.extend(plain.message(&Ack { frame: FrameIndex(1), hash: StateHash(2) })?);
    up.extend(plain.message(&Request::Stamps)?);
    up.extend(plain.message(&Request::Datagrams { bytes: 1200 })?);
    let (sent, frame) = (Micros(5), FrameIndex(1));
    let answer = Pong { sent, received: Micros(6), replied: Micros(7) };
    let edit = Edit { instance: 0, action: EditAction::Hide };
    for (both, ways) in [(&mut up, "up"), (&mut down, "down")] {
        both.extend(plain.message(&Ping { sent })?);
        both.extend(plain.message(&answer)?);
        if ways == "down" {
            both.extend(plain.message(&Stamp { frame, captured: sent, sent })?);
            both.extend(plain.message(&Budget { frame, budget: 99, postponed: 1, ..Budget::default() })?);
            both.extend(plain.message(&edit)?);
        }
    }
    up.extend(plain.message(&Auth { token: Token::new(*b"a token of a seed")? })?);
    up.extend(plain.message(&Close::new(CloseCode::STOPPED, "bye"))?);
    Ok((up, down))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    type Body = fn(&[u8]);
    const BODIES: [(&str, Body); 3] = [("framer", framer), ("recording", recording), ("session", session)];

    #[test]
    fn seeds_reach_what_they_are_for() {
        let seeds = seeds().unwrap();
        for (target, body) in BODIES {
            for seed in seeds.iter().filter(|seed| seed.target == target) {
                body(&seed.bytes);
            }
        }
        let framer_seeds: Vec<u8> =
            seeds.iter().filter(|seed| seed.target == "framer").flat_map(|seed| seed.bytes.clone()).collect();
        let mut framer = Framer::new(limits());
        framer.push(&framer_seeds);
        let mut types = std::collections::BTreeSet::new();
        while let Some(frame) = framer.next_frame().unwrap() {
            types.insert(frame.header.kind.0);
        }
        let unframed = seeds.iter().find(|seed| seed.name == "unframed").unwrap();
        let frames: Vec<u8> = framed(&unframed.bytes[1..]).concat();
        let file = sample_recording(3, 2).unwrap();
        let recorded: Vec<u8> =
            Reader::new(&file).unwrap().flat_map(|r| r.unwrap().frame.bytes.to_vec()).collect();
        assert_eq!(frames, recorded);
        assert_eq!(types, (1..=17).chain([99]).collect(), "a type of frame has no seed");
    }

    proptest! {
        #[test]
        fn damaged_seeds_pass(pick in any::<usize>(), changes in prop::collection::vec(any::<(usize, u8)>(), 1..6)) {
            let seeds = seeds().unwrap();
            let (target, body) = BODIES[pick % BODIES.len()];
            for seed in seeds.iter().filter(|seed| seed.target == target) {
                let mut bytes = seed.bytes.clone();
                for &(place, value) in &changes {
                    let place = place % bytes.len();
                    bytes[place] = value;
                }
                body(&bytes);
            }
        }
    }
}
