//! Every message with any values: a written message is read back equal, and a read payload is written back equal.

use proptest::prelude::*;

use super::*;
use crate::{CoderId, FrameIndex, Micros, Profile, StateHash};

fn text<const MAX: usize>() -> impl Strategy<Value = Text<MAX>> {
    ".{0,80}".prop_map(|text: String| Text::cut(&text))
}

fn float() -> impl Strategy<Value = f32> {
    prop::num::f32::NORMAL | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO
}

fn positive() -> impl Strategy<Value = f32> {
    prop::num::f32::NORMAL.prop_map(f32::abs)
}

fn peer_limits() -> impl Strategy<Value = PeerLimits> {
    any::<[u32; 5]>().prop_map(|[frame_bytes, instances, buckets, cells, points]| PeerLimits {
        frame_bytes,
        instances,
        buckets,
        cells,
        points,
    })
}

prop_compose! {
    fn info()(name in text(), source in text(), digest in any::<[u8; 32]>(), ids in any::<[u8; 5]>(),
              point_bits in prop::sample::select(vec![16u8, 24, 32]), positives in prop::array::uniform4(positive()),
              counts in any::<[u32; 7]>(), seed in any::<u64>(), margin in 1.0f32..9.0, quality in 0.0f32..=1024.0) -> SceneHeader {
        let [profile, coder, geometry, occlusion, threshold] = ids;
        let [fps, radius_m, points_per_m2, paper_table_slots] = positives;
        let [frames_hint, rays, min_points, cell_capacity, set_count, instance_count, point_count] = counts;
        SceneHeader {
            name, source, digest, profile: Profile(profile), point_bits, coder: CoderId(coder),
            geometry: PointSource(geometry), fps, frames_hint, radius_m, rays, occlusion: Occlusion(occlusion),
            threshold, seed, points_per_m2, min_points, cell_capacity, set_count, instance_count, point_count, paper_table_slots, view_margin: margin, quality,
        }
    }
}

prop_compose! {
    fn entry()(origin in prop::array::uniform3(float()), edge in positive(), dims in prop::array::uniform3(1u32..),
               first_bucket in any::<u32>(), shift in 0u32..32, kernel_radius in positive(), points in any::<u32>(),
               needs in any::<u32>()) -> InstanceEntry {
        let bucket_count = 1 << shift;
        InstanceEntry { origin, edge, dims, first_bucket, bucket_count, kernel_radius, points, needs: Needs::from_bits_retain(needs) }
    }
}

prop_compose! {
    fn set()(origin in prop::array::uniform3(float()), positives in prop::array::uniform2(positive()),
             extent in any::<[u32; 3]>(), normal_bits in 2u8..=8, points in any::<u32>(), charts in 1..=1_u32 << 24, ends in prop::collection::vec(any::<u32>(), 0..12),
             digest in any::<u64>())
             -> SetEntry {
        let [step, kernel_radius] = positives;
        let mut ends: Vec<u32> = ends.into_iter().map(|end| end.min(points)).collect();
        ends.sort_unstable();
        let mut level_ends = [0; 11];
        level_ends[..ends.len()].copy_from_slice(&ends);
        let levels = ends.len() as u8 + 1;
        SetEntry { origin, step, extent, normal_bits, points, charts, levels, level_ends, kernel_radius, digest }
    }
}

fn scene() -> impl Strategy<Value = Scene> {
    let batch = (any::<u32>(), prop::collection::vec(entry(), 1..20));
    let sets = (any::<u32>(), prop::collection::vec(set(), 1..20));
    let member = any::<(u32, u32)>()
        .prop_map(|(set, needs)| MemberEntry { set, needs: Needs::from_bits_retain(needs) });
    let members = (any::<u32>(), prop::collection::vec(member, 1..20));
    prop_oneof![
        info().prop_map(Scene::Info),
        batch.prop_map(|(first, entries)| Scene::Instances(InstanceBatch { first, entries })),
        sets.prop_map(|(first, entries)| Scene::Sets(SetBatch { first, entries })),
        members.prop_map(|(first, entries)| Scene::Members(MemberBatch { first, entries })),
    ]
}

