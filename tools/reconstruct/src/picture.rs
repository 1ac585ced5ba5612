//! Pictures to look at: grey images, amplified differences, images side by side, and their PNG bytes.
//!
//! # Decode a frame and look at it
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::Vec3;
//! use psao_reconstruct::picture::Picture;
//! use psao_reconstruct::{Size, Surface, Surfaces, cast_view, reconstruct};
//! use psao_codec::Limits;
//! use psao_codec::block::BlockCoder;
//! use psao_codec::paper::{self, Grid, InstanceLayout, Layout, PointSample};
//! use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
//! use psao_codec::paper::{State, apply};
//! use psao_codec::paper::PointFormat;
//! use psao_proto::message::CameraPose;
//!
//! // Client and server share the scene: a floor at y = 0, four metres square.
//! struct Floor;
//!
//! impl Surfaces for Floor {
//!     fn first_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<Surface> {
//!         let t = -origin.y / dir.y;
//!         let position = origin + dir * t;
//!         let hit = t > 0.0 && t <= tmax && position.abs().max_element() <= 2.0;
//!         hit.then_some(Surface { t, position, normal: Vec3::Y, instance: 0, rest: None })
//!     }
//! }
//!
//! // A server puts points on the floor, dark on the left, and writes a frame.
//! let grid = Grid::new([-2.0, -0.5, -2.0], 1.0, [4, 1, 4])?;
//! let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 4, kernel_radius: 0.5 };
//! let layout = Arc::new(Layout::new(PointFormat::Bits32, vec![instance], 16, &Limits::default())?);
//! let mut encoder = paper::Encoder::new(layout.clone(), &[64])?;
//! for id in 0..64_u8 {
//!     let [x, z] = [id % 8, id / 8].map(|step| (f32::from(step) + 0.5) * 0.5 - 2.0);
//!     let ao = if x < 0.0 { 51 } else { 255 };
//!     encoder.put(id.into(), &PointSample { local: [x, 0.0, z], normal: [0.0, 1.0, 0.0], ao })?;
//! }
//! let meta = FrameMeta { kind: FrameKind::Key, frame: FrameIndex(0), time: StreamTime(0), changed_points: 64 };
//! let frame = encoder.finish(meta, BlockCoder::default())?;
//!
//! // The client decodes it, draws the floor and blends the points of each fragment.
//! let mut state = State::new(layout);
//! apply(&mut state, &frame.body, &Limits::default())?;
//! let pose = CameraPose {
//!     eye: [0.0, 4.0, 0.0],
//!     target: [0.0; 3],
//!     up: [0.0, 0.0, -1.0],
//!     fov_y_deg: 40.0,
//!     aspect: 1.5,
//! };
//! let view = cast_view(&Floor, &pose, Size::new(48, 32)?)?;
//! let found = reconstruct::cells(&state, &view)?;
//!
//! assert_eq!(found.statistics.unsupported, 0);
//! let [left, right] = [4, 43].map(|x| found.image.get(x, 16).unwrap());
//! assert!((left - 0.2).abs() < 1e-6 && right == 1.0);
//! let png = Picture::grey(&found.image).to_png()?;
//! assert_eq!(png[1..4], *b"PNG");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::{AoImage, Size, SizeError};

/// An 8-bit picture, grey or RGB, row by row from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    size: Size,
    pixels: Pixels,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Pixels {
    Grey(Vec<u8>),
    Rgb(Vec<u8>),
}

/// Width in pixels of the white bar between two pictures of [`Picture::side_by_side`].
pub const GAP_PIXELS: u32 = 4;

/// Error of making a picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The two images of a difference differ in size.
    #[error("a difference needs two images of equal size, not {reference} and {test} pixels")]
    SizeMismatch {
        /// Size of the reference.
        reference: Size,
        /// Size of the image under test.
        test: Size,
    },
    /// The amplification of a difference is not a positive, finite number.
    #[error("a difference is amplified by a positive, finite gain, not by {gain}")]
    Gain {
        /// The requested gain.
        gain: f32,
    },
    /// The list of pictures is empty.
    #[error("side by side needs at least one picture")]
    Nothing,
    /// Pictures side by side differ in height.
    #[error(
        "picture {index} is {found} pixels high and the first one {first}; pictures side by side need equal heights"
    )]
    Height {
        /// Position of the picture in the list, from 0.
        index: usize,
        /// Its height in pixels.
        found: u32,
        /// The height of the first picture.
        first: u32,
    },
    /// The composition would be too large.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The PNG encoder failed.
    #[error("the picture could not be encoded as PNG: {0}")]
    Encode(#[from] image::ImageError),
}

