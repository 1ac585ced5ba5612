//! Which points changed in which frame, for clients that missed some.

use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameIndex, FrameMeta};
use crate::{StateRef, surface};

/// Which points changed in which frame of a stream, see [`surface::ChangeLog`]. Of profile `paper` nothing is known.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ChangeLog(Option<Box<surface::ChangeLog>>);

impl ChangeLog {
    /// A change log that begins with `state`.
    #[must_use]
    pub fn new<'a>(state: impl Into<StateRef<'a>>) -> ChangeLog {
        ChangeLog(match state.into() {
            StateRef::Paper(_) => None,
            StateRef::Surface(state) => Some(Box::new(surface::ChangeLog::new(state))),
        })
    }

    /// Returns the points that changed after frame `base`, as [`surface::ChangeLog::changed_since`]. `None` when that cannot be
    /// said, which in profile `paper` is always.
    #[must_use]
    pub fn changed_since(&self, base: FrameIndex) -> Option<impl Iterator<Item = (u32, u64)> + '_> {
        self.0.as_ref()?.changed_since(base)
    }

    /// Whether a client of frame `base` can be told what it missed.
    #[must_use]
    pub fn reaches(&self, base: FrameIndex) -> bool {
        self.changed_since(base).is_some()
    }

    /// Notes what the last frame changed; to be called after every frame, as [`surface::ChangeLog::record`].
    pub fn record<'a>(&mut self, state: impl Into<StateRef<'a>>) {
        match (&mut self.0, state.into()) {
            (Some(log), StateRef::Surface(state)) => log.record(state),
            (_, state) => *self = ChangeLog::new(state),
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
    log: &ChangeLog,
    base: FrameIndex,
    meta: FrameMeta,
    coder: BlockCoder,
    context: bool,
) -> Result<Option<Vec<u8>>, EncodeError> {
    match (state.into(), &log.0) {
        (StateRef::Surface(state), Some(log)) => surface::patch(state, log, base, meta, coder, context),
        _ => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::envelope::FrameKind;
    use crate::{Limits, keyframe, paper};

    #[test]
    fn a_surface_stream_has_its_own_change_log() {
        let layout = surface::Layout::new(Vec::new(), Vec::new(), &Limits::default()).unwrap();
        let mut state = surface::State::new(Arc::new(layout));
        let mut own = surface::ChangeLog::new(&state);
        let mut log = ChangeLog::new(StateRef::Surface(&state));
        assert_eq!(log, ChangeLog(Some(Box::new(own.clone()))));
        let meta = crate::testing::meta(FrameKind::Key, 4);
        let body = keyframe(&state, meta, BlockCoder::Stored, &[]).unwrap();
        surface::Decoder::new().decode(&mut state, &body, &Limits::default()).unwrap();
        own.record(&state);
        log.record(&state);
        assert_eq!(log, ChangeLog(Some(Box::new(own.clone()))));
        let borrowed = StateRef::from(&state);
        assert_eq!((borrowed.hash(), borrowed.frame()), (state.hash(), state.frame()));
        // A change log of the other profile begins anew.
        let cells = paper::State::new(crate::testing::layout());
        log.record(&cells);
        assert_eq!(log, ChangeLog::new(&cells));
        log.record(&state);
        assert_eq!(log, ChangeLog::new(&state));
    }
}
