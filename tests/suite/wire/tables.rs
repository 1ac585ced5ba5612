//! Sequences of SCENE frames, and the scene table or error that results.

use psao_proto::message::{
    Accept, InstanceEntry, MemberEntry, Message, PeerLimits, Scene, SceneHeader, SetEntry, Text,
};
use psao_proto::session::{ClientEvent, ClientSession, SessionError};
use psao_proto::{FrameType, Framer, Limits, Micros, Profile, SceneEntries, SceneError};

use super::accepted::wire;
use super::messages::{INSTANCE, MEMBER, SET, instances, limits, members, paper_info, sets, surface_info};
use super::object::Object;
use super::{Case, CaseKind};

/// Every reason for refusing a scene table.
pub(super) const REASONS: [&str; 5] = ["count", "layout", "order", "points", "profile"];

/// Gives SCENE frames to a client and returns the scene table, `None` for an unfinished table, or one of [`REASONS`].
pub(super) fn outcome(bytes: &[u8]) -> Result<Option<Object>, &'static str> {
    let mut client = ClientSession::new(Limits::default());
    let takes: PeerLimits = limits();
    let accept = Accept { version: 1, profile: profile(bytes), limits: takes, name: Text::default() };
    let accept = wire(FrameType::ACCEPT, (0, 0), &accept.to_payload().unwrap());
    client.handle(&accept, Micros(0)).unwrap();
    let table = match client.handle(bytes, Micros(0)) {
        Err(SessionError::Scene(error)) => return Err(reason(&error)),
        Err(other) => unreachable!("{other}"),
        Ok(events) => events.into_iter().find_map(|event| match event {
            ClientEvent::SceneReady(table) => Some(table),
            _ => None,
        }),
    };
    assert_eq!(client.unfinished_bytes(), 0, "a vector has whole frames");
    Ok(table.map(|table| {
        let (instances, sets) = match table.entries() {
            SceneEntries::Cells(instances) => (instances.len(), 0),
            SceneEntries::Surface { sets, members } => (members.len(), sets.len()),
        };
        let points = table.point_count();
        Object::default().with("instances", instances).with("sets", sets).with("points", points)
    }))
}

/// Returns the profile for ACCEPT: that of the first SCENE frame where it is known.
fn profile(bytes: &[u8]) -> Profile {
    let mut framer = Framer::new(Limits::default());
    framer.push(bytes);
    let first =
        framer.next_frame().ok().flatten().and_then(|frame| Scene::from_payload(frame.payload()).ok());
    match first {
        Some(Scene::Info(info)) if info.profile == Profile::SURFACE => Profile::SURFACE,
        _ => Profile::PAPER,
    }
}

pub(super) fn json(bytes: &[u8]) -> String {
    let object = match outcome(bytes) {
        Err(word) => Object::default().text("error", word),
        Ok(None) => Object::default().with("table", "null"),
        Ok(Some(table)) => Object::default().with("table", table.line()),
    };
    object.file()
}

fn reason(error: &SceneError) -> &'static str {
    match error {
        SceneError::Order { .. } | SceneError::Batch { .. } => "order",
        SceneError::Count { .. } => "count",
        SceneError::Points { .. } => "points",
        SceneError::Profile { .. } => "profile",
        SceneError::Grid { .. } | SceneError::Cells(_) | SceneError::Surface(_) => "layout",
        other => unreachable!("{other} has no word yet"),
    }
}

fn case(name: &str, scenes: &[Scene]) -> Case {
    let frame = |scene: &Scene| wire(FrameType::SCENE, (0, 0), &scene.to_payload().unwrap());
    let bytes = scenes.iter().flat_map(frame).collect();
    Case { name: format!("table-{name}"), kind: CaseKind::Table, bytes }
}

/// Returns the header of a table with two instances of nine points each.
fn paper() -> SceneHeader {
    SceneHeader { point_count: 18, ..paper_info() }
}

/// Returns the header of a table with sets of nine and four points, and three instances.
fn surface() -> SceneHeader {
    SceneHeader { set_count: 2, instance_count: 3, point_count: 22, ..surface_info() }
}

const FIRST: InstanceEntry = InstanceEntry { first_bucket: 0, ..INSTANCE };
const SECOND: InstanceEntry = InstanceEntry { first_bucket: 16, bucket_count: 1, ..INSTANCE };
const SMALL: SetEntry = SetEntry { points: 4, ..SET };
const MEMBERS: [MemberEntry; 3] =
    [MemberEntry { set: 0, ..MEMBER }, MemberEntry { set: 1, ..MEMBER }, MemberEntry { set: 0, ..MEMBER }];

pub(super) fn cases() -> Vec<Case> {
    let (paper, surface) = (Scene::Info(paper()), Scene::Info(surface()));
    let (both, points) = (instances(0, &[FIRST, SECOND]), sets(0, &[SET, SMALL]));
    let nothing = SceneHeader { instance_count: 0, point_count: 0, cell_capacity: 0, ..paper_info() };
    let pointless = SceneHeader { point_count: 0, set_count: 2, instance_count: 0, ..surface_info() };
    let mut all = vec![
        case("paper", &[paper.clone(), both.clone()]),
        case("paper-batches", &[paper.clone(), instances(0, &[FIRST]), instances(1, &[SECOND])]),
        case("surface", &[surface.clone(), points.clone(), members(0, &MEMBERS)]),
        case(
            "surface-batches",
            &[
                surface.clone(),
                sets(0, &[SET]),
                sets(1, &[SMALL]),
                members(0, &MEMBERS[..1]),
                members(1, &MEMBERS[1..]),
            ],
        ),
        case("of-nothing", &[Scene::Info(nothing)]),
        case("without-instances", &[Scene::Info(pointless), points.clone()]),
        case(
            "grid-longest",
            &[paper.clone(), instances(0, &[FIRST, InstanceEntry { dims: [1 << 21, 1, 1], ..SECOND }])],
        ),
        case("unfinished-most", &[Scene::Info(SceneHeader { instance_count: 65_536, ..paper_info() })]),
        case("unfinished-paper", &[paper.clone(), instances(0, &[FIRST])]),
        case("unfinished-surface", &[surface.clone(), points.clone()]),
    ];
    all.extend(out_of_order(&paper, &surface, &both, &points));
    all.extend(counts(&paper, &surface, &points));
    all.extend(layouts(&points));
    all
}

