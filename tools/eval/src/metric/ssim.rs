//! Structural similarity: Wang, Bovik, Sheikh, Simoncelli, *Image Quality Assessment: From Error Visibility to
//! Structural Similarity* (2004).
//!
//! Variants of the metric differ by a tenth. This is the authors' own. It has Gaussian windows of 11 x 11 taps with a
//! standard deviation of 1.5 pixels, population variances and covariance, `K1 = 0.01` and `K2 = 0.03`. The result is
//! the mean over the windows that lie entirely in the image.

use iqa::{Image, SsimOptions};
use psao_reconstruct::AoImage;

use super::{MetricError, size_of_at_least};

/// Width and height of a window in pixels.
pub const WINDOW: u32 = 11;

/// Returns the mean structural similarity, in `[-1, 1]`; 1 for equal images, higher is better. AO is rounded to 16
/// bits.
///
/// # Errors
///
/// [`MetricError::Size`] when the images differ in size, [`MetricError::TooSmall`] below [`WINDOW`] pixels a side.
pub fn ssim(reference: &AoImage, test: &AoImage) -> Result<f64, MetricError> {
    let size = size_of_at_least("SSIM", WINDOW, reference, test)?;
    let refused =
        |error: iqa::Error| MetricError::Refused { metric: "SSIM", size, reason: error.to_string() };
    let grey = |image: &AoImage| {
        let samples = image.values().iter().map(|value| (value * 65_535.0 + 0.5) as u16).collect();
        Image::gray16(size.width(), size.height(), samples).map_err(refused)
    };
    iqa::ssim(&grey(reference)?, &grey(test)?, SsimOptions::default()).map_err(refused)
}
