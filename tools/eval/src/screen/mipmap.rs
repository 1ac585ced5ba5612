//! Mipmapped depth with the far-field estimator: the reference method of Timonen's far-field obscurance (section 5).

use glam::Vec2;
use psao_server::clock::Clock;
use rayon::prelude::*;

use super::depth::Pixel;
use super::far_field::field::SquarePixels;
use super::far_field::slice::{Estimator, Receiver, SlabPlacement, Slice};
use super::far_field::table::ObscuranceTable;
use super::{Falloff, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius, check_setting};

const NAME: &str = "mipmap";

/// Settings of [`Mipmap`].
#[derive(Clone, Debug, PartialEq)]
pub struct MipmapSettings {
    /// Distance in metres at which the falloff ends.
    pub radius: f32,
    /// Weight of an occluder by its distance.
    pub falloff: Falloff,
    /// K: directions of every pixel, 4 to 256; the paper takes 16.
    pub sectors: u32,
    /// Factor by which each step is longer than the one before, 1.01 to 4; the paper takes 1.5.
    pub growth: f32,
    /// Distance in pixels from which samples count, 0 to 4096; 15 is the far field of intervals of 10 pixels (section
    /// 8).
    pub start: f32,
    /// Thickness of the depth field in metres (section 11). Levels then hold the nearest depth and are not
    /// interpolated. `None` is a continuous field, whose levels are means.
    pub thickness: Option<f32>,
}

impl Default for MipmapSettings {
    /// Returns K = 16 and steps 1.5 times as long as the one before, with the ray tracer's 0.6 m and falloff.
    fn default() -> Self {
        Self { radius: 0.6, falloff: Falloff::Linear, sectors: 16, growth: 1.5, start: 0.0, thickness: None }
    }
}

/// Point samples along K directions of each pixel. With distance they are further apart and from coarser levels.
///
/// Stages: `mipmap` and `obscurance`.
#[derive(Clone, Debug, PartialEq)]
pub struct Mipmap {
    settings: MipmapSettings,
    table: ObscuranceTable,
}

impl Mipmap {
    /// Checks the settings and makes the table L.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] when a setting is out of its range.
    pub fn new(settings: MipmapSettings) -> Result<Self, ScreenError> {
        check_radius(settings.radius)?;
        settings.falloff.validate()?;
        check_setting(NAME, "the number of sectors", settings.sectors as f32, 4.0, 256.0)?;
        check_setting(NAME, "the growth of steps", settings.growth, 1.01, 4.0)?;
        check_setting(NAME, "the start", settings.start, 0.0, 4_096.0)?;
        check_setting(NAME, "the thickness", settings.thickness.unwrap_or(1.0), 1e-6, 1e6)?;
        let table = ObscuranceTable::new(settings.radius, &settings.falloff);
        Ok(Self { settings, table })
    }

    /// Returns the settings.
    pub fn settings(&self) -> &MipmapSettings {
        &self.settings
    }

    /// Returns the distances of the samples in square pixels, up to `end`.
    fn distances(&self, end: f32) -> Vec<f32> {
        let (mut distance, mut step) = (1.0, 1.0);
        let mut distances = Vec::new();
        while distance < end {
            if distance >= self.settings.start {
                distances.push(distance);
            }
            step *= self.settings.growth;
            distance += step;
        }
        distances
    }

    /// Returns the level whose pixels are as wide as a sector at a distance.
    fn level(&self, distance: f32) -> f32 {
        let half = libm::tanf(std::f32::consts::PI / self.settings.sectors as f32);
        libm::log2f((2.0 * distance * half).max(1.0))
    }
}

