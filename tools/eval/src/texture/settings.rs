//! What a texture-space stream can be told.

use psao_reconstruct::{CameraError, SizeError};
use psao_server::ao::AoError;

use super::atlas::AtlasFullError;

/// Settings of a texture-space stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureSettings {
    /// Pixels of a full-size screen to a texel, each way: the paper's 8, 16 and 32. A power of two is not needed.
    pub divisor: u32,
    /// Lines of that screen, whatever the size of the pictures that are compared: the paper's 1080.
    pub lines: u32,
    /// Texels that a block has at most each way, a power of two from 2 to [`Self::MAX_TEXELS`].
    pub most: u32,
    /// Rays a texel.
    pub rays: u32,
    /// Frames a second of the server.
    pub fps: f32,
}

impl TextureSettings {
    /// The most texels of a block each way.
    pub const MAX_TEXELS: u32 = 256;

    /// The paper's, at this divisor: blocks for 1080 lines, of 256 texels at most each way.
    #[must_use]
    pub fn new(divisor: u32, rays: u32, fps: f32) -> Self {
        Self { divisor, lines: 1080, most: Self::MAX_TEXELS, rays, fps }
    }

    /// In words and numbers, without the video coder.
    #[must_use]
    pub fn label(&self) -> String {
        format!("1/{}, {} rays, {} Hz", self.divisor, self.rays, self.fps)
    }

    /// Refuses what is out of range.
    ///
    /// # Errors
    ///
    /// [`TextureError::Setting`].
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

/// Why there is no texture-space stream.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TextureError {
    /// A setting is out of its range.
    #[error("texture space: {setting} is {value}; choose {least} to {most}")]
    Setting {
        /// Its name.
        setting: &'static str,
        /// As given.
        value: f32,
        /// The least it may be.
        least: f32,
        /// The most it may be.
        most: f32,
    },
    /// Blocks are halved and doubled.
    #[error("texture space: a block of at most {most} texels a side; choose a power of two")]
    Power {
        /// As given.
        most: u32,
    },
    /// The rays are out of range.
    #[error(transparent)]
    Rays(#[from] AoError),
    /// The camera is degenerate.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The server's view has no size: the camera's aspect is far from any screen's.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// What is in view does not fit the atlas.
    #[error(transparent)]
    Full(#[from] AtlasFullError),
}
