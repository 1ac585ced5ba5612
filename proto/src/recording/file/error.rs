//! Errors of recordings in files.

use std::io;
use std::path::{Path, PathBuf};

use crate::WireFrameError;
use crate::message::MessageError;
use crate::recording::WriterError;

/// Why a recording could not be written to a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The file could not be created or written.
    #[error("cannot write {}: {error}; choose another place or free some room", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        error: io::Error,
    },
    /// The output file is one of the input files.
    #[error("{} would be written over itself; choose another name for the copy", path.display())]
    SameFile {
        /// Path of the input file.
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
    /// The bytes are not one whole frame.
    #[error(transparent)]
    Record(WriterError),
    /// The writing thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
    /// The writing thread ended early.
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
