//! Messages for the vectors, and all named codes.

use psao_proto::message::{
    CameraPose, CloseCode, GapReason, InstanceBatch, InstanceEntry, KeyframeReason, MAX_BATCH, MemberBatch,
    MemberEntry, Needs, Occlusion, PeerLimits, PointSource, RejectCode, Report, Scene, SceneHeader, SetBatch,
    SetEntry, StageId, StageTime, Text,
};
use psao_proto::{CoderId, FrameIndex, Micros, Profile};

/// Returns whether a code has a name. Codes without one are shown by their number.
fn named(code: &impl std::fmt::Debug) -> bool {
    !format!("{code:?}").ends_with(|character: char| character.is_ascii_digit())
}

pub(super) fn close_codes() -> impl Iterator<Item = CloseCode> {
    (0..=u16::MAX).map(CloseCode).filter(named)
}

pub(super) fn reject_codes() -> impl Iterator<Item = RejectCode> {
    (0..=u16::MAX).map(RejectCode).filter(named)
}

pub(super) fn keyframe_reasons() -> impl Iterator<Item = KeyframeReason> {
    (0..=u8::MAX).map(KeyframeReason).filter(named)
}

/// All named reasons of a GAP.
pub(super) fn gap_reasons() -> impl Iterator<Item = GapReason> {
    (0..=u8::MAX).map(GapReason).filter(named)
}

pub(super) const ALL_ONES: PeerLimits = PeerLimits {
    frame_bytes: u32::MAX,
    instances: u32::MAX,
    buckets: u32::MAX,
    cells: u32::MAX,
    points: u32::MAX,
};

pub(super) fn limits() -> PeerLimits {
    PeerLimits { frame_bytes: 1 << 29, instances: 65_536, buckets: 1 << 22, cells: 1 << 21, points: 1 << 26 }
}

/// Returns the longest text, with characters of one, two and three bytes and characters that JSON escapes.
pub(super) fn longest<const MAX: usize>() -> Text<MAX> {
    let mut text = String::from("\"\\\u{7}\n é ");
    while text.len() + 3 <= MAX {
        text.push('面');
    }
    while text.len() < MAX {
        text.push('.');
    }
    Text::new(text).unwrap()
}

pub(super) fn paper_info() -> SceneHeader {
    SceneHeader {
        name: Text::new("hall").unwrap(),
        source: Text::new("scenes/hall.glb").unwrap(),
        digest: [0xab; 32],
        profile: Profile::PAPER,
        point_bits: 24,
        coder: CoderId::ZSTD,
        geometry: PointSource::SENT,
        fps: 60.0,
        frames_hint: 300,
        radius_m: 0.6,
        rays: 192,
        occlusion: Occlusion::OBSCURANCE,
        threshold: 8,
        seed: 0x0102_0304_0506_0708,
        points_per_m2: 1024.0,
        min_points: 48,
        cell_capacity: 4096,
        set_count: 0,
        instance_count: 2,
        point_count: 20_000,
        paper_table_slots: 4.0,
        view_margin: 1.25,
        quality: 4.0,
    }
}

pub(super) fn surface_info() -> SceneHeader {
    SceneHeader {
        profile: Profile::SURFACE,
        point_bits: 32,
        coder: CoderId::RANGE,
        geometry: PointSource::SHARED,
        occlusion: Occlusion::BINARY,
        cell_capacity: 0,
        set_count: 3,
        ..paper_info()
    }
}

/// Returns a header with the largest value in each field, and unknown ids and bits.
pub(super) fn largest_info() -> SceneHeader {
    SceneHeader {
        name: longest(),
        source: longest(),
        digest: [0xff; 32],
        profile: Profile(255),
        point_bits: 32,
        coder: CoderId(255),
        geometry: PointSource(255),
        fps: f32::MAX,
        frames_hint: u32::MAX,
        radius_m: f32::MAX,
        rays: u32::MAX,
        occlusion: Occlusion(255),
        threshold: u8::MAX,
        seed: u64::MAX,
        points_per_m2: f32::MAX,
        min_points: u32::MAX,
        cell_capacity: u32::MAX,
        set_count: u32::MAX,
        instance_count: u32::MAX,
        point_count: u32::MAX,
        paper_table_slots: f32::MAX,
        view_margin: f32::MAX,
        quality: 1024.0,
    }
}

