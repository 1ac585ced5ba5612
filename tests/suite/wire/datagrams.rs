//! Frame bodies cut into datagrams, and a receiver's outcome for each.

use psao_codec::State;
use psao_codec::envelope::FrameKind;
use psao_proto::message::{Ack, Message as _};
use psao_proto::sample::SampleServer;
use psao_proto::session::{Access, ClientOptions, ClientSession, ServerEvent, ServerSession, SharedBody};
use psao_proto::{FrameIndex, Limits, Micros, Profile, StateHash};

use super::accepted::empty_body;
use super::object::Object;
use super::{Case, CaseKind, describe};
use crate::vectors::json::lines;

/// The frame that a client has applied before the datagrams arrive.
const HERE: u32 = 5;
/// Bytes of a datagram's header.
const HEADER: usize = 20;
/// Largest datagram of these vectors in bytes.
const MOST: u16 = 64;

/// Division of a file into datagrams, and the expected bodies.
pub(super) struct Plan {
    to: Receiver,
    /// Bytes of each datagram, in the order of arrival.
    lengths: Vec<usize>,
    /// Frame number and bytes of each completed body, in that order. The client's counts do not show them.
    wholes: Vec<(u32, Vec<u8>)>,
}

#[derive(Clone, Copy, PartialEq)]
enum Receiver {
    Client,
    Server,
}

/// Returns a client that has frame [`HERE`], and its server, which got the acknowledgement and may send datagrams.
fn ends() -> (ClientSession, ServerSession) {
    let now = Micros(0);
    let scene = SampleServer::of(Profile::SURFACE).unwrap().scene().clone();
    let mut server = ServerSession::new(scene, Access::Open, Limits::default());
    let options = ClientOptions::default().with_datagrams(Some(MOST));
    let mut client = ClientSession::with(Limits::default(), options);
    for _ in 0..2 {
        server.handle(&client.take_output(), now).unwrap();
        client.handle(&server.take_output(), now).unwrap();
    }
    let keyframe = body(FrameKind::Key, HERE, empty_body(Profile::SURFACE, 1, HERE));
    server.send_keyframe(&keyframe).unwrap();
    client.handle(&server.take_output(), now).unwrap();
    server.handle(&client.take_output(), now).unwrap();
    assert_eq!(client.state().and_then(State::frame), Some(FrameIndex(HERE)));
    (client, server)
}

fn body(kind: FrameKind, frame: u32, bytes: Vec<u8>) -> SharedBody {
    let (frame, hash, captured) = (FrameIndex(frame), StateHash(0), Micros(0));
    SharedBody { kind, frame, hash, captured, bytes: bytes.into() }
}

impl Plan {
    pub(super) fn json(&self, mut bytes: &[u8]) -> String {
        let (mut client, mut server) = ends();
        let mut wholes = self.wholes.iter();
        let mut items = vec![];
        for length in &self.lengths {
            let (datagram, rest) = bytes.split_at(*length);
            bytes = rest;
            let item = Object::default().with("length", length);
            let item = match self.to {
                Receiver::Client => match given_to_client(&mut client, datagram) {
                    "whole" => {
                        let (frame, body) = wholes.next().unwrap();
                        item.text("outcome", "whole").with("frame", frame).hex("body", body)
                    }
                    outcome => item.text("outcome", outcome),
                },
                Receiver::Server => match server.handle_datagram(datagram, Micros(0)) {
                    Some(ServerEvent::Acked(ack)) => {
                        item.text("outcome", "acknowledged").with("message", describe::ack(&ack).line())
                    }
                    Some(other) => unreachable!("{other:?}"),
                    None => item.text("outcome", "bad"),
                },
            };
            items.push(item.line());
        }
        assert!(bytes.is_empty() && wholes.next().is_none(), "bytes or bodies are left");
        let object = match self.to {
            Receiver::Client => Object::default().text("to", "client").with("here", HERE),
            Receiver::Server => Object::default().text("to", "server"),
        };
        object.with("datagrams", lines(&items)).file()
    }
}

/// Gives a datagram to a client and returns how the client counts it.
fn given_to_client(client: &mut ClientSession, datagram: &[u8]) -> &'static str {
    let before = client.stats();
    client.handle_datagram(datagram, Micros(0));
    let after = client.stats();
    // The client tries a whole body. The bodies of the vectors are not valid, so each counts as late.
    match (
        after.bad_datagrams - before.bad_datagrams,
        after.late_datagram_frames - before.late_datagram_frames,
    ) {
        (1, 0) => "bad",
        (0, 1) => "whole",
        (0, 0) => "waits",
        other => unreachable!("{other:?}"),
    }
}

