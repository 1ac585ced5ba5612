//! Scalable Ambient Obscurance: a spiral of taps over a chain of depth levels.

use glam::Vec2;
use psao_server::clock::Clock;

use super::depth::Pixel;
use super::noise::DirectionTable;
use super::pyramid::{DepthPyramid, Reduce};
use super::{
    Blur, EdgeStop, Falloff, Sampling, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius,
    check_setting,
};

/// Scalable Ambient Obscurance (`McGuire`, Mara and Luebke 2012), after Alchemy (`McGuire` et al. 2011).
///
/// Taps lie on a spiral around the pixel; far taps read coarser levels of depth, which stay in cache. Each tap adds
/// `falloff * max(0, (v . n - bias) / (v . v + epsilon))`. Then follow the mean over squares of 2 x 2 pixels without an
/// edge, and a bilateral blur in two passes. Normals are those of the screen and not rebuilt from depth.
///
/// Lengths in the paper are for a radius of 1 m. Here they are shares of the radius, which gives the same picture at
/// any scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Scalable {
    /// Radius r in metres.
    pub radius: f32,
    /// Taps s on the spiral, 1 to 1024.
    pub taps: u32,
    /// Turns of the spiral, 1 to 1024; best coprime to the taps.
    pub turns: u32,
    /// Strength, 0 to 1000: the paper's sigma, which the paper does not fix.
    pub intensity: f32,
    /// Height over the tangent plane below which nothing hides, over the radius, 0 to 1.
    pub bias: f32,
    /// Addend of squared distances, over the squared radius, 0 to 1. It bounds the contribution of near taps.
    pub epsilon: f32,
    /// Levels of depth above the buffer itself, 0 to 16.
    pub levels: u32,
    /// Weight of a tap by its distance over the radius; the paper's is cubic.
    pub falloff: Falloff,
    /// Blur that removes the noise.
    pub blur: Blur,
}

impl Scalable {
    const NAME: &'static str = "scalable";
    /// A tap 2^(this + n) pixels away reads level n (the paper's q').
    const LOG_FIRST_LEVEL: u32 = 3;
    const MAX_LEVELS: u32 = 16;
    /// Difference in depth, over the radius, above which neighbours in a square of 2 x 2 are not averaged.
    const QUAD_EDGE: f32 = 0.02;

    /// Returns usual settings for a radius in metres: 9 taps on 7 turns, five levels, a blur of 4 taps on each side, 2
    /// pixels apart. With the intensity of 0.4, a right-angled corner is as dark as with the ray tracer's obscurance.
    pub fn new(radius: f32) -> Self {
        let edge = EdgeStop::Hat { metres: 0.15 * radius };
        Self {
            radius,
            taps: 9,
            turns: 7,
            intensity: 0.4,
            bias: 0.01,
            epsilon: 0.01,
            levels: 5,
            falloff: Falloff::Cubic,
            blur: Blur { taps: 4, spacing: 2, sigma: 2.0, edge },
        }
    }

    /// Returns the same settings with this many taps and the levels that reach `pixels`. The number of turns is coprime
    /// to the taps and next to their golden section, which spreads any number of taps evenly.
    #[must_use]
    pub fn spread(self, taps: u32, pixels: f32) -> Self {
        let golden = (f64::from(taps) * 0.618_033_988_749_894_8) as u32;
        let turns = (golden.max(1)..=taps).find(|&turns| coprime(turns, taps)).unwrap_or(1);
        Self { taps, turns, levels: level_at(pixels, Self::MAX_LEVELS as usize) as u32, ..self }
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] names the first setting that is not.
    pub fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        check_setting(Self::NAME, "taps", self.taps as f32, 1.0, 1024.0)?;
        check_setting(Self::NAME, "turns", self.turns as f32, 1.0, 1024.0)?;
        check_setting(Self::NAME, "intensity", self.intensity, 0.0, 1e3)?;
        check_setting(Self::NAME, "bias", self.bias, 0.0, 1.0)?;
        check_setting(Self::NAME, "epsilon", self.epsilon, 0.0, 1.0)?;
        check_setting(Self::NAME, "levels", self.levels as f32, 0.0, Self::MAX_LEVELS as f32)?;
        self.falloff.validate()?;
        self.blur.validate(Self::NAME)
    }

    /// Returns the accessibility of one pixel.
    fn pixel(&self, screen: &Screen, pyramid: &DepthPyramid, compass: &DirectionTable, pixel: &Pixel) -> f32 {
        let reach = screen.radius_px(self.radius, pixel.position.z);
        let centre = Vec2::new(pixel.x as f32, pixel.y as f32) + 0.5;
        let start = turn_of(pixel.x - screen.guard() as i32, pixel.y - screen.guard() as i32);
        let (bias, epsilon) = (self.bias * self.radius, self.epsilon * self.radius * self.radius);
        let mut sum = 0.0;
        for tap in 0..self.taps {
            let along = (tap as f32 + 0.5) / self.taps as f32;
            let offset = compass.at(along * self.turns as f32 + start) * reach * along;
            let level = level_at(offset.length(), pyramid.top());
            let Some((at, depth)) = pyramid.read(screen, level, centre + offset) else { continue };
            let to = screen.unproject(at, depth) - pixel.position;
            let square = to.length_squared();
            let above = to.dot(pixel.normal) - bias;
            if above > 0.0 {
                // The quotient has the dimension 1 over length, so the radius makes it a number.
                let hides = above / (square + epsilon) * self.radius;
                sum += self.falloff.weight(square.sqrt() / self.radius) * hides;
            }
        }
        (1.0 - 5.0 * self.intensity * sum / self.taps as f32).max(0.0)
    }
}

