//! The index of a recording: the places of its keyframes and updates.

use psao_codec::envelope::FrameInfo;

use crate::{FrameHeader, FrameIndex, FrameType, Group, Sequence, StreamTime};

/// Bytes of one entry in an INDEX frame.
pub const INDEX_ENTRY_BYTES: usize = 32;

/// One keyframe or update of a recording.
///
/// In an INDEX frame an entry is 32 bytes, little endian: offset `u64`, stream time `u64`, frame `u32`, group `u32`,
/// sequence `u32`, frame type `u8`, three zero bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IndexEntry {
    /// Offset of its record in the file, in bytes.
    pub offset: u64,
    /// Time on the stream's own clock.
    pub time: StreamTime,
    /// Number of the frame.
    pub frame: FrameIndex,
    /// Group of its wire frame.
    pub group: Group,
    /// Sequence number of its wire frame in the group.
    pub sequence: Sequence,
    /// Whether it is a keyframe.
    pub keyframe: bool,
}

impl IndexEntry {
    /// Creates the entry of the keyframe or update in the record at `offset`, from the headers of its wire frame and of
    /// its body.
    pub(super) fn new(offset: u64, header: FrameHeader, info: &FrameInfo) -> Self {
        let FrameHeader { kind, group, sequence, .. } = header;
        let keyframe = kind == FrameType::KEYFRAME;
        Self { offset, time: info.time, frame: info.frame, group, sequence, keyframe }
    }

    fn to_bytes(self) -> [u8; INDEX_ENTRY_BYTES] {
        let mut out = [0; INDEX_ENTRY_BYTES];
        out[..8].copy_from_slice(&self.offset.to_le_bytes());
        out[8..16].copy_from_slice(&self.time.0.to_le_bytes());
        out[16..20].copy_from_slice(&self.frame.0.to_le_bytes());
        out[20..24].copy_from_slice(&self.group.0.to_le_bytes());
        out[24..28].copy_from_slice(&self.sequence.0.to_le_bytes());
        out[28] = if self.keyframe { FrameType::KEYFRAME.0 } else { FrameType::UPDATE.0 };
        out
    }

    fn from_bytes(bytes: &[u8; INDEX_ENTRY_BYTES]) -> Option<Self> {
        let keyframe = match (FrameType(bytes[28]), &bytes[29..]) {
            (FrameType::KEYFRAME, [0, 0, 0]) => true,
            (FrameType::UPDATE, [0, 0, 0]) => false,
            _ => return None,
        };
        Some(Self {
            offset: u64::from_le_bytes(*bytes.first_chunk()?),
            time: StreamTime(u64::from_le_bytes(*bytes[8..].first_chunk()?)),
            frame: FrameIndex(u32::from_le_bytes(*bytes[16..].first_chunk()?)),
            group: Group(u32::from_le_bytes(*bytes[20..].first_chunk()?)),
            sequence: Sequence(u32::from_le_bytes(*bytes[24..].first_chunk()?)),
            keyframe,
        })
    }
}

/// Returns the payload of an INDEX frame.
pub(crate) fn write_index(entries: &[IndexEntry]) -> Vec<u8> {
    entries.iter().flat_map(|entry| entry.to_bytes()).collect()
}

/// Returns the entries of an INDEX frame, or `None` if the payload is not an index. A reader that gets `None` scans the
/// file instead.
pub(crate) fn read_index(payload: &[u8]) -> Option<Vec<IndexEntry>> {
    let (entries, rest) = payload.as_chunks::<INDEX_ENTRY_BYTES>();
    if !rest.is_empty() {
        return None;
    }
    entries.iter().map(IndexEntry::from_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::testing::hex;

    #[test]
    fn golden_bytes() {
        let entry = IndexEntry {
            offset: 1,
            time: StreamTime(2),
            frame: FrameIndex(3),
            group: Group(4),
            sequence: Sequence(5),
            keyframe: true,
        };
        let update = IndexEntry { keyframe: false, ..entry };
        let bytes = write_index(&[entry, update]);
        let golden = "0100000000000000020000000000000003000000040000000500000007000000";
        assert_eq!(hex(&bytes[..32]), golden);
        assert_eq!(read_index(&bytes), Some(vec![entry, update]));
        assert_eq!(read_index(&bytes[..40]), None);
        let mut bad = bytes;
        bad[28] = 10;
        assert_eq!(read_index(&bad), None);
    }
}
