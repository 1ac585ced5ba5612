//! What a server is asked to do.

use psao_codec::block::BlockCoder;
use psao_codec::setters;
use psao_codec::surface::{Budget, GeometrySource};
use psao_proto::Profile;
use thiserror::Error;

use super::RayBudget;
use crate::ao::{AoError, AoSettings};
use crate::points::{GeometryPrecision, PointError, PointSettings};
use crate::shortcuts::Shortcuts;

/// Settings of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ServerSettings {
    /// Profile of the stream: `surface` or `paper`.
    pub profile: Profile,
    /// Profile `surface`: whether clients are sent the points, or spread them themselves.
    pub geometry: GeometrySource,
    /// Bits of a packed point: 32, 24 or 16. In profile `surface`, how finely positions and normals are rounded: see
    /// [`GeometryPrecision::of_bits`].
    pub bits: u8,
    /// How many points.
    pub points: PointSettings,
    /// How their AO is traced.
    pub ao: AoSettings,
    /// A point is sent again when its AO byte differs by at least this much from the one last sent, 1 to 255.
    pub threshold: u8,
    /// Profile `surface`: the same for points that no camera sees, `threshold` to 255. `None` is eight times the threshold, at
    /// most 64.
    pub unseen_threshold: Option<u8>,
    /// Profile `surface`: distance of neighbouring points on a picture of 1,080 rows, in pixels, at most 1,024. Points that are
    /// closer than that on the screen of every view are not sent. 0 sends all points of the scene.
    pub quality: f32,
    /// Factor on a view's half-angle tangents within which points count as visible, 1 to 100.
    pub view_margin: f32,
    /// Table entries planned for each average cell, above 0 and at most 64 (paper, section 3.2: 4).
    pub table_slots: f32,
    /// Radius within which points count at a place, in Poisson-disk radii of the points, above 0 and at most 4. `None` is the
    /// best: 2.8 in profile `surface`, 1.5 times the distance of neighbours; 2.5 in profile `paper`. There it is `r` of
    /// Eq. 2, of which the paper (section 3.5) says "the average radius" of the elimination without its unit. Cells have an
    /// edge of 4, so the nearest 2 x 2 x 2 hold every point within 2; 2.5 gives the better pictures.
    pub kernel: Option<f32>,
    /// Block coder of the frames.
    pub coder: BlockCoder,
    /// Profile `surface`: how many bytes a frame may take, 64 or more. What does not fit goes later, what is near and in
    /// view first.
    pub budget: Option<Budget>,
    /// How many rays a frame may take, 1 or more; what is left over goes later, what is near and in view first. With it
    /// the AO of points that wait is behind the scene.
    pub ray_budget: Option<RayBudget>,
    /// Frames a second, above 0 and at most 1,000: announced to clients, and the step at which the clip is sampled for
    /// the grids.
    pub fps: f32,
    /// Frames that will be sent, 0 when that is open.
    pub frames_hint: u32,
    /// What is left out because it cannot change anything. The bytes are the same without; it is there to check and to
    /// measure that.
    pub shortcuts: Shortcuts,
    /// Most bytes for [`Shortcuts::SELF_HITS`]. What is kept beyond that is forgotten when the frame ends.
    pub ray_memory: u64,
}

impl Default for ServerSettings {
    /// Profile `surface` with its range coder; the rest is the paper's: 60 Hz, threshold 8/255.
    fn default() -> Self {
        Self {
            profile: Profile::SURFACE,
            geometry: GeometrySource::Sent,
            bits: 32,
            points: PointSettings::default(),
            ao: AoSettings::default(),
            threshold: 8,
            unseen_threshold: None,
            quality: 4.0,
            view_margin: 1.3,
            table_slots: 4.0,
            kernel: None,
            coder: BlockCoder::Range,
            budget: None,
            ray_budget: None,
            fps: 60.0,
            frames_hint: 0,
            shortcuts: Shortcuts::ALL,
            ray_memory: 256 << 20,
        }
    }
}

impl ServerSettings {
    setters! {
        const fn:
        with_profile: profile as Profile,
        with_geometry: geometry as GeometrySource,
        with_bits: bits as u8,
        with_points: points as PointSettings,
        with_ao: ao as AoSettings,
        with_threshold: threshold as u8,
        with_unseen_threshold: unseen_threshold as Option<u8>,
        with_quality: quality as f32,
        with_view_margin: view_margin as f32,
        with_table_slots: table_slots as f32,
        with_kernel: kernel as Option<f32>,
        with_coder: coder as BlockCoder,
        with_budget: budget as Option<Budget>,
        with_ray_budget: ray_budget as Option<RayBudget>,
        with_fps: fps as f32,
        with_frames_hint: frames_hint as u32,
        with_shortcuts: shortcuts as Shortcuts,
        with_ray_memory: ray_memory as u64,
    }

    /// Checks the ranges; those of [`PointSettings`] are checked when points are made.
    ///
    /// # Errors
    /// Names the first setting out of its range.
    pub fn validate(&self) -> Result<(), SettingsError> {
        self.ao.validate()?;
        if !matches!(self.profile, Profile::PAPER | Profile::SURFACE) {
            return Err(SettingsError::Profile { profile: self.profile });
        }
        self.precision()?;
        if self.threshold == 0 {
            return Err(SettingsError::Threshold);
        }
        if let Some(Budget { bytes, .. }) = self.budget {
            if self.profile == Profile::PAPER {
                return Err(SettingsError::BudgetProfile);
            }
            if bytes < LEAST_BUDGET {
                return Err(SettingsError::Budget { found: bytes });
            }
        }
        if self.ray_budget.is_some_and(|budget| budget.rays == 0) {
            return Err(SettingsError::RayBudget);
        }
        let within = |name, value: f32, low: f32, high: f32| {
            // Written so that NaN fails.
            if value >= low && value <= high {
                Ok(())
            } else {
                Err(SettingsError::Range { name, value, low, high })
            }
        };
        within("quality", self.quality, 0.0, 1024.0)?;
        within("view_margin", self.view_margin, 1.0, 100.0)?;
        within("table_slots", self.table_slots, f32::MIN_POSITIVE, 64.0)?;
        if let Some(kernel) = self.kernel {
            within("kernel", kernel, f32::MIN_POSITIVE, 4.0)?;
        }
        within("fps", self.fps, f32::MIN_POSITIVE, 1000.0)
    }

