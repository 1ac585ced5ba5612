//! Frames coded as video, with times and sizes as a stream has them.

use psao_reconstruct::Size;

use super::{Bench, Spread, StageTime, StreamFigures, SweepError};
use crate::video::{VideoClip, VideoCoder};

/// A clip as video, with the milliseconds of a frame.
pub(super) struct TimedVideo {
    pub(super) clip: VideoClip,
    pub(super) encode: Spread,
    pub(super) decode: Spread,
}

/// What a server did for a frame before it was coded.
#[derive(Clone, Copy, Default)]
pub(super) struct FrameWork {
    /// Values that it traced: texels or pixels.
    pub(super) values: u64,
    /// Bytes beside the video.
    pub(super) other_bytes: u64,
    /// Microseconds of its stages.
    pub(super) micros: [u64; 3],
}

impl Bench<'_> {
    /// Codes and decodes frames, as often as runs are measured.
    pub(super) fn code(
        &self,
        coder: &dyn VideoCoder,
        size: Size,
        fps: f32,
        frames: &[Vec<u8>],
    ) -> Result<TimedVideo, SweepError> {
        let per_frame = |micros: u64| micros as f64 / 1e3 / frames.len() as f64;
        let (mut encode, mut decode) = (Vec::new(), Vec::new());
        let run = |encode: &mut Vec<f64>, decode: &mut Vec<f64>| {
            let clip = coder.code(size, fps, frames)?;
            clip.check(frames)?;
            encode.push(per_frame(clip.encode_micros));
            decode.push(per_frame(clip.decode_micros));
            Ok::<_, SweepError>(clip)
        };
        let clip = run(&mut encode, &mut decode)?;
        for _ in 1..self.runs.repeats {
            run(&mut encode, &mut decode)?;
        }
        Ok(TimedVideo { clip, encode: Spread::of(encode), decode: Spread::of(decode) })
    }
}

impl TimedVideo {
    /// Returns the server's stages by their names, encoding, and decoding.
    pub(super) fn stages(&self, names: [&str; 3], work: &[FrameWork]) -> Vec<StageTime> {
        let stage =
            |side: &str, name: &str, ms| StageTime { side: side.to_owned(), name: name.to_owned(), ms };
        let before = (0..).zip(names).map(|(number, name): (usize, _)| {
            let micros: Vec<u64> = work[1..].iter().map(|frame| frame.micros[number]).collect();
            stage("server", name, Spread::of_micros(&micros))
        });
        before
            .chain([stage("server", "encode", self.encode), stage("client", "decode", self.decode)])
            .collect()
    }

    /// Returns the size and times of the stream. Its points are the values that the last frame traced.
    pub(super) fn figures(&self, fps: f32, work: &[FrameWork]) -> StreamFigures {
        let frames = work.len() as u32;
        let seconds = f64::from(frames - 1) / f64::from(fps);
        let mbit_s = |bytes: u64| bytes as f64 * 8.0 / 1e6 / seconds;
        let ms = |frame: &FrameWork| frame.micros.iter().sum::<u64>() as f64 / 1e3 + self.encode.median;
        let (first, later) = (&work[0], &work[1..]);
        let video: u64 = self.clip.bytes[1..].iter().sum();
        let other: u64 = later.iter().map(|frame| frame.other_bytes).sum();
        StreamFigures {
            frames,
            points: work.last().map_or(0, |frame| frame.values as u32),
            scene_table_bytes: 0,
            first_state_bytes: self.clip.bytes[0] + first.other_bytes,
            later_bytes: video + other,
            changed_points: later.iter().map(|frame| frame.values).sum(),
            paper_mbit_s: mbit_s(video),
            wire_mbit_s: mbit_s(video + other),
            first_frame_ms: ms(first),
            server_ms: Spread::of(later.iter().map(ms).collect()),
        }
    }
}
