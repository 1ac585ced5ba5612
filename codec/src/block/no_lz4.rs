//! Replaces the LZ4 coder if the crate is built without it.

use super::{BlockError, CoderId};

/// Refuses to compress.
#[derive(Default)]
pub(super) struct Encoder;

impl Encoder {
    pub(super) fn heap_bytes(&self) -> usize {
        0
    }

    pub(super) fn compress<'a>(
        &mut self,
        _raw: &[u8],
        _buffer: &'a mut Vec<u8>,
    ) -> Result<&'a [u8], BlockError> {
        Err(BlockError::Feature { coder: CoderId::LZ4 })
    }
}

/// Refuses to decompress.
pub(super) fn decompress(_stored: &[u8], _out: &mut [u8]) -> Result<(), BlockError> {
    Err(BlockError::Feature { coder: CoderId::LZ4 })
}
