//! Point-based ambient occlusion streams: from decoded state to pictures.
//!
//! A client draws the scene itself and takes only ambient occlusion from the stream. This crate is that client's
//! last step, on the processor: it looks at a scene ([`raster`](fn@raster)), blends the points of a decoded
//! [`State`](psao_codec::frame::State) for every fragment ([`reconstruct`], paper, section 3.5, Eq. 2 to 4) and
//! makes pictures ([`picture`]). It does no I/O: pixels and PNG bytes are returned.
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
//! use psao_codec::cells::{Grid, InstanceLayout, Layout, PaperEncoder, PointSample};
//! use psao_codec::frame::{FrameIndex, FrameKind, FrameMeta, State, StreamTime, apply};
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
//!         hit.then_some(Surface { t, position, normal: Vec3::Y, instance: 0 })
//!     }
//! }
//!
//! // A server puts points on the floor, dark on the left, and writes a frame.
//! let grid = Grid::new([-2.0, -0.5, -2.0], 1.0, [4, 1, 4])?;
//! let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 4, kernel_radius: 0.5 };
//! let layout = Arc::new(Layout::new(vec![instance], 16, &Limits::default())?);
//! let mut encoder = PaperEncoder::new(layout.clone(), &[64])?;
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
pub use self::raster::{FragmentCountError, GBuffer, Surface, Surfaces, raster};
pub use self::reconstruct::{ReconstructError, Reconstruction, Statistics};
pub use self::size::{Size, SizeError};
