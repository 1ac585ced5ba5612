//! LZ4 blocks by a pure Rust coder that checks its input and output.

use lz4_flex::block::{CompressTable, compress_into_with_table, decompress_into, get_maximum_output_size};

use super::{BlockError, CoderId};

/// The tables of the compressor, made on first use. Short blocks have their own table, so that a block's bytes do not
/// depend on earlier blocks.
#[derive(Default)]
pub(super) struct Encoder {
    small: Option<CompressTable>,
    large: Option<CompressTable>,
}

impl Encoder {
    /// Returns the number of heap bytes in use. A table has 4,096 entries, of two bytes for short blocks and of four
    /// for others.
    pub(super) fn heap_bytes(&self) -> usize {
        self.small.iter().len() * (4096 * 2) + self.large.iter().len() * (4096 * 4)
    }

    /// Compresses `raw` into the start of `buffer`, which never shrinks.
    pub(super) fn compress<'a>(
        &mut self,
        raw: &[u8],
        buffer: &'a mut Vec<u8>,
    ) -> Result<&'a [u8], BlockError> {
        let room = get_maximum_output_size(raw.len());
        if buffer.len() < room {
            buffer.resize(room, 0);
        }
        let table = if raw.len() < usize::from(u16::MAX) {
            self.small.get_or_insert_with(CompressTable::small)
        } else {
            self.large.get_or_insert_with(CompressTable::large)
        };
        let length = compress_into_with_table(raw, buffer, table)
            .map_err(|error| BlockError::Coder { coder: CoderId::LZ4, reason: error.to_string() })?;
        Ok(&buffer[..length])
    }
}

/// Decompresses `stored`, which must fill `out` exactly.
pub(super) fn decompress(stored: &[u8], out: &mut [u8]) -> Result<(), BlockError> {
    let length = decompress_into(stored, out)
        .map_err(|error| BlockError::Corrupt { coder: CoderId::LZ4, reason: error.to_string() })?;
    if length == out.len() {
        return Ok(());
    }
    Err(BlockError::Length { coder: CoderId::LZ4, expected: out.len() as u64, found: length as u64 })
}
