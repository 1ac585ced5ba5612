//! The error figures of Timonen, *Screen-Space Far-Field Ambient Obscurance* (2013), section 8.
//!
//! `e_A` is the average variation of a pixel from the traced value, which is [`mae`](super::mae). `e_<5%` is the share
//! of the pixels within 5 % of it. Both refer to the whole range of AO, not to the traced value.

use psao_reconstruct::AoImage;

use super::error::differences;
use super::{MetricError, SizeMismatchError};

/// Error below which a pixel counts as right: 5 % of the range.
pub const RIGHT_BELOW: f64 = 0.05;

/// Error from which [`error_map`] is black: 20 % of the range (Timonen 2013, figure 7).
pub const BLACK_FROM: f64 = 0.2;

/// Returns `e_<5%`: the share of the pixels with an error below [`RIGHT_BELOW`], in `[0, 1]`; higher is better.
///
/// # Errors
///
/// [`SizeMismatchError`] when the images are not of one size.
pub fn share_right(reference: &AoImage, test: &AoImage) -> Result<f64, SizeMismatchError> {
    let right = differences(reference, test)?.filter(|error| error.abs() < RIGHT_BELOW).count();
    Ok(right as f64 / reference.values().len() as f64)
}

/// Returns the error of each pixel as grey: white is no error, black is [`BLACK_FROM`] or more (Timonen 2013, figure
/// 7).
///
/// # Errors
///
/// [`MetricError::Size`] when the images differ in size.
pub fn error_map(reference: &AoImage, test: &AoImage) -> Result<AoImage, MetricError> {
    let grey = |error: f64| (1.0 - error.abs() / BLACK_FROM).max(0.0) as f32;
    let values = differences(reference, test)?.map(grey).collect();
    let size = reference.size();
    AoImage::new(size, values).map_err(|error| MetricError::Refused {
        metric: "the error map",
        size,
        reason: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use psao_reconstruct::Size;

    use super::*;

    fn image(values: &[f32]) -> AoImage {
        AoImage::new(Size::new(values.len() as u32, 1).unwrap(), values.to_vec()).unwrap()
    }

    #[test]
    fn a_pixel_is_right_below_a_twentieth_of_the_range() {
        let (reference, test) = (image(&[0.5, 0.5, 0.5, 0.0]), image(&[0.5, 0.54, 0.44, 0.0625]));
        assert_eq!(share_right(&reference, &test).unwrap(), 0.5);
    }

    #[test]
    fn the_map_goes_from_white_to_black_at_a_fifth_of_the_range() {
        let map = error_map(&image(&[0.0, 0.5, 0.5, 1.0]), &image(&[0.0, 0.6, 0.4, 0.0])).unwrap();
        let expected = [1.0, 0.5, 0.5, 0.0];
        assert!(map.values().iter().zip(expected).all(|(v, e)| (v - e).abs() < 1e-6), "{:?}", map.values());
    }
}
