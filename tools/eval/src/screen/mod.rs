//! Ambient occlusion from what is on the screen alone: the methods that point-based ambient occlusion is compared
//! with, each from its own paper, all over one input ([`Screen`]) and with one set of falloffs ([`Falloff`]).
//!
//! What none of them can know is what the screen does not show; the geometric reference, which knows all, is
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

/// A way to shade a screen.
pub trait ScreenMethod: Sync {
    /// Short name, as on a command line: letters, digits and dashes.
    fn name(&self) -> &'static str;

    /// The settings in words, for plots and tables.
    fn label(&self) -> String;

    /// What it reads for a pixel, where that is a fixed number of samples of depth.
    fn sampling(&self) -> Option<Sampling> {
        None
    }

    /// Accessibility of the inner pixels of `screen`; sky is 1. The same on any number of threads.
    ///
    /// `clock` is read for the times of the stages only.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] when a setting is out of its range.
    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError>;
}

/// Samples of depth that a method reads for a pixel, those beyond its radius included.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Sampling {
    /// Directions D; `None` of a method that has none.
    pub directions: Option<u32>,
    /// Samples a direction S, of all levels together; `None` without directions.
    pub along: Option<u32>,
    /// Levels of depth L above the buffer itself.
    pub levels: u32,
    /// Samples in all.
    pub per_pixel: u32,
}

impl Sampling {
    /// Of `directions` with `along` samples each.
    pub(crate) fn directed(directions: u32, along: u32, levels: u32) -> Self {
        Self { directions: Some(directions), along: Some(along), levels, per_pixel: directions * along }
    }
}

/// What a method made of a screen.
#[derive(Clone, Debug, PartialEq)]
pub struct Shading {
    /// Accessibility in `[0, 1]` of the inner pixels.
    pub image: AoImage,
    /// Time of each stage in microseconds, in the order they ran.
    pub stages: Vec<(&'static str, u64)>,
    /// Working memory in bytes at its largest: buffers beside the screen itself, the image included.
    pub bytes: usize,
}

impl Shading {
    /// Time of all stages in microseconds.
    pub fn micros(&self) -> u64 {
        self.stages.iter().map(|(_, micros)| micros).sum()
    }
}

/// Reads the clock between the stages of a method.
pub(crate) struct StageTimer<'a> {
    clock: &'a dyn Clock,
    since: u64,
    done: Vec<(&'static str, u64)>,
}

impl<'a> StageTimer<'a> {
    pub(crate) fn new(clock: &'a dyn Clock) -> Self {
        Self { clock, since: clock.micros(), done: Vec::new() }
    }

    /// What ran since the last call, or since the beginning, is `stage`.
    pub(crate) fn end(&mut self, stage: &'static str) {
        let now = self.clock.micros();
        self.done.push((stage, now.saturating_sub(self.since)));
        self.since = now;
    }

    /// The result: accessibilities of the inner pixels, and the bytes that were needed beside them.
    pub(crate) fn shaded(
        self,
        screen: &Screen,
        values: Vec<f32>,
        bytes: usize,
    ) -> Result<Shading, ScreenError> {
        let bytes = bytes + values.len() * size_of::<f32>();
        Ok(Shading { image: screen.image(values)?, stages: self.done, bytes })
    }
}

/// A screen that cannot be made, or a setting of a method that is out of its range.
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
        /// Pixels asked for on each side.
        guard: u32,
    },
    /// A buffer does not fill the image with its guard band.
    #[error("a screen of {size} pixels, guard band included, needs {} {what}, not {found}", size.pixels())]
    Count {
        /// Name of the buffer.
        what: &'static str,
        /// Size with guard band.
        size: Size,
        /// Values given.
        found: usize,
    },
    /// Tangents of the half angles of view are not above 0 and finite.
    #[error("tangents of view of {0} by {1}: both must be above 0 and finite", tangents[0], tangents[1])]
    Tangents {
        /// As given, across and down.
        tangents: [f32; 2],
    },
    /// A depth is not a positive distance into the view. Reversed and normalised depths must be made linear first.
    #[error(
        "pixel ({x}, {y}) of the guarded screen has depth {depth}; depths are metres above 0, infinite for sky"
    )]
    Depth {
        /// Column, guard band included.
        x: u32,
        /// Row, guard band included.
        y: u32,
        /// The value.
        depth: f32,
    },
    /// A normal is not of unit length.
    #[error("pixel ({x}, {y}) of the guarded screen has a normal of length {length}; normals have length 1")]
    Normal {
        /// Column, guard band included.
        x: u32,
        /// Row, guard band included.
        y: u32,
        /// Its length.
        length: f32,
    },
    /// The radius is not a length.
    #[error("an AO radius of {radius} m: choose {} to {}", MIN_RADIUS, MAX_RADIUS)]
    Radius {
        /// As given.
        radius: f32,
    },
    /// A setting of a method is out of its range.
    #[error("{method}: {setting} is {value}; choose {least} to {most}")]
    Setting {
        /// The method's name.
        method: &'static str,
        /// The setting's name.
        setting: &'static str,
        /// As given.
        value: f32,
        /// The least it may be.
        least: f32,
        /// The most it may be.
        most: f32,
    },
    /// A parameter of a falloff is out of its range.
    #[error(
        "{what} of the falloff is {value}; samples are 2 to {} in [0, 1], a decay is above 0 and at most {}",
        Falloff::MAX_SAMPLES,
        Falloff::MAX_DECAY
    )]
    Falloff {
        /// Which parameter.
        what: &'static str,
        /// As given.
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
    /// A method made a value that is none: an error of the method.
    #[error("a screen-space method made a value out of range: {0}")]
    Values(#[from] AoImageError),
}

/// The least AO radius in metres, as that of the ray tracer.
pub const MIN_RADIUS: f32 = 1e-6;
/// The largest AO radius in metres, as that of the ray tracer.
pub const MAX_RADIUS: f32 = 1e6;

/// Refuses a radius that is not a length: 0, negative, NaN, or beyond what squares of f32 hold.
///
/// # Errors
///
/// [`ScreenError::Radius`].
pub fn check_radius(radius: f32) -> Result<(), ScreenError> {
    if (MIN_RADIUS..=MAX_RADIUS).contains(&radius) { Ok(()) } else { Err(ScreenError::Radius { radius }) }
}

/// Refuses a setting that is not in `least..=most`, NaN included.
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
