//! Applies frames to a state of either profile.

use crate::envelope::{FrameError, FrameInfo};
use crate::{Limits, State, paper, surface};

/// Applies frame bodies to states of either profile; keeps its buffers between them.
#[derive(Debug, Default)]
pub struct Decoder {
    cells: paper::Decoder,
    surface: surface::Decoder,
}

impl Decoder {
    /// A decoder with nothing allocated yet.
    #[must_use]
    pub fn new() -> Decoder {
        Decoder::default()
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
            State::Paper(state) => Ok(self.cells.apply(state, body, limits)?.info),
            State::Surface(state) => self.surface.apply(state, body, limits),
        }
    }
}

/// Applies a frame body to `state`. See [`Decoder::apply`], which is cheaper for many frames.
///
/// # Errors
/// Those of [`Decoder::apply`].
pub fn apply(state: &mut State, body: &[u8], limits: &Limits) -> Result<FrameInfo, FrameError> {
    Decoder::new().apply(state, body, limits)
}
