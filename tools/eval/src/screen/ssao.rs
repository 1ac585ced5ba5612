//! The first screen-space ambient occlusion: points in a sphere, compared with the depth buffer.

use glam::Vec3;
use psao_server::clock::Clock;

use super::noise::{bits, pair};
use super::{
    Blur, EdgeStop, Falloff, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius,
    check_setting,
};
use crate::reference::fraction;

/// SSAO as in `CryEngine` 2 (Mittring 2007, "Finding Next Gen: `CryEngine` 2"): the share of points of a sphere around
/// the surface that are in front of the depth buffer.
///
/// It uses no normals, so an open plane hides half of its points and has the value 0.5. Convex edges are brighter, and
/// surfaces behind an outline get a halo. With `doubled` an open plane is open, as in later engines.
#[derive(Clone, Debug, PartialEq)]
pub struct Ssao {
    /// Radius of the sphere in metres.
    pub radius: f32,
    /// Points in the sphere, 1 to 1024.
    pub points: u32,
    /// Range check: weight of a surface in front, by how much nearer to the eye than the receiver it is, over the
    /// radius. Surfaces deeper than the receiver but in front of its point count in full.
    pub falloff: Falloff,
    /// Whether the value is twice the share, at most 1.
    pub doubled: bool,
    /// Blur that removes the noise.
    pub blur: Blur,
    /// Seed of the noise.
    pub seed: u64,
}

impl Ssao {
    const NAME: &'static str = "ssao";

    /// Returns settings for a radius in metres: 16 points, mirrored differently in each pixel, and a small blur.
    pub fn new(radius: f32) -> Self {
        let edge = EdgeStop::Depth { metres: 0.2 * radius };
        Self {
            radius,
            points: 16,
            falloff: Falloff::Binary,
            doubled: false,
            blur: Blur { taps: 2, spacing: 1, sigma: 2.0, edge },
            seed: 1,
        }
    }

    fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        check_setting(Self::NAME, "points", self.points as f32, 1.0, 1024.0)?;
        self.falloff.validate()?;
        self.blur.validate(Self::NAME)
    }
}

impl ScreenMethod for Ssao {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn label(&self) -> String {
        let doubled = if self.doubled { ", doubled" } else { "" };
        format!("SSAO, {} points{doubled}, {}", self.points, self.blur.label())
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        self.validate()?;
        let mut stages = StageTimer::new(clock);
        let sphere = sphere(self.points, self.radius);
        let gain = if self.doubled { 2.0 } else { 1.0 };
        let mut values = screen.each_inner(|pixel| {
            let mirror = direction(pair(bits(screen, &pixel, self.seed), 0).into());
            let offsets = sphere.iter().map(|&offset| offset - mirror * (2.0 * offset.dot(mirror)));
            (gain * (1.0 - covered(screen, pixel.position, offsets, 0.0, self.radius, &self.falloff)))
                .min(1.0)
        });
        stages.end("sample");
        self.blur.apply(screen, &mut values);
        stages.end("blur");
        stages.finish(screen, values, sphere.len() * size_of::<Vec3>() + self.blur.heap_bytes(screen))
    }
}

/// Returns the weighted share of the points `position` + offset that are more than `bias` metres behind the depth
/// buffer.
///
/// The weight of a point is the falloff of the distance by which the depth buffer is nearer than `position`. Points
/// beyond the grid are left out; 0 when there are no others.
pub(super) fn covered(
    screen: &Screen,
    position: Vec3,
    offsets: impl Iterator<Item = Vec3>,
    bias: f32,
    radius: f32,
    falloff: &Falloff,
) -> f32 {
    let (mut hidden, mut seen) = (0.0, 0_u32);
    for offset in offsets {
        let point = position + offset;
        if point.z <= 0.0 {
            seen += 1;
            continue;
        }
        let at = screen.project(point).floor();
        if !screen.covers(at) {
            continue;
        }
        seen += 1;
        let depth = screen.depth(at.x as i32, at.y as i32);
        if depth < point.z - bias {
            hidden += falloff.weight((position.z - depth) / radius);
        }
    }
    if seen == 0 { 0.0 } else { hidden / seen as f32 }
}

/// Returns points in a sphere with even directions (a Hammersley set) and even lengths, so that points are denser near
/// the centre.
fn sphere(points: u32, radius: f32) -> Vec<Vec3> {
    (0..points)
        .map(|point| {
            let even = (point as f32 + 0.5) / points as f32;
            let length = radius * super::noise::length(point);
            direction([even, fraction(point.reverse_bits()) as f32]) * length
        })
        .collect()
}

/// Returns a direction from two numbers in `[0, 1)`. Even numbers give even directions.
fn direction([along, turn]: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * along;
    let across = (1.0 - z * z).max(0.0).sqrt();
    let angle = turn * std::f32::consts::TAU;
    Vec3::new(across * libm::cosf(angle), across * libm::sinf(angle), z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_fill_the_sphere() {
        let points = sphere(256, 0.5);
        let mean: Vec3 = points.iter().sum::<Vec3>() / 256.0;
        assert!(mean.length() < 0.01, "{mean}");
        assert!(points.iter().all(|p| p.length() < 0.5 && p.length() > 0.0));
        let near = points.iter().filter(|p| p.length() < 0.25).count();
        assert!((120..=136).contains(&near), "lengths are even: {near}");
        let octant = points.iter().filter(|p| p.min_element() > 0.0).count();
        assert!((26..=38).contains(&octant), "{octant}");
    }
}
