//! Reads and hashes the bytes of scene files and checks their values.

use std::fs;
use std::io::Read;
use std::path::Path;

use glam::DVec3;

use crate::scene::error::SceneError;
use crate::scene::limits;

/// Checks the values of a scene file. Its errors name the key of the value.
pub(super) struct Checker<'a> {
    pub(super) path: &'a Path,
}

impl Checker<'_> {
    /// Returns the error for an invalid value of a key.
    pub(super) fn wrong(&self, key: &str, problem: impl Into<String>) -> SceneError {
        SceneError::SceneValue { path: self.path.to_owned(), key: key.to_owned(), problem: problem.into() }
    }

    /// Returns the value if it lies between `low` and `high`.
    pub(super) fn range(&self, key: &str, value: f64, low: f64, high: f64) -> Result<f64, SceneError> {
        if value >= low && value <= high {
            Ok(value)
        } else {
            Err(self.wrong(key, format!("{value} is not between {low} and {high}")))
        }
    }

    /// Returns the vector if each coordinate is within the limit.
    pub(super) fn vector(&self, key: &str, value: [f64; 3]) -> Result<DVec3, SceneError> {
        for v in value {
            self.range(key, v, -limits::MAX_MAGNITUDE, limits::MAX_MAGNITUDE)?;
        }
        Ok(DVec3::from_array(value))
    }
}

/// Reads a whole file if it is within the size limit.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, SceneError> {
    let io = |source| SceneError::Io { path: path.to_owned(), source };
    let file = fs::File::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    let too_large =
        |bytes| SceneError::FileTooLarge { path: path.to_owned(), bytes, limit: limits::MAX_FILE_BYTES };
    if bytes > limits::MAX_FILE_BYTES {
        return Err(too_large(bytes));
    }
    let mut data = Vec::new();
    // A device or a pipe has no known size: read at most one byte more than allowed.
    file.take(limits::MAX_FILE_BYTES + 1).read_to_end(&mut data).map_err(io)?;
    if data.len() as u64 > limits::MAX_FILE_BYTES {
        return Err(too_large(data.len() as u64));
    }
    Ok(data)
}

/// Adds a file and its length to a scene's digest. The length keeps different lists of files apart.
pub(crate) fn hash_file(hasher: &mut blake3::Hasher, bytes: &[u8]) {
    hasher.update(&(bytes.len() as u64).to_le_bytes());
    hasher.update(bytes);
}
