//! A recording on a disk. After a failed write it continues behind its last whole record.

use std::fs::File;
use std::io::{ErrorKind, Result, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use super::FileError;
use crate::recording::{Writer, WriterError};
use crate::{Limits, Micros};

/// Destination of a recording's bytes.
pub(super) trait Sink: Send + 'static {
    /// Returns its path, for messages.
    fn path(&self) -> &Path;

    /// Appends all of `bytes`.
    fn put(&mut self, bytes: &[u8]) -> Result<()>;

    /// Truncates it to `length` bytes after a failed [`put`](Self::put).
    fn truncate(&mut self, length: u64) -> Result<()>;

    /// Flushes the bytes to the disk, and checks that the file still exists at its path.
    fn sync(&mut self) -> Result<()>;
}

/// A recording's file.
pub(super) struct RecordingFile {
    path: PathBuf,
    file: File,
}

impl RecordingFile {
    /// Creates the file; an existing file is replaced.
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
            // Devices do not support flushing.
            Err(error) if error.kind() == ErrorKind::InvalidInput => Ok(()),
            done => done,
        }
    }
}

/// Why a frame was not written.
#[derive(Debug)]
pub(super) enum DiskError {
    /// The bytes are not a frame, or the recording is finished.
    Writer(WriterError),
    /// The write failed.
    Io(std::io::Error),
}

impl From<WriterError> for DiskError {
    fn from(error: WriterError) -> Self {
        Self::Writer(error)
    }
}

/// A recording and its destination.
pub(super) struct Disk<S> {
    sink: S,
    writer: Writer,
    /// The file header until the first record. Both are written together, so a file is either empty or a recording.
    head: Vec<u8>,
    /// Bytes up to the end of the last whole record.
    whole_bytes: u64,
    /// Whether a partial record may follow them.
    torn: bool,
}

impl<S: Sink> Disk<S> {
    pub(super) fn new(sink: S, limits: Limits) -> Self {
        let (writer, head) = Writer::new(limits);
        Self { sink, writer, head, whole_bytes: 0, torn: false }
    }

    /// Writes one frame. After an error the recording is unchanged, and the caller may try again.
    pub(super) fn append(&mut self, arrival: Micros, frame: &[u8]) -> std::result::Result<(), DiskError> {
        let record = self.writer.append(arrival, frame)?;
        self.write(&record).map_err(|error| {
            self.writer.take_back();
            DiskError::Io(error)
        })
    }

    /// Writes the index and returns the length of the file.
    pub(super) fn finish(&mut self) -> std::result::Result<u64, DiskError> {
        let end = self.writer.finish()?;
        let written = self.write(&end).and_then(|()| self.sink.sync());
        if written.is_err() && self.torn {
            // A partial index would read as damage.
            let _ = self.sink.truncate(self.whole_bytes);
        }
        written.map_err(DiskError::Io)?;
        Ok(self.whole_bytes)
    }

    /// Flushes the recording; see [`Sink::sync`].
    pub(super) fn sync(&mut self) -> Result<()> {
        self.sink.sync()
    }

    /// Adds the path of the file to an error.
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
        // Each record is one write; the first includes the file header.
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
