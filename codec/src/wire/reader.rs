//! A reader that is a shrinking slice and remembers its offset, so errors can say where.

use super::{VarintFault, read_varint};
use crate::envelope::FrameError;

/// Reads a frame body from front to back.
pub(crate) struct Reader<'a> {
    rest: &'a [u8],
    offset: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Reader<'a> {
        Reader { rest: bytes, offset: 0 }
    }

    /// Bytes read so far.
    pub(crate) fn offset(&self) -> usize {
        self.offset
    }

    /// Bytes not read yet.
    pub(crate) fn remaining(&self) -> usize {
        self.rest.len()
    }

    /// Takes the next `count` bytes; `field` names them in the error.
    pub(crate) fn take(&mut self, field: &'static str, count: usize) -> Result<&'a [u8], FrameError> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let missing = count - self.rest.len();
            return Err(FrameError::Truncated { field, offset: self.offset, missing });
        };
        self.rest = rest;
        self.offset += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], FrameError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(field, N)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self, field: &'static str) -> Result<u8, FrameError> {
        Ok(self.array::<1>(field)?[0])
    }

    pub(crate) fn u32(&mut self, field: &'static str) -> Result<u32, FrameError> {
        Ok(u32::from_le_bytes(self.array(field)?))
    }

    pub(crate) fn u64(&mut self, field: &'static str) -> Result<u64, FrameError> {
        Ok(u64::from_le_bytes(self.array(field)?))
    }

    pub(crate) fn varint(&mut self, field: &'static str) -> Result<u32, FrameError> {
        match read_varint(self.rest) {
            Ok((value, length)) => {
                self.take(field, length)?;
                Ok(value)
            }
            Err(VarintFault::Ends) => Err(FrameError::Truncated { field, offset: self.offset, missing: 1 }),
            Err(VarintFault::Malformed(problem)) => {
                Err(FrameError::Varint { field, offset: self.offset, problem })
            }
        }
    }
}
