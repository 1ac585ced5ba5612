//! The scene as a stream of profile `surface`.

use std::sync::Arc;

use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::surface::{
    Encoder, EncoderSettings, Geometry, GeometryDigest, GeometrySource, Layout, Levels, Member, SetLayout,
};

use super::scene::{PERIOD, Scene, THRESHOLD};

pub(crate) const CODERS: [(&str, BlockCoder); 4] = [
    ("stored", BlockCoder::Stored),
    ("lz4", BlockCoder::Lz4),
    ("zstd 15", BlockCoder::Zstd { level: 15 }),
    ("range", BlockCoder::Range),
];

/// Geometry of the sets, and AO of all points in every frame.
pub(crate) struct Stream {
    pub(crate) geometry: Vec<Arc<Geometry>>,
    pub(crate) layout: Arc<Layout>,
    pub(crate) frames: Vec<Vec<u8>>,
}

impl Stream {
    pub(crate) fn new() -> Result<Stream, Box<dyn std::error::Error>> {
        let scene = Scene::new();
        let lattice = SetLayout {
            origin: [-0.5; 3],
            step: 1.0 / 256.0,
            extent: [2048; 3],
            normal_bits: 6,
            points: 0,
            charts: 6,
            levels: Levels::default(),
            kernel_radius: 0.06,
            digest: GeometryDigest::default(),
        };
        let rounded = scene.sets.each_ref().map(|points| Geometry::round(lattice, points));
        let frames = scene.frames(&rounded.each_ref().map(|rounded| rounded.order.clone()));
        let geometry: Vec<_> = rounded.into_iter().map(|rounded| Arc::new(rounded.geometry)).collect();
        let sets = geometry.iter().map(|geometry| *geometry.layout()).collect();
        let members = scene.instances().into_iter().map(|(set, _)| Member { set }).collect();
        let layout = Arc::new(Layout::new(sets, members, &Limits::default())?);
        Ok(Stream { geometry, layout, frames })
    }

    pub(crate) fn encoder(&self) -> Result<Encoder, Box<dyn std::error::Error>> {
        let settings = EncoderSettings::new(THRESHOLD, GeometrySource::Sent);
        Ok(Encoder::new(Arc::clone(&self.layout), self.geometry.clone(), settings)?)
    }

    /// Sets the points of a frame and finishes it; frame 0 is the keyframe.
    pub(crate) fn frame(
        &self,
        encoder: &mut Encoder,
        number: u32,
        coder: BlockCoder,
    ) -> Result<EncodedFrame, Box<dyn std::error::Error>> {
        for (point, ao) in (0..).zip(&self.frames[(number % PERIOD) as usize]) {
            encoder.set_ao(point, *ao);
        }
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        let time = StreamTime(u64::from(number) * 16_667);
        Ok(encoder.finish(FrameMeta { kind, frame: FrameIndex(number), time, changed_points: 0 }, coder)?)
    }
}
