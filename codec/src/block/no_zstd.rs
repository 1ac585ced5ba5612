//! Replaces the Zstandard coder if the crate is built without it, and so without a C compiler.

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
        _level: i32,
        _buffer: &'a mut Vec<u8>,
    ) -> Result<&'a [u8], BlockError> {
        Err(BlockError::Feature { coder: CoderId::ZSTD })
    }
}

/// Refuses to decompress.
#[derive(Default)]
pub(super) struct Decoder;

impl Decoder {
    pub(super) fn decompress(&mut self, _stored: &[u8], _out: &mut [u8]) -> Result<(), BlockError> {
        Err(BlockError::Feature { coder: CoderId::ZSTD })
    }
}

/// Refuses every frame.
pub(super) fn check_frame(_stored: &[u8], _wanted: usize) -> Result<(), BlockError> {
    Err(BlockError::Feature { coder: CoderId::ZSTD })
}
