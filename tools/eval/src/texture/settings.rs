//! Settings of a texture-space stream.

use psao_reconstruct::{CameraError, SizeError};
use psao_server::ao::AoError;

use super::atlas::AtlasFullError;
use crate::sweep::camera_lag;

/// Settings of a texture-space stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureSettings {
    /// Pixels of a full-size screen in a texel, each way; the paper has 8, 16 and 32. It need not be a power of two.
    pub divisor: u32,
    /// Lines of that screen, whatever the size of the compared pictures; the paper has 1080.
    pub lines: u32,
    /// Largest number of texels in a block each way, a power of two from 2 to [`Self::MAX_TEXELS`].
    pub most: u32,
    /// Rays a texel.
    pub rays: u32,
    /// Frames a second of the server.
    pub fps: f32,
    /// Milliseconds by which the server's camera is behind the client's.
    pub camera_lag_ms: u32,
}

impl TextureSettings {
    /// Upper limit of the texels in a block each way.
    pub const MAX_TEXELS: u32 = 256;

    /// Returns the paper's settings for this divisor: blocks for 1080 lines, of at most 256 texels each way.
    #[must_use]
    pub fn new(divisor: u32, rays: u32, fps: f32) -> Self {
        Self { divisor, lines: 1080, most: Self::MAX_TEXELS, rays, fps, camera_lag_ms: 0 }
    }

    /// Returns the settings in words and numbers, without the video coder.
    #[must_use]
    pub fn label(&self) -> String {
        let lag = camera_lag(self.camera_lag_ms);
        format!("1/{}, {} rays, {} Hz{lag}", self.divisor, self.rays, self.fps)
    }

    /// Checks all ranges.
    ///
    /// # Errors
    ///
    /// [`TextureError::Setting`] or [`TextureError::Power`].
    pub fn validate(&self) -> Result<(), TextureError> {
        let check = |setting, value: f32, least: f32, most: f32| {
            if (least..=most).contains(&value) {
                Ok(())
            } else {
                Err(TextureError::Setting { setting, value, least, most })
            }
        };
        check("divisor", self.divisor as f32, 1.0, 1024.0)?;
        check("lines", self.lines as f32, 16.0, 16_384.0)?;
        check("texels of a block", self.most as f32, 2.0, Self::MAX_TEXELS as f32)?;
        if !self.most.is_power_of_two() {
            return Err(TextureError::Power { most: self.most });
        }
        check("frames a second", self.fps, 1e-3, 1_000.0)
    }
}

/// Error of a texture-space stream.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TextureError {
    /// A setting is out of its range.
    #[error("texture space: {setting} is {value}; choose {least} to {most}")]
    Setting {
        /// Its name.
        setting: &'static str,
        /// The given value.
        value: f32,
        /// Smallest possible value.
        least: f32,
        /// Largest possible value.
        most: f32,
    },
    /// The limit of a block's side is not a power of two.
    #[error("texture space: a block of at most {most} texels a side; choose a power of two")]
    Power {
        /// The given value.
        most: u32,
    },
    /// The rays are out of range.
    #[error(transparent)]
    Rays(#[from] AoError),
    /// The camera is degenerate.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The size of the server's view is impossible, because the camera's aspect is extreme.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The patches in view do not fit into the atlas.
    #[error(transparent)]
    Full(#[from] AtlasFullError),
}
