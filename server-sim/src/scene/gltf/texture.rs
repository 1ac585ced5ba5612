//! Textures of a glTF file: which image to take, how it is decoded and sampled.

use std::sync::Arc;

use image::ImageReader;

use super::document::GltfDocument;
use super::schema::{Sampler, Texture as JsonTexture};
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::texture::{Texture, Wrap};

/// What became of a texture.
pub(super) enum Reading<const N: usize> {
    /// The texels.
    Texels(Texture<N>),
    /// It has only an image in this format, which is not decoded here.
    Unreadable(UnreadFormat),
    /// It has no image.
    Nothing,
}

/// An image format that is not decoded here.
pub(super) type UnreadFormat = &'static str;

/// Reads and decodes a texture, and keeps the channels that `pick` selects.
pub(super) fn read<const N: usize>(
    document: &GltfDocument,
    index: usize,
    place: &str,
    hasher: &mut blake3::Hasher,
    pick: fn([u8; 4]) -> [u8; N],
) -> Result<Reading<N>, SceneError> {
    let texture = document.get("texture", &document.root.textures, index, place)?;
    let here = format!("textures[{index}]");
    let samplers = &document.root.samplers;
    let sampler =
        texture.sampler.map(|sampler| document.get("sampler", samplers, sampler, &here)).transpose()?;
    let (wrap, nearest) = sampling(document, sampler, &here)?;
    let Some(source) = source_of(texture) else {
        return Ok(unread_format(texture).map_or(Reading::Nothing, Reading::Unreadable));
    };
    let bytes = document.image(source, &here, hasher)?;
    if let Some(format) = unread_format_of(&bytes) {
        return Ok(Reading::Unreadable(format));
    }
    let here = format!("images[{source}]");
    let (size, pixels) = decode(document, &bytes, &here)?;
    let texels: Arc<[[u8; N]]> = pixels.pixels().map(|pixel| pick(pixel.0)).collect();
    Texture::new(size, wrap, nearest, texels)
        .map(Reading::Texels)
        .ok_or_else(|| document.error(here, GltfProblem::Missing("a pixel")))
}

/// Returns the image to decode: WebP where there is one, else PNG or JPEG.
fn source_of(texture: &JsonTexture) -> Option<usize> {
    texture.extensions.webp.as_ref().and_then(|webp| webp.source).or(texture.source)
}

/// Returns the format of a texture that has nothing but an image which is not decoded here.
fn unread_format(texture: &JsonTexture) -> Option<UnreadFormat> {
    let extensions = &texture.extensions;
    if extensions.basisu.is_some() {
        return Some("KHR_texture_basisu");
    }
    if extensions.avif.is_some() {
        return Some("EXT_texture_avif");
    }
    extensions.dds.as_ref().map(|_| "MSFT_texture_dds")
}

/// Returns the format of an image that is not decoded here, by its first bytes. Exporters also put such images where the
/// core has its own.
fn unread_format_of(bytes: &[u8]) -> Option<UnreadFormat> {
    if bytes.starts_with(b"\xabKTX 20\xbb") {
        return Some("KHR_texture_basisu");
    }
    if bytes.get(4..12) == Some(b"ftypavif") {
        return Some("EXT_texture_avif");
    }
    bytes.starts_with(b"DDS ").then_some("MSFT_texture_dds")
}

/// Decodes an image whose size is within the limit. Its bytes tell the format, whatever the file says about it.
fn decode(
    document: &GltfDocument,
    bytes: &[u8],
    place: &str,
) -> Result<([u32; 2], image::RgbaImage), SceneError> {
    let fail = |source| SceneError::Image {
        path: document.path.clone(),
        place: place.to_owned(),
        source: Box::new(source),
    };
    let reader =
        || ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| fail(e.into()));
    let (width, height) = reader()?.into_dimensions().map_err(fail)?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > limits::MAX_TEXTURE_PIXELS {
        let (what, limit) = ("pixels", limits::MAX_TEXTURE_PIXELS);
        return Err(document.error(place, GltfProblem::TooMany { what, count: pixels, limit }));
    }
    document.spend_pixels(pixels, place)?;
    Ok(([width, height], reader()?.decode().map_err(fail)?.into_rgba8()))
}

/// Returns the wrap modes, and whether sampling takes the nearest texel.
fn sampling(
    document: &GltfDocument,
    sampler: Option<&Sampler>,
    place: &str,
) -> Result<([Wrap; 2], bool), SceneError> {
    const NEAREST: u32 = 9728;
    let Some(sampler) = sampler else { return Ok(([Wrap::Repeat; 2], false)) };
    let wrap = |mode: Option<u32>| match mode {
        Some(33_071) => Ok(Wrap::Clamp),
        Some(33_648) => Ok(Wrap::Mirror),
        None | Some(10_497) => Ok(Wrap::Repeat),
        Some(_) => Err(document.error(place, GltfProblem::Invalid("wrapping mode"))),
    };
    Ok(([wrap(sampler.wrap_s)?, wrap(sampler.wrap_t)?], sampler.mag_filter == Some(NEAREST)))
}
