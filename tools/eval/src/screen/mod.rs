//! Screen-space ambient occlusion, for comparison with point-based ambient occlusion.
//!
//! Each method follows its own paper. All share one input ([`Screen`]) and one set of falloffs ([`Falloff`]). No method
//! knows surfaces that the screen does not show. The geometric reference, which knows all surfaces, is
//! [`crate::reference`].

mod blur;
mod depth;
mod falloff;
mod far_field;
mod hbao;
mod line_sweep;
mod mipmap;
mod noise;
mod pyramid;
mod pyramid_hbao;
mod scalable;
mod screen_rays;
mod ssao;
mod ssao_plus;
#[cfg(test)]
mod tests;

use psao_reconstruct::{AoImage, AoImageError, CameraError, Size, SizeError};
use psao_server::clock::Clock;
use serde::Serialize;

pub use self::blur::{Blur, EdgeStop};
pub use self::depth::Screen;
pub use self::falloff::{Falloff, Samples};
pub use self::far_field::{FarField, FarFieldSettings, NearField, Separation};
pub use self::hbao::Hbao;
pub use self::line_sweep::LineSweep;
pub use self::mipmap::{Mipmap, MipmapSettings};
pub use self::pyramid_hbao::PyramidHbao;
pub use self::scalable::Scalable;
pub use self::screen_rays::{RayBias, ScreenRays};
pub use self::ssao::Ssao;
pub use self::ssao_plus::SsaoPlus;

/// A screen-space method.
pub trait ScreenMethod: Sync {
    /// Returns the short name, as on a command line: letters, digits and dashes.
    fn name(&self) -> &'static str;

    /// Returns the settings in words, for plots and tables.
    fn label(&self) -> String;

    /// Returns the samples of depth that the method reads for a pixel; `None` where their number varies.
    fn sampling(&self) -> Option<Sampling> {
        None
    }

    /// Computes the accessibility of the inner pixels of `screen`; sky is 1. It is the same on any number of threads.
    ///
    /// The method reads `clock` only for the times of the stages.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] when a setting is out of its range.
    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError>;
}

/// Samples of depth that a method reads for a pixel, including those beyond its radius.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Sampling {
    /// Directions D; `None` for a method without directions.
    pub directions: Option<u32>,
    /// Samples S of a direction, on all levels together; `None` without directions.
    pub along: Option<u32>,
    /// Levels of depth L above the buffer itself.
    pub levels: u32,
    /// Total number of samples.
    pub per_pixel: u32,
}

impl Sampling {
    /// Makes the sampling of `directions` with `along` samples each.
    pub(crate) fn directed(directions: u32, along: u32, levels: u32) -> Self {
        Self { directions: Some(directions), along: Some(along), levels, per_pixel: directions * along }
    }
}

/// Result of a method.
#[derive(Clone, Debug, PartialEq)]
pub struct Shading {
    /// Accessibility in `[0, 1]` of the inner pixels.
    pub image: AoImage,
    /// Time of each stage in microseconds, in the order of the stages.
    pub stages: Vec<(&'static str, u64)>,
    /// Largest working memory in bytes: all buffers except the screen itself, the image included.
    pub bytes: usize,
}

impl Shading {
    /// Returns the time of all stages in microseconds.
    pub fn micros(&self) -> u64 {
        self.stages.iter().map(|(_, micros)| micros).sum()
    }
}

/// Stopwatch for the stages of a method.
pub(crate) struct StageTimer<'a> {
    clock: &'a dyn Clock,
    since: u64,
    done: Vec<(&'static str, u64)>,
}

impl<'a> StageTimer<'a> {
    pub(crate) fn new(clock: &'a dyn Clock) -> Self {
        Self { clock, since: clock.micros(), done: Vec::new() }
    }

    /// Ends `stage`, which began at the last call or when the timer was made. Times of equal stages add up.
    pub(crate) fn end(&mut self, stage: &'static str) {
        let now = self.clock.micros();
        let micros = now.saturating_sub(self.since);
        match self.done.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, sum)) => *sum += micros,
            None => self.done.push((stage, micros)),
        }
        self.since = now;
    }

    /// Makes the result from the accessibilities of the inner pixels and the bytes of all other buffers.
    pub(crate) fn finish(
        self,
        screen: &Screen,
        values: Vec<f32>,
        bytes: usize,
    ) -> Result<Shading, ScreenError> {
        let bytes = bytes + values.len() * size_of::<f32>();
        Ok(Shading { image: screen.image(values)?, stages: self.done, bytes })
    }
}

