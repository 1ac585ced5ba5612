//! From the stream's state to one accessibility per fragment of a view (paper, section 3.5).
//!
//! [`cells`] blends the points of a stream of profile `paper`, in the space that an instance is in now; [`surface`] and
//! [`SurfaceReconstructor`] those of profile `surface`, on the mesh at rest. Weights and mean are the same, and those of
//! [`AoSampler`](crate::AoSampler).
//!
//! # Look at a stream of profile `surface`
//!
//! Its points lie on the mesh at rest, so each fragment says where on that mesh it is ([`AtRest`](crate::AtRest)): two
//! more vertex attributes, interpolated but not transformed. What the body does meanwhile does not matter.
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::Vec3;
//! use psao_reconstruct::reconstruct::SurfaceReconstructor;
//! use psao_reconstruct::{AtRest, GBuffer, Size, Surface};
//! use psao_codec::Limits;
//! use psao_codec::surface::{Geometry, GeometryDigest, Layout, Member, RestPoint, Rounded, SetLayout, State};
//!
//! // What came over the wire: sixteen points along a bar, dark at its left end, in a state that holds them.
//! let set = SetLayout {
//!     origin: [0.0; 3],
//!     step: 1.0 / 1024.0,
//!     extent: [1024; 3],
//!     normal_bits: 4,
//!     kernel_radius: 0.1,
//!     // Number and digest of the points are filled in when they are rounded.
//!     points: 0,
//!     digest: GeometryDigest::default(),
//! };
//! let along = |point: u8| (f32::from(point) + 0.5) / 16.0;
//! let points = (0..16).map(|point| RestPoint { position: [along(point), 0.0, 0.0], normal: [0.0, 1.0, 0.0] });
//! let Rounded { geometry, order, .. } = Geometry::round(set, &points.collect::<Vec<_>>());
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
//!     rest: Some(AtRest { position: rest, normal: Vec3::Y }),
//! };
//! let left = fragment(Vec3::new(7.1, 1.0, 2.0), Vec3::new(0.1, 0.0, 0.0));
//! let right = fragment(Vec3::new(7.7, 1.6, 2.0), Vec3::new(0.9, 0.0, 0.0));
//! let view = GBuffer::from_fragments(Size::new(2, 1)?, vec![Some(left), Some(right)])?;
//!
//! // It keeps what only geometry decides: one for all frames of a stream.
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
