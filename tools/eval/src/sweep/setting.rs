//! Swept settings of a stream and their combinations.

use std::fmt;

use psao_codec::block::BlockCoder;
use psao_proto::Profile;
use psao_server::server::ServerSettings;
use serde::{Deserialize, Serialize};

/// Coder of profile `paper` in place of the range coder, which it does not support (paper, section 4).
const PAPER_CODER: BlockCoder = BlockCoder::Zstd { level: 15 };

/// Number of swept settings.
const AXES: usize = 9;

/// A combination of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Points per square metre.
    pub per_m2: f32,
    /// Distance of neighbouring points on a picture of 1,080 rows, pixels; 0 for all points. Profile `surface`.
    pub quality: f32,
    /// Bits of a packed point: 32, 24 or 16.
    pub bits: u8,
    /// Steps of 1/255 by which AO must change to be sent again.
    pub threshold: u8,
    /// Rays a point.
    pub rays: u32,
    /// Frames a second of the server.
    pub fps: f32,
    /// Block coder.
    pub coder: BlockCoder,
    /// Profile of the stream.
    pub profile: Profile,
    /// Milliseconds by which the server's camera is behind the client's.
    pub camera_lag_ms: u32,
}

impl Setting {
    /// Returns the defaults of the `psao` command, with the paper's lowest density (its Table 1).
    #[must_use]
    pub fn usual() -> Self {
        let settings = ServerSettings::default();
        Self {
            per_m2: 512.0,
            quality: settings.quality,
            bits: settings.bits,
            threshold: settings.threshold,
            rays: settings.ao.rays,
            fps: settings.fps,
            coder: settings.coder,
            profile: settings.profile,
            camera_lag_ms: 0,
        }
    }

    /// Returns the settings of a server: `base` with the swept values in place of its own.
    #[must_use]
    pub fn server(&self, base: ServerSettings) -> ServerSettings {
        let mut settings = base;
        settings.points = base.points.with_per_m2(self.per_m2);
        settings.quality = self.quality;
        settings.ao.rays = self.rays;
        settings.bits = self.bits;
        settings.threshold = self.threshold;
        settings.fps = self.fps;
        settings.coder = self.coder;
        settings.profile = self.profile;
        settings
    }

    /// Returns the setting as reports and files have it.
    #[must_use]
    pub fn summary(&self) -> SettingSummary {
        SettingSummary {
            profile: self.profile.to_string(),
            points_per_m2: self.per_m2,
            quality: if self.profile == Profile::SURFACE { self.quality } else { 0.0 },
            bits: self.bits,
            rays: self.rays,
            threshold: self.threshold,
            fps: self.fps,
            coder: match self.coder {
                BlockCoder::Stored => "none".to_owned(),
                BlockCoder::Lz4 => "lz4".to_owned(),
                BlockCoder::Zstd { level } => format!("zstd:{level}"),
                BlockCoder::Range => "range".to_owned(),
            },
            camera_lag_ms: self.camera_lag_ms,
        }
    }

    /// Returns the setting with a coder that its profile supports.
    fn possible(self) -> Self {
        if self.profile == Profile::PAPER && self.coder == BlockCoder::Range {
            return Self { coder: PAPER_CODER, ..self.uniform() };
        }
        if self.profile == Profile::PAPER { self.uniform() } else { self }
    }

    /// Returns the setting with all points everywhere: profile `paper` has no levels.
    fn uniform(self) -> Self {
        Self { quality: 0.0, ..self }
    }
}

/// A setting as reports and files have it; shown without its profile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettingSummary {
    /// `surface` or `paper`.
    pub profile: String,
    /// Points per square metre.
    pub points_per_m2: f32,
    /// Distance of neighbouring points on a picture of 1,080 rows, pixels; 0 where all points are sent.
    #[serde(default)]
    pub quality: f32,
    /// Bits of a packed point.
    pub bits: u8,
    /// Rays a point.
    pub rays: u32,
    /// Steps of 1/255.
    pub threshold: u8,
    /// Frames a second.
    pub fps: f32,
    /// `range`, `zstd:LEVEL`, `lz4` or `none`.
    pub coder: String,
    /// Milliseconds by which the server's camera is behind the client's.
    #[serde(default)]
    pub camera_lag_ms: u32,
}

impl fmt::Display for SettingSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.quality > 0.0 {
            write!(f, "{} px, at most ", self.quality)?;
        }
        write!(
            f,
            "{}/m\u{b2}, {} bit, {} rays, threshold {}, {} Hz, {}{}",
            self.points_per_m2,
            self.bits,
            self.rays,
            self.threshold,
            self.fps,
            self.coder,
            camera_lag(self.camera_lag_ms)
        )
    }
}

/// Returns how late the server's camera is, as the end of a label; empty where it is not.
pub(crate) fn camera_lag(ms: u32) -> String {
    if ms == 0 { String::new() } else { format!(", camera {ms} ms late") }
}

/// The values of each axis. An empty axis stands for the usual value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SettingGrid {
    /// Points per square metre.
    pub per_m2: Vec<f32>,
    /// Distances of neighbouring points on a picture of 1,080 rows, pixels.
    pub quality: Vec<f32>,
    /// Bits of a packed point.
    pub bits: Vec<u8>,
    /// Thresholds.
    pub threshold: Vec<u8>,
    /// Rays a point.
    pub rays: Vec<u32>,
    /// Frames a second.
    pub fps: Vec<f32>,
    /// Block coders.
    pub coder: Vec<BlockCoder>,
    /// Profiles.
    pub profile: Vec<Profile>,
    /// Milliseconds by which the server's camera is behind the client's.
    pub camera_lag_ms: Vec<u32>,
}

