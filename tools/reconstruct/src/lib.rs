//! Ambient occlusion at any place of a surface, from the points of a decoded stream.
//!
//! A client draws the scene itself and takes only ambient occlusion (AO) from the stream. `psao-codec` decodes the
//! stream into points with AO values. This crate is the step after it: [`AoSampler`] blends the points around any place
//! of a surface: by a fit over the points of its chart, or by the weighted mean of the paper (section 3.5, Eq. 2 to 4). An engine asks it for its vertices, light-map texels or fragments.
//!
//! | feature | what it adds |
//! |---|---|
//! | none | [`AoSampler`] alone: depends on `psao-codec`, `glam` and `thiserror`, runs in the calling thread |
//! | `rayon` | all cores for [`AoSampler::ao_many`], indices and views |
//! | `view` | `cast_view`, `GBuffer`, `reconstruct`: the AO of each pixel that a camera sees |
//! | `picture` | `picture`: views as PNG, differences of views; it turns on `view` |
//!
//! The crate does no I/O: it returns pixels and PNG bytes. Units are metres, Y is up, space is right-handed. AO is
//! *accessibility* in `[0, 1]`; 1 is open. Results do not depend on the number of threads.
//!
//! # AO at my vertices
//!
//! ```
//! use std::sync::Arc;
//!
//! use psao_codec::Limits;
//! use psao_codec::surface::{Geometry, GeometryDigest, Layout, Levels, Member, RestPoint, RoundedGeometry, SetLayout, State};
//! use psao_reconstruct::{AoSampler, Place};
//!
//! // The state that a client has decoded: sixteen points along a bar, dark at its left end.
//! let set = SetLayout {
//!     origin: [0.0; 3],
//!     step: 1.0 / 1024.0,
//!     extent: [1024; 3],
//!     normal_bits: 4,
//!     charts: 1,
//!     levels: Levels::default(),
//!     kernel_radius: 0.1,
//!     // `Geometry::round` fills in the number and the digest of the points.
//!     points: 0,
//!     digest: GeometryDigest::default(),
//! };
//! let along = |point: u8| (f32::from(point) + 0.5) / 16.0;
//! let points = (0..16).map(|point| RestPoint { position: [along(point), 0.0, 0.0], normal: [0.0, 1.0, 0.0], chart: 0 });
//! let RoundedGeometry { geometry, order, .. } = Geometry::round(set, &points.collect::<Vec<_>>());
//! let values: Vec<u8> = order.iter().map(|&point| if point < 8 { 51 } else { 255 }).collect();
//! let layout = Layout::new(vec![*geometry.layout()], vec![Member { set: 0 }], &Limits::default())?;
//! let state = State::from_parts(Arc::new(layout), vec![Arc::new(geometry)], &values);
//!
//! // The vertices of the mesh as it was modelled, before skinning and transforms, each with its chart.
//! let vertex = |position, chart| Place { position, normal: [0.0, 1.0, 0.0], chart, spacing: 0.0 };
//! let vertices = [vertex([0.1, 0.0, 0.0], 0), vertex([0.9, 0.0, 0.0], 0), vertex([0.5, 0.0, 0.0], 1)];
//! let mut ao = [None; 3];
//!
//! let mut sampler = AoSampler::new(); // one for a stream
//! sampler.prepare(&state); // after each frame; cheap unless new geometry arrived
//! sampler.ao_many(&state, 0, &vertices, &mut ao)?;
//!
//! assert!(ao[0].is_some_and(|ao| (ao - 0.2).abs() < 1e-6), "dark on the left");
//! assert_eq!(ao[1], Some(1.0), "open on the right");
//! assert_eq!(ao[2], None, "its chart has no points: the renderer chooses a value, usually 1");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod kernel;
mod paper;
mod parallel;
#[cfg(feature = "picture")]
pub mod picture;
#[cfg(feature = "view")]
pub mod reconstruct;
mod sampler;
mod surface;
#[cfg(test)]
mod testing;
#[cfg(feature = "view")]
mod view;

#[cfg(feature = "view")]
pub use self::reconstruct::{ReconstructError, Reconstruction, Statistics};
pub use self::sampler::{AoSampler, Place, SampleError};
pub use self::surface::SurfaceIndex;
#[cfg(feature = "view")]
pub use self::view::{
    AoImage, AoImageError, AtRest, Camera, CameraError, FragmentCountError, GBuffer, Ray, Size, SizeError,
    Surface, Surfaces, cast_view,
};
