//! A tiny stream with real frames, for examples, tests and the corpora of the fuzz targets.
//!
//! The scene has two instances of a few points each: one is still and its AO changes, one has a moving pose. In profile
//! `surface` they share their points. The same call gives the same bytes on any machine.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameKind, FrameMeta};
use psao_codec::paper::{self, PointSample, Pose};
use psao_codec::surface::{
    Encoder, EncoderSettings, Geometry, GeometryDigest, GeometrySource, Levels, RestPoint, SetLayout,
};
use psao_codec::{Layout, State, apply, keyframe};

use crate::message::{
    Close, CloseCode, InstanceEntry, MemberEntry, Needs, PointSource, Report, SetEntry, StageId, StageTime,
    Text,
};
use crate::recording::Writer;
use crate::{
    CoderId, FrameIndex, Limits, Micros, Numbering, PaperInfo, Profile, SceneEntries, SceneInfo, SceneTable,
    StreamTime, TraceInfo,
};

/// Points of each instance.
const POINTS: u32 = 12;
/// Microseconds between frames.
const STEP: u64 = 16_667;
/// Difference of an AO byte from which a point is sent.
const THRESHOLD: u8 = 8;

/// Error of the sample. None is expected.
pub type Error = Box<dyn std::error::Error + Send + Sync>;

/// The sample's server, which makes one frame after another.
#[derive(Debug)]
pub struct SampleServer {
    scene: Arc<SceneTable>,
    source: Source,
    /// The state that every client should have, kept by applying every frame.
    state: State,
    next: FrameIndex,
}

#[derive(Debug)]
enum Source {
    Paper(Box<paper::Encoder>),
    Surface(Box<Encoder>),
}

impl SampleServer {
    /// Creates a server of profile `paper` before its first frame.
    ///
    /// # Errors
    /// None is expected; see [`Error`].
    pub fn new() -> Result<Self, Error> {
        Self::of(Profile::PAPER)
    }

    /// Creates a server of a profile before its first frame.
    ///
    /// # Errors
    /// A profile that is neither `paper` nor `surface`.
    pub fn of(profile: Profile) -> Result<Self, Error> {
        let geometry = Arc::new(geometry());
        let scene = Arc::new(scene(profile, &geometry)?);
        let source = match scene.layout() {
            Layout::Paper(layout) => {
                Source::Paper(Box::new(paper::Encoder::new(layout.clone(), &[POINTS; 2])?))
            }
            Layout::Surface(layout) => {
                let settings = EncoderSettings::new(THRESHOLD, GeometrySource::Sent);
                Source::Surface(Box::new(Encoder::new(layout.clone(), vec![geometry], settings)?))
            }
        };
        let state = State::new(scene.layout());
        Ok(Self { scene, source, state, next: FrameIndex(0) })
    }

    /// Returns the scene table.
    #[must_use]
    pub const fn scene(&self) -> &Arc<SceneTable> {
        &self.scene
    }

    /// Returns the block coder of its frames.
    #[must_use]
    pub fn coder(&self) -> BlockCoder {
        BlockCoder::default()
    }

    /// Makes the next frame: the first is a keyframe, the others are updates.
    ///
    /// # Errors
    /// None is expected; see [`Error`].
    pub fn step(&mut self) -> Result<EncodedFrame, Error> {
        let frame = self.next;
        let kind = if frame.0 == 0 { FrameKind::Key } else { FrameKind::Delta };
        let meta = FrameMeta { kind, ..self.meta(frame) };
        let changing = (0..2 * POINTS).filter(|point| frame.0 == 0 || point % 5 == frame.0 % 5);
        let encoded = match &mut self.source {
            Source::Paper(encoder) => {
                for point in changing {
                    encoder.put(point, &sample(point, frame.0))?;
                }
                let moved = frame.0 as f32 * 0.25;
                encoder.set_pose(1, Pose { translation: [moved, 0.0, 0.0], ..Pose::IDENTITY })?;
                encoder.retry_unplaced();
                encoder.finish(meta, BlockCoder::default())?
            }
            Source::Surface(encoder) => {
                for point in changing {
                    encoder.set_ao(point, sample(point, frame.0).ao).ok_or("the point is not there")?;
                }
                encoder.finish(meta, BlockCoder::default())?
            }
        };
        apply(&mut self.state, &encoded.body, &Limits::default().codec)?;
        self.next = frame.next().ok_or("frame numbers are used up")?;
        Ok(encoded)
    }

    /// Makes a keyframe of the state after the last step, for a client that joins late or fell behind.
    ///
    /// # Errors
    /// None is expected after a step; see [`Error`].
    pub fn keyframe(&self) -> Result<Vec<u8>, Error> {
        let frame = self.state.frame().ok_or("no frame was made yet")?;
        Ok(keyframe(&self.state, self.meta(frame), BlockCoder::default(), &[])?)
    }

