//! The summary of a recording, found by a scan of the whole file.

use std::collections::BTreeMap;

use psao_codec::envelope::FrameBody;

use super::index::read_index;
use super::{Damage, FOOTER_BYTES, IndexEntry, Reader, ReaderError, parse_footer};
use crate::message::{Close, Gap, Message, Scene};
use crate::{FrameIndex, FrameType, Limits, Micros};

/// Counts of the frames of one type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TypeCount {
    /// Number of frames.
    pub frames: u64,
    /// Their bytes on the wire, headers included.
    pub wire_bytes: u64,
    /// Bytes of their records in the file.
    pub record_bytes: u64,
}

/// State of the index that a recording stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoredIndex {
    /// There is no index, as after a killed recorder. [`Summary::index`] was rebuilt.
    Missing,
    /// The index names exactly the frames of the file.
    Agrees,
    /// The index does not fit the file. [`Summary::index`] was rebuilt.
    Differs,
}

/// Contents of a recording, found by a scan.
///
/// A scan checks every checksum but decompresses nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    file_bytes: u64,
    index: Vec<IndexEntry>,
    stored_index: StoredIndex,
    types: BTreeMap<FrameType, TypeCount>,
    groups: u32,
    first_arrival: Option<Micros>,
    last_arrival: Option<Micros>,
    close: Option<Close>,
    damages: Vec<Damage>,
    gaps: Vec<Gap>,
    prerequisites: Vec<Prerequisite>,
}

/// A record that later frames depend on: part of a scene table, or an edit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Prerequisite {
    offset: u64,
    /// Whether a scene table starts here, so that no earlier record matters.
    starts_scene: bool,
}

impl Summary {
    /// Scans a whole file and checks its checksums.
    ///
    /// # Errors
    /// [`ReaderError`] when the bytes are not a recording that this version reads.
    pub fn scan(bytes: &[u8], limits: Limits) -> Result<Self, ReaderError> {
        let mut summary = Self {
            file_bytes: bytes.len() as u64,
            index: Vec::new(),
            stored_index: StoredIndex::Missing,
            types: BTreeMap::new(),
            groups: 0,
            first_arrival: None,
            last_arrival: None,
            close: None,
            damages: Vec::new(),
            gaps: Vec::new(),
            prerequisites: Vec::new(),
        };
        let mut stored = None;
        let mut group = None;
        for item in Reader::with_limits(bytes, limits)? {
            let record = match item {
                Ok(record) => record,
                Err(damage) => {
                    summary.damages.push(damage);
                    continue;
                }
            };
            let (header, payload) = (record.frame.header, record.frame.payload());
            let count = summary.types.entry(header.kind).or_default();
            count.frames += 1;
            count.wire_bytes += record.wire_bytes();
            count.record_bytes += record.record_bytes();
            if header.kind == FrameType::INDEX {
                stored = Some(read_index(payload));
                continue;
            }
            summary.first_arrival.get_or_insert(record.arrival);
            summary.last_arrival = summary.last_arrival.max(Some(record.arrival));
            if header.kind.carries_state() {
                if let Ok(body) = FrameBody::parse(payload, &limits.codec) {
                    summary.index.push(IndexEntry::new(record.offset(), header, body.info()));
                }
                summary.groups += u32::from(group.replace(header.group) != Some(header.group));
            }
            match header.kind {
                FrameType::CLOSE => summary.close = Close::from_payload(payload).ok(),
                FrameType::GAP => summary.gaps.extend(Gap::from_payload(payload).ok()),
                FrameType::SCENE | FrameType::EDIT => {
                    let scene = (header.kind == FrameType::SCENE).then(|| Scene::from_payload(payload));
                    let starts_scene = matches!(scene, Some(Ok(Scene::Info(_))));
                    summary.prerequisites.push(Prerequisite { offset: record.offset(), starts_scene });
                }
                _ => {}
            }
        }
        summary.stored_index = match stored {
            None => StoredIndex::Missing,
            Some(Some(entries)) if entries == summary.index => StoredIndex::Agrees,
            Some(_) => StoredIndex::Differs,
        };
        Ok(summary)
    }

