//! The recorder, which writes a stream to a file.

use std::fmt;
use std::io::ErrorKind;
use std::path::Path;
use std::time::Instant;

use psao_codec::envelope::FrameKind;

use super::background::BackgroundRecorder;
use super::backlog::kind;
use super::disk::{Disk, RecordingFile};
use super::keyframes::KeyframeTimer;
use super::{FileError, GapTotals, RecorderOptions};
use crate::message::Message;
use crate::{Micros, Numbering, SceneTable};

/// Records a stream into a file.
///
/// A server calls [`scene`](Self::scene), [`body`](Self::body) and [`message`](Self::message), which number its frames
/// as a connection does. A client calls [`wire`](Self::wire) with the frames that it receives. Arrival times count from
/// the start of the recording: [`now`](Self::now) for a live stream, the stream's own time otherwise.
///
/// The [module](crate::recording::file) describes the guarantees and has an example. A recorder that is dropped leaves a valid
/// recording of all frames that it took, but does not report failures.
pub struct Recorder {
    output: Output,
    numbering: Numbering,
    keyframes: KeyframeTimer,
    clock: Clock,
}

/// Way of the frames to the disk.
enum Output {
    /// Each call writes.
    Direct(Disk<RecordingFile>),
    /// A thread writes.
    Background(BackgroundRecorder),
}

/// Result of a finished recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct RecordingOutcome {
    /// Length of the file.
    pub bytes: u64,
    /// Frames that are missing from it.
    pub missing: GapTotals,
}

/// Time since the recording began.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock(Instant);

impl Clock {
    #[expect(clippy::disallowed_methods, reason = "a live recording stores the arrival time of each frame")]
    pub(super) fn start() -> Self {
        Self(Instant::now())
    }

    pub(super) fn now(self) -> Micros {
        Micros(u64::try_from(self.0.elapsed().as_micros()).unwrap_or(u64::MAX))
    }
}

impl Recorder {
    /// Starts a recording; an existing file is replaced.
    ///
    /// # Errors
    /// [`FileError::Io`] when the file cannot be created, [`FileError::Thread`] when the writing thread cannot be
    /// started.
    pub fn create(path: &Path, options: RecorderOptions) -> Result<Self, FileError> {
        let file = RecordingFile::create(path)?;
        let clock = Clock::start();
        let keyframes = KeyframeTimer::new(options.keyframes);
        let output = if options.waits {
            Output::Direct(Disk::new(file, options.limits))
        } else {
            Output::Background(BackgroundRecorder::start(file, options, clock)?)
        };
        Ok(Self { output, numbering: Numbering::default(), keyframes, clock })
    }

