//! Ambient occlusion in a texture atlas that is sent as video, for comparison with point-based streams.
//!
//! It follows shading atlas streaming as section 4 of the PSAO paper describes it. Two triangles that share an edge
//! make a patch ([`Patches`]). Each patch in view has a block of texels ([`Atlas`]): the pixels that it covers on a
//! full-size screen over a divisor each way, at least 2 x 2 ([`TextureSettings`]).
//!
//! The blocks are traced in every frame, and a video coder ([`VideoCoder`]) sends the atlas. A client looks a pixel up
//! in the decoded atlas and interpolates between texels. The paper and the code of the original were not available, so
//! further details of it are missing here.

mod atlas;
mod frame;
mod pairs;
mod patches;
mod settings;
#[cfg(test)]
mod tests;
mod visible;

pub use self::atlas::{Atlas, AtlasFullError, Block, Extent};
pub use self::frame::{BlockMap, TextureServer, TextureStats};
pub use self::patches::{Patch, PatchPoint, Patches};
pub use self::settings::{TextureError, TextureSettings};
pub use self::visible::{PatchLookup, patch_lookup};

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
