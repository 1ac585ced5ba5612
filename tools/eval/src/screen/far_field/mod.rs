//! Far-field obscurance from a depth field (Timonen, *Screen-Space Far-Field Ambient Obscurance*, 2013).
//!
//! The depth field is scanned along parallel lines in every direction, and what is highest in each interval of a line is
//! kept ([`scan`]). Intervals pair up into longer ones, and prefix sums across the lines average them over a sector.
//! Each pixel then meets some eight virtual points a direction, near to far, whatever the radius, and adds up what
//! each hides of its hemisphere ([`slice`], [`table`]). What is nearer than the first interval is found by point
//! samples.
//!
//! Where this differs from the paper, and why, stands at the code: two dimensions of the table L instead of four, one
//! scan for two opposite directions, sectors cut at fractions of a line, segments in slices of their own, sky and
//! what is off the screen counted as open, and no further search where the radius has ended.

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
use super::{Screen, ScreenError, ScreenMethod, Shading, check_setting};

const NAME: &str = "far-field";

/// Square pixels to the first sample of the near field. Between pixels a continuous field is bent: samples a pixel apart
/// pass by its tops, which makes what is near too bright. Where it is snapped to pixels, those in between would put a
/// pixel nearer than it is.
const NEAR_STEP: f32 = 0.5;
const SNAPPED_NEAR_STEP: f32 = 1.0;

/// Most that pixels may be longer one way than the other: lines are spaced by square pixels.
const MAX_STRETCH: f32 = 256.0;

/// Far-field obscurance with its settings and its table L, which is made once.
///
/// Stages: `scan`, `prefix sum`, `near field`, `box average`, `obscurance`, `gather` and `blur`, those of them that the
/// settings ask for.
///
/// ```
/// use glam::Vec3;
/// use psao_reconstruct::Size;
/// use psao_eval::screen::{FarField, FarFieldSettings, Screen, ScreenMethod};
/// use psao_server::clock::NoClock;
///
/// // The bottom of a shaft: a wall 2 m in front of one that is 4 m away, but for a hole in the middle.
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

    /// The settings.
    pub fn settings(&self) -> &FarFieldSettings {
        &self.settings
    }

    /// Distances of the samples of the near field, in square pixels, as far as the near field can go.
    fn near_distances(&self) -> Vec<f32> {
        let Some(NearField { growth }) = self.settings.near else { return Vec::new() };
        // All intervals before the first along the line, over the least cosine that a segment of a sector can have, K
        // being 4 at least.
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

/// Buffers over the inner pixels, and the times of the stages.
struct Buffers<'a> {
    screen: &'a Screen,
    clock: &'a dyn Clock,
    stages: Vec<(&'static str, u64)>,
    averaged: Option<Vec<Option<PixelAverage>>>,
    /// Sums of Eq. 2 of all sectors so far.
    near: Vec<f32>,
    far: Vec<f32>,
    /// Horizons that the near field leaves in the segments of two opposite sectors.
    horizons: Vec<Vec2>,
}

impl Buffers<'_> {
    /// Runs a stage and adds its time to what it has taken before.
    fn time<T>(&mut self, stage: &'static str, run: impl FnOnce(&mut Self) -> T) -> T {
        let start = self.clock.micros();
        let made = run(self);
        let micros = self.clock.micros().saturating_sub(start);
        match self.stages.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, sum)) => *sum += micros,
            None => self.stages.push((stage, micros)),
        }
        made
    }

    fn bytes(&self) -> usize {
        let averaged = self.averaged.as_deref().map_or(0, size_of_val);
        averaged
            + size_of_val(self.near.as_slice())
            + size_of_val(self.far.as_slice())
            + size_of_val(self.horizons.as_slice())
    }

    /// The near field of all pixels: their obscurance, and their horizons for the far field.
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

    /// The far field of the pixels whose turn it is, `pair` being the number of the two opposite sectors.
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

    /// Joins near and far field; gives accessibility.
    fn finish(&mut self, settings: &FarFieldSettings, width: f32) -> Vec<f32> {
        let size = self.screen.inner();
        let averaged = self.averaged.take();
        let mut hidden = std::mem::take(&mut self.near);
        let far = std::mem::take(&mut self.far);
        self.time("gather", |_| match &averaged {
            Some(averaged) => separate::gather(size, averaged, &far, &mut hidden),
            None => hidden.iter_mut().zip(&far).for_each(|(hidden, far)| *hidden += far),
        });
        let mut values: Vec<f32> = hidden.iter().map(|hidden| 1.0 - width * hidden).collect();
        if let (Some(averaged), Some(Separation { blur: true })) = (&averaged, settings.separate) {
            values = self.time("blur", |_| separate::blur(size, averaged, &values));
        }
        values
    }
}

/// The surface of an inner pixel, and where it is in square pixels.
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
        let mut work = Buffers {
            screen,
            clock,
            stages: Vec::new(),
            averaged: None,
            near: vec![0.0; count],
            far: vec![0.0; count],
            horizons: vec![Vec2::ZERO; horizons],
        };
        let field = work.time("scan", |_| DepthField::new(screen, settings.thickness));
        check_setting(NAME, "the stretch of pixels", field.pixels().stretch(), 1.0, MAX_STRETCH)?;
        if settings.separate.is_some() {
            work.averaged = work.time("box average", |_| Some(separate::box_average(screen)));
        }
        let estimator = Estimator { table: &self.table, thickness: settings.thickness };
        let mut scan_bytes = 0;
        for pair in 0..settings.sectors / 2 {
            let turn = f64::from(pair) / f64::from(settings.sectors) * std::f64::consts::TAU;
            let along = Vec2::new(libm::cos(turn) as f32, libm::sin(turn) as f32);
            let mut scan = work.time("scan", |_| {
                Scan::new(&field, ScanLines::new(field.pixels(), along, settings.interval))
            });
            if settings.thickness.is_none() {
                work.time("prefix sum", |_| scan.sum());
            }
            scan_bytes = scan_bytes.max(scan.bytes());
            let segments = Segments::new(settings, along);
            let gather = Gather { field: &field, scan: &scan, estimator, midway, density: density as f32 };
            if settings.near.is_some() {
                work.time("near field", |work| work.near_field(&gather, &segments, each, &distances));
            }
            work.time("obscurance", |work| work.far_field(&gather, &segments, each, pair as usize));
        }
        let bytes = work.bytes() + scan_bytes + field.bytes() + self.table.bytes();
        // Of Eq. 2 the width of a segment on the screen is left, the same for all.
        let width = std::f32::consts::TAU / (settings.sectors * settings.segments) as f32;
        let values = work.finish(settings, width);
        Ok(Shading {
            bytes: bytes + size_of_val(values.as_slice()),
            image: screen.image(values)?,
            stages: work.stages,
        })
    }
}