    /// Checks that a file can probably be created at `path`, before a long computation for it. Writes nothing.
    ///
    /// # Errors
    /// [`FileError::Io`] when the folder does not exist, or when `path` is a folder.
    pub fn check_place(path: &Path) -> Result<(), FileError> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        match folder.metadata() {
            Err(error) => Err(FileError::io(path, error)),
            Ok(_) if path.is_dir() => Err(FileError::io(path, ErrorKind::IsADirectory.into())),
            Ok(_) => Ok(()),
        }
    }

    /// Returns the time since the recording began, which is the arrival time of a frame that comes now.
    #[must_use]
    pub fn now(&self) -> Micros {
        self.clock.now()
    }

    /// Returns whether the next frame should be a keyframe: one would end a gap, or is due by the
    /// [`KeyframeInterval`](super::KeyframeInterval). A server should then record a keyframe of its state in place of an
    /// update that arrives now; a client should request one.
    #[must_use]
    pub fn wants_keyframe(&self, now: Micros) -> bool {
        let due = self.keyframes.due(now);
        match &self.output {
            Output::Direct(_) => due.is_some(),
            Output::Background(background) => background.wants_keyframe(now, due),
        }
    }

    /// Returns the frames that are missing from the recording so far.
    #[must_use]
    pub fn missing(&self) -> GapTotals {
        match &self.output {
            Output::Direct(_) => GapTotals::default(),
            Output::Background(background) => background.missing(),
        }
    }

    /// Records the scene table of a server's stream, at time 0. It must come first.
    ///
    /// # Errors
    /// [`FileError::Scene`] when it holds an invalid value; otherwise as [`wire`](Self::wire).
    pub fn scene(&mut self, scene: &SceneTable) -> Result<(), FileError> {
        for frame in self.numbering.scene(scene).map_err(FileError::Scene)? {
            self.wire(Micros(0), &frame)?;
        }
        Ok(())
    }

    /// Records a frame body of a server's stream.
    ///
    /// # Errors
    /// [`FileError::Body`] for a body over 2^32 - 1 bytes; otherwise as [`wire`](Self::wire).
    pub fn body(&mut self, arrival: Micros, kind: FrameKind, body: &[u8]) -> Result<(), FileError> {
        let frame = match kind {
            FrameKind::Key => self.numbering.keyframe(body),
            FrameKind::Delta => self.numbering.update(body),
        };
        self.wire(arrival, &frame.map_err(FileError::Body)?)
    }

    /// Records a frame body as [`body`](Self::body) does, or what `keyframe` makes of the state after it, where the recording
    /// [wants](Self::wants_keyframe) a keyframe.
    ///
    /// # Errors
    /// Those of `keyframe` and of [`body`](Self::body).
    pub fn body_or_keyframe<E: From<FileError>>(
        &mut self,
        arrival: Micros,
        kind: FrameKind,
        body: &[u8],
        keyframe: impl FnOnce() -> Result<Vec<u8>, E>,
    ) -> Result<(), E> {
        if kind == FrameKind::Delta && self.wants_keyframe(arrival) {
            return Ok(self.body(arrival, FrameKind::Key, &keyframe()?)?);
        }
        Ok(self.body(arrival, kind, body)?)
    }

    /// Records a message of a server's stream.
    ///
    /// # Errors
    /// [`FileError::Message`] when it holds an invalid value; otherwise as [`wire`](Self::wire).
    pub fn message<M: Message>(&mut self, arrival: Micros, message: &M) -> Result<(), FileError> {
        let frame = self.numbering.message(message).map_err(FileError::Message)?;
        self.wire(arrival, &frame)
    }

    /// Records a wire frame byte for byte.
    ///
    /// # Errors
    /// With [`RecorderOptions::with_backpressure`], [`FileError::Record`] when the bytes are not one frame and
    /// [`FileError::Io`] when the frame could not be written. Without it there are no errors: the frame is written
    /// later, or counted as missing.
    pub fn wire(&mut self, arrival: Micros, frame: &[u8]) -> Result<(), FileError> {
        match &mut self.output {
            Output::Direct(disk) => disk.append(arrival, frame).map_err(|error| disk.describe(error))?,
            Output::Background(background) => background.take(arrival, frame),
        }
        self.keyframes.took(arrival, kind(frame), frame.len() as u64);
        Ok(())
    }

    /// Writes all queued frames and the index, and ends the recording.
    ///
    /// # Errors
    /// The first failure of the recording, even if later writes succeeded.
    pub fn finish(self) -> Result<RecordingOutcome, FileError> {
        match self.output {
            Output::Direct(mut disk) => {
                let bytes = disk.finish().map_err(|error| disk.describe(error))?;
                Ok(RecordingOutcome { bytes, missing: GapTotals::default() })
            }
            Output::Background(background) => background.finish(),
        }
    }

    /// Creates a recorder with a writing thread and any sink.
    #[cfg(test)]
    pub(super) fn over(sink: impl super::disk::Sink, options: RecorderOptions) -> Self {
        let clock = Clock::start();
        let keyframes = KeyframeTimer::new(options.keyframes);
        let output = Output::Background(BackgroundRecorder::start(sink, options, clock).unwrap());
        Self { output, numbering: Numbering::default(), keyframes, clock }
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
        assert!(!recorder.wants_keyframe(Micros(5)));
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
