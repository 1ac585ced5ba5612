//! Rays through the depth buffer: the best possible result of a screen-space method.

use glam::{Mat3, Vec2, Vec3};
use psao_server::ao::{AoSettings, MAX_RAYS};
use psao_server::clock::Clock;

use super::depth::Pixel;
use super::noise::bits;
use super::{Falloff, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius, check_setting};
use crate::reference::{directions, tangent_frame};

/// Distance of a ray's origin from the surface, along the normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RayBias {
    /// The bias of the server's rays ([`AoSettings::bias`]): a sixtieth of the radius. Rays miss nearer surfaces, which
    /// for a large radius are much of what a corner hides.
    Server,
    /// This share of the pixel's depth, 1e-6 to 0.1, whatever the radius.
    OfDepth(f32),
}

/// The screen-space reference of far-field obscurance (Timonen 2013, section 8).
///
/// Cosine-distributed rays over the hemisphere of each pixel step through the depth buffer until it is in front of
/// them. A hit has the weight of the falloff at its distance.
///
/// Planes join the depth field between pixels. The method knows only what the screen shows. The geometric reference,
/// which knows hidden surfaces and those off the screen, is [`crate::reference`].
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenRays {
    /// Length of the rays in metres.
    pub radius: f32,
    /// Rays a pixel, 1 to [`MAX_RAYS`].
    pub rays: u32,
    /// Weight of a hit by its distance over the radius.
    pub falloff: Falloff,
    /// Thickness of the depth field behind the visible surface in metres, 1e-6 to 1e6. `None` is infinite, and joins
    /// near surfaces to those far behind them.
    pub thickness: Option<f32>,
    /// Pixels in a step, 0.1 to 16.
    pub step_px: f32,
    /// Distance of the rays' origins from the surface.
    pub bias: RayBias,
    /// Seed of the directions.
    pub seed: u64,
}

impl ScreenRays {
    const NAME: &'static str = "traced";
    /// Number of sets of directions that the pixels choose from, as for the geometric reference.
    const DIRECTION_SETS: usize = 16;
    /// Smallest number of steps of a ray, so that rays straight at the eye meet surfaces in front of it.
    const MIN_STEPS: f32 = 8.0;
    /// Largest number of steps of a ray.
    const MAX_STEPS: f32 = 65_536.0;

    /// Returns settings for a radius in metres: 64 rays a pixel, linear falloff, infinite thickness, the server's bias.
    pub fn new(radius: f32) -> Self {
        let (falloff, bias) = (Falloff::Linear, RayBias::Server);
        Self { radius, rays: 64, falloff, thickness: None, step_px: 1.0, bias, seed: 1 }
    }

    /// Returns the reference settings for far-field methods of this radius and falloff.
    ///
    /// Rays begin a ten-thousandth of the depth off the surface, so that near surfaces count as well. They go in steps
    /// of a quarter of a pixel, because the field is bent between pixels. In steps of a whole pixel, rays miss the tops
    /// of the field, which makes the built-in scenes about 1 % too bright at 160 x 90.
    pub fn far(radius: f32, falloff: Falloff) -> Self {
        Self { falloff, step_px: 0.25, bias: RayBias::OfDepth(1e-4), ..Self::new(radius) }
    }

    fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        check_setting(Self::NAME, "rays", self.rays as f32, 1.0, MAX_RAYS as f32)?;
        check_setting(Self::NAME, "thickness", self.thickness.unwrap_or(1.0), 1e-6, 1e6)?;
        check_setting(Self::NAME, "step", self.step_px, 0.1, 16.0)?;
        if let RayBias::OfDepth(part) = self.bias {
            check_setting(Self::NAME, "ray bias", part, 1e-6, 0.1)?;
        }
        self.falloff.validate()
    }

    /// Returns the accessibility of one pixel by rays in these directions, turned to its normal.
    fn pixel(&self, field: &RayField<'_>, pixel: &Pixel, turned: Mat3, directions: &[Vec3]) -> f32 {
        let bias = match self.bias {
            RayBias::Server => AoSettings::default().with_radius(self.radius).bias(),
            RayBias::OfDepth(part) => part * pixel.position.z,
        };
        let origin = pixel.position + pixel.normal * bias;
        if origin.z <= 0.0 {
            return 1.0;
        }
        let hidden: f32 = directions
            .iter()
            .filter_map(|&local| self.march(field, origin, turned * local))
            .map(|distance| self.falloff.weight(distance / self.radius))
            .sum();
        1.0 - hidden / directions.len() as f32
    }

    /// Returns the distance in metres along the ray to the depth field, if the ray meets it within the radius.
    fn march(&self, field: &RayField<'_>, origin: Vec3, direction: Vec3) -> Option<f32> {
        let screen = field.screen;
        let mut end = origin + direction * self.radius;
        let nearest = origin.z * 1e-2;
        if end.z < nearest {
            end = origin + direction * ((origin.z - nearest) / -direction.z);
        }
        // On the screen a ray is straight, and the inverse of its depth is linear along it.
        let (from, to) = (screen.project(origin), screen.project(end));
        let (near, far) = (origin.z.recip(), end.z.recip());
        let across = (to - from).abs().max_element() / self.step_px;
        let steps = across.ceil().clamp(Self::MIN_STEPS, Self::MAX_STEPS) as u32;
        let mut before = 0.0_f32;
        for step in 1..=steps {
            let part = step as f32 / steps as f32;
            let (at, inverse) = (from + (to - from) * part, near + (far - near) * part);
            // The distance by which the field is nearer to the eye than the ray, as a difference of inverse depths.
            let nearer = field.at(at)? - inverse;
            if nearer > 0.0 && field.is_inside(inverse, nearer) {
                // The place where the line between the last two differences is zero.
                let back = nearer / (nearer - before.min(0.0));
                let met = part - back / steps as f32;
                let point = screen.unproject(from + (to - from) * met, (near + (far - near) * met).recip());
                return Some(point.distance(origin));
            }
            before = nearer;
        }
        None
    }
}

/// The depth field for rays: inverse depths, 0 for sky.
#[derive(Debug)]
struct RayField<'a> {
    screen: &'a Screen,
    inverse: Vec<f32>,
    thickness: f32,
}

impl<'a> RayField<'a> {
    fn new(screen: &'a Screen, thickness: Option<f32>) -> Self {
        let inverse = screen.depths().iter().map(|depth| depth.recip()).collect();
        Self { screen, inverse, thickness: thickness.unwrap_or(f32::INFINITY) }
    }

    /// Returns whether a point of this inverse depth, behind the field by `nearer`, is within its thickness.
    #[inline]
    fn is_inside(&self, inverse: f32, nearer: f32) -> bool {
        // The difference of the depths, times both.
        nearer < self.thickness * inverse * (inverse + nearer)
    }

    /// Returns the inverse depth at a place on the grid, on planes between the centres of pixels. At outlines (sky, or
    /// a jump by more than the thickness) it is that of the pixel itself. `None` beyond the grid.
    #[inline]
    fn at(&self, at: Vec2) -> Option<f32> {
        if !self.screen.covers(at.floor()) {
            return None;
        }
        let (width, height) = (self.screen.size().width() as usize, self.screen.size().height() as usize);
        // Within half a pixel of the sides, the outermost pixels are extended.
        let corner = (at - 0.5).max(Vec2::ZERO);
        let (x, y) = (corner.x as usize, corner.y as usize);
        let part = corner - corner.floor();
        let (row, right) = (y * width + x, usize::from(x + 1 < width));
        let below = row + if y + 1 < height { width } else { 0 };
        let [a, b, c, d] = [row, row + right, below, below + right].map(|index| self.inverse[index]);
        let (most, least) = (a.max(b).max(c.max(d)), a.min(b).min(c.min(d)));
        if least == 0.0 || most - least > self.thickness * most * least {
            return Some(self.inverse[at.y as usize * width + at.x as usize]);
        }
        let (top, bottom) = (a + (b - a) * part.x, c + (d - c) * part.x);
        Some(top + (bottom - top) * part.y)
    }
}

impl ScreenMethod for ScreenRays {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn label(&self) -> String {
        let depth = self.thickness.map_or(String::new(), |metres| format!(", {metres} m thick"));
        let bias = match self.bias {
            RayBias::Server => String::new(),
            RayBias::OfDepth(part) => format!(", lifted by {part} of the depth"),
        };
        format!("screen-space rays, {} a pixel{depth}{bias}", self.rays)
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        self.validate()?;
        let mut stages = StageTimer::new(clock);
        let settings =
            AoSettings::default().with_rays(self.rays).with_radius(self.radius).with_seed(self.seed);
        let sets: Vec<Vec<Vec3>> = (0..Self::DIRECTION_SETS).map(|set| directions(&settings, set)).collect();
        let field = RayField::new(screen, self.thickness);
        let values = screen.each_inner(|pixel| {
            let choice = bits(screen, &pixel, self.seed);
            let turned = tangent_frame(pixel.normal, (choice >> 32) as u32);
            self.pixel(&field, &pixel, turned, &sets[choice as usize % Self::DIRECTION_SETS])
        });
        stages.end("trace");
        let bytes = Self::DIRECTION_SETS * self.rays as usize * size_of::<Vec3>()
            + field.inverse.len() * size_of::<f32>();
        stages.finish(screen, values, bytes)
    }
}

