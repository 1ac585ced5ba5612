//! Why a recording could not be written to a file.

use std::io;
use std::path::{Path, PathBuf};

use crate::WireFrameError;
use crate::message::MessageError;
use crate::recording::WriterError;

/// Why a recording could not be written to a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The file could not be made or written.
    #[error("cannot write {}: {error}; choose another place or free some room", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// A file would be written over one that it is made of.
    #[error("{} would be written over itself; choose another name for the copy", path.display())]
    SameFile {
        /// The file that is read.
        path: PathBuf,
    },
    /// The scene table has a value that cannot be sent.
    #[error(transparent)]
    Scene(MessageError),
    /// A message has a value that cannot be sent.
    #[error(transparent)]
    Message(MessageError),
    /// A frame body is too long for a frame.
    #[error(transparent)]
    Body(WireFrameError),
    /// Bytes that should be a frame are not one.
    #[error(transparent)]
    Record(WriterError),
    /// The system gave no thread to write with.
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
    /// The thread that writes ended early.
    #[error("{}: the recorder's thread failed", path.display())]
    ThreadFailed {
        /// The file.
        path: PathBuf,
    },
}

impl FileError {
    pub(super) fn io(path: &Path, error: io::Error) -> Self {
        Self::Io { path: path.to_owned(), error }
    }
}
