//! What a client holds of a stream of either profile.

use std::sync::Arc;

use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameIndex, FrameMeta, Profile};
use crate::{Layout, StateHash, paper, surface};

/// What a client holds of a stream.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// Of profile `paper`.
    Paper(paper::State),
    /// Of profile `surface`.
    Surface(Box<surface::State>),
}

impl State {
    /// The empty state of a layout; hash 0.
    ///
    /// It allocates what the layout says; making the layout has checked that against the limits.
    #[must_use]
    pub fn new(layout: &Layout) -> State {
        match layout {
            Layout::Paper(layout) => State::Paper(paper::State::new(Arc::clone(layout))),
            Layout::Surface(layout) => State::Surface(Box::new(surface::State::new(Arc::clone(layout)))),
        }
    }

    /// The layout of the stream.
    #[must_use]
    pub fn layout(&self) -> Layout {
        match self {
            State::Paper(state) => Layout::Paper(Arc::clone(state.layout())),
            State::Surface(state) => Layout::Surface(Arc::clone(state.layout())),
        }
    }

    /// The profile of the stream.
    #[must_use]
    pub fn profile(&self) -> Profile {
        match self {
            State::Paper(_) => Profile::PAPER,
            State::Surface(_) => Profile::SURFACE,
        }
    }

    /// The hash of everything in it; kept up by every frame.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        match self {
            State::Paper(state) => state.hash(),
            State::Surface(state) => state.hash(),
        }
    }

    /// The hash computed from scratch: the slow twin of [`State::hash`].
    #[must_use]
    pub fn full_hash(&self) -> StateHash {
        match self {
            State::Paper(state) => state.full_hash(),
            State::Surface(state) => state.full_hash(),
        }
    }

    /// The last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        match self {
            State::Paper(state) => state.frame(),
            State::Surface(state) => state.frame(),
        }
    }

    /// The state of a `paper` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_paper(&self) -> Option<&paper::State> {
        match self {
            State::Paper(state) => Some(state),
            State::Surface(_) => None,
        }
    }

    /// The state of a `surface` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&surface::State> {
        match self {
            State::Paper(_) => None,
            State::Surface(state) => Some(state),
        }
    }

    /// As [`State::as_surface`], to give it geometry that the stream does not carry.
    #[must_use]
    pub fn as_surface_mut(&mut self) -> Option<&mut surface::State> {
        match self {
            State::Paper(_) => None,
            State::Surface(state) => Some(state),
        }
    }
}

/// A state of either profile that someone else owns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StateRef<'a> {
    /// Of profile `paper`.
    Paper(&'a paper::State),
    /// Of profile `surface`.
    Surface(&'a surface::State),
}

impl StateRef<'_> {
    /// The hash of everything in it; kept up by every frame.
    #[must_use]
    pub fn hash(self) -> StateHash {
        match self {
            StateRef::Paper(state) => state.hash(),
            StateRef::Surface(state) => state.hash(),
        }
    }

    /// The last frame applied; `None` before the first.
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

/// Writes the whole of `state` as a keyframe body, for who joins late. `meta.kind` is taken as key; `first` names what
/// goes before all else, as [`surface::keyframe`] says, and means nothing in profile `paper`.
///
/// # Errors
/// Those of [`EncodeError`].
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
