//! Helpers that the tests of several modules share.

use std::sync::Arc;

use crate::Limits;
use crate::block::BlockCoder;
use crate::envelope::{CRC_OFFSET, EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime, body_crc};
use crate::paper::{self, Grid, InstanceLayout, Layout, PointFormat, PointSample, Pose, State, apply};
use crate::surface::{GeometryDigest, Levels, SetLayout};

/// Returns a layout of two instances of 4 x 4 x 4 cells of 25 cm, with 8 buckets each, 64 cells and 32-bit points.
pub(crate) fn layout() -> Arc<Layout> {
    layout_of(PointFormat::Bits32)
}

/// Returns the same layout with points in this format.
pub(crate) fn layout_of(format: PointFormat) -> Arc<Layout> {
    let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4]).unwrap();
    let instance =
        |first_bucket| InstanceLayout { grid, first_bucket, bucket_count: 8, kernel_radius: 0.125 };
    Arc::new(Layout::new(format, vec![instance(0), instance(8)], 64, &Limits::default()).unwrap())
}

/// Returns the layout of a set of `surface` on a lattice of 256 nodes a metre and axis. Rounding adds number, levels
/// and digest.
pub(crate) fn lattice(charts: u32, kernel_radius: f32) -> SetLayout {
    SetLayout {
        origin: [0.0; 3],
        step: 1.0 / 256.0,
        extent: [255; 3],
        normal_bits: 4,
        points: 0,
        charts,
        levels: Levels::default(),
        kernel_radius,
        digest: GeometryDigest::default(),
    }
}

pub(crate) fn meta(kind: FrameKind, frame: u32) -> FrameMeta {
    let time = StreamTime(u64::from(frame) * 16_667);
    FrameMeta { kind, frame: FrameIndex(frame), time, changed_points: frame + 1 }
}

pub(crate) fn sample(local: [f32; 3], ao: u8) -> PointSample {
    PointSample { local, normal: [0.0, 1.0, 0.0], ao }
}

/// A keyframe and a delta of some points, with the states before and after them.
pub(crate) struct Story {
    pub(crate) empty: State,
    pub(crate) after_key: State,
    pub(crate) after_delta: State,
    pub(crate) key: EncodedFrame,
    pub(crate) delta: EncodedFrame,
}

pub(crate) fn story(coder: BlockCoder) -> Story {
    story_of(PointFormat::Bits32, coder)
}

pub(crate) fn story_of(format: PointFormat, coder: BlockCoder) -> Story {
    let layout = layout_of(format);
    let empty = State::new(Arc::clone(&layout));
    let mut encoder = paper::Encoder::new(layout, &[40, 40]).unwrap();
    for point in 0..80_u8 {
        let local = [f32::from(point % 5) / 5.0, f32::from(point % 7) / 7.0, f32::from(point % 40) / 40.0];
        encoder.put(u32::from(point), &sample(local, point * 3)).unwrap();
    }
    let pose = Pose { translation: [1.0, 2.0, 3.0], rotation: [0.6, 0.0, 0.0, 0.8] };
    encoder.set_pose(1, pose).unwrap();
    let key = encoder.finish(meta(FrameKind::Key, 3), coder).unwrap();
    let after_key = encoder.state().clone();
    for point in 0..20 {
        encoder.remove(point * 3).unwrap();
        encoder.put(point * 3 + 1, &sample([0.9, 0.1, f32::from(point as u8) / 20.0], 77)).unwrap();
    }
    encoder.set_pose(1, Pose { translation: [1.5, 2.0, 3.0], ..pose }).unwrap();
    encoder.set_pose(0, pose).unwrap();
    let delta = encoder.finish(meta(FrameKind::Delta, 4), coder).unwrap();
    Story { empty, after_key, after_delta: encoder.state().clone(), key, delta }
}

/// Corrects the checksum of a changed body.
pub(crate) fn reseal(body: &mut [u8]) {
    let crc = body_crc(body);
    body[CRC_OFFSET..CRC_OFFSET + 4].copy_from_slice(&crc.to_le_bytes());
}

/// Applies a body to a copy of `state`; checks that it is refused and the copy unchanged.
pub(crate) fn refuse(state: &State, body: &[u8], limits: &Limits) -> crate::envelope::FrameError {
    let mut after = state.clone();
    let error = apply(&mut after, body, limits).unwrap_err();
    assert_eq!(&after, state, "refused ({error}), but the state changed");
    error
}
