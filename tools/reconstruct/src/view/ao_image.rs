//! An image of ambient occlusion.

use super::Size;

/// One accessibility value per pixel, row by row from the top left: 1 is open, 0 is closed.
///
/// Every value is finite and in `[0, 1]`; the constructors ensure that.
#[derive(Clone, Debug, PartialEq)]
pub struct AoImage {
    size: Size,
    values: Vec<f32>,
}

/// Values that do not make an [`AoImage`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AoImageError {
    /// The number of values is not the number of pixels.
    #[error("an image of {size} pixels needs {} values, not {found}", size.pixels())]
    Length {
        /// The requested size.
        size: Size,
        /// The number of values given.
        found: usize,
    },
    /// A value is not finite or outside `[0, 1]`.
    #[error("pixel ({x}, {y}) holds {value}, which is not in [0, 1]; scale or clamp the values first")]
    Range {
        /// Column of the first such pixel.
        x: u32,
        /// Row of the first such pixel.
        y: u32,
        /// Its value.
        value: f32,
    },
}

impl AoImage {
    /// Makes an image of `values`, row by row from the top left.
    ///
    /// # Errors
    ///
    /// [`AoImageError::Length`] when there are not `size.pixels()` values, [`AoImageError::Range`] when a
    /// value is not in `[0, 1]` (NaN is not).
    pub fn new(size: Size, values: Vec<f32>) -> Result<Self, AoImageError> {
        if values.len() != size.pixels() {
            return Err(AoImageError::Length { size, found: values.len() });
        }
        if let Some(at) = values.iter().position(|v| !(0.0..=1.0).contains(v)) {
            let width = size.width() as usize;
            return Err(AoImageError::Range {
                x: (at % width) as u32,
                y: (at / width) as u32,
                value: values[at],
            });
        }
        Ok(Self { size, values })
    }

    /// Makes an image of 8-bit values, of which 255 is 1.0, row by row from the top left.
    ///
    /// # Errors
    ///
    /// [`AoImageError::Length`] when there are not `size.pixels()` bytes.
    pub fn from_bytes(size: Size, bytes: &[u8]) -> Result<Self, AoImageError> {
        if bytes.len() != size.pixels() {
            return Err(AoImageError::Length { size, found: bytes.len() });
        }
        Ok(Self { size, values: bytes.iter().map(|&b| f32::from(b) / 255.0).collect() })
    }

    /// Makes an image of computed values that are known to be in range.
    pub(crate) fn from_computed(size: Size, values: Vec<f32>) -> Self {
        debug_assert_eq!(values.len(), size.pixels());
        debug_assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
        Self { size, values }
    }

    /// Returns the width and height.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Returns the values, row by row from the top left, each in `[0, 1]`.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Returns the value of the pixel in column `x` and row `y`; `None` outside the image.
    pub fn get(&self, x: u32, y: u32) -> Option<f32> {
        if x >= self.size.width() || y >= self.size.height() {
            return None;
        }
        self.values.get(y as usize * self.size.width() as usize + x as usize).copied()
    }

    /// Returns the values as bytes, `round(255 * value)`, which is the rounding of AO on the wire.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.values.iter().map(|v| (v * 255.0 + 0.5) as u8).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(w: u32, h: u32) -> Size {
        Size::new(w, h).unwrap()
    }

    #[test]
    fn values_out_of_range_are_named() {
        let bad = AoImage::new(size(2, 2), vec![0.0, 1.0, 0.5, 1.5]);
        assert_eq!(bad, Err(AoImageError::Range { x: 1, y: 1, value: 1.5 }));
        assert!(AoImage::new(size(2, 2), vec![0.0, f32::NAN, 0.5, 1.0]).is_err());
        assert!(AoImage::new(size(2, 2), vec![0.0, -f32::EPSILON, 0.5, 1.0]).is_err());
        assert_eq!(
            AoImage::new(size(2, 2), vec![0.0; 3]),
            Err(AoImageError::Length { size: size(2, 2), found: 3 })
        );
    }

    #[test]
    fn every_byte_survives() {
        let bytes: Vec<u8> = (0..=255).collect();
        let image = AoImage::from_bytes(size(16, 16), &bytes).unwrap();
        assert_eq!(image.to_bytes(), bytes);
        assert_eq!(image.get(15, 15), Some(1.0));
        assert_eq!(image.get(16, 0), None);
        assert_eq!(image.get(0, 16), None);
    }
}
