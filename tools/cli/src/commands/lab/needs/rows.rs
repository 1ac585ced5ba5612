//! The things that are left out, and why they can be.

use psao_server::Shortcuts;

/// Work that a server leaves out, which changes no byte.
pub(super) struct Work {
    pub(super) shortcut: Shortcuts,
    /// What is left out.
    pub(super) what: &'static str,
    /// Why it can be.
    pub(super) why: &'static str,
}

pub(super) const WORK: [Work; Shortcuts::EACH.len()] = [
    Work {
        shortcut: Shortcuts::UNTOUCHED,
        what: "rays of untouched points",
        why: "nothing moved within reach",
    },
    Work {
        shortcut: Shortcuts::ALONE,
        what: "rays of bodies that move alone",
        why: "a rigid body sees itself as before",
    },
    Work {
        shortcut: Shortcuts::SELF_HITS,
        what: "rays against a point's own body",
        why: "it keeps its shape; hits are remembered",
    },
    Work {
        shortcut: Shortcuts::MASKS,
        what: "texels of faces without a mask",
        why: "they are opaque everywhere",
    },
    Work {
        shortcut: Shortcuts::RIGID,
        what: "vertices of what does not deform",
        why: "no skin, no morph, constant scale",
    },
    Work {
        shortcut: Shortcuts::SHAPES,
        what: "trees of shapes that stand still",
        why: "every vertex is where it was",
    },
    Work { shortcut: Shortcuts::HIDDEN, what: "poses of what is out of sight", why: "nothing can hit it" },
    Work {
        shortcut: Shortcuts::OUT_OF_VIEW,
        what: "rays of points out of view",
        why: "they are traced when they come into view",
    },
    Work {
        shortcut: Shortcuts::STATIC_BATCH,
        what: "a tree for each still instance",
        why: "they never move: one tree holds them all",
    },
];

/// Parts of the stream that are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// Where points are, in a stream that clients make the points of.
    Geometry,
    /// Where instances are.
    Poses,
    /// What a client that joins later needs besides the values.
    Context,
    /// Points on the back of what has one side.
    Backs,
}

impl Part {
    pub(super) const ALL: [Self; 4] = [Self::Geometry, Self::Poses, Self::Context, Self::Backs];

    /// Returns what is left out.
    pub(super) const fn what(self) -> &'static str {
        match self {
            Self::Geometry => "positions and normals of points",
            Self::Poses => "pose tracks",
            Self::Context => "the coder's history in keyframes",
            Self::Backs => "points on backs",
        }
    }

    /// Why it can be.
    pub(super) const fn why(self) -> &'static str {
        match self {
            Self::Geometry => "clients have the scene and make them (--geometry shared)",
            Self::Poses => "points are at rest on their meshes; profile paper sends where they are",
            Self::Context => "only clients that join later need it",
            Self::Backs => "one-sided faces are seen from the front alone",
        }
    }

    /// Returns why there is no figure, or the note beside it.
    pub(super) const fn note(self) -> &'static str {
        match self {
            Self::Geometry => "the AO is the same; the frames are others",
            Self::Poses => "POSES sections of profile paper on the same points",
            Self::Context => "the CONTEXT section of a keyframe after the last frame",
            Self::Backs => "n/a: no option puts points there, a client would never read them",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shortcut_has_a_row() {
        assert_eq!(WORK.map(|work| work.shortcut), Shortcuts::EACH);
    }
}
