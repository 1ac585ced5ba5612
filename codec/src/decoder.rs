//! Applies frames to a state of either profile.

use crate::envelope::{FrameBody, FrameError, FrameInfo};
use crate::{Limits, State, paper, surface};

/// Applies frame bodies to states of either profile; keeps its buffers between them.
#[derive(Debug, Default)]
pub struct Decoder {
    paper: paper::Decoder,
    surface: surface::Decoder,
}

impl Decoder {
    /// A decoder with nothing allocated yet.
    #[must_use]
    pub fn new() -> Decoder {
        Decoder::default()
    }

    /// Reads a frame body and applies it: [`FrameBody::parse`] and [`Decoder::apply`].
    ///
    /// # Errors
    /// As [`Decoder::apply`].
    pub fn decode(
        &mut self,
        state: &mut State,
        bytes: &[u8],
        limits: &Limits,
    ) -> Result<FrameInfo, FrameError> {
        let body = FrameBody::parse(bytes, limits)?;
        self.apply(state, &body, limits)?;
        Ok(body.into_info())
    }

    /// Applies a frame body to `state`: checks all of it, the hash of the state after included, then writes.
    ///
    /// # Errors
    /// [`FrameError`] says what is wrong and where, [`FrameError::ProfileOther`] for a body of a profile that is not the
    /// state's; `state` is then exactly as before.
    pub fn apply(
        &mut self,
        state: &mut State,
        body: &FrameBody<'_>,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        match state {
            State::Paper(state) => self.paper.apply(state, body, limits),
            State::Surface(state) => self.surface.apply(state, body, limits),
        }
    }
}

/// Applies a frame body to `state`. See [`Decoder::apply`], which is cheaper for many frames.
///
/// # Errors
/// Those of [`Decoder::apply`].
pub fn apply(state: &mut State, body: &[u8], limits: &Limits) -> Result<FrameInfo, FrameError> {
    Decoder::new().decode(state, body, limits)
}
