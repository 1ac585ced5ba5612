//! Errors of single pixels: their means, quantiles and maximum.

use psao_reconstruct::AoImage;

use super::{SizeMismatchError, equal_size, obscurance};

/// All error figures of a pair of images. The unit is AO; 1 is the whole range from closed to open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Mean absolute error, in `[0, 1]`; the `e_A` of [`obscurance`].
    pub mae: f64,
    /// Root of the mean squared error, in `[0, 1]`, at least `mae`.
    pub rmse: f64,
    /// Peak signal-to-noise ratio in dB, at least 0 for values in `[0, 1]`; infinite for equal images.
    pub psnr: f64,
    /// Mean of `test - reference`, in `[-1, 1]`; above 0 the test is too bright.
    pub bias: f64,
    /// The absolute error that at least 99 % of the pixels do not exceed, in `[0, 1]`.
    pub p99: f64,
    /// The largest absolute error, in `[0, 1]`.
    pub max: f64,
    /// Share of the pixels whose absolute error is below 5 % of the range, in `[0, 1]`; the `e_<5%` of [`obscurance`].
    pub within_5: f64,
}

impl Comparison {
    /// Compares `test` with `reference`.
    ///
    /// # Errors
    ///
    /// [`SizeMismatchError`] when the images are not of one size.
    ///
    /// ```
    /// use psao_reconstruct::{AoImage, Size};
    /// use psao_eval::metric::Comparison;
    ///
    /// let size = Size::new(2, 1)?;
    /// let reference = AoImage::new(size, vec![0.5, 1.0])?;
    /// let test = AoImage::new(size, vec![0.5, 0.9])?;
    /// let found = Comparison::new(&reference, &test)?;
    /// assert!((found.mae - 0.05).abs() < 1e-7 && (found.max - 0.1).abs() < 1e-7);
    /// assert!((found.psnr - 23.0103).abs() < 1e-4); // 10 log10(1 / 0.005)
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn new(reference: &AoImage, test: &AoImage) -> Result<Self, SizeMismatchError> {
        let mut errors = differences(reference, test)?.collect::<Vec<_>>();
        let count = errors.len() as f64;
        let bias = errors.iter().sum::<f64>() / count;
        let mean_square = errors.iter().map(|e| e * e).sum::<f64>() / count;
        for error in &mut errors {
            *error = error.abs();
        }
        let mae = errors.iter().sum::<f64>() / count;
        let right = errors.iter().filter(|error| **error < obscurance::RIGHT_BELOW).count();
        // The lowest rank that leaves at most 1 % of the pixels above it.
        let rank = (errors.len() * 99).div_ceil(100) - 1;
        let (_, p99, _) = errors.select_nth_unstable_by(rank, f64::total_cmp);
        let p99 = *p99;
        let max = errors.iter().copied().fold(0.0, f64::max);
        Ok(Self {
            mae,
            rmse: mean_square.sqrt(),
            psnr: decibels(mean_square),
            bias,
            p99,
            max,
            within_5: right as f64 / count,
        })
    }
}

/// Returns the mean absolute error, in `[0, 1]`.
///
/// # Errors
///
/// [`SizeMismatchError`] when the images are not of one size.
pub fn mae(reference: &AoImage, test: &AoImage) -> Result<f64, SizeMismatchError> {
    let sum: f64 = differences(reference, test)?.map(f64::abs).sum();
    Ok(sum / reference.values().len() as f64)
}

/// Returns the root of the mean squared error, in `[0, 1]`.
///
/// # Errors
///
/// [`SizeMismatchError`] when the images are not of one size.
pub fn rmse(reference: &AoImage, test: &AoImage) -> Result<f64, SizeMismatchError> {
    Ok(mean_square(reference, test)?.sqrt())
}

/// Returns the peak signal-to-noise ratio in dB, `10 log10(1 / MSE)` with a peak of 1.0; infinite for equal images.
///
/// # Errors
///
/// [`SizeMismatchError`] when the images are not of one size.
pub fn psnr(reference: &AoImage, test: &AoImage) -> Result<f64, SizeMismatchError> {
    Ok(decibels(mean_square(reference, test)?))
}

fn mean_square(reference: &AoImage, test: &AoImage) -> Result<f64, SizeMismatchError> {
    let sum: f64 = differences(reference, test)?.map(|e| e * e).sum();
    Ok(sum / reference.values().len() as f64)
}

