//! Point-based ambient occlusion streams: a seeded network in virtual time.
//!
//! Sessions of `psao-proto` do no I/O and read no clock, so a simulated network can carry their bytes. A seed decides
//! which bytes are lost, duplicated, reordered, delayed or stalled, and minutes of virtual time take moments.
//!
//! A [`Lab`] holds a source of frames, a server and clients. Each client has a network of its own, with [`Conditions`]
//! and scheduled [`Fault`]s. Whenever a client applies a frame, the lab compares its state with the source's state at
//! that frame. The [`Report`] tells how old the frames were, how long each fault had an effect, and how many bytes were
//! sent. The same seed gives the same run on any machine.
//!
//! | what | where |
//! |---|---|
//! | packets lost, duplicated, reordered; delay, rate, queue | [`Conditions`], [`Fault`] |
//! | reliable, ordered bytes over these packets, with a bounded send buffer | [`SEND_BUFFER_BYTES`], [`retransmission_timeout`] |
//! | frames to stream | [`Source`], [`SampleSource`], [`RecordingSource`] |
//! | clients | [`ClientPlan`], [`Mode`] |

mod conditions;
mod connection;
mod datagram;
mod direction;
mod lab;
mod link;
mod measure;
mod plan;
mod queue;
mod random;
mod source;
mod stream;

pub use conditions::{Conditions, ConditionsError, Fault, MAX_REORDER_DELAY, MIN_MTU};
pub use lab::{Lab, LabError, LabSettings};
pub use link::Traffic;
pub use measure::{ClientReport, Report, Staleness};
pub use plan::{ClientPlan, Mode};
pub use random::MILLION;
pub use source::{RecordingSource, SampleSource, Source};
pub use stream::{MAX_TIMEOUT, MIN_TIMEOUT, SEND_BUFFER_BYTES, retransmission_timeout};