/// Returns a header with the smallest value in each field.
pub(super) fn least_info() -> SceneHeader {
    let least = f32::from_bits(1);
    SceneHeader {
        name: Text::default(),
        source: Text::default(),
        digest: [0; 32],
        profile: Profile(0),
        point_bits: 16,
        coder: CoderId::STORED,
        geometry: PointSource::SENT,
        fps: least,
        frames_hint: 0,
        radius_m: least,
        rays: 0,
        occlusion: Occlusion::OBSCURANCE,
        threshold: 0,
        seed: 0,
        points_per_m2: least,
        min_points: 0,
        cell_capacity: 0,
        set_count: 0,
        instance_count: 0,
        point_count: 0,
        paper_table_slots: least,
        view_margin: 1.0,
        quality: 0.0,
    }
}

pub(super) const INSTANCE: InstanceEntry = InstanceEntry {
    origin: [-1.5, 0.0, 0.1],
    edge: 0.25,
    dims: [4, 5, 6],
    first_bucket: 8,
    bucket_count: 16,
    kernel_radius: 0.125,
    points: 9,
    needs: Needs::SKIN.union(Needs::MASKED),
};

pub(super) const SET: SetEntry = SetEntry {
    origin: [-1.5, -0.0, 0.1],
    step: 0.0078125,
    extent: [4, 5, 2_097_151],
    normal_bits: 6,
    charts: 1,
    levels: 2,
    level_ends: [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    points: 9,
    kernel_radius: 0.125,
    digest: 0x0102_0304_0506_0708,
};

pub(super) const MEMBER: MemberEntry =
    MemberEntry { set: 1, needs: Needs::RIGID_MOTION.union(Needs::NORMAL_MAP) };

pub(super) fn instances(first: u32, entries: &[InstanceEntry]) -> Scene {
    Scene::Instances(InstanceBatch { first, entries: entries.to_vec() })
}

pub(super) fn sets(first: u32, entries: &[SetEntry]) -> Scene {
    Scene::Sets(SetBatch { first, entries: entries.to_vec() })
}

pub(super) fn members(first: u32, entries: &[MemberEntry]) -> Scene {
    Scene::Members(MemberBatch { first, entries: entries.to_vec() })
}

/// Returns a message with the largest number of members, all different.
pub(super) fn most_members() -> Scene {
    let member = |number: u32| MemberEntry { set: number / 3, needs: Needs::from_bits_retain(number % 128) };
    members(512, &(0..MAX_BATCH as u32).map(member).collect::<Vec<_>>())
}

pub(super) const CAMERA: CameraPose = CameraPose {
    eye: [1.0, 2.0, 3.1],
    target: [0.0, 0.5, -0.0],
    up: [0.0, 1.0, 0.0],
    fov_y_deg: 60.0,
    aspect: 1.7777778,
};

pub(super) fn report() -> Report {
    Report {
        frame: FrameIndex(1),
        rays: 2,
        visible: 3,
        traced: 4,
        changed: 5,
        cells: 6,
        stored: 7,
        bucket_full: 8,
        cell_full: 9,
        no_cell: 10,
        outside_grid: 11,
        id_collisions: 12,
        stages: (1..=6).map(|id| StageTime::new(StageId(id), Micros(100 * u64::from(id)))).collect(),
    }
}

/// Returns a report with all bits set and the largest number of stages, most of them unknown.
pub(super) fn largest_report() -> Report {
    let most = u32::MAX;
    Report {
        frame: FrameIndex(most),
        rays: u64::MAX,
        visible: most,
        traced: most,
        changed: most,
        cells: most,
        stored: most,
        bucket_full: most,
        cell_full: most,
        no_cell: most,
        outside_grid: most,
        id_collisions: most,
        stages: (224..=255).map(|id| StageTime { stage: StageId(id), micros: most }).collect(),
    }
}
