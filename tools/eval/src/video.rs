//! Video of 8-bit grey, as rivals of point streams send it.

use psao_reconstruct::Size;

/// Codes pictures of 8-bit grey as video, and decodes them again.
pub trait VideoCoder: Sync {
    /// Returns name and settings, for labels.
    fn label(&self) -> String;

    /// Codes `frames` and decodes the result. Each frame has `size`, row by row; they are shown `fps` times a second.
    ///
    /// # Errors
    ///
    /// [`VideoError`] with the coder's error text.
    fn code(&self, size: Size, fps: f32, frames: &[Vec<u8>]) -> Result<VideoClip, VideoError>;
}

/// A coded and decoded clip.
#[derive(Clone, Debug, PartialEq)]
pub struct VideoClip {
    /// Bytes of each frame.
    pub bytes: Vec<u64>,
    /// The decoded frames.
    pub frames: Vec<Vec<u8>>,
    /// Microseconds that coding the clip took.
    pub encode_micros: u64,
    /// Microseconds that decoding it took.
    pub decode_micros: u64,
}

impl VideoClip {
    /// Checks that the clip has as many frames, and of the same sizes, as `frames`.
    pub(crate) fn check(&self, frames: &[Vec<u8>]) -> Result<(), VideoError> {
        let (bytes, decoded) = (self.bytes.len(), self.frames.len());
        let whole = self.frames.iter().zip(frames).all(|(decoded, frame)| decoded.len() == frame.len());
        if bytes == frames.len() && decoded == frames.len() && whole {
            return Ok(());
        }
        Err(VideoError(format!(
            "of {} frames it wrote {bytes} and read back {decoded}, or only parts of them",
            frames.len()
        )))
    }
}

/// A video coder failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the video coder failed: {0}")]
pub struct VideoError(pub String);
