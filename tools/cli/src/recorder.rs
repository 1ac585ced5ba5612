//! Writes recordings: every record in one write, so that whatever stops the program leaves whole frames behind.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use psao_proto::message::Message;
use psao_proto::recording::Writer;
use psao_proto::{Limits, Micros, Numbering, SceneTable};

use crate::error::{Exit, Failure, Outcome};

/// A recording being written.
pub(crate) struct Recorder {
    path: PathBuf,
    file: File,
    writer: Writer,
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

impl Recorder {
    /// Starts a recording; a file of that name is replaced.
    pub(crate) fn create(path: &Path) -> Outcome<Self> {
        let file = File::create(path).map_err(|error| Failure::writing(path, &error))?;
        let (writer, head) = Writer::new(Limits::default());
        let mut recorder = Self { path: path.to_owned(), file, writer, numbering: Numbering::default() };
        recorder.write(&head)?;
        Ok(recorder)
    }

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
        let record = self.writer.append(arrival, frame).map_err(|error| Failure::new(Exit::System, error))?;
        self.write(&record)
    }

    /// Writes the index; gives the length of the file.
    pub(crate) fn finish(mut self) -> Outcome<u64> {
        let end = self.writer.finish().map_err(|error| Failure::new(Exit::System, error))?;
        self.write(&end)?;
        Ok(self.writer.file_bytes())
    }

    fn write(&mut self, bytes: &[u8]) -> Outcome {
        self.file.write_all(bytes).map_err(|error| {
            self.writer.fail();
            Failure::writing(&self.path, &error)
        })
    }
}
