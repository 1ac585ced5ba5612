//! Writes recordings: every record in one write, so that whatever stops the program leaves whole frames behind.

mod backlog;
mod disk;
mod live;
mod whole;

use std::path::Path;

use psao_proto::message::Message;
use psao_proto::{Micros, Numbering, SceneTable};

use self::disk::{Disk, RecordingFile};
pub(crate) use self::live::Live;
pub(crate) use self::whole::WholeFile;
use crate::error::{Exit, Failure, Outcome};

/// What takes the frames of a recording.
pub(crate) trait Tape {
    /// Takes a frame as it is on the wire.
    fn take(&mut self, arrival: Micros, frame: &[u8]) -> Outcome;
}

/// A recording being written: at once, or behind the stream's back ([`Live`]).
pub(crate) struct Recorder<T = Direct> {
    tape: T,
    numbering: Numbering,
}

/// Whether a file can be made at this place: worth asking before minutes of work for it.
pub(crate) fn check_place(path: &Path) -> Outcome {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match folder.metadata() {
        Err(error) => Err(Failure::writing(path, &error)),
        Ok(_) if path.is_dir() => Err(Failure::writing(path, &std::io::ErrorKind::IsADirectory.into())),
        Ok(_) => Ok(()),
    }
}

/// Writes each frame before it goes on; the first failure is the last frame.
pub(crate) struct Direct(Disk<RecordingFile>);

impl Tape for Direct {
    fn take(&mut self, arrival: Micros, frame: &[u8]) -> Outcome {
        self.0.append(arrival, frame).map_err(|error| self.0.failure(&error))
    }
}

impl Recorder {
    /// Starts a recording; a file of that name is replaced.
    pub(crate) fn create(path: &Path) -> Outcome<Self> {
        Ok(Self { tape: Direct(Disk::new(RecordingFile::create(path)?)), numbering: Numbering::default() })
    }

    /// Writes the index; gives the length of the file.
    pub(crate) fn finish(mut self) -> Outcome<u64> {
        let disk = &mut self.tape.0;
        disk.finish().map_err(|error| disk.failure(&error))
    }
}

impl Recorder<Live> {
    /// Starts a recording that never makes its stream wait; a file of that name is replaced. At most `buffer` bytes wait
    /// for the disk.
    pub(crate) fn live(path: &Path, buffer: usize) -> Outcome<Self> {
        let live = Live::start(RecordingFile::create(path)?, buffer)?;
        Ok(Self { tape: live, numbering: Numbering::default() })
    }

    /// Time since the recording began: the arrival of what comes now.
    pub(crate) fn now(&self) -> Micros {
        self.tape.now()
    }

    /// Whether a keyframe would end a gap.
    pub(crate) fn wants_keyframe(&self) -> bool {
        self.tape.wants_keyframe()
    }

    /// Writes what waits, and the index; says what is missing; gives the length of the file.
    pub(crate) fn finish(self) -> Outcome<u64> {
        self.tape.finish()
    }
}

impl<T: Tape> Recorder<T> {
    /// The scene table of a stream that is made here.
    pub(crate) fn scene(&mut self, scene: &SceneTable) -> Outcome {
        for frame in self.numbering.scene(scene).map_err(Failure::input)? {
            self.wire(Micros(0), &frame)?;
        }
        Ok(())
    }

    /// A frame body of a stream that is made here.
    pub(crate) fn body(&mut self, arrival: Micros, keyframe: bool, body: &[u8]) -> Outcome {
        let frame = if keyframe { self.numbering.keyframe(body) } else { self.numbering.update(body) };
        self.wire(arrival, &frame.map_err(|error| Failure::new(Exit::System, error))?)
    }

    /// A message of a stream that is made here.
    pub(crate) fn message<M: Message>(&mut self, arrival: Micros, message: &M) -> Outcome {
        let frame = self.numbering.message(message).map_err(|error| Failure::new(Exit::System, error))?;
        self.wire(arrival, &frame)
    }

    /// A frame as it was on the wire.
    pub(crate) fn wire(&mut self, arrival: Micros, frame: &[u8]) -> Outcome {
        self.tape.take(arrival, frame)
    }
}
