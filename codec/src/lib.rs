//! Codec of point-based ambient occlusion streams: layouts, states, encoders and decoders of frames.
//!
//! A server traces ambient occlusion (AO) at points on the surfaces of a scene and streams the changes. A client draws
//! the scene itself and looks the points up. This crate is what both share. It defines how points are stored, how a
//! frame of changes becomes bytes, and how those bytes change the state of a client: completely or not at all.
//!
//! A stream has one of two profiles:
//!
//! * [`surface`]: points stay on the mesh at rest and are sent once. A frame holds only AO changes. A range coder
//!   predicts them from neighbouring points and earlier frames. These are the smallest streams.
//! * [`paper`]: the structures of "PSAO: Point-Based Split Rendering for Ambient Occlusion" (sections 3.1 to 3.5),
//!   with points of 32, 24 or 16 bits in hashed cells. This is the baseline.
//!
//! [`Layout`], [`State`], [`Encoder`], [`Decoder`] and [`ChangeLog`] serve both profiles; [`envelope`] is what their
//! frames share. `docs/spec/codec.md` specifies the wire format. The crate does no I/O, reads no clock and draws no
//! randomness: the same calls give the same bytes on every machine.
//!
//! # Send AO changes of points at rest
//!
//! ```
//! use std::sync::Arc;
//! use psao_codec::Limits;
//! use psao_codec::block::BlockCoder;
//! use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
//! use psao_codec::surface::{
//!     Decoder, Encoder, EncoderSettings, Geometry, GeometryDigest, GeometrySource, Layout, Levels, Member, RestPoint,
//!     SetLayout, State,
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // The points of a mesh at rest, rounded to a lattice of 1/128 m; two instances of the mesh share them.
//! let set = SetLayout {
//!     origin: [0.0; 3],
//!     step: 1.0 / 128.0,
//!     extent: [128; 3],
//!     normal_bits: 6,
//!     charts: 1,
//!     levels: Levels::default(),
//!     kernel_radius: 0.1,
//!     // Filled in when the points are rounded.
//!     points: 0,
//!     digest: GeometryDigest::default(),
//! };
//! let along = |n: u8| RestPoint { position: [f32::from(n) / 100.0, 0.0, 0.5], normal: [0.0, 1.0, 0.0], chart: 0 };
//! let points: Vec<RestPoint> = (0..100).map(along).collect();
//! let geometry = Arc::new(Geometry::round(set, &points).geometry);
//! let limits = Limits::default();
//! let members = vec![Member { set: 0 }, Member { set: 0 }];
//! let layout = Arc::new(Layout::new(vec![*geometry.layout()], members, &limits)?);
//!
//! // The server sets the AO of every point. The encoder knows what clients hold and sends changes of 8 or more.
//! let settings = EncoderSettings::new(8, GeometrySource::Sent);
//! let mut encoder = Encoder::new(Arc::clone(&layout), vec![geometry], settings)?;
//! let meta = |kind, frame| FrameMeta { kind, frame: FrameIndex(frame), time: StreamTime(0), changed_points: 0 };
//! for point in 0..200 {
//!     encoder.set_ao(point, 255);
//! }
//! let key = encoder.finish(meta(FrameKind::Key, 0), BlockCoder::Range)?;
//! for point in 120..160 {
//!     encoder.set_ao(point, 90);
//! }
//! let delta = encoder.finish(meta(FrameKind::Delta, 1), BlockCoder::Range)?;
//! assert!(delta.body.len() < 64);
//!
//! // A client holds the same, and no point is off by the threshold.
//! let mut state = State::new(layout);
//! let mut decoder = Decoder::new();
//! decoder.decode(&mut state, &key.body, &limits)?;
//! decoder.decode(&mut state, &delta.body, &limits)?;
//! assert_eq!(&state, encoder.state());
//! assert!(state.values(1)[20..60].iter().all(|ao| ao.abs_diff(90) < 8));
//! # Ok(())
//! # }
//! ```
//!
//! # Update a client that missed frames
//!
//! ```
//! # use std::sync::Arc;
//! # use psao_codec::{Limits, block::BlockCoder, envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime}, surface::*};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let set = SetLayout { origin: [0.0; 3], step: 1.0 / 128.0, extent: [128; 3], normal_bits: 6, charts: 1, levels: Levels::default(), kernel_radius: 0.1,
//! #     points: 0, digest: GeometryDigest::default() };
//! # let along = |n: u8| RestPoint { position: [f32::from(n) / 100.0, 0.0, 0.5], normal: [0.0, 1.0, 0.0], chart: 0 };
//! # let geometry = Arc::new(Geometry::round(set, &(0..100).map(along).collect::<Vec<_>>()).geometry);
//! # let limits = Limits::default();
//! # let layout = Arc::new(Layout::new(vec![*geometry.layout()], vec![Member { set: 0 }], &limits)?);
//! # let settings = EncoderSettings::new(8, GeometrySource::Sent);
//! # let mut encoder = Encoder::new(Arc::clone(&layout), vec![geometry], settings)?;
//! # let meta = |kind, frame| FrameMeta { kind, frame: FrameIndex(frame), time: StreamTime(0), changed_points: 0 };
//! # (0..100).for_each(|point| { encoder.set_ao(point, 255); });
//! // One change log serves all clients; it records every frame of the encoder.
//! let key = encoder.finish(meta(FrameKind::Key, 0), BlockCoder::Range)?;
//! let mut log = ChangeLog::new(encoder.state());
//! for frame in 1..30 {
//!     encoder.set_ao(frame, 90);
//!     encoder.finish(meta(FrameKind::Delta, frame), BlockCoder::Range)?;
//!     log.record(encoder.state());
//! }
//! // This client got only the keyframe. The patch has the newest value of every point that changed since.
//! let mut state = State::new(layout);
//! let mut decoder = Decoder::new();
//! decoder.decode(&mut state, &key.body, &limits)?;
//! let (base, newest) = (FrameIndex(0), meta(FrameKind::Delta, 29));
//! let body = patch(encoder.state(), &log, base, newest, BlockCoder::Range, false)?;
//! decoder.decode(&mut state, &body.ok_or("only a keyframe helps")?, &limits)?;
//! assert_eq!((state.frame(), state.hash()), (encoder.state().frame(), encoder.state().hash()));
//! # Ok(())
//! # }
//! ```
//!
//! # Record two frames, apply them, look up a point
//!
//! ```
//! use std::sync::Arc;
//! use psao_codec::Limits;
//! use psao_codec::block::BlockCoder;
//! use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
//! use psao_codec::paper::{Encoder, Grid, InstanceLayout, Layout, PointFormat, PointSample, State, apply};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Both sides know the layout from the scene messages: one instance, 4 x 4 x 4 cells of 25 cm.
//! let limits = Limits::default();
//! let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4])?;
//! let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 8, kernel_radius: 0.125 };
//! let layout = Arc::new(Layout::new(PointFormat::Bits32, vec![instance], 64, &limits)?);
//!
//! // The server puts points, then finishes a keyframe; later it changes one and finishes a delta.
//! let mut encoder = Encoder::new(Arc::clone(&layout), &[2])?;
//! let floor = PointSample { local: [0.3, 0.1, 0.6], normal: [0.0, 1.0, 0.0], ao: 255 };
//! encoder.put(0, &floor)?;
//! encoder.put(1, &PointSample { local: [0.9, 0.9, 0.9], ..floor })?;
//! let meta = |kind, frame, changed_points| FrameMeta {
//!     kind,
//!     frame: FrameIndex(frame),
//!     time: StreamTime(u64::from(frame) * 16_667),
//!     changed_points,
//! };
//! let key = encoder.finish(meta(FrameKind::Key, 0, 2), BlockCoder::default())?;
//! encoder.put(0, &PointSample { ao: 100, ..floor })?;
//! let delta = encoder.finish(meta(FrameKind::Delta, 1, 1), BlockCoder::default())?;
//!
//! // The client applies both and then holds what the server sent last.
//! let mut state = State::new(Arc::clone(&layout));
//! apply(&mut state, &key.body, &limits)?;
//! apply(&mut state, &delta.body, &limits)?;
//! assert_eq!(state.hash(), encoder.state().hash());
//!
//! let cell = grid.locate(floor.local).cell;
//! let held = state.lookup(0, cell).ok_or("the cell is not there")?;
//! let values: Vec<u8> = held.points(layout.format()).map(|point| point.ao).collect();
//! assert_eq!(values, [100]);
//! # Ok(())
//! # }
//! ```
//!
//! # Let a client join late
//!
//! [`paper::keyframe`] writes any state as a keyframe. A client that applies it has the same hash, so the deltas that
//! follow fit.
//!
//! ```
//! # use std::sync::Arc;
//! # use psao_codec::{Limits, paper::{Encoder, Grid, InstanceLayout, Layout, PointFormat, PointSample}};
//! use psao_codec::block::BlockCoder;
//! use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
//! use psao_codec::paper::{State, apply, keyframe};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let limits = Limits::default();
//! # let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4])?;
//! # let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 8, kernel_radius: 0.125 };
//! # let layout = Arc::new(Layout::new(PointFormat::Bits32, vec![instance], 64, &limits)?);
//! # let mut encoder = Encoder::new(Arc::clone(&layout), &[1])?;
//! # encoder.put(0, &PointSample { local: [0.3; 3], normal: [0.0, 1.0, 0.0], ao: 9 })?;
//! let meta = FrameMeta { kind: FrameKind::Key, frame: FrameIndex(7), time: StreamTime(0), changed_points: 1 };
//! encoder.finish(meta, BlockCoder::default())?;
//!
//! let body = keyframe(encoder.state(), meta, BlockCoder::default())?;
//! let mut late = State::new(layout);
//! apply(&mut late, &body, &limits)?;
//! assert_eq!(&late, encoder.state());
//! # Ok(())
//! # }
//! ```
//!
//! # Inspect a frame without decoding it
//!
//! ```
//! # use std::sync::Arc;
//! # use psao_codec::{Limits, paper::{Encoder, Grid, InstanceLayout, Layout, PointFormat, PointSample}};
//! # use psao_codec::block::BlockCoder;
//! # use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
//! use psao_codec::envelope::inspect;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let limits = Limits::default();
//! # let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4])?;
//! # let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 8, kernel_radius: 0.125 };
//! # let layout = Arc::new(Layout::new(PointFormat::Bits32, vec![instance], 64, &limits)?);
//! # let mut encoder = Encoder::new(layout, &[1])?;
//! # encoder.put(0, &PointSample { local: [0.3; 3], normal: [0.0, 1.0, 0.0], ao: 9 })?;
//! # let meta = FrameMeta { kind: FrameKind::Key, frame: FrameIndex(7), time: StreamTime(0), changed_points: 1 };
//! # let body = encoder.finish(meta, BlockCoder::default())?.body;
//! let info = inspect(&body, &limits)?;
//! for section in &info.sections {
//!     println!("{}: {} records, {} B by {}", section.tag, section.records, section.wire_bytes, section.coder);
//! }
//! assert_eq!(info.body_bytes(), body.len() as u64);
//! # Ok(())
//! # }
//! ```

#[macro_use]
mod setters;

pub mod block;
mod change_log;
mod decoder;
mod encoder;
pub mod envelope;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod fuzzing;
mod hash;
mod layout;
mod limits;
pub mod memory;
pub mod paper;
mod profiles;
pub mod quant;
mod range;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod reference;
mod state;
pub mod surface;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod wire;

pub use change_log::{ChangeLog, patch};
pub use decoder::{Decoder, apply};
pub use encoder::Encoder;
pub use hash::StateHash;
pub use layout::Layout;
pub use limits::Limits;
pub use profiles::ContentError;
pub use state::{State, StateRef, keyframe};
pub use wire::VarintError;
