//! A stream into a file.

use std::io::ErrorKind;
use std::path::Path;
use std::time::Instant;

use psao_codec::frame::FrameKind;

use super::background::Background;
use super::disk::{Disk, RecordingFile};
use super::{FileError, Missing, RecorderOptions};
use crate::message::Message;
use crate::{Micros, Numbering, SceneTable};

/// Records a stream into a file.
///
/// [`scene`](Self::scene), [`body`](Self::body) and [`message`](Self::message) number the frames of a stream that is made
/// here, as a connection does; [`wire`](Self::wire) takes frames that were numbered elsewhere. An arrival is the time
/// since the start of the recording: [`now`](Self::now) for a live stream, the stream's own time for one that is not.
///
/// See the [module](super::file) for what it promises, and an example. A recorder that is
/// dropped leaves a valid recording of everything that it took, but its failures stay unknown.
pub struct Recorder {
    output: Output,
    numbering: Numbering,
    clock: Clock,
}

/// How frames get to the disk.
enum Output {
    /// Each call writes.
    Direct(Disk<RecordingFile>),
    /// A thread writes.
    Background(Background),
}

/// A recording that was finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Recorded {
    /// Length of the file.
    pub bytes: u64,
    /// What is not in it.
    pub missing: Missing,
}

/// Time since the recording began.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock(Instant);

impl Clock {
    #[expect(clippy::disallowed_methods, reason = "a live recording says when each frame came")]
    pub(super) fn start() -> Self {
        Self(Instant::now())
    }

    pub(super) fn now(self) -> Micros {
        Micros(u64::try_from(self.0.elapsed().as_micros()).unwrap_or(u64::MAX))
    }
}

impl Recorder {
    /// Starts a recording; a file of that name is replaced.
    ///
    /// # Errors
    /// [`FileError::Io`] when the file cannot be made, [`FileError::Thread`] without a thread to write with.
    pub fn create(path: &Path, options: RecorderOptions) -> Result<Self, FileError> {
        let file = RecordingFile::create(path)?;
        let clock = Clock::start();
        let output = if options.waits {
            Output::Direct(Disk::new(file, options.limits))
        } else {
            Output::Background(Background::start(file, options, clock)?)
        };
        Ok(Self { output, numbering: Numbering::default(), clock })
    }

    /// Checks that a file can be made at this place: worth asking before minutes of work for it. Nothing is written.
    ///
    /// # Errors
    /// [`FileError::Io`] when the folder is not there, or a folder has that name.
    pub fn check_place(path: &Path) -> Result<(), FileError> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        match folder.metadata() {
            Err(error) => Err(FileError::io(path, error)),
            Ok(_) if path.is_dir() => Err(FileError::io(path, ErrorKind::IsADirectory.into())),
            Ok(_) => Ok(()),
        }
    }

    /// Returns the time since the recording began: the arrival of what comes now.
    #[must_use]
    pub fn now(&self) -> Micros {
        self.clock.now()
    }

    /// Returns whether a keyframe would end a gap now. The next body should be one then: of the state after the frame
    /// where the stream is made here, asked for from the server where it is not.
    #[must_use]
    pub fn wants_keyframe(&self) -> bool {
        match &self.output {
            Output::Direct(_) => false,
            Output::Background(background) => background.wants_keyframe(self.now()),
        }
    }

    /// Returns what is missing from the recording so far.
    #[must_use]
    pub fn missing(&self) -> Missing {
        match &self.output {
            Output::Direct(_) => Missing::default(),
            Output::Background(background) => background.missing(),
        }
    }

    /// Records the scene table of a stream that is made here: first of all, at time 0.
    ///
    /// # Errors
    /// [`FileError::Scene`] when a value in it makes no sense; else as [`wire`](Self::wire).
    pub fn scene(&mut self, scene: &SceneTable) -> Result<(), FileError> {
        for frame in self.numbering.scene(scene).map_err(FileError::Scene)? {
            self.wire(Micros(0), &frame)?;
        }
        Ok(())
    }

    /// Records a frame body of a stream that is made here.
    ///
    /// # Errors
    /// [`FileError::Body`] over 2^32 - 1 bytes; else as [`wire`](Self::wire).
    pub fn body(&mut self, arrival: Micros, kind: FrameKind, body: &[u8]) -> Result<(), FileError> {
        let frame = match kind {
            FrameKind::Key => self.numbering.keyframe(body),
            FrameKind::Delta => self.numbering.update(body),
        };
        self.wire(arrival, &frame.map_err(FileError::Body)?)
    }

    /// Records a message of a stream that is made here.
    ///
    /// # Errors
    /// [`FileError::Message`] when it makes no sense; else as [`wire`](Self::wire).
    pub fn message<M: Message>(&mut self, arrival: Micros, message: &M) -> Result<(), FileError> {
        let frame = self.numbering.message(message).map_err(FileError::Message)?;
        self.wire(arrival, &frame)
    }

    /// Records a frame as it was on the wire.
    ///
    /// # Errors
    /// With [`RecorderOptions::with_backpressure`], [`FileError::Record`] when the bytes are not one frame and
    /// [`FileError::Io`] when it could not be written. Without, none: the frame is written later, or missing.
    pub fn wire(&mut self, arrival: Micros, frame: &[u8]) -> Result<(), FileError> {
        match &mut self.output {
            Output::Direct(disk) => disk.append(arrival, frame).map_err(|error| disk.describe(error)),
            Output::Background(background) => {
                background.take(arrival, frame);
                Ok(())
            }
        }
    }

    /// Writes what waits and the index, and ends the recording.
    ///
    /// # Errors
    /// The first failure of the recording, even if it went on afterwards.
    pub fn finish(self) -> Result<Recorded, FileError> {
        match self.output {
            Output::Direct(mut disk) => {
                let bytes = disk.finish().map_err(|error| disk.describe(error))?;
                Ok(Recorded { bytes, missing: Missing::default() })
            }
            Output::Background(background) => background.finish(),
        }
    }

    /// A recording into any sink, by a thread.
    #[cfg(test)]
    pub(super) fn over(sink: impl super::disk::Sink, options: RecorderOptions) -> Self {
        let clock = Clock::start();
        let background = Background::start(sink, options, clock).unwrap();
        Self { output: Output::Background(background), numbering: Numbering::default(), clock }
    }
}
