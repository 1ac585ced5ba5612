//! Previews of keyframes that have not arrived completely.

use super::{Decoder, State};
use crate::Limits;
use crate::envelope::{FrameError, FrameKind, Profile, check_follows, read_header, whole_blocks};

/// The part of a keyframe that is complete in its first bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Preview {
    /// The state of the complete sections. Nothing vouches for it: checksum and state hash need the rest.
    pub state: State,
    /// Number of complete sections.
    pub sections: usize,
    /// Number of sections of the keyframe.
    pub of: usize,
}

/// Reads the first bytes of a keyframe for a stream with state `state`. Returns `None` while the header is incomplete,
/// or if the frame is not a keyframe.
///
/// # Errors
/// [`FrameError`] if the bytes are not the start of a keyframe.
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
