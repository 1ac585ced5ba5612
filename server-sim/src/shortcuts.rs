//! Optimisations that do not change the output.

use std::ops::{BitOr, Sub};

/// A set of optimisations that do not change the output. Each can be switched off, to verify that and to measure what it
/// saves. Every frame is bit-identical without them, unless a budget of rays chooses what is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcuts(u16);

impl Shortcuts {
    /// None of them: every point that is there is traced in every frame, all of its rays against all that is near.
    pub const NONE: Self = Self(0);
    /// Points that nothing moved near, in this frame or since they were last traced, keep their AO.
    pub const UNTOUCHED: Self = Self(1);
    /// Points of a rigid body with nothing else near keep their AO wherever it goes.
    pub const ALONE: Self = Self(2);
    /// What the rays of a point met in its own body is remembered as long as that keeps its shape, so that only the rest
    /// is traced.
    pub const SELF_HITS: Self = Self(4);
    /// Only hits on faces with a mask are looked up in a texture.
    pub const MASKS: Self = Self(8);
    /// Only instances with a skin, morph targets or a changing scale are posed vertex by vertex, their trees adapted and
    /// their points placed anew.
    pub const RIGID: Self = Self(16);
    /// A deforming instance that keeps its shape from one frame to the next keeps its tree, and the points near it their AO.
    pub const SHAPES: Self = Self(32);
    /// What is out of sight is not posed, nor its tree adapted.
    pub const HIDDEN: Self = Self(64);
    /// Points that no camera's widened view holds are not traced before they come into view.
    pub const OUT_OF_VIEW: Self = Self(128);
    /// All static instances share one body with one tree, instead of a body for each.
    pub const STATIC_BATCH: Self = Self(256);
    /// Each of them alone.
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
    /// All of them.
    pub const ALL: Self = Self(511);

    /// Returns whether all of `other` are among these.
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
