//! FLIP: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, *FLIP: A Difference Evaluator for
//! Alternating Images* (2020), for images of low dynamic range.
//!
//! AO counts as the sRGB grey of [`Picture::grey`](psao_reconstruct::picture::Picture::grey). The viewer sees
//! [`flip_rs::DEFAULT_PPD`] pixels a degree, about 67. That is a monitor 0.7 m wide with 3840 pixels across, 0.7 m
//! away.

use flip_rs::{DEFAULT_PPD, FlipError, RgbImage, ldr_flip};
use psao_reconstruct::AoImage;

use super::{MetricError, equal_size};

/// Returns the mean FLIP error, in `[0, 1]`; 0 for equal images, lower is better.
///
/// # Errors
///
/// [`MetricError::Size`] when the images differ in size, [`MetricError::Refused`] when memory runs out.
pub fn flip(reference: &AoImage, test: &AoImage) -> Result<f64, MetricError> {
    let map = flip_map(reference, test)?;
    Ok(map.iter().copied().map(f64::from).sum::<f64>() / map.len() as f64)
}

/// Returns the FLIP error of each pixel, in `[0, 1]`, row by row from the top left.
///
/// # Errors
///
/// Those of [`flip`].
pub fn flip_map(reference: &AoImage, test: &AoImage) -> Result<Vec<f32>, MetricError> {
    let size = equal_size(reference, test)?;
    let refused = |error: FlipError| MetricError::Refused { metric: "FLIP", size, reason: error.to_string() };
    let rgb = |image: &AoImage| {
        let pixels = image.values().iter().flat_map(|&value| [value; 3]).collect();
        RgbImage::new(size.width() as usize, size.height() as usize, pixels).map_err(refused)
    };
    let map = ldr_flip(&rgb(reference)?, &rgb(test)?, DEFAULT_PPD).map_err(refused)?;
    Ok(map.into_pixels())
}
