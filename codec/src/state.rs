//! The state of a client, for either profile.

use std::sync::Arc;

use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameIndex, FrameMeta, Profile};
use crate::{Layout, StateHash, paper, surface};

/// Everything that a client holds of a stream.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// A stream of profile `paper`.
    Paper(paper::State),
    /// A stream of profile `surface`.
    Surface(Box<surface::State>),
}

impl State {
    /// Creates the empty state of a layout; its hash is 0.
    ///
    /// It allocates as much as the layout asks for. The layout was checked against the limits when it was made.
    #[must_use]
    pub fn new(layout: &Layout) -> State {
        match layout {
            Layout::Paper(layout) => State::Paper(paper::State::new(Arc::clone(layout))),
            Layout::Surface(layout) => State::Surface(Box::new(surface::State::new(Arc::clone(layout)))),
        }
    }

    /// Returns the layout of the stream.
    #[must_use]
    pub fn layout(&self) -> Layout {
        match self {
            State::Paper(state) => Layout::Paper(Arc::clone(state.layout())),
            State::Surface(state) => Layout::Surface(Arc::clone(state.layout())),
        }
    }

    /// Returns the profile of the stream.
    #[must_use]
    pub fn profile(&self) -> Profile {
        match self {
            State::Paper(_) => Profile::PAPER,
            State::Surface(_) => Profile::SURFACE,
        }
    }

    /// Returns the hash of everything in the state. Every frame updates it.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        match self {
            State::Paper(state) => state.hash(),
            State::Surface(state) => state.hash(),
        }
    }

    /// Computes the hash from scratch: the reference of [`State::hash`].
    #[must_use]
    pub fn full_hash(&self) -> StateHash {
        match self {
            State::Paper(state) => state.full_hash(),
            State::Surface(state) => state.full_hash(),
        }
    }

    /// Returns the last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        match self {
            State::Paper(state) => state.frame(),
            State::Surface(state) => state.frame(),
        }
    }

    /// Returns the state of a `paper` stream; `None` for the other profile.
    #[must_use]
    pub fn as_paper(&self) -> Option<&paper::State> {
        match self {
            State::Paper(state) => Some(state),
            State::Surface(_) => None,
        }
    }

    /// Returns the state of a `surface` stream; `None` for the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&surface::State> {
        match self {
            State::Paper(_) => None,
            State::Surface(state) => Some(state),
        }
    }

    /// Returns the state of a `surface` stream, to give it geometry that the stream does not carry.
    #[must_use]
    pub fn as_surface_mut(&mut self) -> Option<&mut surface::State> {
        match self {
            State::Paper(_) => None,
            State::Surface(state) => Some(state),
        }
    }
}

/// A borrowed state of either profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StateRef<'a> {
    /// A stream of profile `paper`.
    Paper(&'a paper::State),
    /// A stream of profile `surface`.
    Surface(&'a surface::State),
}

impl StateRef<'_> {
    /// Returns the hash of everything in the state. Every frame updates it.
    #[must_use]
    pub fn hash(self) -> StateHash {
        match self {
            StateRef::Paper(state) => state.hash(),
            StateRef::Surface(state) => state.hash(),
        }
    }

    /// Returns the last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(self) -> Option<FrameIndex> {
        match self {
            StateRef::Paper(state) => state.frame(),
            StateRef::Surface(state) => state.frame(),
        }
    }
}

impl<'a> From<&'a State> for StateRef<'a> {
    fn from(state: &'a State) -> StateRef<'a> {
        match state {
            State::Paper(state) => StateRef::Paper(state),
            State::Surface(state) => StateRef::Surface(state),
        }
    }
}

impl<'a> From<&'a paper::State> for StateRef<'a> {
    fn from(state: &'a paper::State) -> StateRef<'a> {
        StateRef::Paper(state)
    }
}

impl<'a> From<&'a surface::State> for StateRef<'a> {
    fn from(state: &'a surface::State) -> StateRef<'a> {
        StateRef::Surface(state)
    }
}

/// Writes the whole of `state` as a keyframe body, for a client that joins late. `meta.kind` is taken as key. `first`
/// names the blocks that go first, see [`surface::keyframe`]; profile `paper` ignores it.
///
/// # Errors
/// [`EncodeError`], as [`paper::keyframe`] and [`surface::keyframe`] return it.
pub fn keyframe<'a>(
    state: impl Into<StateRef<'a>>,
    meta: FrameMeta,
    coder: BlockCoder,
    first: &[(u32, u32)],
) -> Result<Vec<u8>, EncodeError> {
    match state.into() {
        StateRef::Paper(state) => paper::keyframe(state, meta, coder),
        StateRef::Surface(state) => surface::keyframe(state, meta, coder, first),
    }
}