    /// Returns the state after the last step, which every client should have.
    #[must_use]
    pub const fn state(&self) -> &State {
        &self.state
    }

    /// Returns a report of a frame.
    #[must_use]
    pub fn report(&self, frame: FrameIndex) -> Report {
        let stages = vec![StageTime { stage: StageId::TRACE, micros: 100 + frame.0 }];
        Report { frame, rays: 64, visible: 2 * POINTS, stored: 2 * POINTS, stages, ..Report::default() }
    }

    fn meta(&self, frame: FrameIndex) -> FrameMeta {
        let time = StreamTime(u64::from(frame.0) * STEP);
        FrameMeta { kind: FrameKind::Key, frame, time, changed_points: 2 * POINTS / 5 }
    }
}

/// Returns a recording of `frames` frames with a keyframe every `group` frames and a report after each, closed and
/// indexed.
///
/// # Errors
/// None is expected; see [`Error`].
pub fn recording(frames: u32, group: u32) -> Result<Vec<u8>, Error> {
    recording_of(Profile::PAPER, frames, group)
}

/// Does the same as [`recording`], for a profile.
///
/// # Errors
/// A profile that is neither `paper` nor `surface`.
pub fn recording_of(profile: Profile, frames: u32, group: u32) -> Result<Vec<u8>, Error> {
    let mut server = SampleServer::of(profile)?;
    let mut numbering = Numbering::default();
    let (mut writer, mut file) = Writer::new(Limits::default());
    for frame in numbering.scene(server.scene())? {
        file.extend(writer.append(Micros(0), &frame)?);
    }
    for number in 0..frames {
        let body = server.step()?.body;
        let now = Micros(u64::from(number) * STEP);
        let frame = match number % group.max(1) {
            0 => numbering.keyframe(&server.keyframe()?)?,
            _ => numbering.update(&body)?,
        };
        file.extend(writer.append(now, &frame)?);
        let report = numbering.message(&server.report(FrameIndex(number)))?;
        file.extend(writer.append(now, &report)?);
    }
    let end = Micros(u64::from(frames) * STEP);
    file.extend(writer.append(end, &numbering.message(&Close::new(CloseCode::DONE, "end of the sample"))?)?);
    file.extend(writer.finish()?);
    Ok(file)
}

/// Returns point `point` of frame `frame`: on a grid, with the normal up, and AO from both numbers.
fn sample(point: u32, frame: u32) -> PointSample {
    let at = |step: u32| (point / step % 3) as f32 * 0.4 + 0.1;
    let ao = (point * 20 + frame * 7) % 256;
    PointSample { local: [at(1), at(3), at(9)], normal: [0.0, 1.0, 0.0], ao: ao as u8 }
}

/// Returns the points of an instance as a set, in an order of their own.
fn geometry() -> Geometry {
    let points: Vec<RestPoint> = (0..POINTS)
        .map(|point| {
            let PointSample { local, normal, .. } = sample(point, 0);
            RestPoint { position: local, normal, chart: 0 }
        })
        .collect();
    let plain = SetLayout {
        origin: [0.0; 3],
        step: 0.05,
        extent: [24; 3],
        normal_bits: 6,
        charts: 1,
        levels: Levels::default(),
        points: POINTS,
        kernel_radius: 0.3,
        digest: GeometryDigest::default(),
    };
    let digest = Geometry::round(plain, &points).geometry.digest();
    Geometry::round(SetLayout { digest, ..plain }, &points).geometry
}

/// Returns facts about a scene without those of profile `paper`, for examples and tests.
#[must_use]
pub fn info() -> SceneInfo {
    let trace = TraceInfo::new(64, 0.6).with_seed(1).with_density(12.0, POINTS).with_view_margin(1.3);
    SceneInfo::new("sample", [7; 32], 60.0, THRESHOLD, CoderId::ZSTD, PointSource::SENT)
        .with_source(Text::cut("sample"))
        .with_trace(trace)
}

fn scene(profile: Profile, geometry: &Geometry) -> Result<SceneTable, Error> {
    let surface = profile == Profile::SURFACE;
    let mut info = info();
    if !surface {
        info = info.with_paper(PaperInfo::new(16));
    }
    let entry = |first_bucket, needs| InstanceEntry {
        origin: [0.0; 3],
        edge: 0.6,
        dims: [2; 3],
        first_bucket,
        bucket_count: 2,
        kernel_radius: 0.3,
        points: POINTS,
        needs,
    };
    let needs = [Needs::NONE, Needs::RIGID_MOTION];
    let entries = if surface {
        let set = SetEntry::from(geometry.layout());
        SceneEntries::Surface {
            sets: vec![set],
            members: needs.map(|needs| MemberEntry { set: 0, needs }).into(),
        }
    } else {
        SceneEntries::Cells(vec![entry(0, needs[0]), entry(2, needs[1])])
    };
    Ok(SceneTable::new(info, entries, &Limits::default())?)
}
