//! Pyramid HBAO: horizons in a pyramid of mean depths.

use glam::Vec2;
use psao_server::clock::Clock;

use super::depth::Pixel;
use super::noise::{DirectionTable, bits, pair};
use super::pyramid::{DepthPyramid, Reduce};
use super::{
    Blur, EdgeStop, Falloff, Sampling, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius,
    check_setting,
};

/// Pyramid HBAO (Astapov, Frolov and Galaktionov 2021).
///
/// Along each of D random directions it takes a few samples of the depth buffer, then as many of each level of a
/// pyramid of means. Pixels and steps of a level are K = 3 times as large as those below (sections 3.3 and 3.4). A
/// direction is hidden by the sample with the largest product of falloff and sine of its angle above the tangent plane
/// (Eq. 8). Accessibility is 1 minus the mean over the directions.
///
/// The reach in pixels is `step_px * samples * (1 + 3 + ... + 3^levels)`, whatever the radius. Larger radii need more
/// levels. The paper leaves the range of the random first step open; here it is 0.5 to 1.5 of `step_px`.
#[derive(Clone, Debug, PartialEq)]
pub struct PyramidHbao {
    /// Radius in metres.
    pub radius: f32,
    /// Directions D, 1 to 256.
    pub directions: u32,
    /// Samples of a direction on each level, 1 to 256.
    pub samples: u32,
    /// Levels of the pyramid above the depth buffer, 0 to 8.
    pub levels: u32,
    /// Step on the depth buffer in pixels, 0.5 to 64.
    pub step_px: f32,
    /// Weight of a sample by its distance over the radius; the paper's is linear (Eq. 7).
    pub falloff: Falloff,
    /// Blur that removes the noise; the paper's is a plain Gaussian of 5 taps (section 3.5).
    pub blur: Blur,
    /// Seed of the noise.
    pub seed: u64,
}

impl PyramidHbao {
    const NAME: &'static str = "pyramid-hbao";
    /// Factor by which levels shrink (section 3.3).
    const K: usize = 3;
    const MAX_LEVELS: u32 = 8;

    /// Returns the paper's settings for a radius in metres: 8 directions, linear falloff, a Gaussian of 5 taps with
    /// sigma 1.5. Samples and levels are not published; 4 samples on each of 4 levels (the depth buffer and 3 more)
    /// reach 160 pixels.
    pub fn new(radius: f32) -> Self {
        Self {
            radius,
            directions: 8,
            samples: 4,
            levels: 3,
            step_px: 1.0,
            falloff: Falloff::Linear,
            blur: Blur { taps: 2, spacing: 1, sigma: 1.5, edge: EdgeStop::None },
            seed: 1,
        }
    }

    /// Returns the same settings with the fewest levels that reach `pixels`, at most 8.
    #[must_use]
    pub fn reaching(self, pixels: f32) -> Self {
        let reach = |levels| Self { levels, ..self.clone() }.reach_px();
        let levels =
            (0..Self::MAX_LEVELS).find(|&levels| reach(levels) >= pixels).unwrap_or(Self::MAX_LEVELS);
        Self { levels, ..self }
    }

    /// Returns the reach of a direction in pixels when its first step is not shifted.
    #[must_use]
    pub fn reach_px(&self) -> f32 {
        let steps: f32 = (0..=self.levels).map(|level| (Self::K as f32).powi(level as i32)).sum();
        self.step_px * self.samples as f32 * steps
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] names the first setting that is not.
    pub fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        check_setting(Self::NAME, "directions", self.directions as f32, 1.0, 256.0)?;
        check_setting(Self::NAME, "samples", self.samples as f32, 1.0, 256.0)?;
        check_setting(Self::NAME, "levels", self.levels as f32, 0.0, Self::MAX_LEVELS as f32)?;
        check_setting(Self::NAME, "step", self.step_px, 0.5, 64.0)?;
        self.falloff.validate()?;
        self.blur.validate(Self::NAME)
    }

    /// Returns the accessibility of one pixel.
    fn pixel(&self, screen: &Screen, pyramid: &DepthPyramid, compass: &DirectionTable, pixel: &Pixel) -> f32 {
        let noise = bits(screen, pixel, self.seed);
        let centre = Vec2::new(pixel.x as f32, pixel.y as f32) + 0.5;
        let hidden: f32 = (0..self.directions)
            .map(|index| {
                // Section 3.5: random directions and a random first step.
                let chance = pair(noise, index as usize);
                let direction = compass.at(chance.x);
                let (mut step, mut along) = (self.step_px * (0.5 + chance.y), 0.0);
                let mut most = 0.0_f32;
                for level in 0..=pyramid.top() {
                    for _ in 0..self.samples {
                        along += step;
                        if let Some((at, depth)) = pyramid.read(screen, level, centre + direction * along) {
                            most = most.max(self.contribution(screen, pixel, at, depth));
                        }
                    }
                    step *= Self::K as f32;
                }
                most
            })
            .sum();
        1.0 - hidden / self.directions as f32
    }

    /// Returns the falloff times sine above the tangent plane (Eq. 8) of the sample at `depth` metres over `at`.
    #[inline]
    fn contribution(&self, screen: &Screen, pixel: &Pixel, at: Vec2, depth: f32) -> f32 {
        let to = screen.unproject(at, depth) - pixel.position;
        let (above, distance) = (pixel.normal.dot(to), to.length());
        if above <= 0.0 || distance >= self.radius {
            return 0.0;
        }
        self.falloff.weight(distance / self.radius) * above / distance
    }
}

