//! The video coder of the texture-space baseline: ffmpeg with x264, where it is installed.

use std::fmt;
use std::io::{Read as _, Write as _};
use std::process::{Command, Stdio};

use psao_eval::texture::{VideoClip, VideoCoder, VideoError};
use psao_reconstruct::Size;

use crate::context::Stopwatch;

/// What to print where there is no video coder.
pub(super) const MISSING: &str =
    "no ffmpeg with libx264 was found; install it (the package is called ffmpeg almost everywhere)";

/// Which ffmpeg there is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Ffmpeg {
    /// As it says itself.
    version: String,
}

/// x264 as real-time streams use it: no frames ahead or back to front, one frame that stands alone, the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct X264 {
    /// Constant rate factor, 0 (no loss) to 51.
    crf: u8,
}

impl Ffmpeg {
    /// Returns the ffmpeg on the path, if it has x264.
    pub(super) fn find() -> Option<Self> {
        let ask = |what: &str| {
            let output =
                Command::new("ffmpeg").args(["-hide_banner", what]).stderr(Stdio::null()).output().ok()?;
            Some(String::from_utf8_lossy(&output.stdout).into_owned())
        };
        let version = ask("-version")?;
        let version = version.lines().next()?.split_whitespace().nth(2)?.to_owned();
        ask("-encoders")?.contains(" libx264 ").then_some(Self { version })
    }

    /// Returns its coder at a rate factor.
    pub(super) fn x264(&self, crf: u8) -> X264 {
        X264 { crf }
    }
}

impl fmt::Display for Ffmpeg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "x264 of ffmpeg {}", self.version)
    }
}

impl VideoCoder for X264 {
    fn label(&self) -> String {
        format!("x264 crf {}", self.crf)
    }

    fn code(&self, size: Size, fps: f32, frames: &[Vec<u8>]) -> Result<VideoClip, VideoError> {
        let size = format!("{}x{}", size.width(), size.height());
        let clock = Stopwatch::start();
        let raw = ["-f", "rawvideo", "-pix_fmt", "gray"];
        let (rate, crf) = (fps.to_string(), self.crf.to_string());
        let keyint = frames.len().to_string();
        // One thread: more would make other bytes. Every frame opens with a delimiter by which it is found again. Grey is
        // from 0 to 255, and the stream must say so, or the decoder stretches it.
        let encoder = [
            "-c:v",
            "libx264",
            "-preset",
            "veryfast",
            "-tune",
            "zerolatency",
            "-crf",
            &crf,
            "-color_range",
            "pc",
            "-g",
            &keyint,
            "-threads",
            "1",
            "-x264-params",
            "aud=1:scenecut=0",
            "-f",
            "h264",
        ];
        let source = ["-s", &size, "-r", &rate, "-i", "pipe:0"];
        let pixels = ["-pix_fmt", "gray"];
        let video = ffmpeg(&[&raw[..], &source, &pixels, &encoder].concat(), frames)?;
        let encoded = clock.micros();
        let decoded = ffmpeg(&[&["-f", "h264", "-i", "pipe:0"], &raw[..]].concat(), &[&video])?;
        let decode_micros = clock.micros().saturating_sub(encoded);
        let bytes = access_units(&video);
        let pixels = frames.first().map_or(1, Vec::len).max(1);
        let decoded: Vec<Vec<u8>> = decoded.chunks_exact(pixels).map(<[u8]>::to_vec).collect();
        Ok(VideoClip { bytes, frames: decoded, encode_micros: encoded, decode_micros })
    }
}

/// Runs ffmpeg with bytes on standard input; returns its standard output.
fn ffmpeg(arguments: &[&str], input: &[impl AsRef<[u8]> + Sync]) -> Result<Vec<u8>, VideoError> {
    let failed = |error: std::io::Error| VideoError(error.to_string());
    let mut child = Command::new("ffmpeg")
        .args(["-hide_banner", "-loglevel", "error", "-nostdin"])
        .args(arguments)
        .arg("pipe:1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    let (stdin, stdout, stderr) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
    let (output, said) = std::thread::scope(|scope| {
        // It writes while it still reads, and stops reading when it fails: then its words say more than the broken pipe.
        scope.spawn(move || {
            let mut stdin = stdin?;
            input.iter().try_for_each(|frame| stdin.write_all(frame.as_ref())).ok()
        });
        let words = scope.spawn(move || {
            let mut said = String::new();
            stderr?.read_to_string(&mut said).ok().map(|_| said)
        });
        let mut output = Vec::new();
        let read = stdout.map(|mut stdout| stdout.read_to_end(&mut output));
        (read.transpose().map(|_| output), words.join().ok().flatten().unwrap_or_default())
    });
    let (output, status) = (output.map_err(failed)?, child.wait().map_err(failed)?);
    if status.success() {
        Ok(output)
    } else {
        Err(VideoError(format!("ffmpeg ended with {status}: {}", said.trim())))
    }
}

/// Bytes of each frame of an H.264 byte stream in which each opens with an access unit delimiter (ITU-T H.264, 7.3.2.4
/// and annex B).
fn access_units(video: &[u8]) -> Vec<u64> {
    const DELIMITER: [u8; 4] = [0, 0, 1, 9];
    let starts = video.windows(DELIMITER.len()).enumerate().filter(|(_, window)| **window == DELIMITER);
    // The start code of the first unit of a frame has a zero more.
    let mut starts: Vec<usize> = starts.map(|(start, _)| start.saturating_sub(1)).collect();
    starts.push(video.len());
    starts.windows(2).map(|pair| (pair[1] - pair[0]) as u64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_told_apart_by_their_delimiters() {
        let video = [&[0, 0, 0, 1, 9, 16, 0, 0, 1, 101, 7][..], &[0, 0, 0, 1, 9, 48, 0, 0, 1, 65]].concat();
        assert_eq!(access_units(&video), [11, 10]);
        assert_eq!(access_units(&[]), [0_u64; 0]);
    }

    #[test]
    fn what_was_coded_comes_back_nearly_the_same() {
        let Some(ffmpeg) = Ffmpeg::find() else {
            eprintln!("SKIPPED: {MISSING}");
            assert!(std::env::var_os("PSAO_REQUIRE_FFMPEG").is_none(), "{MISSING}");
            return;
        };
        let size = Size::new(64, 48).unwrap();
        let frame = |shift: usize| -> Vec<u8> {
            (0..64 * 48)
                .map(|pixel| (128.0 + 100.0 * ((pixel % 64 + shift) as f32 / 9.0).sin()) as u8)
                .collect()
        };
        let frames: Vec<Vec<u8>> = (0..7).map(frame).collect();
        let coded = ffmpeg.x264(18).code(size, 30.0, &frames).unwrap();
        assert_eq!(coded.bytes.len(), 7);
        assert!(coded.bytes.iter().all(|&bytes| bytes > 8), "{:?}", coded.bytes);
        for (found, frame) in coded.frames.iter().zip(&frames) {
            let off: u32 = found.iter().zip(frame).map(|(&a, &b)| u32::from(a.abs_diff(b))).sum();
            assert!(off < 4 * 64 * 48, "{off}");
        }
        assert_eq!(ffmpeg.x264(18).code(size, 30.0, &frames).unwrap().bytes, coded.bytes, "every time");
        let missing = Size::new(64, 3).unwrap();
        assert!(ffmpeg.x264(18).code(missing, 30.0, &[vec![0; 9]]).is_err(), "a frame that is not whole");
    }
}
