//! Files that appear only once they are complete.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use super::{FileError, Recorder};

/// A file that is written under a temporary name and renamed at the end, such as a recording made of others.
///
/// An existing file of the final name stays unchanged until then. A value that is dropped earlier leaves no file
/// behind.
#[derive(Debug)]
pub struct AtomicFile {
    target: PathBuf,
    temporary: PathBuf,
    file: Option<BufWriter<File>>,
}

impl AtomicFile {
    /// Creates the temporary file. `target` must not be one of `inputs`.
    ///
    /// # Errors
    /// [`FileError::SameFile`] when it is one of them, [`FileError::Io`] when the file cannot be created.
    pub fn create(target: &Path, inputs: &[PathBuf]) -> Result<Self, FileError> {
        Recorder::check_place(target)?;
        for input in inputs {
            if is_same(target, input) {
                return Err(FileError::SameFile { path: input.clone() });
            }
        }
        if target.metadata().is_ok_and(|metadata| !metadata.is_file()) {
            return Err(FileError::io(target, ErrorKind::InvalidInput.into()));
        }
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        let temporary = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&temporary)
            .map_err(|error| FileError::io(target, error))?;
        Ok(Self { target: target.to_owned(), temporary, file: Some(BufWriter::new(file)) })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// [`FileError::Io`] when the bytes could not be written.
    pub fn put(&mut self, bytes: &[u8]) -> Result<(), FileError> {
        let Some(file) = &mut self.file else { return Ok(()) };
        file.write_all(bytes).map_err(|error| FileError::io(&self.target, error))
    }

    /// Flushes the file to the disk and renames it.
    ///
    /// # Errors
    /// [`FileError::Io`] when either fails; no file is left behind.
    pub fn finish(mut self) -> Result<(), FileError> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let written = file.into_inner().map_err(std::io::IntoInnerError::into_error);
        // The file is closed before the rename, because not every system renames an open file.
        written
            .and_then(|file| file.sync_all())
            .and_then(|()| std::fs::rename(&self.temporary, &self.target))
            .map_err(|error| {
                let _ = std::fs::remove_file(&self.temporary);
                FileError::io(&self.target, error)
            })
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if self.file.take().is_some() {
            let _ = std::fs::remove_file(&self.temporary);
        }
    }
}

/// Returns whether two paths lead to the same file.
fn is_same(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_whole_or_not_there_and_never_written_over_its_source() {
        let folder = tempfile::tempdir().unwrap();
        let [source, copy] = ["source", "copy"].map(|name| folder.path().join(name));
        let names = || {
            let mut names: Vec<_> =
                folder.path().read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
            names.sort();
            names
        };
        let mut first = AtomicFile::create(&source, &[]).unwrap();
        first.put(b"whole").unwrap();
        assert!(!source.exists());
        first.finish().unwrap();
        assert_eq!(source.metadata().unwrap().len(), 5);
        let inputs = [source.clone()];
        let error = AtomicFile::create(&source, &inputs).unwrap_err();
        assert!(matches!(error, FileError::SameFile { .. }), "{error}");
        let mut dropped = AtomicFile::create(&copy, &inputs).unwrap();
        dropped.put(b"half").unwrap();
        drop(dropped);
        assert_eq!(names(), ["source"]);
        let nowhere = AtomicFile::create(&folder.path().join("no/where"), &[]).unwrap_err();
        assert!(nowhere.to_string().contains("choose another place"), "{nowhere}");
    }
}