impl ScreenMethod for PyramidHbao {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn label(&self) -> String {
        let Self { directions, samples, levels, .. } = self;
        format!("Pyramid HBAO, {directions} directions of {samples} samples on {} levels", levels + 1)
    }

    fn sampling(&self) -> Option<Sampling> {
        Some(Sampling::directed(self.directions, self.samples * (self.levels + 1), self.levels))
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        self.validate()?;
        let mut stages = StageTimer::new(clock);
        let pyramid = DepthPyramid::new(screen, Self::K, self.levels as usize, Reduce::Mean);
        stages.end("pyramid");
        let compass = DirectionTable::new();
        let mut values = screen.each_inner(|pixel| self.pixel(screen, &pyramid, &compass, &pixel));
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

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use psao_reconstruct::Size;

    use super::*;

    #[test]
    fn levels_are_as_few_as_reach() {
        let reaching = |pixels| PyramidHbao::new(1.0).reaching(pixels);
        // 4 steps of 1, of 3, of 9, of 27 pixels.
        for (pixels, levels, reach) in
            [(0.0, 0, 4.0), (4.0, 0, 4.0), (4.1, 1, 16.0), (17.0, 2, 52.0), (100.0, 3, 160.0)]
        {
            let found = reaching(pixels);
            assert_eq!((found.levels, found.reach_px()), (levels, reach), "{pixels}");
            assert_eq!(found.sampling().unwrap().per_pixel, 8 * 4 * (levels + 1));
        }
        for pixels in [f32::INFINITY, f32::NAN] {
            assert_eq!(reaching(pixels).levels, 8, "as many as there may be");
            reaching(pixels).validate().unwrap();
        }
    }

    #[test]
    fn a_sample_counts_by_its_angle_and_distance_whatever_the_level() {
        // A wall 2 m away, except for a block of 9 x 9 pixels on the right that is 1.5 m away.
        let depth = |i: usize| if (18..27).contains(&(i % 27)) && i / 27 < 9 { 1.5 } else { 2.0 };
        let size = Size::new(27, 9).unwrap();
        let depths = (0..27 * 9).map(depth).collect();
        let screen =
            Screen::from_parts(size, 0, [1.0, 1.0 / 3.0], depths, vec![Vec3::NEG_Z; 27 * 9]).unwrap();
        let pyramid = DepthPyramid::new(&screen, PyramidHbao::K, 2, Reduce::Mean);
        let position = screen.position(13, 4).unwrap();
        let pixel = Pixel { x: 13, y: 4, position, normal: Vec3::NEG_Z };
        let method = PyramidHbao::new(4.0);
        for level in 0..=2 {
            let (at, depth) = pyramid.read(&screen, level, Vec2::new(22.5, 4.5)).unwrap();
            // Pixel 22 is 9 pixels of 2 / 27 to the right, at 1.5 m; all levels have their centre there.
            let to = Vec3::new(9.0 * 2.0 / 27.0 * 1.5, 0.0, -0.5);
            let want = (1.0 - to.length() / 4.0) * (0.5 / to.length());
            let found = method.contribution(&screen, &pixel, at, depth);
            assert!((found - want).abs() < 1e-5, "{level}: {found} {want}");
        }
        let (at, depth) = pyramid.read(&screen, 0, Vec2::new(3.5, 4.5)).unwrap();
        assert!(method.contribution(&screen, &pixel, at, depth) < 1e-6, "the wall itself");
        assert_eq!(PyramidHbao::new(0.5).contribution(&screen, &pixel, at, 1.5), 0.0, "too far");
    }
}
