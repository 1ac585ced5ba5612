//! Views of a scene: cameras, rays, a G-buffer, images of its size.
//!
//! A client draws the scene itself. [`cast_view`] does that with one ray for each pixel into any implementation of
//! [`Surfaces`]. A renderer that already has depth and normals fills a [`GBuffer`] with [`GBuffer::from_fragments`].

#[cfg(test)]
mod analytic;
mod ao_image;
mod camera;
mod cast;
mod gbuffer;
mod size;

pub use self::ao_image::{AoImage, AoImageError};
pub use self::camera::{Camera, CameraError, Ray};
pub use self::cast::{Surfaces, cast_view};
pub use self::gbuffer::{AtRest, FragmentCountError, GBuffer, Surface};
pub use self::size::{Size, SizeError};
