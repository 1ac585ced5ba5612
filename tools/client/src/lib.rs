//! Point-based ambient occlusion streams: from decoded state to pictures.
//!
//! A client draws the scene itself and takes only ambient occlusion from the stream. This crate is that client's
//! last step, on the processor: it looks at a scene ([`raster`](fn@raster)), blends the points of a decoded state
//! (profile `paper`: [`paper::State`](psao_codec::paper::State), profile `surface`:
//! [`surface::State`](psao_codec::surface::State)) for every fragment ([`reconstruct`], paper, section 3.5, Eq. 2 to
//! 4) and makes pictures ([`picture`]). It does no I/O: pixels and PNG bytes are returned.
//!
//! Conventions: metres, Y up, right-handed; ambient occlusion is *accessibility* in `[0, 1]`, 1 being open. Every
//! result is the same whatever the number of threads.
//!
//! # Decode a frame and look at it
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::Vec3;
//! use psao_client::picture::Picture;
//! use psao_client::{Size, Surface, Surfaces, raster, reconstruct};
//! use psao_codec::Limits;
//! use psao_codec::block::BlockCoder;
//! use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
//! use psao_codec::paper::{Encoder, Grid, InstanceLayout, Layout, PointFormat, PointSample, State, apply};
//! use psao_proto::message::CameraPose;
//!
//! // The scene, which client and server share: a floor at y = 0, four metres square.
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
//! let mut encoder = Encoder::new(layout.clone(), &[64])?;
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
//! let view = raster(&Floor, &pose, Size::new(48, 32)?)?;
//! let found = reconstruct::cells(&state, &view)?;
//!
//! assert_eq!(found.statistics.unsupported, 0);
//! let [left, right] = [4, 43].map(|x| found.image.get(x, 16).unwrap());
//! assert!((left - 0.2).abs() < 1e-6 && right == 1.0);
//! let png = Picture::grey(&found.image).to_png()?;
//! assert_eq!(png[1..4], *b"PNG");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Look at a stream of profile `surface`
//!
//! Its points lie on the mesh at rest, so each fragment says where on that mesh it is ([`AtRest`]): two more vertex
//! attributes, interpolated but not transformed. What the body does meanwhile does not matter.
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::Vec3;
//! use psao_client::reconstruct::SurfaceReconstructor;
//! use psao_client::{AtRest, GBuffer, Size, Surface};
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

#[cfg(test)]
mod analytic;
mod ao_image;
pub mod camera;
pub mod picture;
pub mod raster;
pub mod reconstruct;
mod size;
#[cfg(test)]
mod testing;

pub use self::ao_image::{AoImage, AoImageError};
pub use self::camera::{Camera, CameraError, Ray};
pub use self::raster::{AtRest, FragmentCountError, GBuffer, Surface, Surfaces, raster};
pub use self::reconstruct::{ReconstructError, Reconstruction, Statistics};
pub use self::size::{Size, SizeError};
