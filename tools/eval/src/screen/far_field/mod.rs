//! Far-field obscurance from a depth field (Timonen, *Screen-Space Far-Field Ambient Obscurance*, 2013).
//!
//! A scan of the depth field along parallel lines in every direction keeps the highest point of each interval of a line
//! ([`scan`]). Intervals pair up into longer ones, and prefix sums across the lines average them over a sector. Each
//! pixel then gathers some eight virtual points a direction, near to far, whatever the radius. It adds up the parts of
//! its hemisphere that they hide ([`slice`], [`table`]). Point samples find occluders nearer than the first interval.
//!
//! Comments at the code explain the differences from the paper. The table L has two dimensions instead of four. One
//! scan serves two opposite directions. Sectors end at fractions of a line, and each segment has its own slice. Sky and
//! places off the screen count as open, and the search ends at the radius.

pub(super) mod field;
mod lines;
mod scan;
mod segments;
mod separate;
mod settings;
pub(super) mod slice;
pub(super) mod table;
#[cfg(test)]
mod tests;

use glam::Vec2;
use psao_server::clock::Clock;
use rayon::prelude::*;

pub use self::settings::{FarFieldSettings, NearField, Separation};

use self::field::{DepthField, SquarePixels};
use self::lines::ScanLines;
use self::scan::Scan;
use self::segments::{Gather, Segments};
use self::separate::PixelAverage;
use self::slice::{Estimator, Receiver};
use self::table::ObscuranceTable;
use super::{Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_setting};

const NAME: &str = "far-field";

/// Distance of the near field's first sample in square pixels, for a continuous field and for one snapped to pixels.
///
/// A continuous field is bent between pixels. Samples a pixel apart miss its tops, which makes near occluders too
/// bright. In a snapped field, samples between pixels would put a pixel nearer than it is.
const NEAR_STEP: f32 = 0.5;
const SNAPPED_NEAR_STEP: f32 = 1.0;

/// Largest ratio of a pixel's sides, because lines are spaced by square pixels.
const MAX_STRETCH: f32 = 256.0;

/// Far-field obscurance: its settings, and its table L, which is made once.
///
/// Stages: `scan`, `prefix sum`, `near field`, `box average`, `obscurance`, `gather` and `blur`. The settings decide
/// which of them run.
///
/// ```
/// use glam::Vec3;
/// use psao_reconstruct::Size;
/// use psao_eval::screen::{FarField, FarFieldSettings, Screen, ScreenMethod};
/// use psao_server::clock::NoClock;
///
/// // The bottom of a shaft: a wall 2 m away with a hole in the middle, through which a wall 4 m away shows.
/// let depth = (0..64 * 36).map(|at| if (28..36).contains(&(at % 64)) { 4.0 } else { 2.0 }).collect();
/// let screen = Screen::from_parts(Size::new(64, 36)?, 0, [1.0, 0.5625], depth, vec![Vec3::NEG_Z; 64 * 36])?;
/// let method = FarField::new(FarFieldSettings { radius: 4.0, ..FarFieldSettings::default() })?;
/// let shaded = method.shade(&screen, &NoClock)?;
/// assert!(shaded.image.values()[18 * 64 + 32] < 0.6 && shaded.image.values()[18 * 64 + 5] > 0.99);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FarField {
    settings: FarFieldSettings,
    table: ObscuranceTable,
}

impl FarField {
    /// Checks the settings and makes the table.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] when a setting is out of its range.
    pub fn new(settings: FarFieldSettings) -> Result<Self, ScreenError> {
        settings.validate()?;
        let table = ObscuranceTable::new(settings.radius, &settings.falloff);
        Ok(Self { settings, table })
    }

    /// Returns the settings.
    pub fn settings(&self) -> &FarFieldSettings {
        &self.settings
    }

    /// Returns the distances of the near field's samples in square pixels, up to the end of the near field.
    fn near_distances(&self) -> Vec<f32> {
        let Some(NearField { growth }) = self.settings.near else { return Vec::new() };
        // The length of all intervals before the first, over the smallest cosine of a segment's angle, which K = 4 has.
        let end =
            (self.settings.density + 1) as f32 * self.settings.interval as f32 * std::f32::consts::SQRT_2;
        let first = if self.settings.thickness.is_some() { SNAPPED_NEAR_STEP } else { NEAR_STEP };
        let (mut distance, mut step) = (0.0, first);
        let mut distances = Vec::new();
        while distance < end {
            distance += step;
            distances.push(distance);
            step *= growth;
        }
        distances
    }
}

/// Buffers over the inner pixels.
struct Buffers<'a> {
    screen: &'a Screen,
    averaged: Option<Vec<Option<PixelAverage>>>,
    /// Sums of Eq. 2 of all sectors so far.
    near: Vec<f32>,
    far: Vec<f32>,
    /// Horizons after the near field in the segments of two opposite sectors.
    horizons: Vec<Vec2>,
}