/// Returns the datagrams into which a server cuts a body.
fn cut(frame: u32, bytes: &[u8]) -> Vec<Vec<u8>> {
    let (_, mut server) = ends();
    let body = body(FrameKind::Delta, frame, bytes.to_vec());
    server.send_datagrams(&body, FrameIndex(HERE)).unwrap();
    std::iter::from_fn(|| server.take_datagram()).collect()
}

/// Returns a datagram with arbitrary header fields and the right checksum.
fn made(kind: u8, frame: u32, (piece, pieces): (u16, u16), total: u32, content: &[u8]) -> Vec<u8> {
    let mut out = vec![0x51, 0xa0, kind, 0];
    out.extend_from_slice(&frame.to_le_bytes());
    out.extend_from_slice(&piece.to_le_bytes());
    out.extend_from_slice(&pieces.to_le_bytes());
    out.extend_from_slice(&total.to_le_bytes());
    out.extend_from_slice(&[0; 4]);
    out.extend_from_slice(content);
    sealed(out)
}

fn sealed(mut datagram: Vec<u8>) -> Vec<u8> {
    let crc = crc32c::crc32c_append(crc32c::crc32c(&datagram[..16]), &datagram[HEADER..]);
    datagram[16..HEADER].copy_from_slice(&crc.to_le_bytes());
    datagram
}

/// Returns a copy of `datagram` with one byte changed and the right checksum.
fn with(datagram: &[u8], at: usize, byte: u8) -> Vec<u8> {
    let mut datagram = datagram.to_vec();
    datagram[at] = byte;
    sealed(datagram)
}

/// Returns the bytes of a body. Their values do not matter to a reassembler.
fn bytes(count: u8, from: u8) -> Vec<u8> {
    (0..count).map(|number| number.wrapping_mul(7).wrapping_add(from)).collect()
}

pub(super) fn cases() -> Vec<Case> {
    let mut all = pieces();
    all.extend(refused_pieces());
    all.extend(acknowledgements());
    all
}

fn case(name: &str, to: Receiver, datagrams: &[&Vec<u8>], wholes: Vec<(u32, Vec<u8>)>) -> Case {
    let lengths = datagrams.iter().map(|datagram| datagram.len()).collect();
    let plan = Plan { to, lengths, wholes };
    let bytes = datagrams.iter().flat_map(|datagram| datagram.to_vec()).collect();
    Case { name: format!("datagram-{name}"), kind: CaseKind::Datagrams(plan), bytes }
}

fn pieces() -> Vec<Case> {
    let to_client =
        |name: &str, datagrams: &[&Vec<u8>], wholes| case(name, Receiver::Client, datagrams, wholes);
    let (short, long, longer) = (bytes(29, 1), bytes(100, 2), bytes(150, 3));
    let one = cut(6, &short);
    let three = cut(6, &long);
    let four = cut(7, &longer);
    assert_eq!((one.len(), three.len(), four.len()), (1, 3, 4));
    let shuffled = [&three[2], &three[0], &three[2], &three[1], &three[1]];
    let overtaken = [&three[1], &four[3], &three[0], &three[2], &four[0], &four[2], &four[1]];
    // As many pieces as there are bytes, or fewer than a server would make.
    let singles: Vec<Vec<u8>> = (0..3).map(|piece| made(1, 6, (piece, 3), 3, &[piece as u8])).collect();
    let alone = made(1, 6, (0, 1), 100, &long);
    let halves = [made(1, 6, (0, 2), 29, &short[..15]), made(1, 6, (1, 2), 29, &short[15..])];
    let old = [cut(4, &short), cut(HERE, &short)].concat();
    let largest = made(1, 6, (32_767, 32_768), 1 << 20, &[7; 32]);
    let over = made(1, 6, (0, 32_769), (1 << 20) + 1, &[7; 32]);
    let nothing = made(1, 6, (0, 1), 0, &[]);
    vec![
        to_client("one", &[&one[0]], vec![(6, short.clone())]),
        to_client("pieces", &three.iter().collect::<Vec<_>>(), vec![(6, long.clone())]),
        to_client("shuffled", &shuffled, vec![(6, long.clone())]),
        to_client("twice", &[&one[0], &one[0]], vec![(6, short.clone())]),
        to_client("overtaken", &overtaken, vec![(7, longer)]),
        to_client("lost", &[&three[0], &three[2]], vec![]),
        to_client("singles", &singles.iter().collect::<Vec<_>>(), vec![(6, vec![0, 1, 2])]),
        to_client("uncut", &[&alone], vec![(6, long)]),
        to_client("halves", &[&halves[1], &halves[0]], vec![(6, short.clone())]),
        to_client("of-nothing", &[&nothing], vec![(6, vec![])]),
        to_client("old", &[&old[0], &old[1], &one[0]], vec![(6, short)]),
        to_client("largest", &[&largest], vec![]),
        to_client("refused-over-limit", &[&over], vec![]),
    ]
}