impl ScreenMethod for Scalable {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn label(&self) -> String {
        format!("Scalable AO, {} taps, {}", self.taps, self.blur.label())
    }

    fn sampling(&self) -> Option<Sampling> {
        Some(Sampling { directions: None, along: None, levels: self.levels, per_pixel: self.taps })
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        self.validate()?;
        let mut stages = StageTimer::new(clock);
        let pyramid = DepthPyramid::new(screen, 2, self.levels as usize, Reduce::Pick);
        stages.end("levels");
        let compass = DirectionTable::new();
        let mut values = screen.each_inner(|pixel| self.pixel(screen, &pyramid, &compass, &pixel));
        average_quads(screen, &mut values, Self::QUAD_EDGE * self.radius);
        stages.end("sample");
        self.blur.apply(screen, &mut values);
        stages.end("blur");
        stages.finish(
            screen,
            values,
            pyramid.heap_bytes() + DirectionTable::BYTES + self.blur.heap_bytes(screen),
        )
    }
}

/// Averages the values of pairs of inner pixels, across and then down, where their depths differ by less than `edge`
/// metres.
fn average_quads(screen: &Screen, values: &mut [f32], edge: f32) {
    let (width, guard) = (screen.inner().width() as usize, screen.guard() as i32);
    let depth = |index: usize| screen.depth((index % width) as i32 + guard, (index / width) as i32 + guard);
    let joined = |a: usize, b: usize| (depth(a) - depth(b)).abs() < edge;
    for first in (0..values.len()).step_by(width) {
        for a in (first..first + width - 1).step_by(2).filter(|&a| joined(a, a + 1)) {
            let mean = (values[a] + values[a + 1]) * 0.5;
            (values[a], values[a + 1]) = (mean, mean);
        }
    }
    for first in (0..values.len() - width).step_by(2 * width) {
        for a in (first..first + width).filter(|&a| joined(a, a + width)) {
            let mean = (values[a] + values[a + width]) * 0.5;
            (values[a], values[a + width]) = (mean, mean);
        }
    }
}

/// Returns the start of the spiral of an image's pixel in turns: the paper's hash `30 (x xor y) + 10 x y`, which is in
/// radians.
fn turn_of(x: i32, y: i32) -> f32 {
    let hash = i64::from(x ^ y) * 30 + i64::from(x) * i64::from(y) * 10;
    (hash as f64 / std::f64::consts::TAU).rem_euclid(1.0) as f32
}

/// Returns whether only 1 divides both numbers.
fn coprime(mut a: u32, mut b: u32) -> bool {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a == 1
}

/// Returns the level of a tap this many pixels away. On it, taps at any distance are about as many pixels apart.
#[inline]
fn level_at(pixels: f32, top: usize) -> usize {
    let log = (pixels as u32).checked_ilog2().unwrap_or(0);
    (log.saturating_sub(Scalable::LOG_FIRST_LEVEL) as usize).min(top)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_rise_where_the_distance_doubles() {
        for pixels in [0.0_f32, 0.9, 7.0, 15.9, 16.0, 31.9, 32.0, 100.0, 1e9, f32::INFINITY] {
            let want = (libm::log2f(pixels.clamp(1.0, 1e9)).floor() - 3.0).clamp(0.0, 5.0);
            assert_eq!(level_at(pixels, 5), want as usize, "{pixels}");
        }
        assert_eq!(level_at(1000.0, 0), 0);
    }

    #[test]
    fn any_number_of_taps_is_spread_over_all_directions() {
        for taps in [1, 2, 9, 32, 64, 96, 128, 224, 1024] {
            let method = Scalable::new(1.0).spread(taps, 100.0);
            method.validate().unwrap();
            // Each tap has its own direction.
            let mut places: Vec<u32> = (0..taps).map(|tap| tap * method.turns % taps).collect();
            places.sort_unstable();
            assert!(places.into_iter().eq(0..taps), "{taps} on {} turns", method.turns);
        }
        let levels =
            [1.0, 15.9, 16.0, 100.0, f32::INFINITY].map(|px| Scalable::new(1.0).spread(9, px).levels);
        assert_eq!(levels, [0, 0, 1, 3, 16], "as far taps use them");
    }

    #[test]
    fn squares_are_averaged_up_to_edges() {
        use glam::Vec3;
        use psao_reconstruct::Size;
        // There are five columns and three rows; the fourth column is far behind the third.
        let depth = (0..15).map(|i| if i % 5 == 3 { 9.0 } else { 2.0 }).collect();
        let size = Size::new(5, 3).unwrap();
        let screen = Screen::from_parts(size, 0, [1.0; 2], depth, vec![Vec3::NEG_Z; 15]).unwrap();
        let mut values: Vec<f32> = (0..15).map(|i| i as f32).collect();
        average_quads(&screen, &mut values, 0.1);
        let want = [3.0, 3.0, 4.5, 5.5, 6.5, 3.0, 3.0, 4.5, 5.5, 6.5, 10.5, 10.5, 12.0, 13.0, 14.0];
        assert_eq!(values, want);
    }

    #[test]
    fn spirals_begin_all_round() {
        let mut eighths = [0; 8];
        for (x, y) in (0..64).flat_map(|x| (0..64).map(move |y| (x, y))) {
            eighths[(turn_of(x, y) * 8.0) as usize] += 1;
        }
        assert!(eighths.iter().all(|n| (400..630).contains(n)), "{eighths:?}");
    }
}
