//! What is measured, kept as it comes: a line of JSON for each, and pictures beside.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use psao_eval::sweep::Record;
use psao_reconstruct::picture::Picture;

use crate::error::{Exit, Failure, Outcome};

const LINES: &str = "results.jsonl";
const PICTURES: &str = "pictures";

/// Records by key; in a folder, where there is one.
pub(super) struct Store {
    records: BTreeMap<String, Record>,
    place: Option<(PathBuf, File)>,
    /// Lines of an earlier run that could not be read; what they held is measured again.
    pub(super) unreadable: usize,
}

impl Store {
    /// Opens a folder. With `resume` its results are kept; without, it must have none.
    pub(super) fn open(folder: Option<&Path>, resume: bool) -> Outcome<Self> {
        let mut store = Self { records: BTreeMap::new(), place: None, unreadable: 0 };
        let Some(folder) = folder else { return Ok(store) };
        let pictures = folder.join(PICTURES);
        fs::create_dir_all(&pictures).map_err(|error| Failure::writing(&pictures, &error))?;
        let path = folder.join(LINES);
        let mut kept = String::new();
        match fs::read(&path) {
            Ok(bytes) if !bytes.is_empty() => {
                if !resume {
                    return Err(Failure::input(format_args!(
                        "{} holds results already; --resume goes on with them, or name another folder",
                        folder.display()
                    )));
                }
                kept = store.take(&String::from_utf8_lossy(&bytes));
            }
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(Failure::reading(&path, &error));
            }
            _ => {}
        }
        // Whole lines alone, so that the next one starts a line of its own; under another name first, to lose nothing.
        let writing = |error: std::io::Error| Failure::writing(&path, &error);
        let partial = folder.join(format!("{LINES}.partial"));
        fs::write(&partial, kept).and_then(|()| fs::rename(&partial, &path)).map_err(writing)?;
        let file = File::options().append(true).open(&path).map_err(writing)?;
        store.place = Some((folder.to_owned(), file));
        Ok(store)
    }

    /// Reads the lines of an earlier run; returns those that are whole.
    fn take(&mut self, text: &str) -> String {
        let mut kept = String::new();
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            match serde_json::from_str::<Record>(line) {
                Ok(record) => {
                    kept.push_str(line);
                    kept.push('\n');
                    self.records.insert(record.key.clone(), record);
                }
                Err(_) => self.unreadable += 1,
            }
        }
        kept
    }

    /// Returns the record of a key.
    pub(super) fn record(&self, key: &str) -> Option<&Record> {
        self.records.get(key)
    }

    /// Saves a record.
    pub(super) fn add(&mut self, record: Record) -> Outcome {
        if let Some((folder, file)) = &mut self.place {
            let mut line = json(&record)?;
            line.push('\n');
            file.write_all(line.as_bytes())
                .and_then(|()| file.sync_data())
                .map_err(|error| Failure::writing(&folder.join(LINES), &error))?;
        }
        self.records.insert(record.key.clone(), record);
        Ok(())
    }

    /// Saves a picture, if there is a folder.
    pub(super) fn picture(&self, key: &str, what: &str, picture: &Picture) -> Outcome {
        let Some((folder, _)) = &self.place else { return Ok(()) };
        let path = picture_path(folder, key, what);
        let png = picture.to_png().map_err(|error| Failure::new(Exit::System, error))?;
        fs::write(&path, png).map_err(|error| Failure::writing(&path, &error))
    }

    /// Returns the PNG file of a picture, where it was saved.
    pub(super) fn png(&self, key: &str, what: &str) -> Option<Vec<u8>> {
        let (folder, _) = self.place.as_ref()?;
        fs::read(picture_path(folder, key, what)).ok()
    }
}

fn picture_path(folder: &Path, key: &str, what: &str) -> PathBuf {
    folder.join(PICTURES).join(format!("{key}.{what}.png"))
}

/// Returns a record as a line of JSON.
fn json(record: &Record) -> Outcome<String> {
    serde_json::to_string(record)
        .map_err(|error| Failure::new(Exit::System, format_args!("cannot write JSON: {error}")))
}

#[cfg(test)]
mod tests {
    use psao_eval::sweep::{ErrorFigures, MemoryFigures, RecordKind, Spread};

    use super::*;

    fn record(key: &str) -> Record {
        Record {
            key: key.to_owned(),
            scene: "s".to_owned(),
            kind: RecordKind::Screen,
            name: "ssao".to_owned(),
            label: "8".to_owned(),
            setting: None,
            error: ErrorFigures { mae: 0.1, lpips: Some(0.3), ..ErrorFigures::default() },
            pictures: Vec::new(),
            picture_ms: Spread::default(),
            stages: Vec::new(),
            stream: None,
            memory: MemoryFigures::default(),
        }
    }

    #[test]
    fn a_line_that_was_cut_off_costs_that_line_alone() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(Some(folder.path()), false).unwrap();
        store.add(record("a")).unwrap();
        store.add(record("b")).unwrap();
        drop(store);
        let path = folder.path().join(LINES);
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() - 7]).unwrap();
        let mut again = Store::open(Some(folder.path()), true).unwrap();
        assert_eq!((again.record("a"), again.record("b")), (Some(&record("a")), None));
        assert_eq!(again.unreadable, 1);
        again.add(record("b")).unwrap();
        drop(again);
        assert_eq!(fs::read(&path).unwrap(), whole, "the next line starts on a line of its own");
    }

    #[test]
    fn figures_that_were_kept_are_the_same_to_the_last_digit() {
        let folder = tempfile::tempdir().unwrap();
        // Read in the quick way these come out one step off.
        let error = ErrorFigures {
            mae: 0.921_883_680_555_555_5,
            rmse: 0.991_277_515_888_214_1,
            ..ErrorFigures::default()
        };
        let kept = Record { error, ..record("a") };
        Store::open(Some(folder.path()), false).unwrap().add(kept.clone()).unwrap();
        assert_eq!(Store::open(Some(folder.path()), true).unwrap().record("a"), Some(&kept));
    }

    #[test]
    fn results_are_not_written_over_unasked() {
        let folder = tempfile::tempdir().unwrap();
        Store::open(Some(folder.path()), false).unwrap().add(record("a")).unwrap();
        let refused = Store::open(Some(folder.path()), false).err().unwrap();
        assert_eq!(refused.exit, Exit::Input);
        assert!(refused.to_string().contains("--resume"), "{refused}");
        assert!(Store::open(Some(folder.path()), true).unwrap().record("a").is_some());
    }
}
