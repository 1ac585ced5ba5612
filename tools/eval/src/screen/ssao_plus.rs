//! Ambient occlusion from points in a hemisphere around the normal.

use glam::Vec3;
use psao_server::ao::AoSettings;
use psao_server::clock::Clock;

use super::noise::{bits, length};
use super::ssao::covered;
use super::{
    Blur, EdgeStop, Falloff, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius,
    check_setting,
};
use crate::reference::{directions, tangent_frame};

/// SSAO with a hemisphere along the normal, a range check and a bilateral blur: Filion and `McNaughton` 2008 ("Effects
/// and Techniques"), called SSAO+ by Astapov et al. (2021, section 2.2). The SSAO that the PSAO paper compares with
/// (its section on baselines) is of this kind.
///
/// Points lie along cosine-distributed directions at even lengths. So the share of points hidden by an infinitely thick
/// occluder is exactly `1 - distance / R`, the ray tracer's obscurance, without an added falloff. Depths are those of
/// the nearest pixel. Planes at a grazing angle darken a little, because a pixel spans more depth there than the bias.
#[derive(Clone, Debug, PartialEq)]
pub struct SsaoPlus {
    /// Radius of the hemisphere in metres.
    pub radius: f32,
    /// Points in the hemisphere, 1 to 1024.
    pub points: u32,
    /// Range check: weight of a surface in front, by how much nearer to the eye than the receiver it is, over the
    /// radius.
    pub falloff: Falloff,
    /// Distance behind the depth buffer from which a point counts as hidden, over the radius, 0 to 1. It prevents acne.
    pub bias: f32,
    /// Blur that removes the noise.
    pub blur: Blur,
    /// Seed of the points and the noise.
    pub seed: u64,
}

impl SsaoPlus {
    const NAME: &'static str = "ssao-plus";

    /// Returns usual settings for a radius in metres: 16 points, a bilateral blur of 5 x 5 pixels.
    pub fn new(radius: f32) -> Self {
        let edge = EdgeStop::DepthAndNormal { metres: 0.2 * radius };
        Self {
            radius,
            points: 16,
            falloff: Falloff::Binary,
            bias: 1.0 / 60.0,
            blur: Blur { taps: 2, spacing: 1, sigma: 2.0, edge },
            seed: 1,
        }
    }

    fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        check_setting(Self::NAME, "points", self.points as f32, 1.0, 1024.0)?;
        check_setting(Self::NAME, "bias", self.bias, 0.0, 1.0)?;
        self.falloff.validate()?;
        self.blur.validate(Self::NAME)
    }
}

impl ScreenMethod for SsaoPlus {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn label(&self) -> String {
        format!("SSAO+, {} points, {}", self.points, self.blur.label())
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        self.validate()?;
        let mut stages = StageTimer::new(clock);
        let rays = AoSettings::default().with_rays(self.points).with_seed(self.seed);
        let hemisphere: Vec<Vec3> = (0..self.points)
            .zip(directions(&rays, 0))
            .map(|(point, direction)| direction * (self.radius * length(point)))
            .collect();
        let bias = self.bias * self.radius;
        let mut values = screen.each_inner(|pixel| {
            let turned = tangent_frame(pixel.normal, bits(screen, &pixel, self.seed) as u32);
            let offsets = hemisphere.iter().map(|&offset| turned * offset);
            1.0 - covered(screen, pixel.position, offsets, bias, self.radius, &self.falloff)
        });
        stages.end("sample");
        self.blur.apply(screen, &mut values);
        stages.end("blur");
        stages.finish(screen, values, hemisphere.len() * size_of::<Vec3>() + self.blur.heap_bytes(screen))
    }
}
