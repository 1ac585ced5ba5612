//! LZ4 blocks, pure Rust, checked encoder and decoder.

use lz4_flex::block::{compress_into, decompress_into, get_maximum_output_size};

use super::{BlockError, CoderId};

/// Compresses `raw` into the start of `buffer`, which only ever grows.
pub(super) fn compress<'a>(raw: &[u8], buffer: &'a mut Vec<u8>) -> Result<&'a [u8], BlockError> {
    let room = get_maximum_output_size(raw.len());
    if buffer.len() < room {
        buffer.resize(room, 0);
    }
    let length = compress_into(raw, buffer)
        .map_err(|error| BlockError::Coder { coder: CoderId::LZ4, reason: error.to_string() })?;
    Ok(&buffer[..length])
}

/// Fills `out` exactly.
pub(super) fn decompress(stored: &[u8], out: &mut [u8]) -> Result<(), BlockError> {
    let length = decompress_into(stored, out)
        .map_err(|error| BlockError::Corrupt { coder: CoderId::LZ4, reason: error.to_string() })?;
    if length == out.len() {
        return Ok(());
    }
    Err(BlockError::Length { coder: CoderId::LZ4, expected: out.len() as u64, found: length as u64 })
}
