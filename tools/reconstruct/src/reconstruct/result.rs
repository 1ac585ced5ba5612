//! The result of a reconstruction, and its errors.

use crate::AoImage;

/// Ambient occlusion of a view, and counts of the points that support it.
#[derive(Clone, Debug, PartialEq)]
pub struct Reconstruction {
    /// Accessibility of each pixel; 1 where there is background or no point counts.
    pub image: AoImage,
    /// Counts over its fragments.
    pub statistics: Statistics,
}

/// Counts over the fragments of one reconstruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Pixels that show a surface.
    pub fragments: u64,
    /// Fragments without a point of a weight above 0; Eq. 4 calls them open.
    pub unsupported: u64,
    /// Points with a weight above 0, summed over all fragments.
    pub blended: u64,
}

impl Statistics {
    /// Returns the mean number of points blended for a fragment (at most 56 for cells); 0 when there is no fragment.
    pub fn mean_blended(&self) -> f64 {
        if self.fragments == 0 { 0.0 } else { self.blended as f64 / self.fragments as f64 }
    }

    /// Returns the share of fragments that no point supports, 0 to 1; 0 when there is no fragment.
    pub fn unsupported_share(&self) -> f64 {
        if self.fragments == 0 { 0.0 } else { self.unsupported as f64 / self.fragments as f64 }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        Self {
            fragments: self.fragments + other.fragments,
            unsupported: self.unsupported + other.unsupported,
            blended: self.blended + other.blended,
        }
    }
}

/// Error of a view that does not match the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReconstructError {
    /// A fragment shows an instance that the stream does not have.
    #[error(
        "pixel {pixel} shows instance {instance}, but the stream has {instances} instances; draw the scene from which the stream was made"
    )]
    Instance {
        /// Number of the first such pixel: row times width plus column.
        pixel: usize,
        /// The instance it shows.
        instance: u32,
        /// Number of instances of the stream's layout.
        instances: usize,
    },
    /// A fragment lacks its place on the mesh at rest, which profile `surface` needs.
    #[error(
        "pixel {pixel} lacks the place of its surface at rest, which a stream of profile surface needs; fill in Surface::rest with the unskinned, unmorphed position and normal"
    )]
    NoRest {
        /// Number of the first such pixel: row times width plus column.
        pixel: usize,
    },
}
