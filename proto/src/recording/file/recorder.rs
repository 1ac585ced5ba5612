//! A stream into a file.

use std::fmt;
use std::io::ErrorKind;
use std::path::Path;
use std::time::Instant;

use psao_codec::envelope::FrameKind;

use super::background::BackgroundRecorder;
use super::disk::{Disk, RecordingFile};
use super::{FileError, GapTotals, RecorderOptions};
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
    Background(BackgroundRecorder),
}

/// A recording that was finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct RecordingOutcome {
    /// Length of the file.
    pub bytes: u64,
    /// What is not in it.
    pub missing: GapTotals,
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
            Output::Background(BackgroundRecorder::start(file, options, clock)?)
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
    pub fn missing(&self) -> GapTotals {
        match &self.output {
            Output::Direct(_) => GapTotals::default(),
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
    pub fn finish(self) -> Result<RecordingOutcome, FileError> {
        match self.output {
            Output::Direct(mut disk) => {
                let bytes = disk.finish().map_err(|error| disk.describe(error))?;
                Ok(RecordingOutcome { bytes, missing: GapTotals::default() })
            }
            Output::Background(background) => background.finish(),
        }
    }

    /// A recording into any sink, by a thread.
    #[cfg(test)]
    pub(super) fn over(sink: impl super::disk::Sink, options: RecorderOptions) -> Self {
        let clock = Clock::start();
        let background = BackgroundRecorder::start(sink, options, clock).unwrap();
        Self { output: Output::Background(background), numbering: Numbering::default(), clock }
    }
}

impl fmt::Debug for Recorder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recorder").field("missing", &self.missing()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::disallowed_methods, reason = "files are read back")]

    use super::*;
    use crate::Limits;
    use crate::recording::{Player, StoredIndex, Summary, WriterError};
    use crate::sample::SampleServer;

    #[test]
    fn with_backpressure_the_file_has_every_frame_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stream.psao");
        let mut source = SampleServer::new().unwrap();
        let mut recorder = Recorder::create(&path, RecorderOptions::default().with_backpressure()).unwrap();
        recorder.scene(source.scene()).unwrap();
        for number in 0..5 {
            let frame = source.step().unwrap();
            recorder.body(Micros(number), frame.info.kind, &frame.body).unwrap();
            let garbage = recorder.wire(Micros(number), b"no frame").unwrap_err();
            assert!(matches!(garbage, FileError::Record(WriterError::NotAFrame(_))), "{garbage}");
            let file = std::fs::read(&path).unwrap();
            let mut player = Player::new(&file, Limits::default()).unwrap();
            while player.next_event().is_some() {}
            assert!(player.stats().is_clean());
            assert_eq!(player.stats().applied, number + 1);
        }
        assert!(!recorder.wants_keyframe());
        let outcome = recorder.finish().unwrap();
        let file = std::fs::read(&path).unwrap();
        assert_eq!((outcome.bytes, outcome.missing), (file.len() as u64, GapTotals::default()));
        assert_eq!(Summary::scan(&file, Limits::default()).unwrap().stored_index(), StoredIndex::Agrees);
    }

    #[test]
    fn places_where_no_file_can_be_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        for place in [folder.path().to_owned(), folder.path().join("no/where")] {
            let checked = Recorder::check_place(&place).unwrap_err();
            let created = Recorder::create(&place, RecorderOptions::default()).unwrap_err();
            for error in [checked, created] {
                assert!(error.to_string().contains("choose another place"), "{error}");
            }
        }
        Recorder::check_place(&folder.path().join("new")).unwrap();
        assert_eq!(folder.path().read_dir().unwrap().count(), 0, "a check writes nothing");
    }
}