/// Error of a screen or of a method's setting.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScreenError {
    /// The camera is degenerate.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The image with its guard band is too large.
    #[error("with its guard band: {0}")]
    Size(#[from] SizeError),
    /// The guard band is too wide.
    #[error("a guard band of {guard} pixels: choose at most {}", Screen::MAX_GUARD)]
    Guard {
        /// Requested pixels on each side.
        guard: u32,
    },
    /// A buffer does not fill the image with its guard band.
    #[error("a screen of {size} pixels, guard band included, needs {} {what}, not {found}", size.pixels())]
    Count {
        /// Name of the buffer.
        what: &'static str,
        /// Size with guard band.
        size: Size,
        /// Number of given values.
        found: usize,
    },
    /// A tangent of the half angles of view is not above 0 and finite.
    #[error("tangents of view of {0} by {1}: both must be above 0 and finite", tangents[0], tangents[1])]
    Tangents {
        /// The given tangents, across and down.
        tangents: [f32; 2],
    },
    /// A depth is not a positive distance into the view. Convert reversed and normalised depths to linear ones first.
    #[error(
        "pixel ({x}, {y}) of the guarded screen has depth {depth}; depths are metres above 0, infinite for sky"
    )]
    Depth {
        /// Column, including the guard band.
        x: u32,
        /// Row, including the guard band.
        y: u32,
        /// The value.
        depth: f32,
    },
    /// A normal is not of unit length.
    #[error("pixel ({x}, {y}) of the guarded screen has a normal of length {length}; normals have length 1")]
    Normal {
        /// Column, including the guard band.
        x: u32,
        /// Row, including the guard band.
        y: u32,
        /// Its length.
        length: f32,
    },
    /// The radius is out of its range.
    #[error("an AO radius of {radius} m: choose {} to {}", MIN_RADIUS, MAX_RADIUS)]
    Radius {
        /// The given value.
        radius: f32,
    },
    /// A setting of a method is out of its range.
    #[error("{method}: {setting} is {value}; choose {least} to {most}")]
    Setting {
        /// The method's name.
        method: &'static str,
        /// The setting's name.
        setting: &'static str,
        /// The given value.
        value: f32,
        /// Smallest possible value.
        least: f32,
        /// Largest possible value.
        most: f32,
    },
    /// A parameter of a falloff is out of its range.
    #[error(
        "{what} of the falloff is {value}; samples are 2 to {} in [0, 1], a decay is above 0 and at most {}",
        Falloff::MAX_SAMPLES,
        Falloff::MAX_DECAY
    )]
    Falloff {
        /// Name of the parameter.
        what: &'static str,
        /// The given value.
        value: f32,
    },
    /// A falloff rises with distance.
    #[error("sample {sample} of the falloff is {value}, above the {before} before it; a falloff never rises")]
    NotMonotone {
        /// Number of the sample, from 0.
        sample: usize,
        /// The sample before.
        before: f32,
        /// Its value.
        value: f32,
    },
    /// A method computed a value out of range. That is a fault of the method.
    #[error("a screen-space method computed a value out of range: {0}")]
    Values(#[from] AoImageError),
}

/// Smallest AO radius in metres, as for the ray tracer.
pub const MIN_RADIUS: f32 = 1e-6;
/// Largest AO radius in metres, as for the ray tracer.
pub const MAX_RADIUS: f32 = 1e6;

/// Refuses a radius that is 0, negative, NaN, or too large for its square in f32.
///
/// # Errors
///
/// [`ScreenError::Radius`].
pub fn check_radius(radius: f32) -> Result<(), ScreenError> {
    if (MIN_RADIUS..=MAX_RADIUS).contains(&radius) { Ok(()) } else { Err(ScreenError::Radius { radius }) }
}

/// Refuses a setting that is not in `least..=most`, including NaN.
pub(crate) fn check_setting(
    method: &'static str,
    setting: &'static str,
    value: f32,
    least: f32,
    most: f32,
) -> Result<(), ScreenError> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(ScreenError::Setting { method, setting, value, least, most })
    }
}
