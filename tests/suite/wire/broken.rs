//! Whole frames whose payload is not a valid message of their type.

use psao_proto::message::{MAX_BATCH, Message as _};
use psao_proto::{FrameType, Profile};

use super::Case;
use super::accepted::{self, Frames, empty_body};
use super::messages::{INSTANCE, MEMBER, SET, instances, members, sets};

/// Bytes of a wire frame's header.
const HEADER: usize = 20;
const NAN: [u8; 4] = [0, 0, 0xc0, 0x7f];
const INFINITY: [u8; 4] = [0, 0, 0x80, 0x7f];
const ZERO: [u8; 4] = [0; 4];
const MINUS_ONE: [u8; 4] = [0, 0, 0x80, 0xbf];
/// A length of a list or text that no memory could hold.
const ENDLESS: [u8; 8] = [0xff; 8];

pub(super) fn frames() -> Vec<Case> {
    let mut broken = BrokenFrames { good: accepted::frames(), frames: Frames { all: vec![] } };
    lengths(&mut broken);
    choices(&mut broken);
    texts(&mut broken);
    lists(&mut broken);
    values(&mut broken);
    scene_values(&mut broken);
    cameras(&mut broken);
    broken.frames.all
}

struct BrokenFrames {
    good: Vec<Case>,
    frames: Frames,
}

impl BrokenFrames {
    /// Returns the type and payload of a good frame.
    fn payload(&self, name: &str) -> (FrameType, Vec<u8>) {
        let case = self.good.iter().find(|case| case.name == name).unwrap();
        (FrameType(case.bytes[2]), case.bytes[HEADER..].to_vec())
    }

    fn add(&mut self, name: &str, kind: FrameType, payload: &[u8]) {
        self.frames.frame(&format!("refused-{name}"), kind, (0, 0), payload);
    }

    /// Adds a good frame's payload with `bytes` written at `at`.
    fn with(&mut self, name: &str, of: &str, at: usize, bytes: &[u8]) {
        let (kind, mut payload) = self.payload(of);
        payload[at..at + bytes.len()].copy_from_slice(bytes);
        self.add(name, kind, &payload);
    }

    /// Adds a good frame's payload cut at `at` and continued with `bytes`.
    fn ending(&mut self, name: &str, of: &str, at: usize, bytes: &[u8]) {
        let (kind, mut payload) = self.payload(of);
        payload.truncate(at);
        payload.extend_from_slice(bytes);
        self.add(name, kind, &payload);
    }
}

/// Names of one good case for each message and choice.
const EACH: [&str; 24] = [
    "hello",
    "accept",
    "reject-busy",
    "scene-info-paper",
    "scene-instances",
    "scene-sets",
    "scene-members",
    "view",
    "edit-move",
    "edit-release",
    "edit-show",
    "edit-hide",
    "request-keyframe-gap",
    "request-stamps",
    "request-datagrams",
    "report",
    "close-done",
    "ack",
    "auth",
    "ping",
    "pong",
    "stamp",
    "budget",
    "gap-1",
];

fn lengths(broken: &mut BrokenFrames) {
    for name in EACH {
        let (kind, payload) = broken.payload(name);
        broken.add(&format!("{name}-ended"), kind, &payload[..payload.len() - 1]);
        broken.add(&format!("{name}-extra"), kind, &[&payload[..], &[0]].concat());
    }
    for kind in (1..=17).filter(|kind| ![7, 8].contains(kind)).chain([65]).map(FrameType) {
        let name = kind.name().unwrap().to_lowercase();
        broken.add(&format!("{name}-of-nothing"), kind, &[]);
    }
    // A payload of another type.
    broken.add("ack-is-an-update", FrameType::ACK, &empty_body(Profile::PAPER, 2, 1));
}

fn choices(broken: &mut BrokenFrames) {
    for (name, of, at, next) in [
        ("scene", "scene-members", 0, 4_u32),
        ("edit", "edit-hide", 4, 4),
        ("request", "request-stamps", 0, 3),
    ] {
        broken.with(&format!("{name}-choice"), of, at, &next.to_le_bytes());
        broken.with(&format!("{name}-choice-largest"), of, at, &u32::MAX.to_le_bytes());
    }
    // A choice has four bytes.
    broken.with("edit-choice-wide", "edit-hide", 4, &[3, 1, 0, 0]);
}

