//! A stream of either profile: what carries, records or follows streams works with these, and need not know which.

use std::sync::Arc;

use crate::block::BlockCoder;
use crate::frame::{EncodeError, FrameError, FrameIndex, FrameInfo, FrameMeta, Profile};
use crate::{Limits, StateHash};
use crate::{cells, frame, surface};

/// What both sides know of a stream before its first frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Layout {
    /// Of profile `paper`.
    Cells(Arc<cells::Layout>),
    /// Of profile `surface`.
    Surface(Arc<surface::Layout>),
}

impl Layout {
    /// The profile of the stream.
    #[must_use]
    pub fn profile(&self) -> Profile {
        match self {
            Layout::Cells(_) => Profile::PAPER,
            Layout::Surface(_) => Profile::SURFACE,
        }
    }

    /// Instances of the stream.
    #[must_use]
    pub fn instances(&self) -> usize {
        match self {
            Layout::Cells(layout) => layout.instances().len(),
            Layout::Surface(layout) => layout.members().len(),
        }
    }

    /// The layout of a `paper` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_cells(&self) -> Option<&Arc<cells::Layout>> {
        match self {
            Layout::Cells(layout) => Some(layout),
            Layout::Surface(_) => None,
        }
    }

    /// The layout of a `surface` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&Arc<surface::Layout>> {
        match self {
            Layout::Cells(_) => None,
            Layout::Surface(layout) => Some(layout),
        }
    }
}

/// What a client holds of a stream.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// Of profile `paper`.
    Cells(frame::State),
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
            Layout::Cells(layout) => State::Cells(frame::State::new(Arc::clone(layout))),
            Layout::Surface(layout) => State::Surface(Box::new(surface::State::new(Arc::clone(layout)))),
        }
    }

    /// The layout of the stream.
    #[must_use]
    pub fn layout(&self) -> Layout {
        match self {
            State::Cells(state) => Layout::Cells(Arc::clone(state.layout())),
            State::Surface(state) => Layout::Surface(Arc::clone(state.layout())),
        }
    }

    /// The profile of the stream.
    #[must_use]
    pub fn profile(&self) -> Profile {
        match self {
            State::Cells(_) => Profile::PAPER,
            State::Surface(_) => Profile::SURFACE,
        }
    }

    /// The hash of everything in it; kept up by every frame.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        match self {
            State::Cells(state) => state.hash(),
            State::Surface(state) => state.hash(),
        }
    }

    /// The hash computed from scratch: the slow twin of [`State::hash`].
    #[must_use]
    pub fn full_hash(&self) -> StateHash {
        match self {
            State::Cells(state) => state.full_hash(),
            State::Surface(state) => state.full_hash(),
        }
    }

    /// The last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        match self {
            State::Cells(state) => state.frame(),
            State::Surface(state) => state.frame(),
        }
    }

    /// The state of a `paper` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_cells(&self) -> Option<&frame::State> {
        match self {
            State::Cells(state) => Some(state),
            State::Surface(_) => None,
        }
    }

    /// The state of a `surface` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&surface::State> {
        match self {
            State::Cells(_) => None,
            State::Surface(state) => Some(state),
        }
    }

    /// As [`State::as_surface`], to give it geometry that the stream does not carry.
    #[must_use]
    pub fn as_surface_mut(&mut self) -> Option<&mut surface::State> {
        match self {
            State::Cells(_) => None,
            State::Surface(state) => Some(state),
        }
    }
}

/// A state of either profile that someone else owns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StateRef<'a> {
    /// Of profile `paper`.
    Cells(&'a frame::State),
    /// Of profile `surface`.
    Surface(&'a surface::State),
}

impl StateRef<'_> {
    /// The hash of everything in it; kept up by every frame.
    #[must_use]
    pub fn hash(self) -> StateHash {
        match self {
            StateRef::Cells(state) => state.hash(),
            StateRef::Surface(state) => state.hash(),
        }
    }

    /// The last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(self) -> Option<FrameIndex> {
        match self {
            StateRef::Cells(state) => state.frame(),
            StateRef::Surface(state) => state.frame(),
        }
    }
}

impl<'a> From<&'a State> for StateRef<'a> {
    fn from(state: &'a State) -> StateRef<'a> {
        match state {
            State::Cells(state) => StateRef::Cells(state),
            State::Surface(state) => StateRef::Surface(state),
        }
    }
}

