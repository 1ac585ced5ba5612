//! One run of a clip, by a server and a client.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameInfo, StreamTime};
use psao_codec::{Decoder, Limits, State};
use psao_proto::message::CameraPose;
use psao_proto::{HEADER_BYTES, SceneTable};
use psao_server::clock::Clock;
use psao_server::points::PointCache;
use psao_server::scene::Scene;
use psao_server::server::{Server, ServerSettings, StageMicros};

use super::{Setting, Spread, SweepError};

/// Bytes of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameBytes {
    /// Bytes that the paper counts: blocks that hold points.
    pub paper: u64,
    /// All bytes on the wire.
    pub wire: u64,
}

/// A clip of a scene.
pub struct Clip<'a> {
    /// The scene.
    pub scene: &'a Arc<Scene>,
    /// Server settings that are not swept.
    pub base: ServerSettings,
    /// Length in seconds. A stream has the frames that begin in it, at least 2.
    pub seconds: f64,
    /// Cache that keeps points between runs.
    pub cache: Option<&'a dyn PointCache>,
    /// Counts the bytes of a frame.
    pub count: fn(&FrameInfo) -> FrameBytes,
}

impl Clip<'_> {
    /// Returns the camera that a server knows at a time: the client's of some time before.
    pub(super) fn server_camera(&self, time_s: f64, lag_ms: u32) -> CameraPose {
        self.scene.camera(time_s - f64::from(lag_ms) / 1e3)
    }
}

/// Bytes of all frames of a clip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ClipBytes {
    pub(super) frames: u32,
    pub(super) table: u64,
    pub(super) first: u64,
    pub(super) largest: u64,
    pub(super) changed: u64,
    pub(super) later: FrameBytes,
}

/// Times of a clip in microseconds.
#[derive(Default)]
pub(super) struct ClipTimes {
    pub(super) first: u64,
    /// Times of the server's stages, by later frame and stage.
    pub(super) server: Vec<StageMicros>,
    /// Times of the decoder, by later frame.
    pub(super) decode: Vec<u64>,
}

impl ClipTimes {
    pub(super) fn add(&mut self, other: Self) {
        self.server.extend(other.server);
        self.decode.extend(other.decode);
    }

    pub(super) fn server_stage(&self, stage: usize) -> Spread {
        Spread::of_micros(&self.server.iter().map(|stages| stages.by_stage()[stage].1).collect::<Vec<_>>())
    }
}

/// One run of a clip, server and client side by side.
pub(super) struct Run<'a> {
    pub(super) clip: &'a Clip<'a>,
    pub(super) clock: &'a dyn Clock,
    pub(super) server: Server,
    pub(super) state: State,
    pub(super) decoder: Decoder,
    pub(super) fps: f64,
    camera_lag_ms: u32,
    pub(super) frames: u32,
    pub(super) points: u32,
    pub(super) bytes: ClipBytes,
    pub(super) took: ClipTimes,
}

impl<'a> Run<'a> {
    pub(super) fn new(
        clip: &'a Clip<'a>,
        setting: &Setting,
        clock: &'a dyn Clock,
    ) -> Result<Self, SweepError> {
        let fps = f64::from(setting.fps);
        let frames = frames(clip.seconds, fps);
        let settings = setting.server(clip.base).with_frames_hint(frames);
        let server = Server::with_cache(Arc::clone(clip.scene), settings, clip.cache, Arc::new(|_| ()))?;
        let table = server.table();
        let bytes = ClipBytes { frames, table: table_bytes(table)?, ..ClipBytes::default() };
        Ok(Self {
            clip,
            clock,
            state: State::new(table.layout()),
            points: table.point_count(),
            server,
            decoder: Decoder::new(),
            fps,
            camera_lag_ms: setting.camera_lag_ms,
            frames,
            bytes,
            took: ClipTimes::default(),
        })
    }

    /// Returns the newest frame that has begun by this time.
    pub(super) fn frame_at(&self, time_s: f64) -> u32 {
        frame_at(time_s, self.fps, self.frames)
    }

    pub(super) fn time(&self, frame: u32) -> StreamTime {
        StreamTime((f64::from(frame) / self.fps * 1e6).round() as u64)
    }

    /// Makes a frame and applies it.
    pub(super) fn frame(&mut self, frame: u32) -> Result<(), SweepError> {
        let camera = [self.clip.server_camera(f64::from(frame) / self.fps, self.camera_lag_ms)];
        let output = self.server.step(FrameIndex(frame), self.time(frame), &camera, self.clock)?;
        let start = self.clock.micros();
        let applied = self.decoder.decode(&mut self.state, &output.body, &Limits::default());
        let decode = self.clock.micros().saturating_sub(start);
        applied.map_err(|error| SweepError::Frame { frame: FrameIndex(frame), error })?;
        let bytes = (self.clip.count)(&output.info);
        let stages = output.stats.micros;
        self.bytes.largest = self.bytes.largest.max(output.body.len() as u64);
        if frame == 0 {
            self.bytes.first = bytes.wire;
            self.took.first = stages.total();
        } else {
            self.bytes.later.paper += bytes.paper;
            self.bytes.later.wire += bytes.wire;
            self.bytes.changed += u64::from(output.stats.changed);
            self.took.server.push(stages);
            self.took.decode.push(decode);
        }
        Ok(())
    }

    /// Returns the bytes of the whole state without compression.
    pub(super) fn keyframe_bytes(&self) -> Result<u64, SweepError> {
        let last = self.frames - 1;
        let body = self.server.keyframe(FrameIndex(last), self.time(last), BlockCoder::Stored)?;
        Ok(body.len() as u64)
    }
}

/// Returns the number of frames that begin in a clip, at least 2.
pub(super) fn frames(seconds: f64, fps: f64) -> u32 {
    (seconds * fps + 1e-6).max(2.0) as u32
}

/// Returns the newest of `frames` frames that has begun by this time.
pub(super) fn frame_at(time_s: f64, fps: f64, frames: u32) -> u32 {
    ((time_s * fps + 1e-6) as u32).min(frames - 1)
}

fn table_bytes(table: &SceneTable) -> Result<u64, SweepError> {
    let payloads = table.payloads()?;
    Ok(payloads.iter().map(|payload| (HEADER_BYTES + payload.len()) as u64).sum())
}