fn out_of_order(paper: &Scene, surface: &Scene, both: &Scene, points: &Scene) -> Vec<Case> {
    let (one, set) = (instances(0, &[FIRST]), sets(0, &[SET]));
    vec![
        case("refused-no-info", std::slice::from_ref(both)),
        case("refused-info-twice", &[paper.clone(), paper.clone()]),
        case("refused-sets-in-paper", &[paper.clone(), points.clone()]),
        case("refused-members-in-paper", &[paper.clone(), members(0, &MEMBERS[..2])]),
        case("refused-instances-in-surface", &[surface.clone(), both.clone()]),
        case("refused-members-before-sets", &[surface.clone(), members(0, &MEMBERS)]),
        case("refused-members-among-sets", &[surface.clone(), set.clone(), members(0, &MEMBERS[..1])]),
        case(
            "refused-sets-after-members",
            &[surface.clone(), points.clone(), members(0, &MEMBERS[..1]), sets(2, &[SET])],
        ),
        case("refused-batch-again", &[paper.clone(), one.clone(), one.clone()]),
        case("refused-batch-later", &[paper.clone(), instances(1, &[SECOND])]),
        case("refused-batch-of-sets-later", &[surface.clone(), set, sets(2, &[SMALL])]),
    ]
}

fn counts(paper: &Scene, surface: &Scene, points: &Scene) -> Vec<Case> {
    let third = InstanceEntry { first_bucket: 17, ..SECOND };
    let paper_of = |change: fn(&mut SceneHeader)| {
        let mut info = self::paper();
        change(&mut info);
        Scene::Info(info)
    };
    let unknown = Scene::Info(SceneHeader { profile: Profile(3), set_count: 0, ..self::surface() });
    vec![
        case("refused-instances-more", &[paper.clone(), instances(0, &[FIRST, SECOND, third])]),
        case("refused-sets-more", &[surface.clone(), sets(0, &[SET, SMALL, SMALL])]),
        case(
            "refused-members-more",
            &[surface.clone(), points.clone(), members(0, &[&MEMBERS[..], &MEMBERS].concat())],
        ),
        case("refused-instances-over-limit", &[paper_of(|info| info.instance_count = 65_537)]),
        case("refused-sets-announced-in-paper", &[paper_of(|info| info.set_count = 1)]),
        case(
            "refused-points-fewer",
            &[paper_of(|info| info.point_count = 19), instances(0, &[FIRST, SECOND])],
        ),
        case("refused-profile", &[unknown]),
    ]
}

fn layouts(points: &Scene) -> Vec<Case> {
    let of = |name: &str, second: InstanceEntry| {
        case(&format!("refused-{name}"), &[Scene::Info(paper()), instances(0, &[FIRST, second])])
    };
    let on = |name: &str, second: SetEntry, member: u32| {
        let members = members(0, &[MEMBERS[0], MEMBERS[1], MemberEntry { set: member, ..MEMBER }]);
        let info = Scene::Info(surface());
        case(&format!("refused-{name}"), &[info, sets(0, &[SET, second]), members])
    };
    let crowded = SceneHeader { cell_capacity: (1 << 22) + 1, ..paper() };
    let many = SceneHeader { point_count: u32::MAX, ..surface() };
    let one = members(0, &MEMBERS[..1]);
    let single = SceneHeader { instance_count: 1, ..many.clone() };
    let half = SetEntry { points: (1 << 25) + 1, ..SET };
    vec![
        of("grid-long", InstanceEntry { dims: [1, 1, (1 << 21) + 1], ..SECOND }),
        of("buckets-apart", InstanceEntry { first_bucket: 17, ..SECOND }),
        of("buckets-shared", InstanceEntry { first_bucket: 15, ..SECOND }),
        of("buckets-over-limit", InstanceEntry { bucket_count: 1 << 22, ..SECOND }),
        case("refused-cells-over-limit", &[Scene::Info(crowded), instances(0, &[FIRST, SECOND])]),
        on("lattice-long", SetEntry { extent: [1, 1 << 21, 1], ..SMALL }, 0),
        on("no-such-set", SMALL, 2),
        // Two sets that are too large together; one set that is too large for its two instances.
        case("refused-sets-over-limit", &[Scene::Info(single), sets(0, &[half, half]), one]),
        case(
            "refused-points-over-limit",
            &[Scene::Info(many), sets(0, &[half, SMALL]), members(0, &MEMBERS)],
        ),
        case(
            "refused-points-more",
            &[
                Scene::Info(SceneHeader { point_count: 21, ..surface() }),
                points.clone(),
                members(0, &MEMBERS),
            ],
        ),
    ]
}
