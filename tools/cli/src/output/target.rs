//! Where results go: a file, or standard output for `-`. Standard output then holds nothing else.

use std::fmt::Display;
use std::fs::File;
use std::io::{IsTerminal as _, Read as _, Write as _};
use std::path::{Path, PathBuf};

use psao_proto::recording::FILE_MAGIC;
use psao_proto::recording::file::AtomicFile;

use crate::context::{broken_output, say};
use crate::error::{Failure, Outcome};

/// The file that is standard output, for what writes to files only.
pub(crate) const STANDARD_OUTPUT: &str = "/dev/stdout";

/// Returns whether a path stands for standard output.
pub(crate) fn is_standard(path: &Path) -> bool {
    path == Path::new("-") || path == Path::new(STANDARD_OUTPUT)
}

/// Returns what a path is called in a sentence.
pub(crate) fn name(path: &Path) -> String {
    if is_standard(path) { "to standard output".to_owned() } else { path.display().to_string() }
}

/// What a file of ours holds.
pub(crate) struct Content {
    /// In words, with an article.
    name: &'static str,
    /// Its first bytes.
    magic: &'static [u8],
    /// Ending of its name, if a name with another one would mislead.
    extension: Option<&'static str>,
}

impl Content {
    pub(crate) const RECORDING: Self = Self { name: "a recording", magic: &FILE_MAGIC, extension: None };
    pub(crate) const PNG: Self =
        Self { name: "a PNG picture", magic: b"\x89PNG\r\n\x1a\n", extension: Some("png") };
    pub(crate) const SVG: Self = Self { name: "an SVG plot", magic: b"<svg", extension: Some("svg") };
}

/// Checks that a name fits what is written under it, and that it is not the name of a file with something else in it, such
/// as the scene.
pub(crate) fn check(path: &Path, content: &Content) -> Outcome {
    if is_standard(path) {
        return Ok(());
    }
    let Content { name, magic, extension } = content;
    if let (Some(given), Some(right)) = (path.extension(), extension)
        && !given.eq_ignore_ascii_case(right)
    {
        return Err(Failure::usage(format_args!(
            "{} would hold {name}: call it {}",
            path.display(),
            path.with_extension(right).display()
        )));
    }
    if !path.metadata().is_ok_and(|about| about.is_file() && about.len() > 0) {
        return Ok(());
    }
    let mut start = vec![0; magic.len()];
    let is_ours =
        File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *magic;
    if is_ours {
        return Ok(());
    }
    Err(Failure::input(format_args!(
        "{} exists and is not {name}: choose another name, or remove it first",
        path.display()
    )))
}

/// Writes a file, whole or not at all, or to standard output.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Outcome {
    if is_standard(path) {
        let mut out = std::io::stdout().lock();
        return out.write_all(bytes).and_then(|()| out.flush()).map_err(|error| broken_output(&error));
    }
    if path.metadata().is_ok_and(|about| !about.is_file()) {
        return std::fs::write(path, bytes).map_err(|error| Failure::writing(path, &error));
    }
    let mut file = AtomicFile::create(path, &[])?;
    file.put(bytes)?;
    Ok(file.finish()?)
}

/// Prints a line about the result: on standard output, or on standard error when the result itself goes to the former.
pub(crate) fn note(path: &Path, text: impl Display) -> Outcome {
    if is_standard(path) {
        eprintln!("{text}");
        return Ok(());
    }
    say(text)
}

/// Returns the path at which a recorder can write what `path` means.
pub(crate) fn recording(path: &Path) -> Outcome<PathBuf> {
    if !is_standard(path) {
        check(path, &Content::RECORDING)?;
        return Ok(path.to_owned());
    }
    refuse_terminal()?;
    let device = PathBuf::from(STANDARD_OUTPUT);
    if device.exists() {
        Ok(device)
    } else {
        Err(Failure::input("this system has no /dev/stdout to record to: name a file instead of -"))
    }
}

/// Refuses to fill a terminal with the bytes of a recording or a picture.
pub(crate) fn refuse_terminal() -> Outcome {
    if std::io::stdout().is_terminal() {
        return Err(Failure::input(
            "- is this terminal, which cannot show the result: name a file, or pipe it on, as in `... -o - | psao inspect -`",
        ));
    }
    Ok(())
}

/// A result that appears whole or not at all; on standard output it appears as it is made.
pub(crate) enum Target {
    File(AtomicFile),
    Standard,
}

impl Target {
    /// Starts the result. It must not be one of `inputs`.
    pub(crate) fn create(path: &Path, inputs: &[PathBuf]) -> Outcome<Self> {
        if is_standard(path) {
            refuse_terminal()?;
            return Ok(Self::Standard);
        }
        check(path, &Content::RECORDING)?;
        Ok(Self::File(AtomicFile::create(path, inputs)?))
    }

    /// Appends bytes.
    pub(crate) fn put(&mut self, bytes: &[u8]) -> Outcome {
        match self {
            Self::File(file) => Ok(file.put(bytes)?),
            Self::Standard => std::io::stdout().write_all(bytes).map_err(|error| broken_output(&error)),
        }
    }

    /// Ends the result.
    pub(crate) fn finish(self) -> Outcome {
        match self {
            Self::File(file) => Ok(file.finish()?),
            Self::Standard => std::io::stdout().flush().map_err(|error| broken_output(&error)),
        }
    }
}
