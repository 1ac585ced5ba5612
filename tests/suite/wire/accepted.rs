//! Frames that a peer must accept.

use psao_proto::message::{
    Accept, Ack, Auth, Budget, CameraPose, Close, CloseCode, CoderSet, Edit, EditAction, Gap, GapReason,
    Hello, InstanceEntry, KeyframeReason, MemberEntry, Message, Needs, Ping, Pong, ProfileSet, Reject,
    RejectCode, Report, Request, Scene, SetEntry, Stamp, Text, Token, View,
};
use psao_proto::{FrameIndex, FrameType, Group, Micros, Profile, Sequence, StateHash, write_frame};

use super::messages::{
    ALL_ONES, CAMERA, INSTANCE, MEMBER, SET, close_codes, gap_reasons, instances, keyframe_reasons,
    largest_info, largest_report, least_info, limits, longest, members, most_members, paper_info,
    reject_codes, report, sets, surface_info,
};
use super::{Case, CaseKind};

pub(super) fn frames() -> Vec<Case> {
    let mut frames = Frames { all: vec![] };
    handshake(&mut frames);
    scenes(&mut frames);
    requests(&mut frames);
    figures(&mut frames);
    times(&mut frames);
    ends(&mut frames);
    bodies(&mut frames);
    frames.all
}

pub(super) struct Frames {
    pub(super) all: Vec<Case>,
}

impl Frames {
    pub(super) fn bytes(&mut self, name: &str, bytes: Vec<u8>) {
        self.all.push(Case { name: name.to_owned(), kind: CaseKind::Frame, bytes });
    }

    pub(super) fn frame(&mut self, name: &str, kind: FrameType, place: (u32, u32), payload: &[u8]) {
        self.bytes(name, wire(kind, place, payload));
    }

    /// Adds a message with a valid group and sequence. Messages that a server sends within a stream repeat those of the
    /// keyframe or update before them.
    fn message<M: Message>(&mut self, name: &str, message: &M) {
        let later = matches!(
            M::KIND,
            FrameType::REPORT | FrameType::STAMP | FrameType::BUDGET | FrameType::CLOSE | FrameType::PING
        );
        let place = if later { (3, 7) } else { (0, 0) };
        self.frame(name, M::KIND, place, &message.to_payload().unwrap());
    }
}

pub(super) fn wire(kind: FrameType, (group, sequence): (u32, u32), payload: &[u8]) -> Vec<u8> {
    let mut out = vec![];
    write_frame(&mut out, kind, Group(group), Sequence(sequence), payload).unwrap();
    out
}

/// Returns a frame body of the empty state. It has no sections, so nothing in it depends on a coder.
pub(super) fn empty_body(profile: Profile, kind: u8, frame: u32) -> Vec<u8> {
    let packing = u8::from(profile == Profile::PAPER);
    let mut body = vec![profile.0, packing, kind, 0];
    body.extend_from_slice(&frame.to_le_bytes());
    body.extend_from_slice(&(u64::from(frame) * 16_667).to_le_bytes());
    body.resize(29, 0);
    let crc = crc32c::crc32c(&body);
    body[24..28].copy_from_slice(&crc.to_le_bytes());
    body
}

/// Returns a code as it is written in the name of a case.
fn word(code: &impl std::fmt::Debug) -> String {
    format!("{code:?}").to_lowercase().replace('_', "-")
}

fn handshake(frames: &mut Frames) {
    let hello = Hello {
        oldest: 1,
        newest: 1,
        profiles: ProfileSet(0b110),
        coders: CoderSet(0b1111),
        limits: limits(),
        name: Text::new("viewer 0.1").unwrap(),
    };
    frames.message("hello", &hello);
    let (profiles, coders) = (ProfileSet(u32::MAX), CoderSet(u32::MAX));
    let largest = Hello { newest: u16::MAX, profiles, coders, limits: ALL_ONES, name: longest(), ..hello };
    frames.message("hello-largest", &largest);
    frames.message("hello-nameless", &Hello { oldest: u16::MAX, name: Text::default(), ..largest });

    let name = Text::new("psao 0.1").unwrap();
    let accept = Accept { version: 1, profile: Profile::SURFACE, limits: limits(), name };
    frames.message("accept", &accept);
    frames.message("accept-paper", &Accept { profile: Profile::PAPER, ..accept });
    let largest = Accept { version: u16::MAX, profile: Profile(255), limits: ALL_ONES, name: longest() };
    frames.message("accept-largest", &largest);

    for code in reject_codes() {
        frames.message(&format!("reject-{}", word(&code)), &Reject::new(code, "no"));
    }
    frames.message("reject-unknown", &Reject { code: RejectCode(u16::MAX), text: longest() });

    frames.message("auth", &Auth { token: Token::new(*b"sixteen bytes ok").unwrap() });
    frames.message("auth-longest", &Auth { token: Token::new((0..=255).collect::<Vec<u8>>()).unwrap() });
}

