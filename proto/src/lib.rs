//! Point-based ambient occlusion streams: frames, sessions, recordings.
//!
//! A server traces ambient occlusion (AO) at points on the surfaces of a scene and sends the changes. A thin client
//! draws the scene itself and turns the points into AO for every pixel. `psao-codec` encodes and decodes the frame
//! bodies of this stream. This crate transports them: it frames them, implements both ends of the protocol, and records
//! streams.
//!
//! | item | purpose |
//! |---|---|
//! | [`Framer`], [`write_frame`] | the framing of sockets and files |
//! | [`message`] | the control messages, one type for each |
//! | [`session`] | [`ClientSession`](session::ClientSession) and [`ServerSession`](session::ServerSession), without I/O |
//! | [`Fanout`] | one stream for many sessions: shared updates, patches for clients that fell behind |
//! | [`recording`] | files of the same frames: writer, reader, index, player |
//! | `net` | sessions over sockets (feature `tokio`) |
//! | `recording::file` | recordings on a disk (feature `fs`) |
//! | `sinks` | one stream to clients and a recording (features `tokio`, `fs`) |
//! | `sample`, `fuzzing` | a tiny stream for tests and examples, and bodies of fuzz targets (feature `testing`) |
//!
//! Outside `net`, `recording::file` and `sinks` this crate does no I/O, reads no clock and draws no random numbers. It
//! takes bytes and a time, and returns events and bytes. `docs/spec/protocol.md` specifies the protocol,
//! `docs/spec/recording.md` the file format.
//!
//! # Connect a client and a server
//!
//! This is the whole drive loop, with two byte vectors in place of a network. Every call takes the time.
//! `next_deadline` returns the time at which an end must be called even without bytes:
//!
//! ```
//! use psao_proto::sample::SampleServer;
//! use psao_proto::session::{Access, ClientEvent, ClientSession, ServerEvent, ServerSession};
//! use psao_proto::{Fanout, Limits, Micros, Profile};
//!
//! let mut source = SampleServer::of(Profile::SURFACE)?; // in place of a tracer
//! let mut fanout = Fanout::new(source.coder());
//! let mut server = ServerSession::new(source.scene().clone(), Access::Open, Limits::default());
//! let mut client = ClientSession::new(Limits::default());
//!
//! let (mut frames, mut held) = (Vec::new(), Vec::new());
//! for turn in 0..6 {
//!     let now = Micros(turn * 16_667);
//!     // Client to server: the handshake, acknowledgements, requests, edits of the scene.
//!     let upstream: Vec<u8> = client.take_output();
//!     for event in server.handle(&upstream, now)? {
//!         match event {
//!             ServerEvent::Acked(ack) => held.push(ack.frame.0),
//!             ServerEvent::Edit(edit) => fanout.edit(&edit), // and into the scene that is traced
//!             _ => {}
//!         }
//!     }
//!     // The server's frame. A joining client gets a keyframe, one that fell behind gets a patch.
//!     let frame = source.step()?;
//!     fanout.advance(&frame.info, frame.body, source.state().into(), now);
//!     fanout.give(&mut server, source.state().into())?;
//!     // Server to client: the scene, then frames.
//!     let downstream: Vec<u8> = server.take_output();
//!     for event in client.handle(&downstream, now)? {
//!         if let ClientEvent::Applied(frame) = event {
//!             frames.push(frame.info.frame.0);
//!         }
//!     }
//!     // Keep-alives are due when no bytes come for a while, and a silent peer is given up.
//!     for deadline in [server.next_deadline(), client.next_deadline()].into_iter().flatten() {
//!         assert!(deadline > now);
//!     }
//!     (server.tick(now)?, client.tick(now)?);
//! }
//! assert_eq!((frames, held), (vec![0, 1, 2, 3, 4, 5], vec![0, 1, 2, 3, 4]));
//! let state = client.state().expect("the scene has arrived");
//! assert_eq!(state.hash(), source.state().hash());
//! # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
//! ```
//!
//! # Record a stream and play it
//!
//! ```
//! use psao_proto::recording::{Player, PlayerEvent, Writer};
//! use psao_proto::sample::SampleServer;
//! use psao_proto::{Limits, Micros, Numbering};
//!
//! // A recorder at the server numbers frames as a connection does.
//! let mut source = SampleServer::new()?;
//! let mut numbering = Numbering::default();
//! let (mut writer, mut file) = Writer::new(Limits::default());
//! for frame in numbering.scene(source.scene())? {
//!     file.extend(writer.append(Micros(0), &frame)?);
//! }
//! let first = source.step()?;
//! file.extend(writer.append(Micros(0), &numbering.keyframe(&first.body)?)?);
//! let second = source.step()?;
//! file.extend(writer.append(Micros(16_667), &numbering.update(&second.body)?)?);
//!
//! // The recorder is killed here, in the middle of a write. Whole records stay readable.
//! file.extend_from_slice(&[0, 1, 2, 3]);
//! let mut player = Player::new(&file, Limits::default())?;
//! let mut hashes = Vec::new();
//! while let Some(event) = player.next_event() {
//!     match event {
//!         PlayerEvent::Frame(frame) => hashes.push(frame.info.hash),
//!         PlayerEvent::Damage(damage) => assert_eq!(damage.lost_bytes, 4),
//!         _ => {}
//!     }
//! }
//! assert_eq!(hashes, [first.info.hash, second.info.hash]);
//! # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
//! ```

#[macro_use]
mod wire_enum;

mod fanout;
mod follow;
mod framer;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod fuzzing;
mod limits;
pub mod message;
#[cfg(feature = "tokio")]
pub mod net;
mod numbering;
pub mod recording;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod sample;
mod scene;
pub mod session;
#[cfg(any(feature = "tokio", feature = "fs"))]
pub mod sinks;
mod units;

pub use fanout::{Delivery, Fanout, FanoutError};
pub use follow::FollowError;
pub use framer::{
    FRAME_MAGIC, FrameHeader, FrameType, Framer, FramerError, HEADER_BYTES, WireFrame, WireFrameError,
    write_frame,
};
pub use limits::Limits;
pub use numbering::Numbering;
pub use psao_codec::StateHash;
pub use psao_codec::block::CoderId;
pub use psao_codec::envelope::{FrameIndex, Profile, StreamTime};
pub use scene::{PaperInfo, SceneEntries, SceneError, SceneInfo, SceneTable, TraceInfo};
pub use units::{Group, Micros, Sequence};