impl ScreenMethod for Mipmap {
    fn name(&self) -> &'static str {
        NAME
    }

    fn label(&self) -> String {
        let MipmapSettings { radius, falloff, sectors, growth, start, thickness } = &self.settings;
        let mut label =
            format!("mipmapped depth, K = {sectors}, steps x {growth}, R = {radius} m, {}", falloff.label());
        if *start > 0.0 {
            label += &format!(", from {start} pixels");
        }
        if let Some(thickness) = thickness {
            label += &format!(", {thickness} m thick");
        }
        label
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        let mut stages = StageTimer::new(clock);
        let levels = MipLevels::new(screen, self.settings.thickness.is_some());
        stages.end("mipmap");
        let pixels = SquarePixels::new(screen);
        let samples: Vec<(f32, f32)> = self
            .distances(2.0 * pixels.half().length())
            .into_iter()
            .map(|distance| (distance, self.level(distance)))
            .collect();
        let turns: Vec<Vec2> = (0..self.settings.sectors)
            .map(|k| std::f64::consts::TAU * f64::from(k) / f64::from(self.settings.sectors))
            .map(|turn| Vec2::new(libm::cos(turn) as f32, libm::sin(turn) as f32))
            .collect();
        let width = std::f32::consts::TAU / self.settings.sectors as f32;
        let estimator = Estimator { table: &self.table, thickness: self.settings.thickness };
        let values = screen.each_inner(|pixel| {
            let gather = Gather {
                method: self,
                levels: &levels,
                pixels: &pixels,
                estimator: &estimator,
                samples: &samples,
            };
            1.0 - width * turns.iter().map(|along| gather.slice(&pixel, *along)).sum::<f32>()
        });
        stages.end("obscurance");
        stages.finish(screen, values, levels.heap_bytes() + self.table.heap_bytes())
    }
}

/// Inputs that all pixels share.
struct Gather<'a> {
    method: &'a Mipmap,
    levels: &'a MipLevels,
    pixels: &'a SquarePixels,
    estimator: &'a Estimator<'a>,
    /// Distances and levels.
    samples: &'a [(f32, f32)],
}

impl Gather<'_> {
    /// Returns the obscurance of one slice over the width of its sector.
    fn slice(&self, pixel: &Pixel, along: Vec2) -> f32 {
        let receiver = Receiver::new(pixel.position, pixel.normal);
        let slice = Slice::new(&receiver, along);
        let at = self.pixels.place(pixel.x, pixel.y);
        let slope = self.pixels.slope();
        let edge = to_edge(self.pixels.half(), at, along);
        let end = edge.min(slice.reach(self.estimator.table.radius()) / slope);
        let [across, depth] = slice.axes();
        let start = receiver.slope().dot(along);
        let (mut hidden, mut horizon) = (0.0, slice.open());
        let mut sample = |distance: f32, level: f32| {
            let inverse = self.levels.inverse(self.pixels.on_grid(at + along * distance), level);
            if inverse > 0.0 {
                let sight = across * (start + distance * slope) + depth;
                hidden += self.estimator.add(&slice, &mut horizon, sight / inverse, SlabPlacement::Top, 1.0);
            }
        };
        for &(distance, level) in self.samples.iter().take_while(|(distance, _)| *distance < end) {
            sample(distance, level);
        }
        // One more sample at the very edge of the depth field.
        if end == edge && edge >= self.method.settings.start.max(1.0) {
            sample(edge, self.method.level(edge));
        }
        slice.weight() * hidden
    }
}

/// Returns the distance to the last place within `half` of the middle, half a pixel inside.
fn to_edge(half: Vec2, at: Vec2, along: Vec2) -> f32 {
    let side = (half - 0.5).max(Vec2::ZERO) - at * along.signum();
    let distance = side / along.abs().max(Vec2::splat(f32::MIN_POSITIVE));
    distance.min_element().max(0.0)
}

/// Levels of inverse depth, each half the size of the one before; sky is 0. Means of inverse depths preserve planes,
/// and can represent sky.
#[derive(Debug)]
struct MipLevels {
    levels: Vec<MipLevel>,
    /// Whether values are not interpolated.
    snapped: bool,
}

#[derive(Debug)]
struct MipLevel {
    width: usize,
    height: usize,
    inverse: Vec<f32>,
}

impl MipLevels {
    /// Makes levels down to a single pixel: of means, or of the nearest depths if `snapped`.
    fn new(screen: &Screen, snapped: bool) -> Self {
        let (width, height) = (screen.size().width() as usize, screen.size().height() as usize);
        let inverse = screen.depths().iter().map(|depth| depth.recip()).collect();
        let mut levels = vec![MipLevel { width, height, inverse }];
        while let Some(level) = levels.last().filter(|level| level.width > 1 || level.height > 1) {
            let half = level.half(snapped);
            levels.push(half);
        }
        Self { levels, snapped }
    }