fn scenes(frames: &mut Frames) {
    frames.message("scene-info-paper", &Scene::Info(paper_info()));
    frames.message("scene-info-surface", &Scene::Info(surface_info()));
    frames.message("scene-info-largest", &Scene::Info(largest_info()));
    frames.message("scene-info-least", &Scene::Info(least_info()));

    let most = u32::MAX;
    let largest = InstanceEntry {
        origin: [f32::MAX, f32::MIN, -0.0],
        edge: f32::MAX,
        dims: [1, 1 << 21, 1],
        first_bucket: most,
        bucket_count: 1 << 31,
        kernel_radius: f32::from_bits(1),
        points: most,
        needs: Needs::from_bits_retain(most),
    };
    frames.message("scene-instances", &instances(0, &[INSTANCE, largest]));
    frames
        .message("scene-instances-last", &instances(most, &[InstanceEntry { bucket_count: 1, ..INSTANCE }]));
    let largest = SetEntry {
        origin: [f32::MIN, f32::from_bits(1), f32::MAX],
        step: f32::from_bits(1),
        extent: [0, 2_097_151, 0],
        normal_bits: 8,
        charts: 1,
        levels: 12,
        level_ends: [0, 1, 1, 2, 3, 4, 5, 6, most - 1, most, most],
        points: most,
        kernel_radius: f32::MAX,
        digest: u64::MAX,
    };
    frames.message("scene-sets", &sets(0, &[SET, largest]));
    let empty = SetEntry { normal_bits: 2, points: 0, level_ends: [0; 11], ..SET };
    frames.message("scene-sets-last", &sets(most, &[empty]));
    let largest = MemberEntry { set: most, needs: Needs::from_bits_retain(most) };
    frames.message("scene-members", &members(0, &[MEMBER, largest]));
    frames.message("scene-members-most", &most_members());
}

fn requests(frames: &mut Frames) {
    frames.message("view", &View { camera: CAMERA });
    let far = CameraPose {
        eye: [f32::MAX, f32::MIN, f32::from_bits(1)],
        target: [f32::MIN, f32::MAX, -f32::from_bits(1)],
        up: [f32::from_bits(1), 0.0, 0.0],
        fov_y_deg: f32::from_bits(1),
        aspect: f32::MAX,
    };
    frames.message("view-far", &View { camera: far });
    // The smallest angle to the line of sight that is not zero.
    let steep = CameraPose {
        eye: [0.0, 1.0, 0.0],
        target: [0.0; 3],
        up: [0.0, 1.0, f32::from_bits(1)],
        fov_y_deg: 179.99998,
        aspect: f32::from_bits(1),
    };
    frames.message("view-steep", &View { camera: steep });
    // Computed in binary32, the line of sight would be parallel to `up`.
    let exact = CameraPose {
        eye: [16_777_216.0, 16_777_216.0, 0.0],
        target: [-1.0, 0.0, 0.0],
        up: [1.0, 1.0, 0.0],
        ..CAMERA
    };
    frames.message("view-exact", &View { camera: exact });

    let edit = |action| Edit { instance: 7, action };
    let turn = |translation, rotation| EditAction::Move { translation, rotation };
    let moved = edit(turn([1.0, -0.0, -2.5], [0.5, -0.5, 0.5, -0.5]));
    frames.message("edit-move", &moved);
    // A server sends the same bytes for an edit that is done.
    frames.frame("edit-move-done", FrameType::EDIT, (3, 7), &moved.to_payload().unwrap());
    let far = turn([f32::MAX, f32::MIN, f32::from_bits(1)], [0.0, 0.0, 0.0, 1.0004]);
    frames.message("edit-move-far", &Edit { instance: u32::MAX, action: far });
    frames.message("edit-move-short", &edit(turn([0.0; 3], [0.9996, 0.0, 0.0, 0.0])));
    frames.message("edit-release", &edit(EditAction::Release));
    frames.message("edit-show", &edit(EditAction::Show));
    frames.message("edit-hide", &edit(EditAction::Hide));

    for reason in keyframe_reasons() {
        frames.message(&format!("request-keyframe-{}", word(&reason)), &Request::Keyframe { reason });
    }
    frames.message("request-keyframe-unknown", &Request::Keyframe { reason: KeyframeReason(255) });
    frames.message("request-stamps", &Request::Stamps);
    for (name, bytes) in [("", 1200), ("-least", 64), ("-most", u16::MAX)] {
        frames.message(&format!("request-datagrams{name}"), &Request::Datagrams { bytes });
    }
}

