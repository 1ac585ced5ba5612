//! Reconstruction of views: one accessibility for each fragment, from the state of a stream (paper, section 3.5).
//!
//! [`cells`] blends the points of profile `paper` in the current local space of an instance. [`surface`] and
//! [`SurfaceReconstructor`] fit the points of profile `surface` on the mesh at rest. The values are those of
//! [`AoSampler`](crate::AoSampler).
//!
//! # View a stream of profile `surface`
//!
//! Its points lie on the mesh at rest, so each fragment has its place on that mesh ([`AtRest`](crate::AtRest)). A
//! renderer interpolates two more vertex attributes for it, without transforming them, and passes on the number of the
//! triangle's chart. The motion of the body does not
//! matter.
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::Vec3;
//! use psao_reconstruct::reconstruct::SurfaceReconstructor;
//! use psao_reconstruct::{AtRest, GBuffer, Size, Surface};
//! use psao_codec::Limits;
//! use psao_codec::surface::{Geometry, GeometryDigest, Layout, Levels, Member, RestPoint, RoundedGeometry, SetLayout, State};
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
//! // The client draws the bar, bent upwards somewhere in the world; two fragments show its ends.
//! let fragment = |position, rest| Surface {
//!     t: 3.0,
//!     position,
//!     normal: Vec3::Y,
//!     instance: 0,
//!     rest: Some(AtRest { position: rest, normal: Vec3::Y, chart: 0 }),
//! };
//! let left = fragment(Vec3::new(7.1, 1.0, 2.0), Vec3::new(0.1, 0.0, 0.0));
//! let right = fragment(Vec3::new(7.7, 1.6, 2.0), Vec3::new(0.9, 0.0, 0.0));
//! let view = GBuffer::from_fragments(Size::new(2, 1)?, vec![Some(left), Some(right)])?;
//!
//! // One reconstructor for all frames of a stream: it keeps the indices of the geometry.
//! let mut reconstructor = SurfaceReconstructor::new();
//! let found = reconstructor.reconstruct(&state, &view)?;
//! assert!((found.image.values()[0] - 0.2).abs() < 1e-6 && found.image.values()[1] == 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod cells;
mod result;
mod surface;
#[cfg(test)]
mod tests;
mod walk;

pub use self::cells::cells;
pub use self::result::{ReconstructError, Reconstruction, Statistics};
pub use self::surface::{SurfaceReconstructor, surface};
