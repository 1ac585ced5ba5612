//! A reader of bytes that tracks its offset, so that errors can tell where.

use super::{ReadVarintError, WireError, WireErrorKind, read_varint};

/// Reads a frame body or a section from front to back.
pub(crate) struct Reader<'a> {
    rest: &'a [u8],
    offset: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Reader<'a> {
        Reader { rest: bytes, offset: 0 }
    }

    /// Returns the number of bytes read so far.
    pub(crate) fn offset(&self) -> usize {
        self.offset
    }

    /// Returns the number of bytes not read yet.
    pub(crate) fn remaining(&self) -> usize {
        self.rest.len()
    }

    /// Reads the next `count` bytes; `field` names them in the error.
    pub(crate) fn take(&mut self, field: &'static str, count: usize) -> Result<&'a [u8], WireError> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let missing = count - self.rest.len();
            return Err(self.error(field, WireErrorKind::Ends { missing }));
        };
        self.rest = rest;
        self.offset += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], WireError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(field, N)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self, field: &'static str) -> Result<u8, WireError> {
        Ok(self.array::<1>(field)?[0])
    }

    pub(crate) fn u32(&mut self, field: &'static str) -> Result<u32, WireError> {
        Ok(u32::from_le_bytes(self.array(field)?))
    }

    pub(crate) fn u64(&mut self, field: &'static str) -> Result<u64, WireError> {
        Ok(u64::from_le_bytes(self.array(field)?))
    }

    pub(crate) fn varint(&mut self, field: &'static str) -> Result<u32, WireError> {
        match read_varint(self.rest) {
            Ok((value, length)) => {
                self.take(field, length)?;
                Ok(value)
            }
            Err(ReadVarintError::Ends) => Err(self.error(field, WireErrorKind::Ends { missing: 1 })),
            Err(ReadVarintError::Malformed(problem)) => {
                Err(self.error(field, WireErrorKind::Varint(problem)))
            }
        }
    }

    /// Checks that all bytes were read.
    pub(crate) fn end(&self) -> Result<(), WireError> {
        match self.rest.len() {
            0 => Ok(()),
            extra => Err(self.error("the end", WireErrorKind::Trailing { extra })),
        }
    }

    fn error(&self, field: &'static str, kind: WireErrorKind) -> WireError {
        WireError { field, offset: self.offset, kind }
    }
}
