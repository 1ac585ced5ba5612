//! The layout of a stream, for either profile.

use std::sync::Arc;

use crate::envelope::Profile;
use crate::{paper, surface};

/// What both ends know of a stream before its first frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Layout {
    /// A stream of profile `paper`.
    Paper(Arc<paper::Layout>),
    /// A stream of profile `surface`.
    Surface(Arc<surface::Layout>),
}

impl Layout {
    /// Returns the profile of the stream.
    #[must_use]
    pub fn profile(&self) -> Profile {
        match self {
            Layout::Paper(_) => Profile::PAPER,
            Layout::Surface(_) => Profile::SURFACE,
        }
    }

    /// Returns the number of instances.
    #[must_use]
    pub fn instances(&self) -> usize {
        match self {
            Layout::Paper(layout) => layout.instances().len(),
            Layout::Surface(layout) => layout.members().len(),
        }
    }

    /// Returns the layout of a `paper` stream; `None` for the other profile.
    #[must_use]
    pub fn as_paper(&self) -> Option<&Arc<paper::Layout>> {
        match self {
            Layout::Paper(layout) => Some(layout),
            Layout::Surface(_) => None,
        }
    }

    /// Returns the layout of a `surface` stream; `None` for the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&Arc<surface::Layout>> {
        match self {
            Layout::Paper(_) => None,
            Layout::Surface(layout) => Some(layout),
        }
    }
}
