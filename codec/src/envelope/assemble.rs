//! Writes the header of a frame before its blocks.

use super::header::write_header;
use super::{
    CRC_OFFSET, EncodedFrame, FrameInfo, FrameKind, FrameMeta, Packing, Profile, SectionInfo, body_crc,
};
use crate::StateHash;

/// The ids at the start of a header.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FrameIds {
    pub(crate) profile: Profile,
    pub(crate) packing: Packing,
    pub(crate) kind: FrameKind,
}

/// Returns the frame of these blocks: it writes the header and the checksum.
pub(crate) fn assemble(
    meta: &FrameMeta,
    FrameIds { profile, packing, kind }: FrameIds,
    hash: StateHash,
    sections: Vec<SectionInfo>,
    blocks: &[u8],
) -> EncodedFrame {
    let (frame, time, changed_points) = (meta.frame, meta.time, meta.changed_points);
    let mut info =
        FrameInfo { profile, packing, kind, frame, time, hash, changed_points, header_bytes: 0, sections };
    let mut body = Vec::with_capacity(blocks.len() + 96);
    write_header(&mut body, &info);
    info.header_bytes = body.len() as u32;
    body.extend_from_slice(blocks);
    let crc = body_crc(&body);
    body[CRC_OFFSET..CRC_OFFSET + 4].copy_from_slice(&crc.to_le_bytes());
    EncodedFrame { body, info }
}