impl Picture {
    /// Makes a grey picture of ambient occlusion, `round(255 * ao)`: open is white, closed is black. Values are linear;
    /// no transfer curve is applied.
    pub fn grey(image: &AoImage) -> Self {
        Self { size: image.size(), pixels: Pixels::Grey(image.to_bytes()) }
    }

    /// Makes a picture of the difference `test - reference`, amplified by `gain` and clamped to +-1.
    ///
    /// White means equal, red means too bright (the test is more open than the reference), blue means too dark. Full
    /// red or blue is a difference of at least `1 / gain`. With `d = clamp(gain * (test - reference), -1, 1)` and `w =
    /// round(255 * (1 - |d|))` the colour is `(255, w, w)` for `d >= 0` and `(w, w, 255)` for `d < 0`.
    ///
    /// # Errors
    ///
    /// [`PictureError::SizeMismatch`] when the sizes differ, [`PictureError::Gain`] when `gain` is not positive
    /// and finite.
    pub fn difference(reference: &AoImage, test: &AoImage, gain: f32) -> Result<Self, PictureError> {
        if reference.size() != test.size() {
            return Err(PictureError::SizeMismatch { reference: reference.size(), test: test.size() });
        }
        if !(gain > 0.0 && gain.is_finite()) {
            return Err(PictureError::Gain { gain });
        }
        let colour = |(r, t): (&f32, &f32)| {
            let d = (gain * (t - r)).clamp(-1.0, 1.0);
            let white = ((1.0 - d.abs()) * 255.0 + 0.5) as u8;
            if d < 0.0 { [white, white, 255] } else { [255, white, white] }
        };
        let rgb = reference.values().iter().zip(test.values()).flat_map(colour).collect();
        Ok(Self { size: reference.size(), pixels: Pixels::Rgb(rgb) })
    }

    /// Joins pictures from left to right, with white bars of [`GAP_PIXELS`] between them. Grey if all of them are grey.
    ///
    /// # Errors
    ///
    /// [`PictureError::Nothing`] for an empty list, [`PictureError::Height`] when heights differ,
    /// [`PictureError::Size`] when the result would be larger than [`Size`] allows.
    pub fn side_by_side(pictures: &[Self]) -> Result<Self, PictureError> {
        let first = pictures.first().ok_or(PictureError::Nothing)?.size.height();
        let mut width = 0u64;
        for (index, picture) in pictures.iter().enumerate() {
            let found = picture.size.height();
            if found != first {
                return Err(PictureError::Height { index, found, first });
            }
            width += u64::from(picture.size.width()) + if index > 0 { u64::from(GAP_PIXELS) } else { 0 };
        }
        let size = Size::new(u32::try_from(width).unwrap_or(u32::MAX), first)?;
        let grey = pictures.iter().all(|p| matches!(p.pixels, Pixels::Grey(_)));
        let channels = if grey { 1 } else { 3 };
        let mut out = Vec::with_capacity(size.pixels() * channels);
        for y in 0..first as usize {
            for (index, picture) in pictures.iter().enumerate() {
                if index > 0 {
                    out.resize(out.len() + GAP_PIXELS as usize * channels, 255);
                }
                picture.push_row(y, grey, &mut out);
            }
        }
        Ok(Self { size, pixels: if grey { Pixels::Grey(out) } else { Pixels::Rgb(out) } })
    }

    fn push_row(&self, y: usize, grey: bool, out: &mut Vec<u8>) {
        let width = self.size.width() as usize;
        match &self.pixels {
            Pixels::Rgb(rgb) => out.extend_from_slice(&rgb[y * width * 3..(y + 1) * width * 3]),
            Pixels::Grey(bytes) => {
                let row = &bytes[y * width..(y + 1) * width];
                if grey {
                    out.extend_from_slice(row);
                } else {
                    out.extend(row.iter().flat_map(|&v| [v; 3]));
                }
            }
        }
    }

    /// Returns width and height.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Returns the colour of the pixel in column `x` and row `y` as red, green, blue; `None` outside the picture.
    pub fn rgb(&self, x: u32, y: u32) -> Option<[u8; 3]> {
        if x >= self.size.width() || y >= self.size.height() {
            return None;
        }
        let at = y as usize * self.size.width() as usize + x as usize;
        Some(match &self.pixels {
            Pixels::Grey(bytes) => [bytes[at]; 3],
            Pixels::Rgb(rgb) => [rgb[at * 3], rgb[at * 3 + 1], rgb[at * 3 + 2]],
        })
    }

