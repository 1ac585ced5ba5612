//! A file that is there when it is whole, and not before.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use super::check_place;
use crate::error::{Failure, Outcome};

/// A file under a temporary name beside its own, which it gets at the end. Until then a file of that name stays as it is;
/// what is dropped before leaves nothing behind.
pub(crate) struct WholeFile {
    target: PathBuf,
    temporary: PathBuf,
    file: Option<BufWriter<File>>,
}

impl WholeFile {
    /// Starts the file. It must not be one of `inputs`.
    pub(crate) fn create(target: &Path, inputs: &[PathBuf]) -> Outcome<Self> {
        check_place(target)?;
        for input in inputs {
            if is_same(target, input) {
                return Err(Failure::usage(format_args!(
                    "{} would be written over itself; give -o another name",
                    input.display()
                )));
            }
        }
        if target.metadata().is_ok_and(|metadata| !metadata.is_file()) {
            return Err(Failure::writing(target, &ErrorKind::InvalidInput.into()));
        }
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        let temporary = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&temporary)
            .map_err(|error| Failure::writing(target, &error))?;
        Ok(Self { target: target.to_owned(), temporary, file: Some(BufWriter::new(file)) })
    }

    /// Appends bytes.
    pub(crate) fn put(&mut self, bytes: &[u8]) -> Outcome {
        let Some(file) = &mut self.file else { return Ok(()) };
        file.write_all(bytes).map_err(|error| Failure::writing(&self.target, &error))
    }

    /// Brings everything to the disk and gives the file its name.
    pub(crate) fn finish(mut self) -> Outcome {
        let Some(file) = self.file.take() else { return Ok(()) };
        let written = file.into_inner().map_err(std::io::IntoInnerError::into_error);
        // Closed before it is renamed: not every system renames an open file.
        written
            .and_then(|file| file.sync_all())
            .and_then(|()| std::fs::rename(&self.temporary, &self.target))
            .map_err(|error| {
                let _ = std::fs::remove_file(&self.temporary);
                Failure::writing(&self.target, &error)
            })
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if self.file.take().is_some() {
            let _ = std::fs::remove_file(&self.temporary);
        }
    }
}

/// Whether two paths lead to the same file.
fn is_same(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}
