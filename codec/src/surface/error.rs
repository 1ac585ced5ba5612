//! Errors of sections of profile `surface`.

use super::{ChangeError, ContextError, GeometrySectionError, ValueError};

/// Why a section of a frame was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SectionError {
    /// The points of a set are invalid.
    #[error(transparent)]
    Geometry(#[from] GeometrySectionError),
    /// Point blocks or their AO are invalid.
    #[error(transparent)]
    Values(#[from] ValueError),
    /// Changes of AO, or the points of a patch, are invalid or do not fit the state.
    #[error(transparent)]
    Changes(#[from] ChangeError),
    /// The coder context is invalid.
    #[error(transparent)]
    Context(#[from] ContextError),
}
