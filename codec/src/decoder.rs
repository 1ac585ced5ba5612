//! The decoder, for either profile.

use crate::envelope::{FrameBody, FrameError, FrameInfo};
use crate::{Limits, State, paper, surface};

/// Applies frame bodies to states of either profile. It keeps its buffers between frames.
#[derive(Debug, Default)]
pub struct Decoder {
    paper: paper::Decoder,
    surface: surface::Decoder,
}

impl Decoder {
    /// Creates a decoder that has allocated nothing yet.
    #[must_use]
    pub fn new() -> Decoder {
        Decoder::default()
    }

    /// Parses a frame body and applies it: [`FrameBody::parse`], then [`Decoder::apply`].
    ///
    /// # Errors
    /// Those of [`Decoder::apply`].
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

    /// Applies a frame body to `state`. It checks everything first, including the hash of the resulting state, and
    /// then writes.
    ///
    /// # Errors
    /// [`FrameError`] tells what is wrong and where. [`FrameError::ProfileOther`] refuses a body of the other profile.
    /// `state` is unchanged after an error.
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

/// Applies one frame body to `state`. [`Decoder::apply`] is cheaper for many frames.
///
/// # Errors
/// Those of [`Decoder::apply`].
pub fn apply(state: &mut State, body: &[u8], limits: &Limits) -> Result<FrameInfo, FrameError> {
    Decoder::new().decode(state, body, limits)
}