impl<'a> From<&'a frame::State> for StateRef<'a> {
    fn from(state: &'a frame::State) -> StateRef<'a> {
        StateRef::Cells(state)
    }
}

impl<'a> From<&'a surface::State> for StateRef<'a> {
    fn from(state: &'a surface::State) -> StateRef<'a> {
        StateRef::Surface(state)
    }
}

/// Which points changed in which frame of a stream, see [`surface::Ledger`]. Of profile `paper` nothing is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Ledger(Option<Box<surface::Ledger>>);

impl Ledger {
    /// A ledger that begins with `state`.
    #[must_use]
    pub fn new<'a>(state: impl Into<StateRef<'a>>) -> Ledger {
        Ledger(match state.into() {
            StateRef::Cells(_) => None,
            StateRef::Surface(state) => Some(Box::new(surface::Ledger::new(state))),
        })
    }

    /// Whether a client of frame `base` can be told what it missed.
    #[must_use]
    pub fn reaches(&self, base: FrameIndex) -> bool {
        self.0.as_ref().is_some_and(|ledger| ledger.missed(base).is_some())
    }

    /// Notes what the last frame changed; to be called after every frame, as [`surface::Ledger::follow`].
    pub fn follow<'a>(&mut self, state: impl Into<StateRef<'a>>) {
        match (&mut self.0, state.into()) {
            (Some(ledger), StateRef::Surface(state)) => ledger.follow(state),
            (_, state) => *self = Ledger::new(state),
        }
    }
}

/// Writes the body of a delta that brings any client whose last frame is `base` or later to `state`, as
/// [`surface::patch`]; `None` when only a keyframe helps, which in profile `paper` is always.
///
/// # Errors
/// Those of [`surface::patch`].
pub fn patch<'a>(
    state: impl Into<StateRef<'a>>,
    ledger: &Ledger,
    base: FrameIndex,
    meta: FrameMeta,
    coder: BlockCoder,
    context: bool,
) -> Result<Option<Vec<u8>>, EncodeError> {
    match (state.into(), &ledger.0) {
        (StateRef::Surface(state), Some(ledger)) => surface::patch(state, ledger, base, meta, coder, context),
        _ => Ok(None),
    }
}

/// Applies frame bodies to states of either profile; keeps its buffers between them.
#[derive(Debug, Default)]
pub struct Applier {
    cells: frame::Applier,
    surface: surface::Applier,
}

impl Applier {
    /// An applier with nothing allocated yet.
    #[must_use]
    pub fn new() -> Applier {
        Applier::default()
    }

    /// Applies a frame body to `state`: checks all of it, the hash of the state after included, then writes.
    ///
    /// # Errors
    /// [`FrameError`] says what is wrong and where, [`FrameError::ProfileOther`] for a body of a profile that is not the
    /// state's; `state` is then exactly as before.
    pub fn apply(
        &mut self,
        state: &mut State,
        body: &[u8],
        limits: &Limits,
    ) -> Result<FrameInfo, FrameError> {
        match state {
            State::Cells(state) => Ok(self.cells.apply(state, body, limits)?.info),
            State::Surface(state) => self.surface.apply(state, body, limits),
        }
    }
}

