//! The failure of a command: an exit code for scripts and a sentence for people.

use std::fmt;
use std::path::Path;

use psao_eval::reference::ReferenceError;
use psao_proto::recording::file::FileError;
use psao_proto::sinks::SinkError;
use psao_server::points::PointError;
use psao_server::server::SettingsError;
use psao_server::server::live::PipelineError;

use crate::producer::refused;

use crate::context::broken_output;
use crate::output::target::STANDARD_OUTPUT;

/// Exit codes of `psao`, as the README documents them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// The system failed: disk, memory, threads.
    System = 1,
    /// The command line is wrong, whatever it is run on (clap uses the same code).
    Usage = 2,
    /// A scene, recording, file or machine was refused, or an option that does not fit it.
    Input = 3,
    /// The command is done, but damaged input was left out.
    DataLoss = 4,
    /// The network or the peer failed.
    Peer = 5,
    /// A check failed: a hash, a bound, a verdict.
    Check = 6,
}

/// A command's failure: how bad, and a sentence that says what, where and what to do.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) exit: Exit,
    text: String,
}

/// The result of a command.
pub(crate) type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    pub(crate) fn new(exit: Exit, text: impl fmt::Display) -> Self {
        Self { exit, text: text.to_string() }
    }

    pub(crate) fn usage(text: impl fmt::Display) -> Self {
        Self::new(Exit::Usage, text)
    }

    pub(crate) fn input(text: impl fmt::Display) -> Self {
        Self::new(Exit::Input, text)
    }

    /// Returns the failure of a stream's settings that were refused: by themselves, or for this scene.
    pub(crate) fn settings(error: SettingsError) -> Self {
        match error {
            SettingsError::Points(error) => Self::points(error),
            error => Self::usage(error),
        }
    }

    /// Returns the failure of settings of points that were refused: by themselves, or for this scene.
    pub(crate) fn points(error: PointError) -> Self {
        match error {
            PointError::TooMany { .. } => Self::input(error),
            error => Self::usage(error),
        }
    }

    /// Returns the failure of reference rays: their settings, or the scene.
    pub(crate) fn reference(error: ReferenceError) -> Self {
        match error {
            ReferenceError::Settings(error) => Self::usage(error),
            error => Self::input(error),
        }
    }

    /// Returns the failure to read a file; the command line names the wrong one, so this is bad input.
    pub(crate) fn reading(path: &Path, error: &std::io::Error) -> Self {
        Self::new(Exit::Input, format_args!("cannot read {}: {error}", path.display()))
    }

    /// Returns the failure to write a file.
    pub(crate) fn writing(path: &Path, error: &std::io::Error) -> Self {
        Self::new(
            Exit::System,
            format_args!("cannot write {}: {error}; choose another place or free some room", path.display()),
        )
    }
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Self {
        let exit = match &error {
            FileError::Io { path, error } if path == Path::new(STANDARD_OUTPUT) => {
                return broken_output(error);
            }
            FileError::SameFile { .. } => Exit::Usage,
            FileError::Scene(_) => Exit::Input,
            _ => Exit::System,
        };
        Self::new(exit, error)
    }
}

impl From<SinkError> for Failure {
    fn from(error: SinkError) -> Self {
        match error {
            SinkError::Recording(error) => error.into(),
            error => Self::new(Exit::System, error),
        }
    }
}

impl From<PipelineError> for Failure {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Server(error) => refused(error),
            PipelineError::Sink(error) => error.into(),
            error => Self::new(Exit::System, error),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};

    use super::*;

    #[test]
    fn a_file_that_cannot_be_written_is_the_systems_fault_and_its_own_source_the_users() {
        let path = Path::new("there").to_owned();
        let full = FileError::Io { path: path.clone(), error: Error::from(ErrorKind::StorageFull) };
        assert_eq!(full.to_string(), Failure::writing(&path, &ErrorKind::StorageFull.into()).to_string());
        assert_eq!(Failure::from(full).exit, Exit::System);
        assert_eq!(Failure::from(FileError::SameFile { path }).exit, Exit::Usage);
    }
}
