//! Reading files, standard input, and recordings with their damage repaired.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use psao_proto::Limits;
use psao_proto::recording::{Reader, Repaired, repair};

use crate::error::{Exit, Failure, Outcome};
use crate::output::number;

/// Largest number of bytes that are read of what is not a regular file, which may have no end.
const MAX_STREAM_BYTES: u64 = 4 << 30;
/// Bytes after which a stream must have shown that it is a recording.
const PROBE_BYTES: u64 = 16 << 20;

/// Returns whether a path stands for standard input.
fn is_standard(path: &Path) -> bool {
    path == Path::new("-")
}

/// Reads a whole file into memory, or standard input for `-`.
pub(crate) fn load(path: &Path) -> Outcome<Vec<u8>> {
    if is_standard(path) {
        return stream(&mut std::io::stdin().lock(), path, MAX_STREAM_BYTES);
    }
    let file = File::open(path).map_err(|error| Failure::reading(path, &error))?;
    if file.metadata().is_ok_and(|about| about.is_file()) {
        return std::fs::read(path).map_err(|error| Failure::reading(path, &error));
    }
    stream(&mut &file, path, MAX_STREAM_BYTES)
}

/// Reads a recording into memory, and repairs damage as far as the recording can. What was repaired goes to standard
/// error.
pub(crate) fn recording(path: &Path) -> Outcome<Vec<u8>> {
    let (bytes, repaired) = recording_with_repairs(path)?;
    if let Some(text) = repairs(&repaired) {
        eprintln!("psao: {}: {text}", path.display());
    }
    Ok(bytes)
}

/// Reads a recording into memory, and repairs damage as far as the recording can. Returns what was repaired as well.
pub(crate) fn recording_with_repairs(path: &Path) -> Outcome<(Vec<u8>, Vec<Repaired>)> {
    let mut bytes = load(path)?;
    let repaired = repair(&mut bytes, Limits::default());
    Ok((bytes, repaired))
}

/// Returns what was repaired, in words; `None` if nothing was.
pub(crate) fn repairs(repaired: &[Repaired]) -> Option<String> {
    let first = repaired.first()?;
    let bytes: u64 = repaired.iter().map(|stretch| stretch.bytes).sum();
    Some(format!(
        "repaired {} in memory, {}, the first at offset {}; `psao recover` writes a whole copy",
        number::counted(repaired.len() as u64, "damaged place"),
        number::bytes(bytes),
        first.offset
    ))
}

/// Reads up to `most` bytes of what may have no end.
fn stream(from: &mut dyn Read, path: &Path, most: u64) -> Outcome<Vec<u8>> {
    let name = if is_standard(path) { "standard input".to_owned() } else { path.display().to_string() };
    let failed =
        |error: std::io::Error| Failure::new(Exit::System, format_args!("cannot read {name}: {error}"));
    let mut bytes = Vec::new();
    from.take(PROBE_BYTES).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 == PROBE_BYTES && Reader::new(&bytes).is_err() {
        return Err(Failure::input(format_args!(
            "{name} goes on and on, and is not a psao recording: save it to a file first"
        )));
    }
    let rest = most - bytes.len() as u64;
    from.take(rest).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 == most {
        return Err(Failure::input(format_args!(
            "{name} has {} or more, which is too much for a stream: save it to a file first",
            number::bytes(most)
        )));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_no_end_is_refused() {
        let read = |mut from: &mut dyn Read, most| stream(&mut from, Path::new("x"), most);
        let zeros = read(&mut std::io::repeat(0), MAX_STREAM_BYTES).unwrap_err().to_string();
        assert!(zeros.contains("not a psao recording"), "{zeros}");
        let (_, head) = psao_proto::recording::Writer::new(Limits::default());
        let long = read(&mut (&head[..]).chain(std::io::repeat(7)), PROBE_BYTES + 5).unwrap_err().to_string();
        assert!(long.contains("too much for a stream"), "{long}");
        assert_eq!(read(&mut &b"short"[..], MAX_STREAM_BYTES).unwrap(), b"short");
    }
}