impl SettingGrid {
    /// Returns the usual value on each axis that has it or is empty, and the first value on each other axis.
    #[must_use]
    pub fn centre(&self) -> Setting {
        fn of<T: Copy + PartialEq>(values: &[T], usual: T) -> T {
            if values.contains(&usual) { usual } else { values.first().copied().unwrap_or(usual) }
        }
        let usual = Setting::usual();
        Setting {
            per_m2: of(&self.per_m2, usual.per_m2),
            quality: of(&self.quality, usual.quality),
            bits: of(&self.bits, usual.bits),
            threshold: of(&self.threshold, usual.threshold),
            rays: of(&self.rays, usual.rays),
            fps: of(&self.fps, usual.fps),
            coder: of(&self.coder, usual.coder),
            profile: of(&self.profile, usual.profile),
            camera_lag_ms: of(&self.camera_lag_ms, usual.camera_lag_ms),
        }
        .possible()
    }

    /// Returns the centre, then the settings that differ from it on one axis.
    #[must_use]
    pub fn one_at_a_time(&self) -> Vec<Setting> {
        let centre = self.centre();
        distinct(std::iter::once(centre).chain(self.variants(&centre).into_iter().flatten()))
    }

    /// Returns every combination, the centre first.
    #[must_use]
    pub fn full(&self) -> Vec<Setting> {
        let mut settings = vec![self.centre()];
        for axis in 0..AXES {
            let varied = |setting: &Setting| std::mem::take(&mut self.variants(setting)[axis]);
            let varied: Vec<Setting> = settings.iter().flat_map(varied).collect();
            if !varied.is_empty() {
                settings = varied;
            }
        }
        distinct(std::iter::once(self.centre()).chain(settings))
    }

    /// Returns the fastest rate in frames a second.
    #[must_use]
    pub fn fastest(&self) -> f32 {
        self.fps.iter().copied().fold(self.centre().fps, f32::max)
    }

    /// Returns for each axis the settings that have its values in place of `from`'s.
    fn variants(&self, from: &Setting) -> [Vec<Setting>; AXES] {
        [
            self.per_m2.iter().map(|&per_m2| Setting { per_m2, ..*from }).collect(),
            self.quality.iter().map(|&quality| Setting { quality, ..*from }).collect(),
            self.bits.iter().map(|&bits| Setting { bits, ..*from }).collect(),
            self.threshold.iter().map(|&threshold| Setting { threshold, ..*from }).collect(),
            self.rays.iter().map(|&rays| Setting { rays, ..*from }).collect(),
            self.fps.iter().map(|&fps| Setting { fps, ..*from }).collect(),
            self.coder.iter().map(|&coder| Setting { coder, ..*from }).collect(),
            self.profile.iter().map(|&profile| Setting { profile, ..*from }).collect(),
            self.camera_lag_ms.iter().map(|&camera_lag_ms| Setting { camera_lag_ms, ..*from }).collect(),
        ]
    }
}

/// Returns the settings with supported coders, each once, in the order of their first mention.
fn distinct(settings: impl IntoIterator<Item = Setting>) -> Vec<Setting> {
    let mut found: Vec<Setting> = Vec::new();
    for setting in settings.into_iter().map(Setting::possible) {
        if !found.contains(&setting) {
            found.push(setting);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> SettingGrid {
        SettingGrid {
            per_m2: vec![256.0, 512.0],
            threshold: vec![2, 4, 16],
            profile: vec![Profile::SURFACE, Profile::PAPER],
            coder: vec![BlockCoder::Range, PAPER_CODER],
            ..SettingGrid::default()
        }
    }

    #[test]
    fn the_centre_is_usual_where_it_can_be() {
        let centre = grid().centre();
        assert_eq!((centre.per_m2, centre.threshold, centre.rays), (512.0, 2, 192));
        assert_eq!(SettingGrid::default().one_at_a_time(), [Setting::usual()]);
    }

    #[test]
    fn one_at_a_time_differs_from_the_centre_on_one_axis() {
        let (settings, centre) = (grid().one_at_a_time(), grid().centre());
        assert_eq!(settings.len(), 1 + 1 + 2 + 1 + 1);
        for setting in &settings[1..] {
            let paper = setting.profile == Profile::PAPER; // which takes a coder of its own
            let differing = [
                setting.per_m2 != centre.per_m2,
                setting.threshold != centre.threshold,
                setting.coder != centre.coder && !paper,
                paper,
            ];
            assert_eq!(differing.iter().filter(|differs| **differs).count(), 1, "{setting:?}");
        }
    }

    #[test]
    fn the_full_grid_has_every_possible_combination_once() {
        let settings = grid().full();
        assert_eq!(settings[0], grid().centre());
        // Surface has either coder, paper one.
        assert_eq!(settings.len(), 2 * 3 * 3);
        let paper = settings.iter().filter(|setting| setting.profile == Profile::PAPER);
        assert!(paper.clone().all(|setting| setting.coder == PAPER_CODER) && paper.count() == 6);
    }
}
