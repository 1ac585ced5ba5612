//! Point-based ambient occlusion streams: packing, cells, blocks, state hash, apply.
//!
//! A server traces ambient occlusion (AO) at points on the surfaces of a scene and streams what changed; a
//! client, which draws the scene itself, looks the points up. This crate is what both share: how a point
//! becomes 32 bits, how points are kept in hashed cells, how a frame of changes becomes bytes, and how those
//! bytes change the state of a client, all of it or nothing.
//!
//! It implements profile `paper`: the structures of "PSAO: Point-Based Split Rendering for Ambient Occlusion"
//! (sections 3.1 to 3.5). The wire format is specified in `docs/spec/codec.md`. The crate does no I/O, reads no
//! clock and draws no randomness: the same calls give the same bytes on any machine.
//!
//! # Record two frames, apply them, look up a point
//!
//! ```
//! use std::sync::Arc;
//! use psao_codec::Limits;
//! use psao_codec::block::BlockCoder;
//! use psao_codec::cells::{Grid, InstanceLayout, Layout, PaperEncoder, PointSample};
//! use psao_codec::frame::{FrameIndex, FrameKind, FrameMeta, State, StreamTime, apply};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Both sides know the layout from the scene messages: one instance, 4 x 4 x 4 cells of 25 cm.
//! let limits = Limits::default();
//! let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4])?;
//! let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 8, kernel_radius: 0.125 };
//! let layout = Arc::new(Layout::new(vec![instance], 64, &limits)?);
//!
//! // The server puts points, then finishes a keyframe; later it changes one and finishes a delta.
//! let mut encoder = PaperEncoder::new(Arc::clone(&layout), &[2])?;
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
//! // The client applies both and holds what the server sent last.
//! let mut state = State::new(layout);
//! apply(&mut state, &key.body, &limits)?;
//! apply(&mut state, &delta.body, &limits)?;
//! assert_eq!(state.hash(), encoder.state().hash());
//!
//! let cell = grid.locate(floor.local).cell;
//! let points: Vec<u8> = state.lookup(0, cell).into_iter().flat_map(|cell| cell.points()).map(|p| p.ao()).collect();
//! assert_eq!(points, [100]);
//! # Ok(())
//! # }
//! ```
//!
//! # Let a client join late
//!
//! [`frame::keyframe`] writes any state down; the client that applies it has the same hash, so the deltas that
//! follow fit.
//!
//! ```
//! # use std::sync::Arc;
//! # use psao_codec::{Limits, cells::{Grid, InstanceLayout, Layout, PaperEncoder, PointSample}};
//! use psao_codec::block::BlockCoder;
//! use psao_codec::frame::{FrameIndex, FrameKind, FrameMeta, State, StreamTime, apply, keyframe};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let limits = Limits::default();
//! # let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4])?;
//! # let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 8, kernel_radius: 0.125 };
//! # let layout = Arc::new(Layout::new(vec![instance], 64, &limits)?);
//! # let mut encoder = PaperEncoder::new(Arc::clone(&layout), &[1])?;
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
//! # See what a frame holds without decoding it
//!
//! ```
//! # use std::sync::Arc;
//! # use psao_codec::{Limits, cells::{Grid, InstanceLayout, Layout, PaperEncoder, PointSample}};
//! # use psao_codec::block::BlockCoder;
//! # use psao_codec::frame::{FrameIndex, FrameKind, FrameMeta, StreamTime};
//! use psao_codec::frame::inspect;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let limits = Limits::default();
//! # let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4])?;
//! # let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 8, kernel_radius: 0.125 };
//! # let layout = Arc::new(Layout::new(vec![instance], 64, &limits)?);
//! # let mut encoder = PaperEncoder::new(layout, &[1])?;
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

pub mod block;
pub mod cells;
pub mod frame;
pub mod fuzzing;
mod hash;
mod limits;
pub mod point;
pub mod quant;
pub mod reference;
#[cfg(test)]
mod testing;
mod wire;

pub use hash::StateHash;
pub use limits::Limits;
pub use wire::VarintProblem;
