//! Results of a measured setting or method. `docs/evaluate-json.md` of the repository describes the fields in files.

use serde::{Deserialize, Serialize};

use super::SettingSummary;
use crate::metric::{Comparison, PerceptualFigures};
use crate::screen::Sampling;

/// Kind of a record: a stream, or a method without a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordKind {
    /// A stream of points.
    Stream,
    /// A screen-space method: it uses the picture's own depth and normals.
    Screen,
    /// A texture-space stream: an atlas of texels as video.
    Texture,
    /// Cloud rendering: the picture itself as video.
    Cloud,
}

/// Results of one setting or method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Digest of everything that the figures depend on.
    pub key: String,
    /// Name of the scene.
    pub scene: String,
    /// Kind of what was measured.
    pub kind: RecordKind,
    /// Name of the profile or the method.
    pub name: String,
    /// The settings in words.
    pub label: String,
    /// The setting of a stream.
    pub setting: Option<SettingSummary>,
    /// Errors over all pictures.
    pub error: ErrorFigures,
    /// Figures of each picture.
    pub pictures: Vec<PictureFigures>,
    /// Milliseconds that a client takes for the AO of a picture. For a stream they cover applying a frame and
    /// reconstruction, for a method all stages.
    pub picture_ms: Spread,
    /// Times of the stages, those of the server first.
    pub stages: Vec<StageTime>,
    /// Figures of a stream.
    pub stream: Option<StreamFigures>,
    /// Sizes of working sets.
    pub memory: MemoryFigures,
}

impl Record {
    /// Returns the name and the settings.
    #[must_use]
    pub fn title(&self) -> String {
        format!("{}: {}", self.name, self.label)
    }
}

/// A record of a sweep over several radii.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RecordAtRadius<'a> {
    /// The record.
    #[serde(flatten)]
    pub record: &'a Record,
    /// Radius of the reference and of the measured method, in metres.
    pub radius_m: f32,
    /// Length of the radius in pixels, where settings depend on it ([`reach_px`](super::reach_px())).
    pub reach_px: Option<f32>,
    /// Samples of a method that reads a fixed number of them.
    pub sampling: Option<Sampling>,
}

impl RecordAtRadius<'_> {
    /// Returns the milliseconds of all client stages except the blur.
    #[must_use]
    pub fn ms_without_blur(&self) -> f64 {
        let stages = self.record.stages.iter();
        stages
            .filter(|stage| stage.side == "client" && stage.name != "blur")
            .map(|stage| stage.ms.median)
            .sum()
    }
}

/// Errors against the reference, see [`crate::metric`] for the ranges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorFigures {
    /// Mean absolute error, `e_A`.
    pub mae: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// PSNR in dB; `None` for equal pictures.
    pub psnr_db: Option<f64>,
    /// Mean of picture minus reference.
    pub bias: f64,
    /// Error that 99 % of the pixels do not exceed.
    pub p99: f64,
    /// The largest error.
    pub max: f64,
    /// Share of the pixels within 5 %, `e_<5%`.
    pub within_5: f64,
    /// Structural similarity; `None` for pictures too small for a window.
    pub ssim: Option<f64>,
    /// Mean FLIP error.
    pub flip: f64,
    /// LPIPS distance; `None` without a network.
    pub lpips: Option<f64>,
}

impl ErrorFigures {
    /// Makes the figures of one picture.
    #[must_use]
    pub fn new(error: &Comparison, perceived: &PerceptualFigures) -> Self {
        Self {
            mae: error.mae,
            rmse: error.rmse,
            psnr_db: Some(error.psnr).filter(|psnr| psnr.is_finite()),
            bias: error.bias,
            p99: error.p99,
            max: error.max,
            within_5: error.within_5,
            ssim: perceived.ssim,
            flip: perceived.flip,
            lpips: perceived.lpips,
        }
    }

    /// Pools the figures of several pictures of equal size; `None` without pictures.
    ///
    /// RMSE and PSNR are those of all pixels together. P99 and maximum are the largest. All other figures are means.
    #[must_use]
    pub fn pooled(pictures: &[Self]) -> Option<Self> {
        let first = pictures.first()?;
        let count = pictures.len() as f64;
        let mean = |of: &dyn Fn(&Self) -> f64| pictures.iter().map(of).sum::<f64>() / count;
        let mean_of_some = |of: &dyn Fn(&Self) -> Option<f64>| {
            let sum: Option<f64> = pictures.iter().map(of).sum();
            sum.map(|sum| sum / count)
        };
        let largest = |of: &dyn Fn(&Self) -> f64| pictures.iter().map(of).fold(0.0, f64::max);
        let mean_square = mean(&|figures| figures.rmse * figures.rmse);
        Some(Self {
            mae: mean(&|figures| figures.mae),
            rmse: mean_square.sqrt(),
            psnr_db: (mean_square > 0.0).then(|| -10.0 * libm::log10(mean_square)),
            bias: mean(&|figures| figures.bias),
            p99: largest(&|figures| figures.p99),
            max: largest(&|figures| figures.max),
            within_5: mean(&|figures| figures.within_5),
            ssim: first.ssim.and_then(|_| mean_of_some(&|figures| figures.ssim)),
            flip: mean(&|figures| figures.flip),
            lpips: first.lpips.and_then(|_| mean_of_some(&|figures| figures.lpips)),
        })
    }
}

