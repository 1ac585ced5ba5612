//! A stream of profile `surface` in which half of the points change in every frame.

use std::error::Error;
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::surface::{
    Encoder, EncoderSettings, Geometry, GeometryDigest, GeometrySource, Levels, RestPoint, SetLayout,
};
use psao_codec::{Layout, StateRef};
use psao_proto::message::{MemberEntry, Needs, PointSource, SetEntry};
use psao_proto::{Limits, SceneEntries, SceneInfo, SceneTable};

/// Points in a row of the square that the points lie on.
const ROW: u32 = 256;

/// A source of frames in place of a tracer.
pub(crate) struct Source {
    scene: Arc<SceneTable>,
    encoder: Encoder,
    coder: BlockCoder,
    points: u32,
    next: u32,
}

impl Source {
    /// Creates a stream in which `changing` of twice as many points change in a frame.
    pub(crate) fn new(
        changing: u32,
        coder: BlockCoder,
        fps: f32,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let points = changing * 2;
        let geometry = Arc::new(geometry(points));
        let scene = Arc::new(scene(&geometry, coder, fps)?);
        let Layout::Surface(layout) = scene.layout() else { return Err("not of profile surface".into()) };
        let settings = EncoderSettings::new(2, GeometrySource::Sent);
        let encoder = Encoder::new(layout.clone(), vec![geometry], settings)?;
        Ok(Self { scene, encoder, coder, points, next: 0 })
    }

    pub(crate) fn scene(&self) -> &Arc<SceneTable> {
        &self.scene
    }

    pub(crate) fn state(&self) -> StateRef<'_> {
        self.encoder.state().into()
    }

    /// Makes the next frame: a wave of AO moves over the points, and every other point changes.
    pub(crate) fn step(&mut self) -> Result<EncodedFrame, Box<dyn Error + Send + Sync>> {
        let frame = self.next;
        self.next += 1;
        let changing = (0..self.points).filter(|point| frame == 0 || point % 2 == frame % 2);
        for point in changing {
            let phase = (point / ROW * 3 + point % ROW + frame * 5 + noise(point, frame)) % 256;
            let ao = 255 - (phase * 2).abs_diff(255).min(255);
            self.encoder.set_ao(point, ao as u8).ok_or("the point is there")?;
        }
        let kind = if frame == 0 { FrameKind::Key } else { FrameKind::Delta };
        let time = StreamTime(u64::from(frame) * 16_667);
        let meta = FrameMeta { kind, frame: FrameIndex(frame), time, changed_points: self.points / 2 };
        Ok(self.encoder.finish(meta, self.coder)?)
    }
}

/// Returns a number from 0 to 15, so that consecutive frames differ.
fn noise(point: u32, frame: u32) -> u32 {
    (point ^ frame.wrapping_mul(0x9E37_79B1)).wrapping_mul(0x85EB_CA6B) >> 28
}

/// Returns points on a square in the plane y = 0.
fn geometry(points: u32) -> Geometry {
    let place = |point: u32| [(point % ROW) as f32 * 0.05, 0.0, (point / ROW) as f32 * 0.05];
    let rest: Vec<_> = (0..points)
        .map(|point| RestPoint { position: place(point), normal: [0.0, 1.0, 0.0], chart: 0 })
        .collect();
    let plain = SetLayout {
        origin: [0.0; 3],
        step: 0.01,
        extent: [ROW * 5, 1, (points / ROW + 1) * 5],
        normal_bits: 6,
        charts: 1,
        levels: Levels::default(),
        points,
        kernel_radius: 0.1,
        digest: GeometryDigest::default(),
    };
    let digest = Geometry::round(plain, &rest).geometry.digest();
    Geometry::round(SetLayout { digest, ..plain }, &rest).geometry
}

fn scene(
    geometry: &Geometry,
    coder: BlockCoder,
    fps: f32,
) -> Result<SceneTable, Box<dyn Error + Send + Sync>> {
    let info = SceneInfo::new("soak", [0; 32], fps, 2, coder.id(), PointSource::SENT);
    let entries = SceneEntries::Surface {
        sets: vec![SetEntry::from(geometry.layout())],
        members: vec![MemberEntry { set: 0, needs: Needs::NONE }],
    };
    Ok(SceneTable::new(info, entries, &Limits::default())?)
}