    /// Returns the bytes of a PNG file, 8 bits a channel, grey or RGB. Equal pictures give equal bytes.
    ///
    /// # Errors
    ///
    /// [`PictureError::Encode`] when the encoder fails.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        let (bytes, colour) = match &self.pixels {
            Pixels::Grey(bytes) => (bytes, ExtendedColorType::L8),
            Pixels::Rgb(bytes) => (bytes, ExtendedColorType::Rgb8),
        };
        let mut png = Vec::new();
        PngEncoder::new_with_quality(&mut png, CompressionType::Default, FilterType::Adaptive).write_image(
            bytes,
            self.size.width(),
            self.size.height(),
            colour,
        )?;
        Ok(png)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, values: &[f32]) -> AoImage {
        AoImage::new(Size::new(width, height).unwrap(), values.to_vec()).unwrap()
    }

    #[test]
    fn a_grey_png_reads_back_byte_for_byte() {
        let values: Vec<f32> = (0..256).map(|v| v as f32 / 255.0).collect();
        let grey = Picture::grey(&image(32, 8, &values));
        let png = grey.to_png().unwrap();
        assert_eq!(png, grey.to_png().unwrap());
        let back = image::load_from_memory(&png).unwrap();
        assert_eq!(back.color(), image::ColorType::L8);
        assert_eq!(back.to_luma8().into_raw(), (0..=255).collect::<Vec<u8>>());
    }

    #[test]
    fn differences_are_red_blue_and_white() {
        let reference = image(5, 1, &[0.5, 0.5, 0.5, 0.5, 0.5]);
        let test = image(5, 1, &[0.5, 0.625, 0.375, 1.0, 0.0]);
        let picture = Picture::difference(&reference, &test, 4.0).unwrap();
        let colours: Vec<_> = (0..5).map(|x| picture.rgb(x, 0).unwrap()).collect();
        assert_eq!(colours, [[255; 3], [255, 128, 128], [128, 128, 255], [255, 0, 0], [0, 0, 255]]);
        assert_eq!(picture.rgb(5, 0), None);
        let back = image::load_from_memory(&picture.to_png().unwrap()).unwrap().to_rgb8();
        assert_eq!(back.get_pixel(4, 0).0, [0, 0, 255]);
    }

    #[test]
    fn a_difference_of_sizes_or_a_bad_gain_is_an_error() {
        let (a, b) = (image(2, 1, &[0.0; 2]), image(1, 2, &[0.0; 2]));
        assert!(matches!(Picture::difference(&a, &b, 1.0), Err(PictureError::SizeMismatch { .. })));
        for gain in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(matches!(Picture::difference(&a, &a, gain), Err(PictureError::Gain { .. })), "{gain}");
        }
    }

    #[test]
    fn side_by_side_keeps_pixels_and_order() {
        let a = Picture::grey(&image(2, 2, &[0.0, 1.0, 1.0, 0.0]));
        let b = Picture::difference(&image(1, 2, &[0.0; 2]), &image(1, 2, &[0.0, 1.0]), 1.0).unwrap();
        let both = Picture::side_by_side(&[a.clone(), b]).unwrap();
        assert_eq!((both.size().width(), both.size().height()), (2 + GAP_PIXELS + 1, 2));
        assert_eq!(both.rgb(0, 0), Some([0; 3]));
        assert_eq!(both.rgb(0, 1), Some([255; 3]));
        assert_eq!(both.rgb(2, 1), Some([255; 3]), "the bar is white");
        assert_eq!(both.rgb(2 + GAP_PIXELS, 1), Some([255, 0, 0]));
        let greys = Picture::side_by_side(&[a.clone(), a.clone()]).unwrap();
        let back = image::load_from_memory(&greys.to_png().unwrap()).unwrap();
        assert_eq!(back.color(), image::ColorType::L8);
        assert_eq!(greys.rgb(2 + GAP_PIXELS + 1, 0), Some([255; 3]));
    }

    #[test]
    fn side_by_side_refuses_what_does_not_fit() {
        assert!(matches!(Picture::side_by_side(&[]), Err(PictureError::Nothing)));
        let tall = Picture::grey(&image(1, 2, &[0.0; 2]));
        let flat = Picture::grey(&image(1, 1, &[0.0]));
        assert!(matches!(
            Picture::side_by_side(&[flat, tall]),
            Err(PictureError::Height { index: 1, found: 2, first: 1 })
        ));
        let wide = Picture::grey(&image(Size::MAX_SIDE, 1, &vec![0.0; Size::MAX_SIDE as usize]));
        assert!(matches!(Picture::side_by_side(&[wide.clone(), wide]), Err(PictureError::Size(_))));
    }
}