fn texts(broken: &mut BrokenFrames) {
    let text = |bytes: &[u8]| [&(bytes.len() as u64).to_le_bytes()[..], bytes].concat();
    let name = |length: usize| text(&vec![b'n'; length]);
    broken.ending("hello-name-long", "hello", 32, &name(65));
    broken.ending("accept-name-long", "accept", 23, &name(65));
    broken.ending("reject-text-long", "reject-busy", 2, &name(513));
    broken.ending("close-text-long", "close-done", 2, &name(513));
    broken.ending("close-text-endless", "close-done", 2, &ENDLESS);
    let info = broken.payload("scene-info-paper").1;
    let (hall, rest) = (&info[4..16], &info[39..]);
    let scene = |parts: &[&[u8]]| [&ZERO[..], &parts.concat()].concat();
    broken.add("scene-name-long", FrameType::SCENE, &scene(&[&name(65), &info[16..39], rest]));
    broken.add("scene-source-long", FrameType::SCENE, &scene(&[hall, &name(513), rest]));

    broken.ending("hello-name-utf-8", "hello", 32, &text(b"caf\xff"));
    broken.ending("accept-name-utf-8", "accept", 23, &text(b"caf\xc3"));
    broken.ending("reject-text-utf-8", "reject-busy", 2, &text(b"an overlong \xc0\x80"));
    broken.ending("close-text-utf-8", "close-done", 2, &text(b"a surrogate \xed\xa0\x80"));
    broken.add("scene-name-utf-8", FrameType::SCENE, &scene(&[&text(b"\x80"), &info[16..39], rest]));
    let beyond = text(b"beyond all \xf4\x90\x80\x80");
    broken.add("scene-source-utf-8", FrameType::SCENE, &scene(&[hall, &beyond, rest]));
}

fn lists(broken: &mut BrokenFrames) {
    for (name, of) in [("instances", "scene-instances"), ("sets", "scene-sets"), ("members", "scene-members")]
    {
        broken.ending(&format!("scene-{name}-none"), of, 8, &[0; 8]);
        broken.with(&format!("scene-{name}-endless"), of, 8, &ENDLESS);
    }
    // A batch with one entry too many. It is assembled by hand because the library writes none.
    let more = |first: &[u8], entry: &[u8]| {
        let count = (MAX_BATCH as u64 + 1).to_le_bytes();
        [&first[..8], &count, &entry.repeat(MAX_BATCH + 1)].concat()
    };
    for (name, one) in [
        ("instances", instances(0, &[INSTANCE])),
        ("sets", sets(0, &[SET])),
        ("members", members(0, &[MEMBER])),
    ] {
        let one = one.to_payload().unwrap();
        broken.add(&format!("scene-{name}-many"), FrameType::SCENE, &more(&one, &one[16..]));
    }
    broken.ending("report-stages-many", "report", 52, &[&[33, 0, 0, 0, 0, 0, 0, 0][..], &[1; 165]].concat());
    broken.with("report-stages-endless", "report", 52, &ENDLESS);
    let token = |length: usize| [&(length as u64).to_le_bytes()[..], &vec![9; length]].concat();
    for (name, length) in [("none", 0), ("short", 15), ("long", 257)] {
        broken.add(&format!("auth-token-{name}"), FrameType::AUTH, &token(length));
    }
    broken.add("auth-token-endless", FrameType::AUTH, &ENDLESS);
}

fn values(broken: &mut BrokenFrames) {
    broken.with("hello-version-0", "hello", 0, &[0, 0]);
    broken.with("hello-versions-crossed", "hello", 0, &[2, 0, 1, 0]);
    broken.with("accept-version-0", "accept", 0, &[0, 0]);
    broken.with("request-datagrams-small", "request-datagrams", 4, &63_u16.to_le_bytes());
    broken.with("stamp-before-capture", "stamp", 4, &1_251_u64.to_le_bytes());
    broken.with("budget-age-of-nothing", "budget", 12, &ZERO);
    broken.with("edit-translation-nan", "edit-move", 8, &NAN);
    broken.with("edit-translation-infinite", "edit-move", 16, &INFINITY);
    broken.with("edit-rotation-nan", "edit-move", 20, &NAN);
    broken.with("edit-rotation-zero", "edit-move", 20, &[0; 16]);
    let turn = |w: f32| [&[0; 12][..], &w.to_le_bytes()].concat();
    broken.with("edit-rotation-long", "edit-move", 20, &turn(1.0006));
    broken.with("edit-rotation-short", "edit-move", 20, &turn(0.9994));
    broken.with("edit-rotation-infinite", "edit-move", 20, &[&[0; 12][..], &INFINITY].concat());
}

