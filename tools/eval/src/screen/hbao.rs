//! Horizon-based ambient occlusion.

use glam::{Vec2, Vec3};
use psao_server::clock::Clock;

use super::depth::Pixel;
use super::noise::{DirectionTable, bits, pair};
use super::{
    Blur, EdgeStop, Falloff, Sampling, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius,
    check_setting,
};

/// HBAO (Bavoil, Sainz and Dimitrov 2008, "Image-Space Horizon-Based Ambient Occlusion"; Bavoil and Sainz 2009,
/// "Multi-Layer Dual-Resolution Screen-Space Ambient Occlusion").
///
/// It searches the depth buffer for the horizon along each direction on the screen. Hidden is the part between the
/// tangent plane and the horizon: the sine of the horizon's angle minus that of the tangent's, both against the plane
/// of the screen. Each rise of the horizon has the weight of the sample that caused it.
///
/// Directions count by solid angle, without the cosine to the normal that the ray-traced reference has. That is part of
/// the method, and makes it differ from the reference even where it sees everything.
#[derive(Clone, Debug, PartialEq)]
pub struct Hbao {
    /// Radius in metres.
    pub radius: f32,
    /// Directions, 1 to 256.
    pub directions: u32,
    /// Samples a direction, 1 to 1024.
    pub steps: u32,
    /// Angle above the tangent plane below which nothing hides, in degrees, 0 to 89. It ignores facets of coarse
    /// meshes.
    pub angle_bias_deg: f32,
    /// Weight of a sample by its distance over the radius.
    pub falloff: Falloff,
    /// Whether directions turn and first steps shift from pixel to pixel.
    pub jitter: bool,
    /// Blur that removes the noise.
    pub blur: Blur,
    /// Seed of the noise.
    pub seed: u64,
}

impl Hbao {
    const NAME: &'static str = "hbao";

    /// Returns settings for a radius in metres: 8 directions of 10 samples, as in Astapov et al. (2021), and a
    /// cross-bilateral blur.
    pub fn new(radius: f32) -> Self {
        let edge = EdgeStop::Depth { metres: 0.2 * radius };
        Self {
            radius,
            directions: 8,
            steps: 10,
            angle_bias_deg: 10.0,
            falloff: Falloff::Quadratic,
            jitter: true,
            blur: Blur { taps: 4, spacing: 1, sigma: 2.0, edge },
            seed: 1,
        }
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] names the first setting that is not.
    pub fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        check_setting(Self::NAME, "directions", self.directions as f32, 1.0, 256.0)?;
        check_setting(Self::NAME, "steps", self.steps as f32, 1.0, 1024.0)?;
        check_setting(Self::NAME, "angle bias", self.angle_bias_deg, 0.0, 89.0)?;
        self.falloff.validate()?;
        self.blur.validate(Self::NAME)
    }

    /// Returns the accessibility of one pixel.
    fn pixel(&self, screen: &Screen, pixel: &Pixel, compass: &DirectionTable, bias: AngleBias) -> f32 {
        let reach = screen.radius_px(self.radius, pixel.position.z);
        // Steps of less than a pixel would read the same sample again.
        let step = (reach / (self.steps + 1) as f32).max(Vec2::ONE);
        let noise = bits(screen, pixel, self.seed);
        let shift = if self.jitter { pair(noise, 0) } else { Vec2::new(0.0, 0.5) };
        let centre = Vec2::new(pixel.x as f32, pixel.y as f32) + 0.5;
        let hidden: f32 = (0..self.directions)
            .map(|index| {
                let direction = compass.at((index as f32 + shift.x) / self.directions as f32);
                let first = if self.jitter { 0.5 + pair(noise, index as usize + 1).x } else { 1.0 };
                let samples = (0..self.steps).filter_map(|sample| {
                    let at = (centre + direction * step * (sample as f32 + first)).floor();
                    screen.position(at.x as i32, at.y as i32)
                });
                self.slice(pixel, direction * screen.slope(), samples, bias)
            })
            .sum();
        1.0 - hidden / self.directions as f32
    }

    /// Returns the weighted sine between tangent and horizon along one direction, from the samples from near to far.
    fn slice(
        &self,
        pixel: &Pixel,
        direction: Vec2,
        samples: impl Iterator<Item = Vec3>,
        bias: AngleBias,
    ) -> f32 {
        // Tangents of angles above the plane of the screen, towards the eye. A normal that faces away is clamped.
        let lean = direction.normalize().dot(pixel.normal.truncate()) / pixel.normal.z.min(-1e-4);
        let mut tan_horizon = raised(lean, bias.tan);
        let mut sine = sine(tan_horizon);
        let mut hidden = 0.0;
        for sample in samples {
            let to = sample - pixel.position;
            let (across, distance) = (to.truncate().length(), to.length());
            // Pixels lie a little beside the line, where the tangent plane is at another angle. The bias is above that
            // plane.
            let above = pixel.normal.dot(to) > bias.sin * distance;
            if above && -to.z > tan_horizon * across && distance < self.radius {
                tan_horizon = -to.z / across.max(f32::MIN_POSITIVE);
                let higher = self::sine(tan_horizon);
                hidden += (higher - sine) * self.falloff.weight(distance / self.radius);
                sine = higher;
            }
        }
        hidden
    }
}

