//! Settings of far-field obscurance, and their ranges.

use crate::screen::{Falloff, ScreenError, check_radius, check_setting};

/// Settings of [`FarField`](super::FarField).
#[derive(Clone, Debug, PartialEq)]
pub struct FarFieldSettings {
    /// Distance in metres at which the falloff ends. It hardly affects the run time.
    pub radius: f32,
    /// Weight of an occluder by its distance. Any falloff is possible.
    pub falloff: Falloff,
    /// K: azimuthal sectors, even, 4 to [`FarFieldSettings::MAX_SECTORS`]. The paper shows 8, 16 and 18.
    pub sectors: u32,
    /// Segments in which each sector is evaluated (section 7), 1 to [`FarFieldSettings::MAX_SEGMENTS`]; the paper
    /// takes 2.
    pub segments: u32,
    /// `B_0`: pixels of the shortest interval, 2 to [`FarFieldSettings::MAX_INTERVAL`]. The far field begins at 1.5 of
    /// it on average. The paper shows 5, 10 and 20.
    pub interval: u32,
    /// Smallest distance of an interval in units of its length, 1 to [`FarFieldSettings::MAX_DENSITY`].
    ///
    /// A larger one gives more slabs a direction and a longer near field. The paper's spacing is 1. It gives some eight
    /// slabs in each direction of a screen of 1536 x 864 with intervals of 10 pixels.
    pub density: u32,
    /// Search of the near field; `None` leaves it out.
    pub near: Option<NearField>,
    /// Thickness of the depth field in metres (section 11); `None` is a continuous field of infinite thickness.
    pub thickness: Option<f32>,
    /// Whether a point's slab stands midway between the point and the near end of its interval, instead of at the
    /// point.
    ///
    /// The slab represents everything between the point and the receiver. The paper has it at the point (section 4),
    /// which is the furthest possible place, so falloffs come out too bright. Slabs midway remove most of that error
    /// against rays through the same depth buffer. Against rays through the scene they are no better, mostly worse.
    /// There an infinite depth field is too dark, and slabs at their points compensate a part of it.
    pub midway: bool,
    /// Seed for turning the sectors of each pixel by its own angle, up to half a segment to either side (section 11.1).
    /// It replaces banding by noise.
    pub jitter: Option<u64>,
    /// Separable approximation: each pixel evaluates a ninth of the sectors (section 10).
    pub separate: Option<Separation>,
}

/// The search of the near field (section 9): point samples along each segment.
///
/// The first sample is half a pixel away, or one pixel where the field has a thickness. Between samples that it joins,
/// the field is a straight line, and slabs stand in its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearField {
    /// Factor by which each step is longer than the one before, 1 to 4; 1 visits every pixel.
    pub growth: f32,
}

/// Separable approximation of the far field in groups of 3 x 3 pixels (section 10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Separation {
    /// Whether a selective blur hides the seam of near and far field.
    pub blur: bool,
}

impl FarFieldSettings {
    /// Largest number of sectors.
    pub const MAX_SECTORS: u32 = 180;
    /// Largest number of segments in a sector.
    pub const MAX_SEGMENTS: u32 = 8;
    /// Upper limit of the shortest interval in pixels.
    pub const MAX_INTERVAL: u32 = 256;
    /// Largest density.
    pub const MAX_DENSITY: u32 = 64;
    /// Number of pixels in a group of [`Separation`].
    pub(crate) const GROUP: u32 = 9;

    /// Checks all ranges.
    ///
    /// # Errors
    ///
    /// [`ScreenError`] names the setting and its range.
    pub fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        self.falloff.validate()?;
        let within = |setting, value: u32, least: u32, most: u32| {
            check_setting(super::NAME, setting, value as f32, least as f32, most as f32)
        };
        within("the number of sectors", self.sectors, 4, Self::MAX_SECTORS)?;
        within("the remainder of the number of sectors by 2", self.sectors % 2, 0, 0)?;
        within("the number of segments", self.segments, 1, Self::MAX_SEGMENTS)?;
        within("the interval", self.interval, 2, Self::MAX_INTERVAL)?;
        within("the density", self.density, 1, Self::MAX_DENSITY)?;
        if self.separate.is_some() {
            let rest = self.sectors % (2 * Self::GROUP);
            within("the remainder of the number of separated sectors by 18", rest, 0, 0)?;
        }
        if let Some(NearField { growth }) = self.near {
            check_setting(super::NAME, "the growth of near steps", growth, 1.0, 4.0)?;
        }
        if let Some(thickness) = self.thickness {
            check_setting(super::NAME, "the thickness", thickness, 1e-6, 1e6)?;
        }
        Ok(())
    }

    /// Returns the settings in words.
    pub(crate) fn label(&self) -> String {
        let Self { sectors, segments, interval, radius, .. } = self;
        let mut label = format!(
            "far-field obscurance, K = {sectors}x{segments}, B0 = {interval}, R = {radius} m, {}",
            self.falloff.label()
        );
        if self.density > 1 {
            label += &format!(", each {} of its lengths away", self.density);
        }
        match self.near {
            None => label += ", far field alone",
            Some(NearField { growth: 1.0 }) => {}
            Some(NearField { growth }) => label += &format!(", near steps x {growth}"),
        }
        if let Some(thickness) = self.thickness {
            label += &format!(", {thickness} m thick");
        }
        if self.midway {
            label += ", slabs midway";
        }
        if self.jitter.is_some() {
            label += ", jittered";
        }
        match self.separate {
            None => {}
            Some(Separation { blur: false }) => label += ", 3x3 separated",
            Some(Separation { blur: true }) => label += ", 3x3 separated and blurred",
        }
        label
    }
}

impl Default for FarFieldSettings {
    /// Returns K = 16x2 with intervals of 10 pixels (section 8) and every pixel of the near field, with the ray
    /// tracer's 0.6 m and falloff.
    fn default() -> Self {
        Self {
            radius: 0.6,
            falloff: Falloff::Linear,
            sectors: 16,
            segments: 2,
            interval: 10,
            density: 1,
            near: Some(NearField { growth: 1.0 }),
            thickness: None,
            midway: false,
            jitter: None,
            separate: None,
        }
    }
}