    fn heap_bytes(&self) -> usize {
        self.levels.iter().map(|level| size_of_val(level.inverse.as_slice())).sum()
    }

    /// Returns the inverse depth at a place on the grid in pixels, interpolated in and between two levels; 0 is sky.
    fn inverse(&self, at: Vec2, level: f32) -> f32 {
        let level = level.clamp(0.0, (self.levels.len() - 1) as f32);
        let lower = level as usize;
        let scale = 1.0 / (1_u32 << lower) as f32;
        if self.snapped {
            return self.levels[lower].at(at.x * scale, at.y * scale);
        }
        let part = level - lower as f32;
        let near = self.levels[lower].between(at * scale);
        if part == 0.0 {
            return near;
        }
        near + (self.levels[lower + 1].between(at * (0.5 * scale)) - near) * part
    }
}

impl MipLevel {
    /// Returns the next level. Each of its pixels covers up to two by two pixels of this level.
    fn half(&self, nearest: bool) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut inverse = vec![0.0; width * height];
        inverse.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                let [x, y] = [2 * x, 2 * y].map(|at| at as f32);
                let [a, b, c, d] =
                    [[x, y], [x + 1.0, y], [x, y + 1.0], [x + 1.0, y + 1.0]].map(|[x, y]| self.at(x, y));
                *value = if nearest { a.max(b).max(c.max(d)) } else { 0.25 * (a + b + c + d) };
            }
        });
        Self { width, height, inverse }
    }

    /// Returns the pixel at a place, or the last pixel on that side.
    #[inline]
    fn at(&self, x: f32, y: f32) -> f32 {
        let (x, y) = ((x.max(0.0) as usize).min(self.width - 1), (y.max(0.0) as usize).min(self.height - 1));
        self.inverse[y * self.width + x]
    }

    /// Interpolates between the four pixels around a place.
    #[inline]
    fn between(&self, at: Vec2) -> f32 {
        let corner = (at - 0.5).floor();
        let part = at - 0.5 - corner;
        let [a, b] = [0.0, 1.0].map(|x| self.at(corner.x + x, corner.y));
        let [c, d] = [0.0, 1.0].map(|x| self.at(corner.x + x, corner.y + 1.0));
        let (above, below) = (a + (b - a) * part.x, c + (d - c) * part.x);
        above + (below - above) * part.y
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use psao_reconstruct::{AoImage, Size};
    use psao_server::clock::NoClock;

    use super::*;

    fn shade(settings: MipmapSettings, screen: &Screen) -> AoImage {
        Mipmap::new(settings).unwrap().shade(screen, &NoClock).unwrap().image
    }

    fn screen(width: u32, height: u32, guard: u32, depth: impl Fn(u32, u32) -> f32) -> Screen {
        let (across, down) = (width + 2 * guard, height + 2 * guard);
        let depths: Vec<f32> = (0..across * down).map(|at| depth(at % across, at / across)).collect();
        let tangents = [1.0, height as f32 / width as f32];
        let normals = vec![Vec3::NEG_Z; depths.len()];
        Screen::from_parts(Size::new(width, height).unwrap(), guard, tangents, depths, normals).unwrap()
    }

    #[test]
    fn levels_are_means_or_the_nearest() {
        let screen = screen(4, 3, 0, |x, y| [1.0, 2.0, 4.0, f32::INFINITY][x as usize] * (1 << y) as f32);
        let means = MipLevels::new(&screen, false);
        let sizes: Vec<_> = means.levels.iter().map(|level| (level.width, level.height)).collect();
        assert_eq!(sizes, [(4, 3), (2, 2), (1, 1)]);
        assert_eq!(means.levels[1].inverse, [0.5625, 0.09375, 0.1875, 0.03125]);
        let near = MipLevels::new(&screen, true);
        assert_eq!(near.levels[1].inverse, [1.0, 0.25, 0.25, 0.0625]);
        assert_eq!(near.levels[2].inverse, [1.0]);
        assert_eq!(near.inverse(Vec2::new(3.9, 0.1), 1.7), 0.25, "the pixel itself, of the level itself");
        assert_eq!(means.heap_bytes(), (12 + 4 + 1) * 4);
        // Halfway between two pixels, halfway between two levels.
        assert_eq!(means.inverse(Vec2::new(1.0, 0.5), 0.0), 0.75);
        let between = 0.5
            * (means.levels[0].between(Vec2::new(2.0, 1.0)) + means.levels[1].between(Vec2::new(1.0, 0.5)));
        assert_eq!(means.inverse(Vec2::new(2.0, 1.0), 0.5), between);
    }

    #[test]
    fn samples_go_out_as_the_paper_says_and_end_at_the_edge() {
        let method = Mipmap::new(MipmapSettings::default()).unwrap();
        assert_eq!(method.distances(9.0), [1.0, 2.5, 4.75, 8.125]);
        assert_eq!(method.level(1.0), 0.0);
        assert!((method.level(100.0) - 5.314).abs() < 1e-3, "a sixteenth of a turn is 39.8 pixels wide");
        let half = Vec2::new(20.0, 10.0);
        assert_eq!(to_edge(half, Vec2::new(5.0, 0.0), Vec2::X), 14.5);
        assert_eq!(to_edge(half, Vec2::new(5.0, 0.0), Vec2::NEG_X), 24.5);
        assert_eq!(to_edge(half, Vec2::new(0.0, -9.5), Vec2::NEG_Y), 0.0);
    }

    #[test]
    fn a_wall_is_open_a_pit_is_not() {
        let base = MipmapSettings { radius: 4.0, ..MipmapSettings::default() };
        for thickness in [None, Some(5.0)] {
            for (width, height, guard) in [(1, 1, 0), (1, 1, 20), (40, 20, 4), (3, 50, 0)] {
                let wall = shade(
                    MipmapSettings { thickness, ..base.clone() },
                    &screen(width, height, guard, |_, _| 3.0),
                );
                assert!(wall.values().iter().all(|v| *v > 0.999), "{width} x {height}");
            }
            let pit =
                screen(41, 41, 0, |x, y| if x.abs_diff(20).max(y.abs_diff(20)) < 6 { 4.0 } else { 2.0 });
            let found = shade(MipmapSettings { thickness, ..base.clone() }, &pit);
            assert!(found.values()[20 * 41 + 20] < 0.6 && found.values()[0] > 0.999);
            let far = shade(MipmapSettings { thickness, start: 15.0, ..base.clone() }, &pit);
            assert!(far.values()[20 * 41 + 20] > found.values()[20 * 41 + 20], "the rim is nearer than that");
        }
        let sky = shade(base.clone(), &screen(9, 9, 1, |_, _| f32::INFINITY));
        assert!(sky.values().iter().all(|v| *v == 1.0));
    }

    #[test]
    fn on_any_number_of_threads_it_is_the_same() {
        let screen = screen(50, 30, 3, |x, y| 1.0 + (x * 7 + y * 13) as f32 % 5.0);
        let [one, four] = [1, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| shade(MipmapSettings::default(), &screen))
        });
        assert_eq!(one, four);
    }

    #[test]
    fn what_is_out_of_range_is_refused() {
        let base = MipmapSettings::default;
        for radius in [0.0, f32::NAN] {
            let found = Mipmap::new(MipmapSettings { radius, ..base() });
            assert!(matches!(found, Err(ScreenError::Radius { .. })), "{found:?}");
        }
        for settings in [
            MipmapSettings { sectors: 3, ..base() },
            MipmapSettings { growth: 1.0, ..base() },
            MipmapSettings { start: f32::NAN, ..base() },
            MipmapSettings { thickness: Some(0.0), ..base() },
        ] {
            let found = Mipmap::new(settings.clone());
            assert!(matches!(found, Err(ScreenError::Setting { method: "mipmap", .. })), "{settings:?}");
        }
    }
}
