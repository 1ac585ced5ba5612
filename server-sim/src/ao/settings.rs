//! Settings of a point's rays.

use psao_codec::setters;
use thiserror::Error;

/// Largest number of rays per point. It is far beyond any use and keeps a mistyped number from exhausting memory.
pub const MAX_RAYS: u32 = 65_536;

/// Contribution of a ray to the AO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Mean of `min(distance, R) / R`: near hits darken more. The paper's released prototype uses this.
    Obscurance,
    /// Share of the rays that meet nothing within R.
    Binary,
}

/// Settings of the AO of a point (paper, section 3.3).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct AoSettings {
    /// Number of rays per point, 1 to [`MAX_RAYS`].
    pub rays: u32,
    /// Length R of a ray in metres, finite and above 0.
    pub radius: f32,
    /// Contribution of a ray.
    pub kind: Occlusion,
    /// Seed of the ray directions.
    pub seed: u64,
}

impl Default for AoSettings {
    /// The authors' values: 192 rays of 0.6 m, obscurance.
    fn default() -> Self {
        Self { rays: 192, radius: 0.6, kind: Occlusion::Obscurance, seed: 1 }
    }
}

impl AoSettings {
    setters! {
        const fn:
        with_rays: rays as u32,
        with_radius: radius as f32,
        with_kind: kind as Occlusion,
        with_seed: seed as u64,
    }

    /// Returns the distance in metres by which a ray's origin is moved off the surface along the normal. It is R /
    /// 60, which is the authors' 0.01 m for 0.6 m.
    #[must_use]
    pub fn bias(&self) -> f32 {
        self.radius / 60.0
    }

    /// Returns the distance in metres from a point within which geometry can change its AO.
    #[must_use]
    pub fn influence(&self) -> f32 {
        self.radius + self.bias()
    }

    /// Checks the ranges of the settings.
    ///
    /// # Errors
    /// Returns the first setting out of its range.
    pub fn validate(&self) -> Result<(), AoError> {
        if self.rays == 0 || self.rays > MAX_RAYS {
            return Err(AoError::Rays { rays: self.rays });
        }
        // Lengths are squared: keep the squares inside the range of f32.
        if !(self.radius >= 1e-6 && self.radius <= 1e6) {
            return Err(AoError::Radius { radius: self.radius });
        }
        Ok(())
    }
}

/// An AO setting is out of its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum AoError {
    /// The number of rays is zero or too large.
    #[error("{rays} rays a point: choose 1 to {MAX_RAYS}")]
    Rays {
        /// Number of rays in the settings.
        rays: u32,
    },
    /// The radius is not a valid length.
    #[error("an AO radius of {radius} m: choose 1e-6 to 1e6")]
    Radius {
        /// Radius in the settings, metres.
        radius: f32,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_is_not_a_setting() {
        let with = |rays, radius| AoSettings { rays, radius, ..AoSettings::default() }.validate();
        assert_eq!(with(192, 0.6), Ok(()));
        assert_eq!(with(0, 0.6), Err(AoError::Rays { rays: 0 }));
        assert_eq!(with(u32::MAX, 0.6), Err(AoError::Rays { rays: u32::MAX }));
        for radius in [0.0, -1.0, f32::INFINITY, f32::MIN_POSITIVE, 1e30] {
            assert_eq!(with(1, radius), Err(AoError::Radius { radius }));
        }
        assert!(matches!(with(1, f32::NAN), Err(AoError::Radius { .. })));
        assert!((AoSettings::default().bias() - 0.01).abs() < 1e-9);
    }
}