fn report() -> impl Strategy<Value = Report> {
    let stages = prop::collection::vec(any::<(u8, u32)>(), 0..=MAX_STAGES);
    (any::<u32>(), any::<u64>(), any::<[u32; 10]>(), stages).prop_map(|(frame, rays, counts, stages)| {
        let [
            visible,
            traced,
            changed,
            cells,
            stored,
            bucket_full,
            cell_full,
            no_cell,
            outside_grid,
            id_collisions,
        ] = counts;
        let stages =
            stages.into_iter().map(|(stage, micros)| StageTime { stage: StageId(stage), micros }).collect();
        let frame = FrameIndex(frame);
        Report {
            frame,
            rays,
            visible,
            traced,
            changed,
            cells,
            stored,
            bucket_full,
            cell_full,
            no_cell,
            outside_grid,
            id_collisions,
            stages,
        }
    })
}

fn edit() -> impl Strategy<Value = Edit> {
    let turn = prop::sample::select(vec![[0.0, 0.0, 0.0, 1.0], [0.6, 0.0, 0.8, 0.0], [-0.5, 0.5, -0.5, 0.5]]);
    let action = prop_oneof![
        (prop::array::uniform3(float()), turn)
            .prop_map(|(translation, rotation)| EditAction::Move { translation, rotation }),
        Just(EditAction::Release),
        Just(EditAction::Show),
        Just(EditAction::Hide),
    ];
    (any::<u32>(), action).prop_map(|(instance, action)| Edit { instance, action })
}

/// Checks that a written message is read back equal. Then changes one byte, which must give an error or another message
/// that is written back equal (0.0 and -0.0 compare equal but are two messages).
fn check<M: Message + PartialEq + std::fmt::Debug>(
    message: &M,
    place: usize,
    xor: u8,
) -> Result<(), TestCaseError> {
    let mut bytes = message.to_payload().unwrap();
    prop_assert_eq!(&M::from_payload(&bytes).unwrap(), message);
    let place = place % bytes.len();
    bytes[place] ^= xor;
    if let Ok(other) = M::from_payload(&bytes) {
        prop_assert_eq!(other.to_payload().unwrap(), bytes);
    }
    Ok(())
}

proptest! {
    #[test]
    fn round_trips(
        (place, xor) in (any::<usize>(), 1u8..),
        versions in (1u16..100, 0u16..100), sets in any::<(u32, u32)>(), limits in peer_limits(),
        name in text(), words in text(), code in any::<u16>(), id in any::<u8>(), ack in any::<(u32, u64)>(),
        scene in scene(), report in report(), edit in edit(),
        eye in prop::array::uniform3(-1e3f32..1e3), fov_y_deg in 0.1f32..179.9, aspect in positive(),
    ) {
        let hello = Hello {
            oldest: versions.0, newest: versions.0 + versions.1, profiles: ProfileSet(sets.0),
            coders: CoderSet(sets.1), limits, name: name.clone(),
        };
        check(&hello, place, xor)?;
        check(&Accept { version: versions.0, profile: Profile(id), limits, name }, place, xor)?;
        check(&Reject { code: RejectCode(code), text: words.clone() }, place, xor)?;
        check(&Close { code: CloseCode(code), text: words }, place, xor)?;
        check(&Request::Keyframe { reason: KeyframeReason(id) }, place, xor)?;
        check(&Ack { frame: FrameIndex(ack.0), hash: StateHash(ack.1) }, place, xor)?;
        check(&Request::Datagrams { bytes: 64 | code }, place, xor)?;
        check(&Auth { token: Token::new(vec![id; 16 + usize::from(id % 241)]).unwrap() }, place, xor)?;
        let times = [ack.1, u64::from(sets.0), u64::from(sets.1)].map(Micros);
        check(&Ping { sent: times[0] }, place, xor)?;
        check(&Pong { sent: times[0], received: times[1], replied: times[2] }, place, xor)?;
        let captured = times[1].min(times[2]);
        check(&Stamp { frame: FrameIndex(ack.0), captured, sent: times[1].max(times[2]) }, place, xor)?;
        let [budget, used] = [limits.points, limits.cells];
        let (postponed, oldest, forced) = (sets.0 | 1, sets.1, limits.buckets);
        check(&Budget { frame: FrameIndex(ack.0), budget, used, postponed, oldest, forced }, place, xor)?;
        check(&scene, place, xor)?;
        check(&report, place, xor)?;
        check(&edit, place, xor)?;
        let camera = CameraPose { eye, target: [0.0, 2e3, 1.0], up: [1.0, 0.0, 0.5], fov_y_deg, aspect };
        prop_assume!(camera.is_valid());
        check(&View { camera }, place, xor)?;
    }
}
