//! A state of either profile.

use psao_codec::envelope::{FrameError, FrameInfo};
use psao_codec::{Limits, paper, surface};

use super::scenes::Stream;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Stand {
    Paper(Box<paper::State>),
    Surface(Box<surface::State>),
}

impl Stand {
    /// The empty state of a stream, with the geometry that is shared.
    pub(super) fn new(stream: &Stream) -> Stand {
        match stream {
            Stream::Paper { layout, .. } => Stand::Paper(Box::new(paper::State::new(layout.clone()))),
            Stream::Surface { layout, geometry, shared, .. } => {
                let mut state = surface::State::new(layout.clone());
                for (geometry, set) in geometry.iter().zip(0..).filter(|_| *shared) {
                    state.share_geometry(set, geometry.clone()).unwrap();
                }
                Stand::Surface(Box::new(state))
            }
        }
    }

    pub(super) fn apply(&mut self, body: &[u8]) -> Result<FrameInfo, FrameError> {
        let limits = Limits::default();
        match self {
            Stand::Paper(state) => paper::apply(state, body, &limits),
            Stand::Surface(state) => surface::Decoder::new().decode(state, body, &limits),
        }
    }
}
