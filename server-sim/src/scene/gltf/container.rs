//! The two containers of glTF: text (`.gltf`) and chunks (`.glb`; glTF 2.0, chapter 4).

use std::ops::Range;

use serde::de::DeserializeOwned;
use serde_json::{Number, Value};

use super::schema::{Head, Root};
use crate::scene::error::GltfProblem;
use crate::scene::limits;

/// Places of the JSON text and the binary chunk within a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Chunks {
    pub(super) json: Range<usize>,
    pub(super) binary: Option<Range<usize>>,
}

/// Size of the header of a binary file.
const HEADER_BYTES: usize = 12;

/// Finds the parts of a file. A problem is one of the binary header or of a chunk.
pub(super) fn split(file: &[u8]) -> Result<Chunks, GltfProblem> {
    if file.starts_with(b"glTF") {
        return split_binary(file);
    }
    Ok(Chunks { json: text_in(file, 0..file.len())?, binary: None })
}

fn split_binary(file: &[u8]) -> Result<Chunks, GltfProblem> {
    let out_of_bytes = |start: usize, end: usize, available: usize| GltfProblem::OutOfBytes {
        start: start as u64,
        end: end as u64,
        available: available as u64,
    };
    let word = |at: usize| {
        let bytes = file.get(at..at.saturating_add(4)).and_then(|bytes| bytes.first_chunk());
        bytes.map(|bytes| u32::from_le_bytes(*bytes)).ok_or(out_of_bytes(at, at + 4, file.len()))
    };
    match word(4)? {
        2 => {}
        version => return Err(GltfProblem::Version(format!("{version}.0"))),
    }
    let end = word(8)? as usize;
    if end > file.len() {
        return Err(out_of_bytes(0, end, file.len()));
    }
    let mut chunks: Vec<(u32, Range<usize>)> = Vec::new();
    let mut at = HEADER_BYTES;
    // Chunks of other kinds may follow the first two and are ignored (section 4.4.1).
    while chunks.len() < 2 && at.saturating_add(8) <= end {
        let (length, kind) = (word(at)? as usize, word(at + 4)?);
        let data = at + 8..(at + 8).saturating_add(length);
        if data.end > end {
            return Err(out_of_bytes(data.start, data.end, end));
        }
        at = data.end;
        chunks.push((kind, data));
    }
    let is = |index: usize, kind: &[u8; 4]| {
        chunks.get(index).filter(|chunk| chunk.0 == u32::from_le_bytes(*kind)).map(|chunk| chunk.1.clone())
    };
    let json = is(0, b"JSON").ok_or(GltfProblem::Missing("the JSON chunk"))?;
    Ok(Chunks { json: text_in(file, json)?, binary: is(1, b"BIN\0") })
}

/// Returns the place of the text without a byte order mark and without the NUL bytes with which some exporters pad it.
fn text_in(file: &[u8], mut place: Range<usize>) -> Result<Range<usize>, GltfProblem> {
    let text = &file[place.clone()];
    if text.starts_with(&[0xfe, 0xff]) || text.starts_with(&[0xff, 0xfe]) {
        return Err(GltfProblem::Utf16);
    }
    let padding = text.iter().rev().take_while(|byte| **byte == 0).count();
    place.end -= padding;
    if text.starts_with(&[0xef, 0xbb, 0xbf]) {
        place.start += 3;
    }
    Ok(place)
}

/// Parses the JSON text. `Ok(Err(version))` is a version of glTF that is not read here.
pub(super) fn parse(json: &[u8]) -> Result<Result<Root, String>, serde_json::Error> {
    let head: Head = read_json(json)?;
    let asset = head.asset.unwrap_or_default();
    // The asset, and the version in it, became required with glTF 2.0.
    let version = asset.version.unwrap_or_else(|| "1.0".to_owned());
    if !version.starts_with("2.") {
        return Ok(Err(version));
    }
    // A file of a later version says in `minVersion` that a reader of 2.0 cannot do it justice (section 3.2).
    match asset.min_version.filter(|least| least != "2.0") {
        Some(least) => Ok(Err(least)),
        None => read_json(json).map(Ok),
    }
}

/// Reads JSON text as glTF understands it (section 2.7): the last of several values for one key counts, and integers may
/// be written as `100.0` or `1e2`. Hardly any file needs that, so the plain way is tried first.
fn read_json<T: DeserializeOwned>(json: &[u8]) -> Result<T, serde_json::Error> {
    serde_json::from_slice(json).or_else(|error| {
        if json.len() > limits::MAX_UNUSUAL_JSON_BYTES {
            return Err(error);
        }
        let Ok(mut value) = serde_json::from_slice::<Value>(json) else { return Err(error) };
        write_integers(&mut value);
        // This error has no line, unlike the first one.
        T::deserialize(value).map_err(|_| error)
    })
}

/// Turns numbers without a fractional part into integers.
fn write_integers(value: &mut Value) {
    match value {
        Value::Number(number) => {
            let whole =
                number.as_f64().filter(|v| number.is_f64() && v.fract() == 0.0 && (0.0..9e15).contains(v));
            if let Some(whole) = whole {
                *number = Number::from(whole as u64);
            }
        }
        Value::Array(list) => list.iter_mut().for_each(write_integers),
        Value::Object(map) => map.values_mut().for_each(write_integers),
        Value::Null | Value::Bool(_) | Value::String(_) => {}
    }
}