/// Figures of one picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureFigures {
    /// Time in the clip, in seconds.
    pub time_s: f64,
    /// Share of the fragments that no point supports; 0 for a method.
    pub unsupported: f64,
    /// Its errors.
    #[serde(flatten)]
    pub error: ErrorFigures,
}

/// Quartiles of the samples of a figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Half of the samples are at most this large.
    pub median: f64,
    /// A quarter of the samples are at most this large.
    pub low: f64,
    /// Three quarters of the samples are at most this large.
    pub high: f64,
    /// Number of samples; 0 when there is no figure.
    pub samples: u64,
}

impl Spread {
    /// Returns the quartiles of finite samples in any order.
    #[must_use]
    pub fn of(mut samples: Vec<f64>) -> Self {
        samples.sort_by(f64::total_cmp);
        let quantile = |numerator: usize| {
            let rank = (samples.len() * numerator).div_ceil(4).max(1) - 1;
            samples.get(rank).copied().unwrap_or(0.0)
        };
        Self { median: quantile(2), low: quantile(1), high: quantile(3), samples: samples.len() as u64 }
    }

    /// Returns the quartiles of times in microseconds, in milliseconds.
    #[must_use]
    pub fn of_micros(samples: &[u64]) -> Self {
        Self::of(samples.iter().map(|&micros| micros as f64 / 1e3).collect())
    }
}

/// Times of one stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// `server` or `client`.
    pub side: String,
    /// Its name.
    pub name: String,
    /// Milliseconds a frame, or a picture.
    pub ms: Spread,
}

/// Size and times of a stream. Bytes are the same on any machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamFigures {
    /// Frames of the clip, the first state included.
    pub frames: u32,
    /// Points of all instances.
    pub points: u32,
    /// Wire bytes of the scene table.
    pub scene_table_bytes: u64,
    /// Wire bytes of the first frame.
    pub first_state_bytes: u64,
    /// Wire bytes of the later frames.
    pub later_bytes: u64,
    /// Points sent in later frames.
    pub changed_points: u64,
    /// Mbit/s of later frames as the paper counts: blocks that hold points.
    pub paper_mbit_s: f64,
    /// Mbit/s of later frames, everything counted.
    pub wire_mbit_s: f64,
    /// Milliseconds of the server's first frame, all stages, in the first run.
    pub first_frame_ms: f64,
    /// Milliseconds of the server's later frames, all stages.
    pub server_ms: Spread,
}

/// Bytes of working sets, computed from their contents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MemoryFigures {
    /// The client's input for a picture: the G-buffer, or depth and normals with their guard band.
    pub picture_bytes: u64,
    /// The client's state of a stream, written without compression.
    pub state_bytes: Option<u64>,
    /// The largest frame body of a stream.
    pub largest_frame_bytes: Option<u64>,
    /// Memory that a method allocates besides, by its own count.
    pub working_bytes: Option<u64>,
    /// Memory of a stream's server after the last frame, see [`psao_server::server::ServerMemory`].
    pub server_bytes: Option<u64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(mae: f64, rmse: f64, lpips: Option<f64>) -> ErrorFigures {
        let psnr_db = (rmse > 0.0).then(|| -20.0 * libm::log10(rmse));
        ErrorFigures {
            mae,
            rmse,
            psnr_db,
            bias: mae,
            p99: rmse,
            max: rmse,
            within_5: 1.0 - mae,
            ssim: Some(1.0),
            flip: mae,
            lpips,
        }
    }

    #[test]
    fn pooled_figures_are_those_of_all_pixels() {
        let pooled =
            ErrorFigures::pooled(&[figures(0.1, 0.3, Some(0.2)), figures(0.0, 0.4, Some(0.4))]).unwrap();
        assert!((pooled.mae - 0.05).abs() < 1e-12 && (pooled.rmse - 0.125_f64.sqrt()).abs() < 1e-12);
        assert!((pooled.psnr_db.unwrap() - 9.0309).abs() < 1e-4, "{pooled:?}");
        assert_eq!((pooled.p99, pooled.max, pooled.ssim), (0.4, 0.4, Some(1.0)));
        assert!((pooled.lpips.unwrap() - 0.3).abs() < 1e-12);
        assert_eq!(ErrorFigures::pooled(&[figures(0.0, 0.0, None)]).unwrap().psnr_db, None);
        assert_eq!(ErrorFigures::pooled(&[]), None);
    }

    #[test]
    fn a_spread_is_of_the_sorted_samples() {
        let spread = Spread::of(vec![4.0, 1.0, 3.0, 2.0]);
        assert_eq!((spread.low, spread.median, spread.high, spread.samples), (1.0, 2.0, 3.0, 4));
        assert_eq!(Spread::of_micros(&[1500]).median, 1.5);
        assert_eq!(Spread::of(Vec::new()), Spread::default());
    }
}
