//! Optimisations that do not change the output.

use std::ops::{BitOr, Sub};

/// A set of optimisations that do not change the output. Each can be switched off to verify that and to measure what
/// it saves. Every frame is bit-identical without them, unless a ray budget selects what is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcuts(u16);

impl Shortcuts {
    /// No shortcut: every point is traced in every frame, with all of its rays against everything near it.
    pub const NONE: Self = Self(0);
    /// Points keep their AO unless something near them has moved since they were last traced.
    pub const UNTOUCHED: Self = Self(1);
    /// Points of a rigid body with nothing else near it keep their AO wherever it moves.
    pub const ALONE: Self = Self(2);
    /// The hits of a point's rays in its own body are cached while the body keeps its shape, so that only the rest is
    /// traced.
    pub const SELF_HITS: Self = Self(4);
    /// Only hits on masked triangles are checked against a texture.
    pub const MASKS: Self = Self(8);
    /// Only instances with a skin, morph targets or a changing scale have their vertices posed, their trees refitted
    /// and their points placed again.
    pub const RIGID: Self = Self(16);
    /// A deforming instance that keeps its shape between two frames keeps its tree, and the points near it keep their
    /// AO.
    pub const SHAPES: Self = Self(32);
    /// Hidden instances are not posed, and their trees are not refitted.
    pub const HIDDEN: Self = Self(64);
    /// Points outside all cameras' widened views are traced only when they come into view.
    pub const OUT_OF_VIEW: Self = Self(128);
    /// All static instances share one body with one tree, instead of one body each.
    pub const STATIC_BATCH: Self = Self(256);
    /// Each shortcut alone.
    pub const EACH: [Self; 9] = [
        Self::UNTOUCHED,
        Self::ALONE,
        Self::SELF_HITS,
        Self::MASKS,
        Self::RIGID,
        Self::SHAPES,
        Self::HIDDEN,
        Self::OUT_OF_VIEW,
        Self::STATIC_BATCH,
    ];
    /// All shortcuts.
    pub const ALL: Self = Self(511);

    /// Returns whether this set contains all of `other`.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl BitOr for Shortcuts {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Sub for Shortcuts {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_is_each_of_them() {
        let each = Shortcuts::EACH;
        assert_eq!(each.into_iter().fold(Shortcuts::NONE, BitOr::bitor), Shortcuts::ALL);
        assert_eq!(each.into_iter().fold(Shortcuts::ALL, Sub::sub), Shortcuts::NONE);
        assert!(!(Shortcuts::ALL - Shortcuts::ALONE).contains(Shortcuts::ALONE));
    }
}
