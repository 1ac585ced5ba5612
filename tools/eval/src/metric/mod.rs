//! Metrics of the difference between an image and its reference.
//!
//! | figure | range | better | meaning |
//! |---|---|---|---|
//! | [`Comparison::mae`], the `e_A` of Timonen (2013) | 0 to 1 | lower | mean error |
//! | [`Comparison::rmse`] | 0 to 1 | lower | as `mae`, but large errors count more |
//! | [`Comparison::psnr`] | dB, from 0 | higher | `rmse` on a logarithmic scale |
//! | [`Comparison::bias`] | -1 to 1 | near 0 | too bright above 0, too dark below |
//! | [`Comparison::p99`], [`Comparison::max`] | 0 to 1 | lower | the worst pixels |
//! | [`Comparison::within_5`], the `e_<5%` of Timonen (2013) | 0 to 1 | higher | share of pixels with an error below 5 % |
//! | [`ssim`](mod@ssim) | -1 to 1 | higher | structure in windows of 11 pixels |
//! | [`flip`](mod@flip) | 0 to 1 | lower | visible difference when the two images alternate |
//! | [`Lpips`] | from 0 | lower | distance of the features of a trained network |
//!
//! All figures are over every pixel of the picture. That includes the background, which is open in both images. The
//! figures of [`Comparison`] take one pass; those of [`PerceptualFigures`] take up to seconds for a large picture. FLIP
//! detects that a whole picture is too dark, LPIPS hardly does. Structural similarity is most sensitive to noise.
//!
//! Sums are in f64 over the pixels in row order, so a figure does not depend on the number of threads.

mod error;
pub mod flip;
mod lpips;
pub mod obscurance;
#[cfg(test)]
mod shared;
pub mod ssim;

use psao_reconstruct::{AoImage, Size};

pub use self::error::{Comparison, mae, psnr, rmse};
pub use self::lpips::{Lpips, WeightsError};

/// Error of comparing two images of different sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the reference has {reference} pixels and the image under test {test}; compare images of equal size")]
pub struct SizeMismatchError {
    /// Size of the reference.
    pub reference: Size,
    /// Size of the image under test.
    pub test: Size,
}

/// Error of a metric.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MetricError {
    /// The images differ in size.
    #[error(transparent)]
    Size(#[from] SizeMismatchError),
    /// The windows of a metric do not fit into the images.
    #[error("{metric} needs images of at least {least} x {least} pixels, not {size}")]
    TooSmall {
        /// Name of the metric.
        metric: &'static str,
        /// Size of the images.
        size: Size,
        /// Smallest possible side in pixels.
        least: u32,
    },
    /// The library behind a metric refused the images.
    #[error("{metric} refused images of {size} pixels: {reason}")]
    Refused {
        /// Name of the metric.
        metric: &'static str,
        /// Size of the images.
        size: Size,
        /// The library's error text.
        reason: String,
    },
}

/// Figures of metrics that model human vision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerceptualFigures {
    /// Structural similarity, see [`ssim`](mod@ssim); `None` for images below [`ssim::WINDOW`] pixels a side.
    pub ssim: Option<f64>,
    /// Mean FLIP error, see [`flip`](mod@flip).
    pub flip: f64,
    /// LPIPS distance; `None` without a network, and for images below [`Lpips::MIN_SIDE`] pixels a side.
    pub lpips: Option<f64>,
}

impl PerceptualFigures {
    /// Compares `test` with `reference`. LPIPS needs a network.
    ///
    /// # Errors
    ///
    /// [`MetricError::Size`] when the images differ in size, [`MetricError::Refused`] when FLIP runs out of memory.
    pub fn new(reference: &AoImage, test: &AoImage, network: Option<&Lpips>) -> Result<Self, MetricError> {
        Ok(Self {
            ssim: if_large_enough(ssim::ssim(reference, test))?,
            flip: flip::flip(reference, test)?,
            lpips: match network {
                Some(network) => if_large_enough(network.distance(reference, test))?,
                None => None,
            },
        })
    }
}

fn if_large_enough(figure: Result<f64, MetricError>) -> Result<Option<f64>, MetricError> {
    match figure {
        Ok(figure) => Ok(Some(figure)),
        Err(MetricError::TooSmall { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Returns the common size of both images.
fn equal_size(reference: &AoImage, test: &AoImage) -> Result<Size, SizeMismatchError> {
    if reference.size() == test.size() {
        Ok(reference.size())
    } else {
        Err(SizeMismatchError { reference: reference.size(), test: test.size() })
    }
}

/// Returns the common size of both images, which must be at least `least` pixels a side.
fn size_of_at_least(
    metric: &'static str,
    least: u32,
    reference: &AoImage,
    test: &AoImage,
) -> Result<Size, MetricError> {
    let size = equal_size(reference, test)?;
    if size.width().min(size.height()) < least {
        return Err(MetricError::TooSmall { metric, size, least });
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: u32, height: u32, value: f32) -> AoImage {
        let size = Size::new(width, height).unwrap();
        AoImage::new(size, vec![value; size.pixels()]).unwrap()
    }

    #[test]
    fn equal_images_are_perceived_as_equal() {
        let found = PerceptualFigures::new(&grey(16, 12, 0.5), &grey(16, 12, 0.5), None).unwrap();
        assert_eq!(found, PerceptualFigures { ssim: Some(1.0), flip: 0.0, lpips: None });
    }

    #[test]
    fn images_too_small_for_a_window_have_the_other_figures() {
        let found = PerceptualFigures::new(&grey(10, 30, 1.0), &grey(10, 30, 0.0), None).unwrap();
        assert_eq!(found.ssim, None);
        assert!(found.flip > 0.9);
        let refused = ssim::ssim(&grey(10, 30, 1.0), &grey(10, 30, 0.0)).unwrap_err();
        assert!(matches!(refused, MetricError::TooSmall { least: 11, .. }), "{refused}");
    }

    #[test]
    fn sizes_must_agree_even_if_the_pixels_do() {
        let (a, b) = (grey(20, 30, 0.0), grey(30, 20, 0.0));
        assert!(matches!(PerceptualFigures::new(&a, &b, None), Err(MetricError::Size(_))));
        assert!(flip::flip(&a, &b).is_err() && obscurance::error_map(&a, &b).is_err());
    }
}
