//! The scene as a stream of profile `paper`, with 32-bit points.

use std::sync::Arc;

use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, SectionTag, StreamTime};
use psao_codec::paper::{self, Grid, InstanceLayout, Layout, PointFormat, PointSample, bucket_count};

use super::scene::{EDGE, FLOOR, PERIOD, Scene, THING, THRESHOLD};

type Failure = Box<dyn std::error::Error>;

/// Edge of a cell, metres: four times the Poisson-disk radius.
const CELL: f32 = 0.095;

/// Points of the scene in the order given, and AO of all of them in every frame.
pub(crate) struct Paper {
    pub(crate) encoder: paper::Encoder,
    pub(crate) frames: Vec<Vec<u8>>,
    /// Place and normal of every point.
    pub(crate) samples: Vec<PointSample>,
    /// AO last sent.
    sent: Vec<u8>,
}

impl Paper {
    pub(crate) fn new() -> Result<Paper, Failure> {
        let scene = Scene::new();
        let grids = [
            (Grid::new([0.0, -0.05, 0.0], CELL, [66, 1, 66])?, bucket_count(EDGE * EDGE, CELL, 4.0)),
            (Grid::new([-0.44; 3], CELL, [10; 3])?, bucket_count(4.0, CELL, 4.0)),
        ];
        let mut instances = Vec::new();
        let mut first_bucket = 0;
        for (set, _) in scene.instances() {
            let (grid, bucket_count) = grids[usize::from(set > 0)];
            instances.push(InstanceLayout { grid, first_bucket, bucket_count, kernel_radius: 0.06 });
            first_bucket += bucket_count;
        }
        let layout = Layout::new(PointFormat::Bits32, instances, 1 << 16, &Limits::default())?;
        let counts: Vec<u32> =
            scene.instances().iter().map(|(set, _)| if *set == 0 { FLOOR } else { THING }).collect();
        let orders = scene.sets.each_ref().map(|set| (0..set.len() as u32).collect());
        let points = scene.instances().into_iter().flat_map(|(set, _)| scene.sets[set as usize].clone());
        let sample = |point: psao_codec::surface::RestPoint| PointSample {
            local: point.position,
            normal: point.normal,
            ao: 0,
        };
        Ok(Paper {
            encoder: paper::Encoder::new(Arc::new(layout), &counts)?,
            frames: scene.frames(&orders),
            samples: points.map(sample).collect(),
            sent: Vec::new(),
        })
    }

    /// Puts the points that changed by the threshold and finishes a frame; frame 0 is the keyframe. Also returns the
    /// number of these points.
    pub(crate) fn frame(&mut self, number: u32, coder: BlockCoder) -> Result<(EncodedFrame, u32), Failure> {
        let now = &self.frames[(number % PERIOD) as usize];
        let first = self.sent.is_empty();
        if first {
            self.sent.clone_from(now);
        }
        let mut changed = 0;
        for (at, (sent, ao)) in self.sent.iter_mut().zip(now).enumerate() {
            if first || sent.abs_diff(*ao) >= THRESHOLD {
                *sent = *ao;
                self.encoder.put(at as u32, &PointSample { ao: *ao, ..self.samples[at] })?;
                changed += 1;
            }
        }
        let kind = if first { FrameKind::Key } else { FrameKind::Delta };
        let time = StreamTime(u64::from(number) * 16_667);
        let meta = FrameMeta { kind, frame: FrameIndex(number), time, changed_points: changed };
        Ok((self.encoder.finish(meta, coder)?, changed))
    }
}

/// Returns the cell records of a frame whose blocks are stored.
pub(crate) fn cell_records(frame: &EncodedFrame) -> &[u8] {
    let cells = frame.info.section(SectionTag::CELLS).map_or(0, |section| section.wire_bytes as usize);
    &frame.body[frame.body.len() - cells..]
}