fn decibels(mean_square: f64) -> f64 {
    if mean_square == 0.0 { f64::INFINITY } else { -10.0 * libm::log10(mean_square) }
}

/// Returns `test - reference` of each pixel, in row order.
pub(super) fn differences<'a>(
    reference: &'a AoImage,
    test: &'a AoImage,
) -> Result<impl Iterator<Item = f64> + 'a, SizeMismatchError> {
    equal_size(reference, test)?;
    Ok(reference.values().iter().zip(test.values()).map(|(r, t)| f64::from(*t) - f64::from(*r)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use psao_reconstruct::Size;

    use super::*;

    fn image(width: u32, height: u32, values: Vec<f32>) -> AoImage {
        AoImage::new(Size::new(width, height).unwrap(), values).unwrap()
    }

    #[test]
    fn equal_images_have_no_error_and_infinite_psnr() {
        let a = image(2, 2, vec![0.0, 0.25, 0.5, 1.0]);
        let found = Comparison::new(&a, &a).unwrap();
        assert_eq!(
            found,
            Comparison {
                mae: 0.0,
                rmse: 0.0,
                psnr: f64::INFINITY,
                bias: 0.0,
                p99: 0.0,
                max: 0.0,
                within_5: 1.0
            }
        );
    }

    #[test]
    fn black_against_white_is_the_worst_there_is() {
        let found = Comparison::new(&image(3, 1, vec![0.0; 3]), &image(3, 1, vec![1.0; 3])).unwrap();
        assert_eq!(
            found,
            Comparison { mae: 1.0, rmse: 1.0, psnr: 0.0, bias: 1.0, p99: 1.0, max: 1.0, within_5: 0.0 }
        );
    }

    #[test]
    fn p99_leaves_one_pixel_in_a_hundred_above() {
        let black = |n: u32| image(n, 1, vec![0.0; n as usize]);
        let with_spikes = |n: u32, spikes: usize| {
            let mut values = vec![0.25; n as usize];
            values[..spikes].fill(1.0);
            image(n, 1, values)
        };
        assert_eq!(Comparison::new(&black(200), &with_spikes(200, 2)).unwrap().p99, 0.25);
        assert_eq!(Comparison::new(&black(200), &with_spikes(200, 3)).unwrap().p99, 1.0);
        assert_eq!(Comparison::new(&black(1), &with_spikes(1, 1)).unwrap().p99, 1.0, "one pixel has no tail");
    }

    #[test]
    fn sizes_must_agree_even_if_the_pixels_do() {
        let (a, b) = (image(2, 3, vec![0.0; 6]), image(3, 2, vec![0.0; 6]));
        assert!(mae(&a, &b).is_err() && rmse(&a, &b).is_err() && psnr(&a, &b).is_err());
        let error = Comparison::new(&a, &b).unwrap_err();
        assert_eq!(error, SizeMismatchError { reference: a.size(), test: b.size() });
    }

    proptest! {
        #[test]
        fn one_pass_and_single_figures_agree(pixels in prop::collection::vec((0.0_f32..=1.0, 0.0_f32..=1.0), 1..300)) {
            let (r, t): (Vec<_>, Vec<_>) = pixels.into_iter().unzip();
            let width = u32::try_from(r.len()).unwrap();
            let (r, t) = (image(width, 1, r), image(width, 1, t));
            let all = Comparison::new(&r, &t).unwrap();
            prop_assert_eq!(all.mae, mae(&r, &t).unwrap());
            prop_assert_eq!(all.rmse, rmse(&r, &t).unwrap());
            prop_assert_eq!(all.psnr, psnr(&r, &t).unwrap());
            prop_assert_eq!(all.within_5, obscurance::share_right(&r, &t).unwrap());
            prop_assert!(all.bias.abs() <= all.mae + 1e-12);
            prop_assert!(all.mae <= all.rmse + 1e-12 && all.rmse <= all.max + 1e-12 && all.p99 <= all.max);
            prop_assert!(all.psnr >= 0.0);
            let mut sorted: Vec<f32> = r.values().iter().zip(t.values()).map(|(r, t)| (t - r).abs()).collect();
            sorted.sort_by(f32::total_cmp);
            let above = sorted.iter().filter(|&&e| f64::from(e) > all.p99 + 1e-6).count();
            prop_assert!(above * 100 <= sorted.len());
        }
    }
}
