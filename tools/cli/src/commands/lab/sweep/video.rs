//! The video coders of rivals: ffmpeg with x264, x265 and SVT-AV1, where they are installed.

use std::fmt;
use std::io::{Read as _, Write as _};
use std::process::{Command, Stdio};

use clap::ValueEnum;
use psao_eval::video::{VideoClip, VideoCoder, VideoError};
use psao_reconstruct::Size;

use crate::context::Stopwatch;

/// A program that codes video.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Encoder {
    /// H.264 by x264
    X264,
    /// H.265 by x265
    X265,
    /// AV1 by SVT-AV1
    SvtAv1,
}

/// Which ffmpeg there is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Ffmpeg {
    /// As it says itself.
    version: String,
    encoders: Vec<Encoder>,
}

/// An encoder as real-time streams use it: no frames ahead or back to front, one frame that stands alone, the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Video {
    encoder: Encoder,
    /// Constant rate factor, 0 (best) to the encoder's largest.
    crf: u8,
}

impl Encoder {
    const ALL: [Self; 3] = [Self::X264, Self::X265, Self::SvtAv1];

    /// Returns the name on the command line.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::X264 => "x264",
            Self::X265 => "x265",
            Self::SvtAv1 => "svt-av1",
        }
    }

    /// Returns the name in ffmpeg.
    pub(super) const fn library(self) -> &'static str {
        match self {
            Self::X264 => "libx264",
            Self::X265 => "libx265",
            Self::SvtAv1 => "libsvtav1",
        }
    }

    /// Returns the largest rate factor.
    pub(super) const fn most(self) -> u8 {
        match self {
            Self::X264 | Self::X265 => 51,
            Self::SvtAv1 => 63,
        }
    }

    /// Returns the format in which each frame of the output is found again.
    const fn format(self) -> &'static str {
        match self {
            Self::X264 => "h264",
            Self::X265 => "hevc",
            Self::SvtAv1 => "ivf",
        }
    }

    /// Returns the pixels on both sides. SVT-AV1 has no grey; its two colour planes are of one value and cost little.
    const fn pixels(self) -> &'static str {
        match self {
            Self::X264 | Self::X265 => "gray",
            Self::SvtAv1 => "yuv420p",
        }
    }

    /// Returns the arguments for a real-time stream. One thread: more would make other bytes.
    fn arguments(self) -> Vec<&'static str> {
        const X26X: &[&str] = &["-preset", "veryfast", "-tune", "zerolatency"];
        let (speed, parameters) = match self {
            Self::X264 => (X26X, ["-x264-params", "aud=1:scenecut=0"]),
            Self::X265 => {
                (X26X, ["-x265-params", "aud=1:scenecut=0:pools=none:frame-threads=1:log-level=error"])
            }
            Self::SvtAv1 => {
                (&["-preset", "8", "-bf", "0"][..], ["-svtav1-params", "pred-struct=1:lookahead=0:lp=1"])
            }
        };
        [speed, &["-threads", "1"], &parameters].concat()
    }

    /// Returns the bytes of the colour planes of a frame, each half as wide and high.
    fn colour_bytes(self, size: Size) -> usize {
        let half = |length: u32| length.div_ceil(2) as usize;
        if self == Self::SvtAv1 { 2 * half(size.width()) * half(size.height()) } else { 0 }
    }

    /// Returns a frame with the planes of [`Self::pixels`].
    fn planes(self, grey: &[u8], size: Size) -> Vec<u8> {
        const NEUTRAL: u8 = 128;
        grey.iter().copied().chain(std::iter::repeat_n(NEUTRAL, self.colour_bytes(size))).collect()
    }

    /// Returns the grey planes of decoded frames.
    fn grey(self, decoded: &[u8], size: Size) -> Vec<Vec<u8>> {
        let frames = decoded.chunks_exact(size.pixels() + self.colour_bytes(size));
        frames.map(|frame| frame[..size.pixels()].to_vec()).collect()
    }

    /// Returns the bytes of each frame of the output.
    fn frame_bytes(self, video: &[u8]) -> Vec<u64> {
        // Access unit delimiters: ITU-T H.264, 7.3.2.4, and ITU-T H.265, 7.3.2.5 (type 35).
        match self {
            Self::X264 => access_units(video, [0, 0, 1, 9]),
            Self::X265 => access_units(video, [0, 0, 1, 0x46]),
            Self::SvtAv1 => ivf_frames(video),
        }
    }
}

impl Ffmpeg {
    /// Returns the ffmpeg on the path.
    pub(super) fn find() -> Option<Self> {
        let ask = |what: &str| {
            let output =
                Command::new("ffmpeg").args(["-hide_banner", what]).stderr(Stdio::null()).output().ok()?;
            Some(String::from_utf8_lossy(&output.stdout).into_owned())
        };
        let version = ask("-version")?;
        let version = version.lines().next()?.split_whitespace().nth(2)?.to_owned();
        let known = ask("-encoders")?;
        let has = |encoder: &Encoder| known.contains(&format!(" {} ", encoder.library()));
        Some(Self { version, encoders: Encoder::ALL.into_iter().filter(has).collect() })
    }

    /// Returns one of its coders at a rate factor, if it has the encoder.
    pub(super) fn video(&self, encoder: Encoder, crf: u8) -> Option<Video> {
        self.encoders.contains(&encoder).then_some(Video { encoder, crf })
    }
}

impl fmt::Display for Ffmpeg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ffmpeg {}", self.version)
    }
}

/// Returns what to print where an encoder is missing.
pub(super) fn missing(encoder: Encoder) -> String {
    format!(
        "no ffmpeg with {} was found; install it (the package is called ffmpeg almost everywhere)",
        encoder.library()
    )
}