fn refused_pieces() -> Vec<Case> {
    let body = bytes(100, 2);
    let good = cut(6, &body);
    let mut damaged = good[1].clone();
    damaged[40] ^= 1;
    let more = [&good[0][..], &[0]].concat();
    let alone = [
        ("empty", vec![]),
        ("short", good[0][..19].to_vec()),
        ("magic", with(&good[0], 0, 0x50)),
        ("flags", with(&good[0], 3, 1)),
        ("type", with(&good[0], 2, 3)),
        ("checksum", damaged),
        ("piece-cut", good[0][..good[0].len() - 1].to_vec()),
        ("piece-short", made(1, 6, (0, 3), 100, &body[..33])),
        ("piece-long", sealed(more)),
        ("last-long", made(1, 6, (2, 3), 100, &bytes(34, 0))),
        ("no-such-piece", made(1, 6, (3, 3), 100, &[])),
        ("no-pieces", made(1, 6, (0, 0), 0, &[])),
        // Ten bytes in six pieces would be two each, and none in the last.
        ("last-empty", made(1, 6, (0, 6), 10, &body[..2])),
        ("last-empty-itself", made(1, 6, (5, 6), 10, &[])),
        ("acknowledgement", made(2, 6, (0, 1), 12, &ack(6))),
    ];
    let mut all: Vec<Case> = alone
        .iter()
        .map(|(name, datagram)| case(&format!("refused-{name}"), Receiver::Client, &[datagram], vec![]))
        .collect();
    // Pieces with another length or count than the first piece of their frame do not belong to its body.
    let (other_length, other_number) =
        (made(1, 6, (1, 3), 99, &body[..33]), made(1, 6, (1, 4), 100, &body[..25]));
    let mixed = [&good[0], &other_length, &other_number, &good[1], &good[2]];
    all.push(case("refused-other-body", Receiver::Client, &mixed, vec![(6, body)]));
    all
}

fn ack(frame: u32) -> Vec<u8> {
    Ack { frame: FrameIndex(frame), hash: StateHash(0x0102_0304_0506_0708) }.to_payload().unwrap()
}

fn acknowledgements() -> Vec<Case> {
    let good = made(2, 6, (0, 1), 12, &ack(6));
    let mut damaged = good.clone();
    damaged[31] ^= 0x80;
    let largest = Ack { frame: FrameIndex(u32::MAX), hash: StateHash(u64::MAX) }.to_payload().unwrap();
    let mut all = vec![
        case("acknowledgement", Receiver::Server, &[&good], vec![]),
        case("acknowledgement-twice", Receiver::Server, &[&good, &good], vec![]),
        case(
            "acknowledgement-largest",
            Receiver::Server,
            &[&made(2, u32::MAX, (0, 1), 12, &largest)],
            vec![],
        ),
    ];
    for (name, datagram) in [
        ("checksum", damaged),
        ("flags", with(&good, 3, 0x80)),
        ("of-another-frame", made(2, 7, (0, 1), 12, &ack(6))),
        ("short", made(2, 6, (0, 1), 11, &ack(6)[..11])),
        ("long", made(2, 6, (0, 1), 13, &[&ack(6)[..], &[0]].concat())),
        ("of-nothing", made(2, 6, (0, 1), 0, &[])),
        ("type", with(&good, 2, 0)),
        ("piece", made(1, 6, (0, 1), 12, &ack(6))),
    ] {
        all.push(case(&format!("refused-acknowledgement-{name}"), Receiver::Server, &[&datagram], vec![]));
    }
    all
}
