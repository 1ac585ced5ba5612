//! What the rays of a point are.

use thiserror::Error;

/// Most rays a point may have; far beyond any use, it keeps a mistyped number from filling memory.
pub const MAX_RAYS: u32 = 65_536;

/// What a ray's hit means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Mean of `min(distance, R) / R`: near hits darken more. The paper's released prototype uses this.
    Obscurance,
    /// Share of the rays that meet nothing within R.
    Binary,
}

/// Settings of the AO of a point (paper, section 3.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AoSettings {
    /// Rays a point, 1 to [`MAX_RAYS`].
    pub rays: u32,
    /// Length R of a ray in metres, finite and above 0.
    pub radius: f32,
    /// What a hit means.
    pub kind: Occlusion,
    /// Seed of the ray directions.
    pub seed: u64,
}

impl Default for AoSettings {
    /// 192 rays of 0.6 m, obscurance: the authors' own.
    fn default() -> Self {
        Self { rays: 192, radius: 0.6, kind: Occlusion::Obscurance, seed: 1 }
    }
}

impl AoSettings {
    /// Returns the distance in metres by which a ray's origin is lifted off the surface along the normal: R / 60,
    /// which is the authors' 0.01 m at 0.6 m.
    #[must_use]
    pub fn bias(&self) -> f32 {
        self.radius / 60.0
    }

    /// Returns the distance in metres from a point within which geometry can change its AO.
    #[must_use]
    pub fn influence(&self) -> f32 {
        self.radius + self.bias()
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// Names the first setting out of its range.
    pub fn validate(&self) -> Result<(), AoError> {
        if self.rays == 0 || self.rays > MAX_RAYS {
            return Err(AoError::Rays { rays: self.rays });
        }
        // Squares of lengths are compared: keep them inside the range of f32.
        if !(self.radius >= 1e-6 && self.radius <= 1e6) {
            return Err(AoError::Radius { radius: self.radius });
        }
        Ok(())
    }
}

/// An AO setting out of its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum AoError {
    /// Zero or too many rays.
    #[error("{rays} rays a point: choose 1 to {MAX_RAYS}")]
    Rays {
        /// As given.
        rays: u32,
    },
    /// A radius that is not a length.
    #[error("an AO radius of {radius} m: choose 1e-6 to 1e6")]
    Radius {
        /// As given.
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
