//! Recordings in files: a recorder that never slows its stream, and files that appear only once complete. Feature `fs`.
//!
//! This is the only part of [`recording`](super) that uses a disk, a clock and a thread.
//!
//! A [`Recorder`] takes the frames of a stream and writes each record with one write. The file is therefore a valid
//! recording after every frame, whatever stops the program. By default a separate thread writes, so the stream never
//! waits. Frames that do not fit the buffer are left out up to the next keyframe, and a [`Gap`](crate::message::Gap)
//! record marks the place. After a failed write the recording continues behind its last whole record, once the disk
//! works again. The failure is reported at the end.
//!
//! ```
//! use psao_proto::recording::file::{Recorder, RecorderOptions};
//! use psao_proto::sample::SampleServer;
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("stream.psao");
//! let mut source = SampleServer::new()?; // stands for a server that traces
//! let options = RecorderOptions::default().with_observer(|notice| eprintln!("recording: {notice}"));
//! let mut recorder = Recorder::create(&path, options)?;
//! recorder.scene(source.scene())?;
//! for _ in 0..10 {
//!     let frame = source.step()?;
//!     // The keyframe is made if the last one is long ago, or if frames are missing.
//!     let now = recorder.now();
//!     recorder.body_or_keyframe(now, frame.info.kind, &frame.body, || source.keyframe())?;
//! }
//! let recorded = recorder.finish()?;
//! assert_eq!(recorded.missing.frames, 0);
//! assert_eq!(recorded.bytes, std::fs::metadata(&path)?.len());
//! # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
//! ```

mod atomic;
mod background;
mod backlog;
mod disk;
mod error;
mod keyframes;
mod options;
mod recorder;

pub use self::atomic::AtomicFile;
pub use self::backlog::GapTotals;
pub use self::error::FileError;
pub use self::keyframes::KeyframeInterval;
pub use self::options::{RecorderNotice, RecorderOptions};
pub use self::recorder::{Recorder, RecordingOutcome};
