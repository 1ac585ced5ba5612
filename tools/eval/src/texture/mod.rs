//! Ambient occlusion in a texture atlas that is sent as video: what point-based streams are compared with.
//!
//! In the spirit of shading atlas streaming, as section 4 of the PSAO paper describes it: two triangles that share an edge
//! make a patch ([`Patches`]); each patch that is in view has a block of texels ([`Atlas`]), as many as it covers pixels
//! of a full-size screen over a divisor each way, 2 x 2 at least ([`TextureSettings`]); the blocks are traced in every
//! frame, and the atlas is sent by a video coder ([`VideoCoder`]). A client looks a pixel up in the decoded atlas, between
//! texels. What the original does besides, from its own paper, is not known here: no code or text of it was at hand.

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
    /// Name and settings, for labels.
    fn label(&self) -> String;

    /// Codes `frames`, each of `size` and row by row, to be shown `fps` times a second, and decodes the result.
    ///
    /// # Errors
    ///
    /// What the coder said when it failed.
    fn code(&self, size: Size, fps: f32, frames: &[Vec<u8>]) -> Result<VideoClip, VideoError>;
}

/// A clip that was coded and decoded.
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
    /// Refuses a result that is not of these frames.
    pub(crate) fn check(&self, frames: &[Vec<u8>]) -> Result<(), VideoError> {
        let (bytes, decoded) = (self.bytes.len(), self.frames.len());
        let whole = self.frames.iter().zip(frames).all(|(decoded, frame)| decoded.len() == frame.len());
        if bytes == frames.len() && decoded == frames.len() && whole {
            return Ok(());
        }
        Err(VideoError(format!(
            "of {} frames it wrote {bytes} and read {decoded} back, or parts of them",
            frames.len()
        )))
    }
}

/// A video coder failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the video coder failed: {0}")]
pub struct VideoError(pub String);
