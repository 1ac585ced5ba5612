//! A parsed frame body: its header, and bytes with a correct checksum.

use super::header::read_checked;
use super::{FrameError, FrameInfo, SectionInfo};
use crate::Limits;

/// A frame body with a valid header and a correct checksum. It is parsed once; then it can be inspected, passed on and
/// applied.
///
/// ```
/// # use psao_codec::{Limits, State, StateRef, Layout, block::BlockCoder, keyframe, surface};
/// # use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
/// use psao_codec::Decoder;
/// use psao_codec::envelope::FrameBody;
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let limits = Limits::default();
/// # let layout = Layout::Surface(surface::Layout::new(Vec::new(), Vec::new(), &limits)?.into());
/// # let mut state = State::new(&layout);
/// # let meta = FrameMeta { kind: FrameKind::Key, frame: FrameIndex(7), time: StreamTime(0), changed_points: 0 };
/// # let bytes = keyframe(&state, meta, BlockCoder::default(), &[])?;
/// let body = FrameBody::parse(&bytes, &limits)?;
/// println!("frame {} has {} sections", body.info().frame, body.info().sections.len());
/// Decoder::new().apply(&mut state, &body, &limits)?;
/// assert_eq!(state.frame(), Some(body.info().frame));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct FrameBody<'a> {
    info: FrameInfo,
    bytes: &'a [u8],
}

/// A section and its block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SectionBlock<'a> {
    pub(crate) section: SectionInfo,
    /// Start of the block in the body.
    pub(crate) offset: usize,
    /// The block as on the wire.
    pub(crate) bytes: &'a [u8],
}

impl<'a> FrameBody<'a> {
    /// Reads the header of a frame body. It checks everything that needs neither a state nor decompression: ids,
    /// canonical varints, lengths against each other and against `limits`, and the checksum.
    ///
    /// # Errors
    /// [`FrameError`] names the field and its byte offset.
    pub fn parse(bytes: &'a [u8], limits: &Limits) -> Result<FrameBody<'a>, FrameError> {
        Ok(FrameBody { info: read_checked(bytes, limits)?, bytes })
    }

    /// Returns the header.
    #[must_use]
    pub fn info(&self) -> &FrameInfo {
        &self.info
    }

    /// Returns the header and drops the bytes.
    #[must_use]
    pub fn into_info(self) -> FrameInfo {
        self.info
    }

    /// Returns the whole body.
    #[must_use]
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Returns the sections with their blocks.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = SectionBlock<'a>> + Clone + use<'_, 'a> {
        whole_blocks(&self.info, self.bytes)
    }
}

/// Returns the sections whose blocks are complete in `bytes`, the start of a body.
pub(crate) fn whole_blocks<'i, 'a>(
    info: &'i FrameInfo,
    bytes: &'a [u8],
) -> impl Iterator<Item = SectionBlock<'a>> + Clone + use<'i, 'a> {
    let mut offset = info.header_bytes as usize;
    info.sections.iter().map_while(move |section| {
        let block = bytes.get(offset..offset + section.wire_bytes as usize)?;
        offset += block.len();
        Some(SectionBlock { section: *section, offset: offset - block.len(), bytes: block })
    })
}

/// Returns the header of a frame body, as [`FrameBody::parse`] reads it.
///
/// # Errors
/// Those of [`FrameBody::parse`].
pub fn inspect(bytes: &[u8], limits: &Limits) -> Result<FrameInfo, FrameError> {
    Ok(FrameBody::parse(bytes, limits)?.into_info())
}
