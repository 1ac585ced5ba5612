//! What is in a recording, found by scanning all of it.

use std::collections::BTreeMap;

use psao_codec::envelope::FrameBody;

use super::index::read_index;
use super::{Damage, FOOTER_BYTES, IndexEntry, Reader, ReaderError, parse_footer};
use crate::message::{Close, Gap, Message, Scene};
use crate::{FrameIndex, FrameType, Limits, Micros};

/// Frames of one type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TypeCount {
    /// How many.
    pub frames: u64,
    /// Bytes that they took on the wire, headers included.
    pub wire_bytes: u64,
    /// Bytes of their records in the file.
    pub record_bytes: u64,
}

/// Whether a recording has an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoredIndex {
    /// It has none, as after a killed recorder; [`Summary::index`] was rebuilt.
    Missing,
    /// It has one and it names exactly the frames that are there.
    Agrees,
    /// It has one that does not fit the file; [`Summary::index`] was rebuilt.
    Differs,
}

/// What a scan of a recording found.
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

/// A record that a reader needs even if it jumps over it: part of a scene table, or an edit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Prerequisite {
    offset: u64,
    /// Whether a scene table starts_scene here: nothing before it matters any more.
    starts_scene: bool,
}

impl Summary {
    /// Scans a whole file, checksums included, without decompressing anything.
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

    /// Bytes of the file.
    #[must_use]
    pub const fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Every keyframe and update whose header can be read, in file order.
    #[must_use]
    pub fn index(&self) -> &[IndexEntry] {
        &self.index
    }

    /// What the file's own index is worth.
    #[must_use]
    pub const fn stored_index(&self) -> StoredIndex {
        self.stored_index
    }

    /// Frames by type, in the order of their wire ids.
    #[must_use]
    pub const fn types(&self) -> &BTreeMap<FrameType, TypeCount> {
        &self.types
    }

    /// Frames of one type.
    #[must_use]
    pub fn count(&self, kind: FrameType) -> TypeCount {
        self.types.get(&kind).copied().unwrap_or_default()
    }

    /// Groups of which at least one frame is there.
    #[must_use]
    pub const fn groups(&self) -> u32 {
        self.groups
    }

    /// Time from the first arrival to the last; zero without records.
    #[must_use]
    pub fn duration(&self) -> Micros {
        self.last_arrival.unwrap_or_default().since(self.first_arrival.unwrap_or_default())
    }

    /// The CLOSE at the end; `None` when the recorder or the stream was cut off.
    #[must_use]
    pub const fn close(&self) -> Option<&Close> {
        self.close.as_ref()
    }

    /// Every stretch that could not be read.
    #[must_use]
    pub fn damages(&self) -> &[Damage] {
        &self.damages
    }

    /// Every stretch of the stream that the recorder says it did not write.
    #[must_use]
    pub fn gaps(&self) -> &[Gap] {
        &self.gaps
    }

    /// Offsets of the records that must be played before the one at `offset`, in order: the last scene table that starts_scene
    /// before it, and the edits since.
    pub(super) fn prerequisites_of(&self, offset: u64) -> impl Iterator<Item = u64> + '_ {
        let end = self.prerequisites.partition_point(|mark| mark.offset < offset);
        let prerequisites = self.prerequisites.get(..end).unwrap_or_default();
        let begin = prerequisites.iter().rposition(|mark| mark.starts_scene).unwrap_or(0);
        prerequisites.get(begin..).unwrap_or_default().iter().map(|mark| mark.offset)
    }

    /// Bytes of the recorded frames on the wire, headers included, an index left out.
    #[must_use]
    pub fn wire_bytes(&self) -> u64 {
        self.types.iter().filter(|(kind, _)| **kind != FrameType::INDEX).map(|(_, c)| c.wire_bytes).sum()
    }

    /// Where to start playing so as to reach `frame`: the last keyframe that is not after it.
    #[must_use]
    pub fn keyframe_before(&self, frame: FrameIndex) -> Option<&IndexEntry> {
        self.index.iter().rfind(|entry| entry.keyframe && entry.frame <= frame)
    }
}

/// The index of a recording: the one at its end when it is there and every entry lies in the file, otherwise one made
/// by scanning. What an entry points to is checked again when it is read, so a wrong index costs time, never a wrong
/// picture.
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