#[cfg(test)]
mod tests {
    use psao_reconstruct::Size;

    use super::*;

    /// Returns 32 x 32 pixels with a view of 45 degrees to each side: a wall 4 m away with a 1 x 1 m step towards the
    /// eye.
    fn step() -> Screen {
        let inside = |x: usize, y: usize| (8..16).contains(&x) && (8..16).contains(&y);
        let depth = (0..1024).map(|i| if inside(i % 32, i / 32) { 2.0 } else { 4.0 }).collect();
        Screen::from_parts(Size::new(32, 32).unwrap(), 0, [1.0; 2], depth, vec![Vec3::NEG_Z; 1024]).unwrap()
    }

    #[test]
    fn rays_meet_what_is_in_front_and_tell_how_far() {
        let screen = step();
        let field = RayField::new(&screen, None);
        let method = ScreenRays::new(4.0);
        // The ray goes along -x at a depth of 3, at the height of the step's middle. The side of the step is at x = 0,
        // where the field falls off over one pixel, 0.19 m wide at that depth.
        let from = Vec3::new(1.0, -0.5, 3.0);
        let met = method.march(&field, from, Vec3::NEG_X).unwrap();
        assert!((met - 1.0).abs() < 0.15, "{met}");
        assert_eq!(method.march(&field, from, Vec3::X), None, "leaves the screen");
        assert_eq!(method.march(&field, from, Vec3::NEG_Z), None, "to the eye");
        let wall = method.march(&field, from, Vec3::Z).unwrap();
        assert!((wall - 1.0).abs() < 1e-3, "{wall}");
        let short = ScreenRays::new(0.5);
        assert_eq!(short.march(&field, from, Vec3::NEG_X), None, "too far");
    }

    #[test]
    fn what_is_nearer_than_the_bias_is_not_met() {
        // The pixel is beside and below the step, whose side is higher than the bias for so large a radius.
        let screen = step();
        let high = ScreenRays { falloff: Falloff::Binary, ..ScreenRays::new(60.0) };
        let low = ScreenRays::far(60.0, Falloff::Binary);
        let [high, low] = [high, low].map(|method| {
            let shaded = method.shade(&screen, &psao_server::clock::NoClock).unwrap();
            shaded.image.values()[12 * 32 + 17]
        });
        assert!(low < high - 0.05, "{low} {high}");
    }

    #[test]
    fn rays_pass_behind_what_is_thin() {
        let screen = step();
        let field = RayField::new(&screen, Some(0.5));
        let from = Vec3::new(1.0, -0.5, 3.0);
        let thin = ScreenRays { thickness: Some(0.5), ..ScreenRays::new(4.0) };
        assert_eq!(thin.march(&field, from, Vec3::NEG_X), None, "1 m behind the step");
        let near = Vec3::new(1.0, -0.5, 2.25);
        let met = thin.march(&field, near, Vec3::NEG_X).unwrap();
        assert!((met - 1.0).abs() < 0.2, "{met}");
        let wall = thin.march(&field, from, Vec3::Z).unwrap();
        assert!((wall - 1.0).abs() < 1e-3, "{wall}");
    }

    #[test]
    fn the_field_of_a_plane_is_that_plane_between_its_pixels() {
        let size = Size::new(16, 12).unwrap();
        let plane = |x: f32, y: f32| 0.2 + 0.01 * x - 0.008 * y;
        let depth = (0..192).map(|i| plane((i % 16) as f32 + 0.5, (i / 16) as f32 + 0.5).recip()).collect();
        let screen = Screen::from_parts(size, 0, [1.0, 0.75], depth, vec![Vec3::NEG_Z; 192]).unwrap();
        let field = RayField::new(&screen, None);
        for (x, y) in [(0.5, 0.5), (7.3, 4.9), (15.4, 11.3), (3.0, 9.0)] {
            let found = field.at(Vec2::new(x, y)).unwrap();
            assert!((found - plane(x, y)).abs() < 1e-6, "{x} {y}: {found}");
        }
        for (x, y) in [(-0.1, 3.0), (16.0, 3.0), (3.0, 12.5), (f32::NAN, 1.0)] {
            assert_eq!(field.at(Vec2::new(x, y)), None);
        }
    }
}
