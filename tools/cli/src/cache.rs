//! A folder that keeps the points of scenes between runs: a file for each scene and settings.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::PathBuf;
use std::time::SystemTime;

use etcetera::{BaseStrategy as _, choose_base_strategy};
use psao_server::points::{PointCache, PointCacheError, PointKey};

use crate::args::CacheArgs;

/// Endings of files, and of those that are still being written.
const WHOLE: &str = "points";
const PARTIAL: &str = "partial";

/// A folder of points.
pub(crate) struct Folder {
    path: PathBuf,
    most_bytes: u64,
}

impl Folder {
    /// Returns the folder that the options name, or the system's folder for caches; `None` where points are not kept.
    pub(crate) fn of(args: &CacheArgs) -> Option<Self> {
        let of_system = || Some(choose_base_strategy().ok()?.cache_dir().join("psao"));
        let path = args.cache.clone().or_else(of_system)?;
        (!args.no_cache).then_some(Self { path, most_bytes: args.cache_size.0 })
    }

    fn file(&self, key: &PointKey) -> PathBuf {
        self.path.join(format!("{key}.{WHOLE}"))
    }

    fn read(&self, key: &PointKey) -> io::Result<Vec<u8>> {
        let file = File::open(self.file(key))?;
        let mut bytes = Vec::new();
        file.take(self.most_bytes + 1).read_to_end(&mut bytes)?;
        // Notes the last use. If that fails, the file is removed a little early.
        let _ = File::options()
            .append(true)
            .open(self.file(key))
            .and_then(|file| file.set_modified(SystemTime::now()));
        Ok(bytes)
    }

    /// Writes a file under another name first, so that it appears whole or not at all.
    fn write(&self, key: &PointKey, bytes: &[u8]) -> io::Result<()> {
        fs::create_dir_all(&self.path)?;
        let mut file = tempfile::Builder::new().suffix(&format!(".{PARTIAL}")).tempfile_in(&self.path)?;
        file.write_all(bytes)?;
        file.persist(self.file(key)).map_err(|error| error.error)?;
        self.make_room()
    }

    /// Removes the least recently used files until the rest fits. Other files are left alone.
    fn make_room(&self) -> io::Result<()> {
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.path)? {
            let path = entry?.path();
            let ours =
                path.extension().is_some_and(|end| end == OsStr::new(WHOLE) || end == OsStr::new(PARTIAL));
            // Another run may have removed it meanwhile.
            if let (true, Ok(about)) = (ours, fs::metadata(&path)) {
                files.push((about.modified()?, about.len(), path));
            }
        }
        files.sort_unstable();
        let mut sum: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, bytes, path) in files {
            if sum <= self.most_bytes {
                break;
            }
            fs::remove_file(&path).or_else(|error| gone(&error).then_some(()).ok_or(error))?;
            sum -= bytes;
        }
        Ok(())
    }
}

fn gone(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::NotFound
}

/// Returns the folder as the libraries take it.
pub(crate) fn as_cache(folder: &Option<Folder>) -> Option<&dyn PointCache> {
    folder.as_ref().map(|folder| folder as &dyn PointCache)
}

impl PointCache for Folder {
    fn load(&self, key: &PointKey) -> Option<Vec<u8>> {
        self.read(key)
            .map_err(|error| {
                if !gone(&error) {
                    eprintln!(
                        "psao: {} cannot be read: {error}; the points are computed again",
                        self.file(key).display()
                    );
                }
            })
            .ok()
    }

    fn store(&self, key: &PointKey, bytes: &[u8]) {
        if let Err(error) = self.write(key, bytes) {
            eprintln!(
                "psao: the points cannot be kept in {}: {error}; name another folder with --cache, or use --no-cache",
                self.path.display()
            );
        }
    }

    fn refused(&self, key: &PointKey, reason: &PointCacheError) {
        eprintln!("psao: {} is not used: {reason}; the points are computed again", self.file(key).display());
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::time::Duration;

    use psao_server::points::PointSettings;
    use psao_server::scene::Scene;

    use super::*;
    use crate::quantity::Size;

    fn keys(count: u64) -> Vec<PointKey> {
        let scene = Scene::load("asteroids").unwrap();
        (0..count).map(|seed| PointKey::new(&scene, &PointSettings::default().with_seed(seed))).collect()
    }

    #[test]
    fn what_was_not_used_for_longest_goes_first() {
        let place = tempfile::tempdir().unwrap();
        let folder = Folder { path: place.path().join("new"), most_bytes: 250 };
        let keys = keys(3);
        let age = |key: &PointKey, seconds| {
            let file = File::options().append(true).open(folder.file(key)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(seconds)).unwrap();
        };
        folder.store(&keys[0], &[0; 100]);
        fs::write(folder.path.join("mine.txt"), [0; 1000]).unwrap();
        fs::write(folder.path.join("cut.partial"), [0; 20]).unwrap();
        folder.store(&keys[1], &[1; 100]);
        age(&keys[0], 9000);
        age(&keys[1], 5000);
        let cut = File::options().append(true).open(folder.path.join("cut.partial")).unwrap();
        cut.set_modified(SystemTime::now() - Duration::from_secs(7000)).unwrap();
        // Read again, the oldest is the newest.
        assert_eq!(folder.load(&keys[0]), Some(vec![0; 100]));
        folder.store(&keys[2], &[2; 100]);
        assert_eq!(folder.load(&keys[0]), Some(vec![0; 100]));
        assert_eq!(folder.load(&keys[1]), None);
        assert_eq!(folder.load(&keys[2]), Some(vec![2; 100]));
        assert!(folder.path.join("mine.txt").exists() && !folder.path.join("cut.partial").exists());
    }

    #[test]
    fn options_come_before_the_environment() {
        let args = |cache: Option<&str>, no_cache| CacheArgs {
            cache: cache.map(PathBuf::from),
            cache_size: Size(1 << 30),
            no_cache,
        };
        assert_eq!(Folder::of(&args(Some("here"), false)).unwrap().path, Path::new("here"));
        assert!(Folder::of(&args(None, true)).is_none());
    }
}
