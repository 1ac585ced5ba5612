//! The change log, for either profile.

use crate::block::BlockCoder;
use crate::envelope::{EncodeError, FrameIndex, FrameMeta};
use crate::{StateRef, surface};

/// The last frame in which each point changed, see [`surface::ChangeLog`]. In profile `paper` it records nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ChangeLog(Option<Box<surface::ChangeLog>>);

impl ChangeLog {
    /// Creates a change log that begins with `state`.
    #[must_use]
    pub fn new<'a>(state: impl Into<StateRef<'a>>) -> ChangeLog {
        ChangeLog(match state.into() {
            StateRef::Paper(_) => None,
            StateRef::Surface(state) => Some(Box::new(surface::ChangeLog::new(state))),
        })
    }

    /// Returns the points that changed after frame `base`, see [`surface::ChangeLog::changed_since`]. `None` if this
    /// is not known, as always in profile `paper`.
    #[must_use]
    pub fn changed_since(&self, base: FrameIndex) -> Option<impl Iterator<Item = (u32, u64)> + '_> {
        self.0.as_ref()?.changed_since(base)
    }

    /// Returns whether a patch can update a client of frame `base`.
    #[must_use]
    pub fn reaches(&self, base: FrameIndex) -> bool {
        self.changed_since(base).is_some()
    }

    /// Records what the last frame changed. Call it after every frame, see [`surface::ChangeLog::record`].
    pub fn record<'a>(&mut self, state: impl Into<StateRef<'a>>) {
        match (&mut self.0, state.into()) {
            (Some(log), StateRef::Surface(state)) => log.record(state),
            (_, state) => *self = ChangeLog::new(state),
        }
    }
}

/// Writes the body of a delta that brings every client at frame `base` or later to `state`, see [`surface::patch`].
/// Returns `None` if only a keyframe helps, as always in profile `paper`.
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
        // A state of the other profile starts a new log.
        let cells = paper::State::new(crate::testing::layout());
        log.record(&cells);
        assert_eq!(log, ChangeLog::new(&cells));
        log.record(&state);
        assert_eq!(log, ChangeLog::new(&state));
    }
}
