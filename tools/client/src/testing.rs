//! Small states for tests, made the way a server makes them: encoder, frame body, `apply`.

use std::sync::Arc;

use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::{self, Grid, InstanceLayout, Layout, PointFormat, PointSample, Pose, State, apply};

/// An instance for [`state`].
pub(crate) struct TestInstance {
    pub(crate) grid: Grid,
    pub(crate) kernel_radius: f32,
    pub(crate) pose: Pose,
    pub(crate) points: Vec<PointSample>,
}

/// A client's state after one keyframe with these instances.
pub(crate) fn state(instances: &[TestInstance]) -> State {
    state_of(PointFormat::Bits32, instances)
}

/// The same, packed like this.
pub(crate) fn state_of(format: PointFormat, instances: &[TestInstance]) -> State {
    let mut first_bucket = 0;
    let layouts = instances.iter().map(|instance| {
        let bucket_count = 64;
        first_bucket += bucket_count;
        InstanceLayout {
            grid: instance.grid,
            first_bucket: first_bucket - bucket_count,
            bucket_count,
            kernel_radius: instance.kernel_radius,
        }
    });
    let layout = Arc::new(Layout::new(format, layouts.collect(), 4_096, &Limits::default()).unwrap());
    let counts: Vec<u32> = instances.iter().map(|i| u32::try_from(i.points.len()).unwrap()).collect();
    let mut encoder = paper::Encoder::new(layout.clone(), &counts).unwrap();
    let mut id = 0;
    for (number, instance) in (0_u32..).zip(instances) {
        encoder.set_pose(number, instance.pose).unwrap();
        for point in &instance.points {
            encoder.put(id, point).unwrap();
            id += 1;
        }
    }
    let meta =
        FrameMeta { kind: FrameKind::Key, frame: FrameIndex(0), time: StreamTime(0), changed_points: id };
    let frame = encoder.finish(meta, BlockCoder::default()).unwrap();
    let mut state = State::new(layout);
    apply(&mut state, &frame.body, &Limits::default()).unwrap();
    state
}