impl ScreenMethod for Hbao {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn label(&self) -> String {
        format!("HBAO, {} directions of {} samples, {}", self.directions, self.steps, self.blur.label())
    }

    fn sampling(&self) -> Option<Sampling> {
        Some(Sampling::directed(self.directions, self.steps, 0))
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        self.validate()?;
        let mut stages = StageTimer::new(clock);
        let compass = DirectionTable::new();
        let angle = self.angle_bias_deg.to_radians();
        // A plane is flat only up to rounding.
        let bias = AngleBias { tan: libm::tanf(angle), sin: libm::sinf(angle).max(1e-3) };
        let mut values = screen.each_inner(|pixel| self.pixel(screen, &pixel, &compass, bias));
        stages.end("sample");
        self.blur.apply(screen, &mut values);
        stages.end("blur");
        stages.finish(screen, values, DirectionTable::BYTES + self.blur.heap_bytes(screen))
    }
}

/// Tangent and sine of the angle bias.
#[derive(Clone, Copy, Debug)]
struct AngleBias {
    tan: f32,
    sin: f32,
}

/// Returns the tangent of the sum of two angles from their tangents, at most that of 90 degrees. The second angle is in
/// `[0, 90)` degrees.
fn raised(tan: f32, by: f32) -> f32 {
    let rest = 1.0 - tan * by;
    if rest > 1e-6 { (tan + by) / rest } else { 1e6 }
}

/// Returns the sine of the angle in `[-90, 90]` degrees with this tangent.
fn sine(tan: f32) -> f32 {
    if tan.abs() < 1e6 { tan / (1.0 + tan * tan).sqrt() } else { tan.signum() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_add_and_have_their_sines() {
        for (a, b) in [(0.0_f32, 10.0_f32), (-80.0, 30.0), (40.0, 45.0), (0.0, 0.0)] {
            let tan = raised(a.to_radians().tan(), b.to_radians().tan());
            assert!((tan.atan().to_degrees() - a - b).abs() < 1e-3, "{a} + {b}: {tan}");
            assert!((sine(tan) - (a + b).to_radians().sin()).abs() < 1e-5);
        }
        assert_eq!(sine(raised(2.0, 2.0)), 1.0, "no further than straight up");
        assert_eq!([f32::INFINITY, f32::NEG_INFINITY, 1e20].map(sine), [1.0, -1.0, 1.0]);
    }

    #[test]
    fn each_rise_of_the_horizon_counts_by_its_own_distance() {
        let method = Hbao { angle_bias_deg: 0.0, ..Hbao::new(2.0) };
        let pixel = Pixel { x: 0, y: 0, position: Vec3::new(0.0, 0.0, 5.0), normal: Vec3::NEG_Z };
        let at = |x: f32, up: f32| Vec3::new(x, 0.0, 5.0 - up);
        // Up 45 degrees at 0.5, then a hidden sample, then straight on up to 60 degrees further out.
        let far = at(0.8, 0.8 * 3.0_f32.sqrt());
        let samples = [at(0.0, 0.0), at(0.5, 0.5), at(0.7, 0.1), far, at(0.1, 3.0)];
        let hidden = method.slice(&pixel, Vec2::X, samples.into_iter(), AngleBias { tan: 0.0, sin: 0.0 });
        let (near, sin45, sin60) = (0.5_f32, 0.5_f32.sqrt(), 0.75_f32.sqrt());
        let want = sin45 * (1.0 - near / 4.0) + (sin60 - sin45) * (1.0 - 2.56 / 4.0);
        assert!((hidden - want).abs() < 1e-6, "{hidden} {want}");
    }
}
