//! Streams ray-traced ambient occlusion (AO) from a server to thin clients.
//!
//! A server computes AO at points on the surfaces of a scene and sends the values that changed. A client draws the scene
//! itself and fits the points around each vertex or pixel. This crate is the front door of the toolkit, for programs with a
//! scene and rays of their own:
//!
//! | type | what it does |
//! |---|---|
//! | [`Publisher`] | takes points once and AO values every frame; sends frames to clients and to a recording |
//! | [`Subscriber`] | follows a live server or a recording; holds the newest state |
//! | [`AoSampler`] | returns the AO at any place of a mesh from the points around it |
//!
//! The layers below are re-exported: [`codec`] makes and applies frame bodies, [`proto`] carries and records them. The
//! `psao` command and the crate `psao-server` trace scenes by themselves.
//!
//! # Publish AO values, follow them, sample them
//!
//! ```
//! use psao::{AoSampler, Place, Publisher, RestPoint, Subscriber};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Points on a mesh at rest, 10 cm apart; two instances of the mesh share them.
//! let along = |i: u8| RestPoint { position: [f32::from(i) * 0.1, 0.0, 0.0], normal: [0.0, 1.0, 0.0], chart: 0 };
//! let points: Vec<RestPoint> = (0..20).map(along).collect();
//! let mut builder = Publisher::builder("two bars").threshold(2);
//! let mesh = builder.mesh(&points, 0.15);
//! let (_left, right) = (builder.instance(mesh), builder.instance(mesh));
//! let mut publisher = builder.build()?;
//!
//! // The right bar darkens from frame to frame. Every frame goes into a file.
//! # let folder = tempfile::tempdir()?;
//! # let file = folder.path().join("bars.psao");
//! publisher.record(&file)?;
//! for frame in 0..3_u8 {
//!     publisher.set_all(right, &[1.0 - 0.25 * f32::from(frame); 20])?;
//!     publisher.send()?;
//! }
//! publisher.finish("done")?;
//!
//! // A client of that file, and the AO in the middle of the right bar.
//! let mut subscriber = Subscriber::open(&file)?;
//! while subscriber.next_event()?.is_some() {}
//! let state = subscriber.state().ok_or("no frame came")?;
//! let mut sampler = AoSampler::new();
//! sampler.prepare(state);
//! let ao = sampler.ao(state, right.0, &Place { position: [0.95, 0.0, 0.0], normal: [0.0, 1.0, 0.0], chart: 0, spacing: 0.0 });
//! assert!(ao.is_some_and(|ao| (ao - 0.5).abs() < 0.01));
//! # Ok(())
//! # }
//! ```
//!
//! # Features
//!
//! | feature | default | what it adds |
//! |---|---|---|
//! | `fs` | yes | [`Publisher::record`] and [`Subscriber::open`] |
//! | `tokio` | yes | [`Publisher::listen`] and [`Subscriber::connect`] |
//! | `zstd`, `lz4` | yes | blocks of these coders; `zstd` needs a C compiler |
//! | `tls` | no | TLS on sockets |
//! | `rayon` | no | all cores for [`AoSampler::ao_many`] |

mod publisher;
#[cfg(feature = "tokio")]
mod runtime;
#[cfg(any(feature = "fs", feature = "tokio"))]
mod subscriber;

#[cfg(all(test, feature = "tokio", feature = "fs"))]
mod tests;

pub use psao_codec as codec;
pub use psao_codec::surface::{Charts, RestPoint};
pub use psao_codec::{Layout, State, StateHash, StateRef};
pub use psao_proto as proto;
pub use psao_proto::{Limits, SceneInfo, SceneTable, TraceInfo};
pub use psao_reconstruct::{AoSampler, Place, SampleError};

pub use self::publisher::{InstanceId, MeshId, PublishError, Publisher, PublisherBuilder, SentFrame};
#[cfg(any(feature = "fs", feature = "tokio"))]
pub use self::subscriber::{ChangedPoint, Event, SubscribeError, Subscriber};
