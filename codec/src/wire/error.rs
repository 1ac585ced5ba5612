//! Errors of the wire reader.

use super::VarintError;

/// A field that could not be read. The readers of bodies and sections turn it into their own errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct WireError {
    /// The field.
    pub(crate) field: &'static str,
    /// Start of the field, in bytes from the start of the input.
    pub(crate) offset: usize,
    /// What is wrong.
    pub(crate) kind: WireErrorKind,
}

/// What is wrong with a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WireErrorKind {
    /// The input ends inside the field; at least `missing` bytes are missing.
    Ends { missing: usize },
    /// The field is not a canonical varint.
    Varint(VarintError),
    /// `extra` bytes follow the expected end.
    Trailing { extra: usize },
}