impl VideoCoder for Video {
    fn label(&self) -> String {
        format!("{} crf {}", self.encoder.name(), self.crf)
    }

    fn code(&self, size: Size, fps: f32, frames: &[Vec<u8>]) -> Result<VideoClip, VideoError> {
        let encoder = self.encoder;
        let size_text = format!("{}x{}", size.width(), size.height());
        let (rate, crf) = (fps.to_string(), self.crf.to_string());
        let keyint = frames.len().to_string();
        let raw = ["-f", "rawvideo", "-pix_fmt", encoder.pixels()];
        let source = ["-s", &size_text, "-r", &rate, "-i", "pipe:0"];
        // Grey is from 0 to 255, and the stream must say so, or the decoder stretches it.
        let target = ["-pix_fmt", encoder.pixels(), "-color_range", "pc"];
        let coder = ["-c:v", encoder.library(), "-crf", &crf, "-g", &keyint];
        let format = ["-f", encoder.format()];
        let planes: Vec<Vec<u8>> = frames.iter().map(|frame| encoder.planes(frame, size)).collect();
        let clock = Stopwatch::start();
        let arguments = [&raw[..], &source, &target, &coder, &encoder.arguments(), &format].concat();
        let video = ffmpeg(&arguments, &planes)?;
        let encoded = clock.micros();
        let decoded = ffmpeg(&[&format[..], &["-i", "pipe:0"], &raw].concat(), &[&video])?;
        let decode_micros = clock.micros().saturating_sub(encoded);
        Ok(VideoClip {
            bytes: encoder.frame_bytes(&video),
            frames: encoder.grey(&decoded, size),
            encode_micros: encoded,
            decode_micros,
        })
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

/// Returns the bytes of each frame of a byte stream in which each opens with a delimiter (ITU-T H.264, annex B).
fn access_units(video: &[u8], delimiter: [u8; 4]) -> Vec<u64> {
    let starts = video.windows(delimiter.len()).enumerate().filter(|(_, window)| **window == delimiter);
    // The start code of the first unit of a frame has a zero more.
    let mut starts: Vec<usize> = starts.map(|(start, _)| start.saturating_sub(1)).collect();
    starts.push(video.len());
    starts.windows(2).map(|pair| (pair[1] - pair[0]) as u64).collect()
}

/// Returns the bytes of each frame of an IVF file: 32 bytes of header, then frames of size, time (8 bytes) and data.
fn ivf_frames(video: &[u8]) -> Vec<u64> {
    let mut rest = video.get(32..).unwrap_or_default();
    let mut sizes = Vec::new();
    while let Some((size, frame)) = rest.split_first_chunk::<4>() {
        let size = u32::from_le_bytes(*size);
        sizes.push(u64::from(size));
        rest = frame.get(8 + size as usize..).unwrap_or_default();
    }
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_told_apart_by_their_delimiters() {
        let video = [&[0, 0, 0, 1, 9, 16, 0, 0, 1, 101, 7][..], &[0, 0, 0, 1, 9, 48, 0, 0, 1, 65]].concat();
        assert_eq!(Encoder::X264.frame_bytes(&video), [11, 10]);
        assert_eq!(Encoder::X264.frame_bytes(&[]), [0_u64; 0]);
        let video =
            [&[0, 0, 0, 1, 0x46, 1, 16, 0, 0, 1, 0x26, 1, 7][..], &[0, 0, 0, 1, 0x46, 1, 48]].concat();
        assert_eq!(Encoder::X265.frame_bytes(&video), [13, 7]);
    }

    #[test]
    fn frames_of_ivf_have_their_sizes_before_them() {
        let frame = |data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], &[0; 8], data].concat();
        let video = [vec![0; 32], frame(&[1, 2, 3]), frame(&[4])].concat();
        assert_eq!(Encoder::SvtAv1.frame_bytes(&video), [3, 1]);
        assert_eq!(Encoder::SvtAv1.frame_bytes(&video[..20]), [0_u64; 0]);
    }

    #[test]
    fn what_was_coded_comes_back_nearly_the_same() {
        let ffmpeg = Ffmpeg::find();
        for encoder in Encoder::ALL {
            let Some(video) = ffmpeg.as_ref().and_then(|ffmpeg| ffmpeg.video(encoder, 18)) else {
                eprintln!("SKIPPED: {}", missing(encoder));
                assert!(std::env::var_os("PSAO_REQUIRE_FFMPEG").is_none(), "{}", missing(encoder));
                continue;
            };
            // SVT-AV1 takes nothing smaller than 64 pixels.
            let size = Size::new(128, 64).unwrap();
            let frame = |shift: usize| -> Vec<u8> {
                let shade = |pixel| (128.0 + 100.0 * ((pixel % 128 + shift) as f32 / 9.0).sin()) as u8;
                (0..size.pixels()).map(shade).collect()
            };
            let frames: Vec<Vec<u8>> = (0..7).map(frame).collect();
            let coded = video.code(size, 30.0, &frames).unwrap();
            assert_eq!(coded.bytes.len(), 7, "{encoder:?}");
            assert!(coded.bytes.iter().all(|&bytes| bytes > 4), "{encoder:?} {:?}", coded.bytes);
            for (found, frame) in coded.frames.iter().zip(&frames) {
                let off: u32 = found.iter().zip(frame).map(|(&a, &b)| u32::from(a.abs_diff(b))).sum();
                assert!(off < 4 * 128 * 64, "{encoder:?} {off}");
            }
            assert_eq!(
                video.code(size, 30.0, &frames).unwrap().bytes,
                coded.bytes,
                "{encoder:?}: every time"
            );
            let half = Size::new(128, 3).unwrap();
            assert!(video.code(half, 30.0, &[vec![0; 9]]).is_err(), "{encoder:?}: a frame that is not whole");
        }
    }
}