    /// Returns the threshold of points that no camera sees.
    #[must_use]
    pub fn unseen_threshold(&self) -> u8 {
        let usual = self.threshold.saturating_mul(8).min(MAX_USUAL_UNSEEN);
        self.unseen_threshold.unwrap_or(usual).max(self.threshold)
    }

    /// Returns the distance of points that views ask for, pixels; `None` if all points of the scene are sent.
    pub(super) fn levels_by_view(&self) -> Option<f32> {
        (self.profile == Profile::SURFACE && self.quality > 0.0).then_some(self.quality)
    }

    /// How finely points are rounded in profile `surface`.
    pub(super) fn precision(&self) -> Result<GeometryPrecision, SettingsError> {
        GeometryPrecision::of_bits(self.bits).ok_or(SettingsError::Bits { found: self.bits })
    }
}

/// Largest threshold of points that no camera sees, where none is asked for: a quarter of the range.
const MAX_USUAL_UNSEEN: u8 = 64;

/// Fewest bytes that a frame may have to do with: a header of some 40, and a few changes.
const LEAST_BUDGET: u32 = 64;

/// A setting out of its range.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SettingsError {
    /// AO settings.
    #[error(transparent)]
    Ao(#[from] AoError),
    /// Point settings.
    #[error(transparent)]
    Points(#[from] PointError),
    /// A profile that this version does not write.
    #[error("no stream of profile {profile} can be made: choose surface or paper")]
    Profile {
        /// As given.
        profile: Profile,
    },
    /// There is no packing of this width.
    #[error("bits is {found}: choose 32, 24 or 16")]
    Bits {
        /// As given.
        found: u8,
    },
    /// A threshold of zero would send every point in every frame.
    #[error("a threshold of 0 sends every point in every frame: choose 1 to 255")]
    Threshold,
    /// A budget that a header alone takes up.
    #[error(
        "a budget of {found} B a frame leaves no room for points beside the header: give {LEAST_BUDGET} B or more"
    )]
    Budget {
        /// Bytes as given.
        found: u32,
    },
    /// Nothing would ever be traced.
    #[error("a budget of 0 rays a frame: give 1 or more")]
    RayBudget,
    /// A budget for a profile in which points cannot wait.
    #[error(
        "profile paper takes no byte budget: a point that moves must be taken out of its old cell and put into its new one \
         in the same frame, so none can wait; choose profile surface"
    )]
    BudgetProfile,
    /// Another setting.
    #[error("{name} is {value}: choose {low} to {high}")]
    Range {
        /// Which setting.
        name: &'static str,
        /// As given.
        value: f32,
        /// Smallest possible.
        low: f32,
        /// Largest possible.
        high: f32,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_settings_out_of_range_and_names_them() {
        let good = ServerSettings::default();
        assert_eq!(good.validate(), Ok(()));
        assert_eq!(ServerSettings { threshold: 0, ..good }.validate(), Err(SettingsError::Threshold));
        for found in [0, 8, 31, 64] {
            let error = ServerSettings { bits: found, ..good }.validate();
            assert_eq!(error, Err(SettingsError::Bits { found }));
        }
        let budget = |bytes| Some(Budget::new(bytes).with_longest_age(0));
        assert_eq!(ServerSettings { budget: budget(64), ..good }.validate(), Ok(()));
        let refused = ServerSettings { budget: budget(63), ..good }.validate();
        assert_eq!(refused, Err(SettingsError::Budget { found: 63 }));
        let paper = ServerSettings { profile: Profile::PAPER, budget: budget(64), ..good };
        assert_eq!(paper.validate(), Err(SettingsError::BudgetProfile));
        let rays = |rays| Some(RayBudget { rays, longest_age: 0 });
        assert_eq!(ServerSettings { ray_budget: rays(1), ..good }.validate(), Ok(()));
        let refused = ServerSettings { ray_budget: rays(0), ..good }.validate();
        assert_eq!(refused, Err(SettingsError::RayBudget));
        let ao = AoSettings { rays: 0, ..good.ao };
        assert!(matches!(ServerSettings { ao, ..good }.validate(), Err(SettingsError::Ao(_))));
        let profile = Profile(9);
        let refused = ServerSettings { profile, ..good }.validate();
        assert_eq!(refused, Err(SettingsError::Profile { profile }));
        assert_eq!(ServerSettings { bits: 7, ..good }.validate(), Err(SettingsError::Bits { found: 7 }));
        for bad in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
            for (settings, field) in [
                (ServerSettings { view_margin: bad, ..good }, "view_margin"),
                (ServerSettings { table_slots: bad, ..good }, "table_slots"),
                (ServerSettings { kernel: Some(bad), ..good }, "kernel"),
                (ServerSettings { fps: bad, ..good }, "fps"),
            ] {
                let error = settings.validate().unwrap_err();
                assert!(matches!(error, SettingsError::Range { name, .. } if name == field), "{error}");
            }
        }
    }
}
