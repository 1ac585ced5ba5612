//! What can be shown of a keyframe before all of it is here.

use super::{Decoder, State};
use crate::Limits;
use crate::envelope::{FrameError, FrameKind, Profile, check_follows, read_header, whole_blocks};

/// What can be shown of a keyframe of which only the first bytes are here.
#[derive(Debug, Clone, PartialEq)]
pub struct Preview {
    /// What the whole sections among the bytes make. Nothing vouches for it: checksum and state hash need the rest.
    pub state: State,
    /// Sections that are whole.
    pub sections: usize,
    /// Sections of the keyframe.
    pub of: usize,
}

/// Reads the first bytes of a keyframe for a stream whose state so far is `state`; `None` while the header is not whole,
/// or when it is no keyframe.
///
/// # Errors
/// [`FrameError`] where the bytes are no beginning of a keyframe.
pub fn preview(state: &State, bytes: &[u8], limits: &Limits) -> Result<Option<Preview>, FrameError> {
    let info = match read_header(bytes, limits) {
        Err(FrameError::Truncated { .. }) => return Ok(None),
        header => header?.0,
    };
    check_follows(&info, Profile::SURFACE, state.frame)?;
    if info.kind != FrameKind::Key {
        return Ok(None);
    }
    let blocks = whole_blocks(&info, bytes);
    let mut next = Decoder::new().keyframe(state, blocks.clone(), limits)?;
    next.hash = next.full_hash();
    next.frame = Some(info.frame);
    Ok(Some(Preview { state: next, sections: blocks.count(), of: info.sections.len() }))
}