impl Buffers<'_> {
    fn heap_bytes(&self) -> usize {
        let averaged = self.averaged.as_deref().map_or(0, size_of_val);
        averaged
            + size_of_val(self.near.as_slice())
            + size_of_val(self.far.as_slice())
            + size_of_val(self.horizons.as_slice())
    }

    /// Computes the near field of all pixels: their obscurance, and their horizons for the far field.
    fn near_field(&mut self, gather: &Gather<'_>, segments: &Segments, each: usize, distances: &[f32]) {
        let screen = self.screen;
        let width = screen.inner().width() as usize;
        let rows = self.near.par_chunks_mut(width).zip(self.horizons.par_chunks_mut(width * each));
        rows.enumerate().for_each(|(y, (values, horizons))| {
            for (x, (value, horizons)) in values.iter_mut().zip(horizons.chunks_mut(each)).enumerate() {
                let Some((receiver, at)) = receiver(screen, gather.field.pixels(), x, y) else { continue };
                for (segment, horizon) in segments.of(y * width + x).iter().zip(horizons) {
                    let slice = segment.slice(&receiver);
                    *horizon = slice.open();
                    let hidden = gather.near(&receiver, &slice, segment, at, distances, horizon);
                    *value += slice.weight() * hidden;
                }
            }
        });
    }

    /// Computes the far field of the pixels that evaluate `pair`, the number of two opposite sectors.
    fn far_field(&mut self, gather: &Gather<'_>, segments: &Segments, each: usize, pair: usize) {
        let screen = self.screen;
        let width = screen.inner().width() as usize;
        let (horizons, averaged) = (&self.horizons, &self.averaged);
        self.far.par_chunks_mut(width).enumerate().for_each(|(y, values)| {
            for (x, value) in values.iter_mut().enumerate() {
                let pixel = y * width + x;
                let found = match averaged {
                    None => receiver(screen, gather.field.pixels(), x, y),
                    Some(_) if separate::part(x, y) != pair % FarFieldSettings::GROUP as usize => None,
                    Some(averaged) => averaged[pixel].map(|averaged| {
                        let receiver = averaged.receiver;
                        (receiver, gather.field.pixels().of_grid(screen.project(receiver.position)))
                    }),
                };
                let Some((receiver, at)) = found else { continue };
                for (number, segment) in segments.of(pixel).iter().enumerate() {
                    let slice = segment.slice(&receiver);
                    let mut horizon = horizons.get(pixel * each + number).copied().unwrap_or(slice.open());
                    *value += slice.weight() * gather.far(&receiver, &slice, segment, at, &mut horizon);
                }
            }
        });
    }

    /// Joins near and far field, and returns accessibility.
    fn finish(&mut self, settings: &FarFieldSettings, width: f32, stages: &mut StageTimer<'_>) -> Vec<f32> {
        let size = self.screen.inner();
        let averaged = self.averaged.take();
        let mut hidden = std::mem::take(&mut self.near);
        let far = std::mem::take(&mut self.far);
        match &averaged {
            Some(averaged) => separate::gather(size, averaged, &far, &mut hidden),
            None => hidden.iter_mut().zip(&far).for_each(|(hidden, far)| *hidden += far),
        }
        stages.end("gather");
        let mut values: Vec<f32> = hidden.iter().map(|hidden| 1.0 - width * hidden).collect();
        if let (Some(averaged), Some(Separation { blur: true })) = (&averaged, settings.separate) {
            values = separate::blur(size, averaged, &values);
            stages.end("blur");
        }
        values
    }
}

/// Returns the surface of an inner pixel and its place in square pixels.
fn receiver(screen: &Screen, pixels: &SquarePixels, x: usize, y: usize) -> Option<(Receiver, Vec2)> {
    let [x, y] = [x, y].map(|at| at as i32 + screen.guard() as i32);
    Some((Receiver::new(screen.position(x, y)?, screen.normal(x, y)), pixels.place(x, y)))
}

impl ScreenMethod for FarField {
    fn name(&self) -> &'static str {
        NAME
    }

    fn label(&self) -> String {
        self.settings.label()
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        let settings = &self.settings;
        let &FarFieldSettings { midway, density, .. } = settings;
        let count = screen.inner().pixels();
        let each = 2 * settings.segments as usize;
        let distances = self.near_distances();
        let horizons = if settings.near.is_some() { count * each } else { 0 };
        let mut buffers = Buffers {
            screen,
            averaged: None,
            near: vec![0.0; count],
            far: vec![0.0; count],
            horizons: vec![Vec2::ZERO; horizons],
        };
        let mut stages = StageTimer::new(clock);
        let field = DepthField::new(screen, settings.thickness);
        stages.end("scan");
        check_setting(NAME, "the stretch of pixels", field.pixels().stretch(), 1.0, MAX_STRETCH)?;
        if settings.separate.is_some() {
            buffers.averaged = Some(separate::box_average(screen));
            stages.end("box average");
        }
        let estimator = Estimator { table: &self.table, thickness: settings.thickness };
        let mut scan_bytes = 0;
        for pair in 0..settings.sectors / 2 {
            let turn = f64::from(pair) / f64::from(settings.sectors) * std::f64::consts::TAU;
            let along = Vec2::new(libm::cos(turn) as f32, libm::sin(turn) as f32);
            let mut scan = Scan::new(&field, ScanLines::new(field.pixels(), along, settings.interval));
            stages.end("scan");
            if settings.thickness.is_none() {
                scan.sum();
                stages.end("prefix sum");
            }
            scan_bytes = scan_bytes.max(scan.heap_bytes());
            let segments = Segments::new(settings, along);
            let gather = Gather { field: &field, scan: &scan, estimator, midway, density: density as f32 };
            if settings.near.is_some() {
                buffers.near_field(&gather, &segments, each, &distances);
                stages.end("near field");
            }
            buffers.far_field(&gather, &segments, each, pair as usize);
            stages.end("obscurance");
        }
        let bytes = buffers.heap_bytes() + scan_bytes + field.heap_bytes() + self.table.heap_bytes();
        // The remaining factor of Eq. 2 is the width of a segment on the screen, the same for all segments.
        let width = std::f32::consts::TAU / (settings.sectors * settings.segments) as f32;
        let values = buffers.finish(settings, width, &mut stages);
        stages.finish(screen, values, bytes)
    }
}
