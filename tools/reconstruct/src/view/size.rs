//! Sizes of images, checked before any allocation.

/// Width and height of an image in pixels.
///
/// Both sides are in `1..=`[`Size::MAX_SIDE`] and the image has at most [`Size::MAX_PIXELS`] pixels. So a size from a
/// user or a file cannot ask for more memory than a picture may need.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    width: u32,
    height: u32,
}

/// A size that no image of this crate may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "an image of {width} x {height} pixels is not possible: each side must be in 1..={} and the product at most {}; choose a smaller size",
    Size::MAX_SIDE,
    Size::MAX_PIXELS
)]
pub struct SizeError {
    /// Requested width in pixels.
    pub width: u32,
    /// Requested height in pixels.
    pub height: u32,
}

impl Size {
    /// Largest side in pixels.
    pub const MAX_SIDE: u32 = 16_384;
    /// Largest number of pixels in an image: 2^26, twice an 8K frame. Reconstruction takes about 2 GiB of buffers for
    /// it, 4 with places at rest.
    pub const MAX_PIXELS: u64 = 1 << 26;

    /// Makes a size.
    ///
    /// # Errors
    ///
    /// [`SizeError`] when a side is 0 or above [`Size::MAX_SIDE`], or there are more than
    /// [`Size::MAX_PIXELS`] pixels.
    ///
    /// ```
    /// use psao_reconstruct::Size;
    ///
    /// assert_eq!(Size::new(480, 270)?.pixels(), 129_600);
    /// assert!(Size::new(0, 270).is_err());
    /// # Ok::<(), psao_reconstruct::SizeError>(())
    /// ```
    pub fn new(width: u32, height: u32) -> Result<Self, SizeError> {
        let fits = (1..=Self::MAX_SIDE).contains(&width)
            && (1..=Self::MAX_SIDE).contains(&height)
            && u64::from(width) * u64::from(height) <= Self::MAX_PIXELS;
        if fits { Ok(Self { width, height }) } else { Err(SizeError { width, height }) }
    }

    /// Returns the width in pixels.
    pub fn width(self) -> u32 {
        self.width
    }

    /// Returns the height in pixels.
    pub fn height(self) -> u32 {
        self.height
    }

    /// Returns the number of pixels, which is the length of every buffer of an image of this size.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Returns width over height. A camera with this aspect has square pixels in an image of this size.
    pub fn aspect(self) -> f32 {
        self.width as f32 / self.height as f32
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {}", self.width, self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_exact() {
        assert!(Size::new(1, 1).is_ok());
        assert!(Size::new(Size::MAX_SIDE, 4_096).is_ok(), "2^14 x 2^12 is exactly the most pixels");
        assert!(Size::new(Size::MAX_SIDE, 4_097).is_err());
        assert!(Size::new(Size::MAX_SIDE + 1, 1).is_err());
        assert!(Size::new(1, 0).is_err());
        assert_eq!(
            Size::new(u32::MAX, u32::MAX),
            Err(SizeError { width: u32::MAX, height: u32::MAX }),
            "the product must not overflow"
        );
    }

    #[test]
    fn the_error_says_what_and_what_to_do() {
        let text = SizeError { width: 0, height: 7 }.to_string();
        assert!(text.contains("0 x 7") && text.contains("choose a smaller size"), "{text}");
    }
}