fn figures(frames: &mut Frames) {
    frames.message("report", &report());
    frames.message("report-largest", &largest_report());
    frames.message("report-nothing", &Report::default());

    let frame = FrameIndex(9);
    let budget = Budget { frame, budget: 1200, used: 1199, postponed: 7, oldest: 3, forced: 1 };
    frames.message("budget", &budget);
    frames.message("budget-all-sent", &Budget { postponed: 0, oldest: 0, ..budget });
    let most = u32::MAX;
    let frame = FrameIndex(most);
    let largest = Budget { frame, budget: most, used: most, postponed: most, oldest: most, forced: most };
    frames.message("budget-largest", &largest);
}

fn times(frames: &mut Frames) {
    let most = Micros(u64::MAX);
    frames.message("ack", &Ack { frame: FrameIndex(2), hash: StateHash(0x0102_0304_0506_0708) });
    frames.message("ack-largest", &Ack { frame: FrameIndex(u32::MAX), hash: StateHash(u64::MAX) });
    frames.message("ping", &Ping { sent: Micros(1_234_567) });
    frames.message("ping-largest", &Ping { sent: most });
    let (sent, received, replied) = (Micros(1_234_567), Micros(70), Micros(75));
    frames.message("pong", &Pong { sent, received, replied });
    frames.message("pong-largest", &Pong { sent: most, received: most, replied: most });
    // A message with impossible clocks is still accepted.
    frames.message("pong-backwards", &Pong { sent, received: replied, replied: received });
    let frame = FrameIndex(5);
    frames.message("stamp", &Stamp { frame, captured: Micros(1_000), sent: Micros(1_250) });
    frames.message("stamp-at-once", &Stamp { frame: FrameIndex(u32::MAX), captured: most, sent: most });
}

fn ends(frames: &mut Frames) {
    for code in close_codes() {
        frames.message(&format!("close-{}", word(&code)), &Close::new(code, "bye"));
    }
    for reason in gap_reasons() {
        let (first_lost, last_lost) = (FrameIndex(5), FrameIndex(258));
        let gap = Gap { first_lost, last_lost, frames: 254, bytes: 1 << 33, reason };
        frames.message(&format!("gap-{}", reason.0), &gap);
    }
    let most = FrameIndex(u32::MAX);
    let (frames_lost, bytes, reason) = (u32::MAX, u64::MAX, GapReason(255));
    let largest = Gap { first_lost: most, last_lost: most, frames: frames_lost, bytes, reason };
    frames.message("gap-largest", &largest);
    // The stream started again within the gap.
    frames.message("gap-backwards", &Gap { last_lost: FrameIndex(0), frames: 0, bytes: 0, ..largest });
    frames.message("close-silent", &Close::new(CloseCode::DONE, ""));
    frames.message("close-unknown", &Close { code: CloseCode(u16::MAX), text: longest() });
}

fn bodies(frames: &mut Frames) {
    frames.frame("keyframe", FrameType::KEYFRAME, (1, 0), &empty_body(Profile::PAPER, 1, 0));
    frames.frame("keyframe-surface", FrameType::KEYFRAME, (1, 0), &empty_body(Profile::SURFACE, 1, 0));
    frames.frame("update", FrameType::UPDATE, (1, 1), &empty_body(Profile::PAPER, 2, 1));
    let last = (u32::MAX, u32::MAX);
    frames.frame("update-wraps", FrameType::UPDATE, last, &empty_body(Profile::SURFACE, 2, u32::MAX));
    // A frame is accepted whatever is in its body.
    frames.frame("keyframe-of-nothing", FrameType::KEYFRAME, (2, 0), &[]);

    let mut entry = vec![];
    entry.extend_from_slice(&16_u64.to_le_bytes());
    entry.extend_from_slice(&16_667_u64.to_le_bytes());
    for number in [1_u32, 7] {
        entry.extend_from_slice(&number.to_le_bytes());
    }
    frames.frame("index", FrameType::INDEX, (0, 0), &entry);
    frames.frame("index-of-nothing", FrameType::INDEX, (0, 0), &[]);
    let parity = [&16_u64.to_le_bytes()[..], &[2, 0, 0, 0, 64, 0, 0, 0], &[0xff; 4 + 2 * 64]].concat();
    frames.frame("parity", FrameType::PARITY, (0, 0), &parity);
    frames.frame("parity-of-nothing", FrameType::PARITY, (0, 0), &[]);

    for kind in [0, 18, 63, 255] {
        frames.frame(&format!("unknown-{kind}"), FrameType(kind), (3, 7), b"of a later version");
    }
    frames.frame("unknown-of-nothing", FrameType(18), (3, 7), &[]);
}
