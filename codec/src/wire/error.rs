//! Why bytes could not be read as what they should be.

use super::VarintError;

/// A field that could not be read. What reads a body or a section makes its own error of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct WireError {
    /// The field.
    pub(crate) field: &'static str,
    /// Where the field starts, in bytes from the start of what is read.
    pub(crate) offset: usize,
    /// What is wrong.
    pub(crate) kind: WireErrorKind,
}

/// What is wrong with a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WireErrorKind {
    /// The bytes end inside it; so many are missing at least.
    Ends { missing: usize },
    /// It is no canonical varint.
    Varint(VarintError),
    /// Bytes follow where it should have been the end.
    Trailing { extra: usize },
}
