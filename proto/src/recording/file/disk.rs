//! A recording on a disk: after a failed write it goes on behind its last whole record.

use std::fs::File;
use std::io::{ErrorKind, Result, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use super::FileError;
use crate::recording::{Writer, WriterError};
use crate::{Limits, Micros};

/// Where the bytes of a recording go.
pub(super) trait Sink: Send + 'static {
    /// Its name, for people.
    fn path(&self) -> &Path;

    /// Appends all of `bytes`.
    fn put(&mut self, bytes: &[u8]) -> Result<()>;

    /// Cuts it back to its first `length` bytes, after a [`put`](Self::put) that failed.
    fn truncate(&mut self, length: u64) -> Result<()>;

    /// Brings what was put to the disk, and checks that it is still where it should be.
    fn sync(&mut self) -> Result<()>;
}

/// A file.
pub(super) struct RecordingFile {
    path: PathBuf,
    file: File,
}

impl RecordingFile {
    /// A new file; one of that name is replaced.
    #[expect(clippy::disallowed_methods, reason = "this module is the crate's way to the disk")]
    pub(super) fn create(path: &Path) -> std::result::Result<Self, FileError> {
        let file = File::create(path).map_err(|error| FileError::io(path, error))?;
        Ok(Self { path: path.to_owned(), file })
    }
}

impl Sink for RecordingFile {
    fn path(&self) -> &Path {
        &self.path
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes)
    }

    fn truncate(&mut self, length: u64) -> Result<()> {
        self.file.set_len(length)?;
        self.file.seek(SeekFrom::Start(length)).map(drop)
    }

    fn sync(&mut self) -> Result<()> {
        if !self.path.exists() {
            return Err(ErrorKind::NotFound.into());
        }
        match self.file.sync_data() {
            // A device has nothing to bring anywhere.
            Err(error) if error.kind() == ErrorKind::InvalidInput => Ok(()),
            done => done,
        }
    }
}

/// Why a frame is not in the recording.
#[derive(Debug)]
pub(super) enum DiskError {
    /// It is no frame, or the recording is finished.
    Writer(WriterError),
    /// It could not be written.
    Io(std::io::Error),
}

impl From<WriterError> for DiskError {
    fn from(error: WriterError) -> Self {
        Self::Writer(error)
    }
}

/// A recording and where it goes.
pub(super) struct Disk<S> {
    sink: S,
    writer: Writer,
    /// The file header, until the first record: they are written together, so that a file is a recording or empty.
    head: Vec<u8>,
    /// Bytes up to the end of the last whole record.
    whole_bytes: u64,
    /// Whether something may follow them.
    torn: bool,
}

impl<S: Sink> Disk<S> {
    pub(super) fn new(sink: S, limits: Limits) -> Self {
        let (writer, head) = Writer::new(limits);
        Self { sink, writer, head, whole_bytes: 0, torn: false }
    }

    /// Writes one frame. After an error the recording is as before, and it may be tried again.
    pub(super) fn append(&mut self, arrival: Micros, frame: &[u8]) -> std::result::Result<(), DiskError> {
        let record = self.writer.append(arrival, frame)?;
        self.write(&record).map_err(|error| {
            self.writer.take_back();
            DiskError::Io(error)
        })
    }

    /// Writes the index; gives the length of the file.
    pub(super) fn finish(&mut self) -> std::result::Result<u64, DiskError> {
        let end = self.writer.finish()?;
        let written = self.write(&end).and_then(|()| self.sink.sync());
        if written.is_err() && self.torn {
            // Half an index would read as damage.
            let _ = self.sink.truncate(self.whole_bytes);
        }
        written.map_err(DiskError::Io)?;
        Ok(self.whole_bytes)
    }

    /// See [`Sink::sync`].
    pub(super) fn sync(&mut self) -> Result<()> {
        self.sink.sync()
    }

    /// An error with the name of the file.
    pub(super) fn describe(&self, error: DiskError) -> FileError {
        match error {
            DiskError::Writer(error) => FileError::Record(error),
            DiskError::Io(error) => FileError::io(self.sink.path(), error),
        }
    }

    fn write(&mut self, record: &[u8]) -> Result<()> {
        if self.torn {
            self.sink.truncate(self.whole_bytes)?;
            self.torn = false;
        }
        // One write for one record; the header goes with the first.
        let joined = (!self.head.is_empty()).then(|| [&self.head[..], record].concat());
        let bytes = joined.as_deref().unwrap_or(record);
        self.torn = true;
        self.sink.put(bytes)?;
        self.torn = false;
        self.whole_bytes += bytes.len() as u64;
        self.head = Vec::new();
        Ok(())
    }
}