fn scene_values(broken: &mut BrokenFrames) {
    let info = "scene-info-paper";
    for (name, bits) in [("31", 31), ("0", 0), ("8", 8)] {
        broken.with(&format!("scene-point-bits-{name}"), info, 72, &[bits]);
    }
    for (name, at) in [("fps", 75), ("radius", 83), ("density", 101), ("slots", 125)] {
        broken.with(&format!("scene-{name}-zero"), info, at, &ZERO);
        broken.with(&format!("scene-{name}-nan"), info, at, &NAN);
        broken.with(&format!("scene-{name}-negative"), info, at, &MINUS_ONE);
        broken.with(&format!("scene-{name}-infinite"), info, at, &INFINITY);
    }
    broken.with("scene-margin-below-1", info, 129, &0.999_f32.to_le_bytes());
    broken.with("scene-margin-nan", info, 129, &NAN);
    broken.with("scene-margin-infinite", info, 129, &INFINITY);

    // In the second entry, so that a reader that checks only the first fails.
    let (instances, second) = ("scene-instances", 16 + 48);
    broken.with("scene-instance-origin-nan", instances, second + 4, &NAN);
    broken.with("scene-instance-edge-zero", instances, second + 12, &ZERO);
    broken.with("scene-instance-edge-nan", instances, second + 12, &NAN);
    broken.with("scene-instance-cells-0", instances, second + 20, &ZERO);
    broken.with("scene-instance-buckets-0", instances, second + 32, &ZERO);
    broken.with("scene-instance-buckets-3", instances, second + 32, &3_u32.to_le_bytes());
    broken.with("scene-instance-kernel-negative", instances, second + 36, &MINUS_ONE);
    let (sets, second) = ("scene-sets", 16 + 94);
    broken.with("scene-set-origin-infinite", sets, second + 8, &INFINITY);
    broken.with("scene-set-step-zero", sets, second + 12, &ZERO);
    broken.with("scene-set-step-infinite", sets, second + 12, &INFINITY);
    broken.with("scene-set-normal-bits-1", sets, second + 28, &[1]);
    broken.with("scene-set-normal-bits-9", sets, second + 28, &[9]);
    broken.with("scene-set-charts-0", sets, second + 33, &ZERO);
    broken.with("scene-set-levels-0", sets, second + 37, &[0]);
    broken.with("scene-set-levels-13", sets, second + 37, &[13]);
    broken.with("scene-set-level-of-none", sets, second + 37, &[11]);
    broken.with("scene-set-level-descends", sets, second + 38 + 4 * 3, &ZERO);
    broken.with("scene-set-level-beyond", sets, 16 + 38, &[10, 0, 0, 0]);
    broken.with("scene-set-kernel-nan", sets, second + 82, &NAN);
}

fn cameras(broken: &mut BrokenFrames) {
    let view = "view";
    broken.with("view-eye-nan", view, 0, &NAN);
    broken.with("view-target-infinite", view, 16, &INFINITY);
    broken.with("view-up-nan", view, 32, &NAN);
    let eye = broken.payload(view).1[..12].to_vec();
    broken.with("view-target-is-eye", view, 12, &eye);
    broken.with("view-up-zero", view, 24, &[0; 12]);
    // Down along the line of sight: from (0, 2, 0) to the origin.
    let along: Vec<u8> = [0.0_f32, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, -3.0, 0.0].map(f32::to_le_bytes).concat();
    broken.with("view-up-along", view, 0, &along);
    let along = [3.0_f32, 5.0, 7.0, 0.0, 0.0, 0.0, -6.0, -10.0, -14.0];
    let along: Vec<u8> = along.map(f32::to_le_bytes).concat();
    broken.with("view-up-along-oblique", view, 0, &along);
    broken.with("view-angle-0", view, 36, &ZERO);
    broken.with("view-angle-180", view, 36, &180.0_f32.to_le_bytes());
    broken.with("view-angle-nan", view, 36, &NAN);
    broken.with("view-aspect-0", view, 40, &ZERO);
    broken.with("view-aspect-negative", view, 40, &MINUS_ONE);
    broken.with("view-aspect-infinite", view, 40, &INFINITY);
}