/// Applies a frame body to `state`. See [`Applier::apply`], which is cheaper for many frames.
///
/// # Errors
/// Those of [`Applier::apply`].
pub fn apply(state: &mut State, body: &[u8], limits: &Limits) -> Result<FrameInfo, FrameError> {
    Applier::new().apply(state, body, limits)
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
        StateRef::Cells(state) => frame::keyframe(state, meta, coder),
        StateRef::Surface(state) => surface::keyframe(state, meta, coder, first),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::story;

    fn surface_layout() -> Layout {
        let layout = surface::Layout::new(Vec::new(), Vec::new(), &Limits::default()).unwrap();
        Layout::Surface(Arc::new(layout))
    }

    #[test]
    fn a_paper_stream_is_followed_as_by_the_paper_applier() {
        let story = story(BlockCoder::default());
        let mut state = State::new(&Layout::Cells(Arc::clone(story.empty.layout())));
        let mut applier = Applier::new();
        for (frame, after) in [(&story.key, &story.after_key), (&story.delta, &story.after_delta)] {
            let info = applier.apply(&mut state, &frame.body, &Limits::default()).unwrap();
            assert_eq!((&info, state.as_cells()), (&frame.info, Some(after)));
            assert_eq!((state.hash(), state.full_hash()), (after.hash(), after.full_hash()));
            assert_eq!(state.frame(), after.frame());
        }
        let meta = crate::testing::meta(frame::FrameKind::Key, 4);
        let body = keyframe(&state, meta, BlockCoder::default(), &[]).unwrap();
        let mut late = State::new(&state.layout());
        apply(&mut late, &body, &Limits::default()).unwrap();
        assert_eq!(late, state);
    }

    #[test]
    fn a_body_of_the_other_profile_is_refused_by_name() {
        let story = story(BlockCoder::Stored);
        let mut state = State::new(&surface_layout());
        let before = state.clone();
        let (offset, found, expected) = (0, Profile::PAPER, Profile::SURFACE);
        let refused = apply(&mut state, &story.key.body, &Limits::default());
        assert_eq!(refused, Err(FrameError::ProfileOther { offset, found, expected }));
        assert_eq!(state, before);
        let meta = crate::testing::meta(frame::FrameKind::Key, 4);
        let body = keyframe(&state, meta, BlockCoder::Stored, &[]).unwrap();
        let mut state = State::Cells(story.empty.clone());
        let refused = apply(&mut state, &body, &Limits::default());
        assert_eq!(refused, Err(FrameError::ProfileOther { offset, found: expected, expected: found }));
        assert_eq!(state.as_cells(), Some(&story.empty));
    }

    #[test]
    fn a_paper_stream_is_never_patched() {
        let story = story(BlockCoder::Stored);
        let (key, delta) = (State::Cells(story.after_key), State::Cells(story.after_delta));
        let mut ledger = Ledger::new(&key);
        ledger.follow(&delta);
        let base = key.frame().unwrap();
        let meta = crate::testing::meta(frame::FrameKind::Delta, 4);
        assert_eq!(patch(&delta, &ledger, base, meta, BlockCoder::Stored, true), Ok(None));
        let borrowed = StateRef::from(&delta);
        assert_eq!((borrowed.hash(), borrowed.frame()), (delta.hash(), delta.frame()));
    }

    #[test]
    fn a_surface_stream_has_its_own_ledger() {
        let mut state = surface::State::new(Arc::clone(surface_layout().as_surface().unwrap()));
        let mut own = surface::Ledger::new(&state);
        let mut ledger = Ledger::new(StateRef::Surface(&state));
        assert_eq!(ledger, Ledger(Some(Box::new(own.clone()))));
        let meta = crate::testing::meta(frame::FrameKind::Key, 4);
        let body = keyframe(&state, meta, BlockCoder::Stored, &[]).unwrap();
        surface::Applier::new().apply(&mut state, &body, &Limits::default()).unwrap();
        own.follow(&state);
        ledger.follow(&state);
        assert_eq!(ledger, Ledger(Some(Box::new(own.clone()))));
        let borrowed = StateRef::from(&state);
        assert_eq!((borrowed.hash(), borrowed.frame()), (state.hash(), state.frame()));
        // A ledger of the other profile begins anew.
        let cells = frame::State::new(crate::testing::layout());
        ledger.follow(&cells);
        assert_eq!(ledger, Ledger::new(&cells));
        ledger.follow(&state);
        assert_eq!(ledger, Ledger::new(&state));
    }

    #[test]
    fn layouts_and_states_know_their_profile() {
        let (cells, surface) = (Layout::Cells(crate::testing::layout()), surface_layout());
        assert_eq!((cells.profile(), cells.instances()), (Profile::PAPER, 2));
        assert_eq!((surface.profile(), surface.instances()), (Profile::SURFACE, 0));
        for layout in [cells, surface] {
            let mut state = State::new(&layout);
            assert_eq!((state.layout(), state.profile()), (layout.clone(), layout.profile()));
            assert_eq!(state.as_cells().is_some(), layout.as_cells().is_some());
            assert_eq!(state.as_surface().is_some(), layout.as_surface().is_some());
            assert_eq!(state.as_surface_mut().is_some(), state.as_cells().is_none());
            assert_eq!((state.hash(), state.frame()), (StateHash::default(), None));
        }
    }
}
