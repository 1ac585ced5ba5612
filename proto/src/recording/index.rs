//! The index of a recording: where playing can start, and what must be played before.

use psao_codec::envelope::FrameInfo;

use crate::message::{Edit, Message as _, Scene};
use crate::{FrameHeader, FrameIndex, FrameType, Group, Sequence, StreamTime};

/// Bytes of one entry in an INDEX frame.
pub const INDEX_ENTRY_BYTES: usize = 24;

/// One keyframe or update of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameEntry {
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

impl FrameEntry {
    /// Creates the entry of the keyframe or update in the record at `offset`, from the headers of its wire frame and of
    /// its body.
    pub(super) fn new(offset: u64, header: FrameHeader, info: &FrameInfo) -> Self {
        let FrameHeader { kind, group, sequence, .. } = header;
        let keyframe = kind == FrameType::KEYFRAME;
        Self { offset, time: info.time, frame: info.frame, group, sequence, keyframe }
    }
}

/// A record of the index: a keyframe, or a record that must be played before the keyframes after it.
///
/// In an INDEX frame an entry is 24 bytes, little endian: offset `u64`, stream time `u64`, frame `u32`, frame type `u8`,
/// three zero bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IndexEntry {
    /// Offset of the record in the file, in bytes.
    pub offset: u64,
    /// What it holds.
    pub kind: IndexKind,
}

/// Content of an indexed record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndexKind {
    /// The first record of a scene table. The rest of the table follows it.
    Scene,
    /// An edit.
    Edit,
    /// A keyframe, with which a group begins.
    Keyframe {
        /// Time on the stream's own clock.
        time: StreamTime,
        /// Number of the frame.
        frame: FrameIndex,
    },
}

impl IndexEntry {
    /// Returns the entry of the record at `offset`, if it belongs in the index. `info` is the header of its body, which
    /// keyframes and updates have.
    pub(super) fn of(offset: u64, kind: FrameType, payload: &[u8], info: Option<&FrameInfo>) -> Option<Self> {
        let kind = match (kind, info) {
            (FrameType::KEYFRAME, Some(info)) => IndexKind::Keyframe { time: info.time, frame: info.frame },
            (FrameType::SCENE, _) if matches!(Scene::from_payload(payload), Ok(Scene::Info(_))) => {
                IndexKind::Scene
            }
            (FrameType::EDIT, _) if Edit::from_payload(payload).is_ok() => IndexKind::Edit,
            _ => return None,
        };
        Some(Self { offset, kind })
    }

    fn to_bytes(self) -> [u8; INDEX_ENTRY_BYTES] {
        let (kind, time, frame) = match self.kind {
            IndexKind::Scene => (FrameType::SCENE, StreamTime(0), FrameIndex(0)),
            IndexKind::Edit => (FrameType::EDIT, StreamTime(0), FrameIndex(0)),
            IndexKind::Keyframe { time, frame } => (FrameType::KEYFRAME, time, frame),
        };
        let mut out = [0; INDEX_ENTRY_BYTES];
        out[..8].copy_from_slice(&self.offset.to_le_bytes());
        out[8..16].copy_from_slice(&time.0.to_le_bytes());
        out[16..20].copy_from_slice(&frame.0.to_le_bytes());
        out[20] = kind.0;
        out
    }

    fn from_bytes(bytes: &[u8; INDEX_ENTRY_BYTES]) -> Option<Self> {
        let time = StreamTime(u64::from_le_bytes(*bytes[8..].first_chunk()?));
        let frame = FrameIndex(u32::from_le_bytes(*bytes[16..].first_chunk()?));
        let kind = match (FrameType(bytes[20]), time.0, frame.0) {
            (FrameType::KEYFRAME, ..) => IndexKind::Keyframe { time, frame },
            (FrameType::SCENE, 0, 0) => IndexKind::Scene,
            (FrameType::EDIT, 0, 0) => IndexKind::Edit,
            _ => return None,
        };
        let offset = u64::from_le_bytes(*bytes.first_chunk()?);
        (bytes[21..] == [0; 3]).then_some(Self { offset, kind })
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
    let entries: Vec<IndexEntry> = entries.iter().map(IndexEntry::from_bytes).collect::<Option<_>>()?;
    entries.is_sorted_by(|entry, next| entry.offset < next.offset).then_some(entries)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::testing::hex;

    #[test]
    fn golden_bytes() {
        let keyframe = IndexKind::Keyframe { time: StreamTime(2), frame: FrameIndex(3) };
        let entries = [
            IndexEntry { offset: 16, kind: IndexKind::Scene },
            IndexEntry { offset: 64, kind: IndexKind::Edit },
            IndexEntry { offset: 100, kind: keyframe },
        ];
        let bytes = write_index(&entries);
        assert_eq!(hex(&bytes[..24]), "100000000000000000000000000000000000000004000000");
        assert_eq!(hex(&bytes[48..]), "640000000000000002000000000000000300000007000000");
        assert_eq!(read_index(&bytes), Some(entries.to_vec()));
        assert_eq!(read_index(&bytes[..40]), None);
        // Another type, a byte that is not zero, a time of a scene table, an offset that does not ascend.
        for (place, byte) in [(20, 8), (21, 1), (8, 1), (24, 16)] {
            let mut bad = bytes.clone();
            bad[place] = byte;
            assert_eq!(read_index(&bad), None, "byte {place}");
        }
    }
}