    /// Returns the length of the file in bytes.
    #[must_use]
    pub const fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Returns an entry for every keyframe and update whose header can be read, in file order.
    #[must_use]
    pub fn index(&self) -> &[IndexEntry] {
        &self.index
    }

    /// Returns the state of the index that the file stores.
    #[must_use]
    pub const fn stored_index(&self) -> StoredIndex {
        self.stored_index
    }

    /// Returns the counts of all frame types, in the order of their wire ids.
    #[must_use]
    pub const fn types(&self) -> &BTreeMap<FrameType, TypeCount> {
        &self.types
    }

    /// Returns the counts of one frame type.
    #[must_use]
    pub fn count(&self, kind: FrameType) -> TypeCount {
        self.types.get(&kind).copied().unwrap_or_default()
    }

    /// Returns the number of groups with at least one frame in the file.
    #[must_use]
    pub const fn groups(&self) -> u32 {
        self.groups
    }

    /// Returns the time from the first arrival to the last; zero without records.
    #[must_use]
    pub fn duration(&self) -> Micros {
        self.last_arrival.unwrap_or_default().since(self.first_arrival.unwrap_or_default())
    }

    /// Returns the last CLOSE; `None` if the recorder or the stream was cut off.
    #[must_use]
    pub const fn close(&self) -> Option<&Close> {
        self.close.as_ref()
    }

    /// Returns every stretch of the file that could not be read.
    #[must_use]
    pub fn damages(&self) -> &[Damage] {
        &self.damages
    }

    /// Returns every stretch of the stream that the recorder reported as not written.
    #[must_use]
    pub fn gaps(&self) -> &[Gap] {
        &self.gaps
    }

    /// Returns the offsets of the records that must be played before the one at `offset`, in order. These are the last
    /// scene table before it, and the edits since that table.
    pub(super) fn prerequisites_of(&self, offset: u64) -> impl Iterator<Item = u64> + '_ {
        let end = self.prerequisites.partition_point(|mark| mark.offset < offset);
        let prerequisites = self.prerequisites.get(..end).unwrap_or_default();
        let start = prerequisites.iter().rposition(|mark| mark.starts_scene).unwrap_or(0);
        prerequisites.get(start..).unwrap_or_default().iter().map(|mark| mark.offset)
    }

    /// Returns the bytes of all frames on the wire, headers included, without the index.
    #[must_use]
    pub fn wire_bytes(&self) -> u64 {
        self.types.iter().filter(|(kind, _)| **kind != FrameType::INDEX).map(|(_, c)| c.wire_bytes).sum()
    }

    /// Returns the keyframe from which to play in order to reach `frame`: the last one that is not after it.
    #[must_use]
    pub fn keyframe_before(&self, frame: FrameIndex) -> Option<&IndexEntry> {
        self.index.iter().rfind(|entry| entry.keyframe && entry.frame <= frame)
    }
}

/// Returns the index of a recording: the stored index if all its entries lie within the file, otherwise one made by a
/// scan. A reader checks each record again, so a wrong index costs time but never gives a wrong state.
///
/// # Errors
/// [`ReaderError`] when the bytes are not a recording that this version reads.
pub fn load_index(bytes: &[u8], limits: Limits) -> Result<Vec<IndexEntry>, ReaderError> {
    match stored_index(bytes, limits) {
        Some(entries) => Ok(entries),
        None => Ok(Summary::scan(bytes, limits)?.index),
    }
}

fn stored_index(bytes: &[u8], limits: Limits) -> Option<Vec<IndexEntry>> {
    let offset = parse_footer(bytes.last_chunk::<FOOTER_BYTES>()?)?;
    let mut reader = Reader::with_limits(bytes, limits).ok()?;
    reader.seek(offset);
    let record = reader.next()?.ok()?;
    if record.offset() != offset || record.frame.header.kind != FrameType::INDEX {
        return None;
    }
    let entries = read_index(record.frame.payload())?;
    entries.iter().all(|entry| entry.offset < offset).then_some(entries)
}
