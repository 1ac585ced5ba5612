//! Point-based ambient occlusion streams: a seeded network in virtual time.
//!
//! Sessions of `psao-proto` do no I/O and read no clock, so a network can be played to them: bytes are lost, doubled,
//! overtaken, delayed and held up as a seed says, and minutes pass in moments. A [`Lab`] is a source of frames, a server
//! and clients, each behind a network of its own, with [`Conditions`] and scheduled [`Fault`]s. At every frame that a client
//! applies, its state is compared with the source's of that number; how old it was, how long a fault was felt and what it
//! all took in bytes stands in the [`Report`]. The same seed gives the same run on any machine.
//!
//! | what | where |
//! |---|---|
//! | packets lost, doubled, held back; delay, rate, queue | [`Conditions`], [`Fault`] |
//! | bytes over them, reliable and in order, with a bounded send buffer | [`SEND_BUFFER`], [`timeout`] |
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

pub use conditions::{Conditions, ConditionsError, Fault, HELD_BACK, MIN_MTU};
pub use lab::{Lab, LabError, Settings};
pub use link::Traffic;
pub use measure::{ClientReport, Report, Staleness};
pub use plan::{ClientPlan, Mode};
pub use random::MILLION;
pub use source::{RecordingSource, SampleSource, Source};
pub use stream::{LEAST_TIMEOUT, MOST_TIMEOUT, SEND_BUFFER, timeout};
