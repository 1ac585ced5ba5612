//! What both sides know of a stream of either profile.

use std::sync::Arc;

use crate::envelope::Profile;
use crate::{paper, surface};

/// What both sides know of a stream before its first frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Layout {
    /// Of profile `paper`.
    Paper(Arc<paper::Layout>),
    /// Of profile `surface`.
    Surface(Arc<surface::Layout>),
}

impl Layout {
    /// The profile of the stream.
    #[must_use]
    pub fn profile(&self) -> Profile {
        match self {
            Layout::Paper(_) => Profile::PAPER,
            Layout::Surface(_) => Profile::SURFACE,
        }
    }

    /// Instances of the stream.
    #[must_use]
    pub fn instances(&self) -> usize {
        match self {
            Layout::Paper(layout) => layout.instances().len(),
            Layout::Surface(layout) => layout.members().len(),
        }
    }

    /// The layout of a `paper` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_paper(&self) -> Option<&Arc<paper::Layout>> {
        match self {
            Layout::Paper(layout) => Some(layout),
            Layout::Surface(_) => None,
        }
    }

    /// The layout of a `surface` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&Arc<surface::Layout>> {
        match self {
            Layout::Paper(_) => None,
            Layout::Surface(layout) => Some(layout),
        }
    }
}
