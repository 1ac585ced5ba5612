//! The summary of a recording, found by a scan of the whole file.

use std::collections::BTreeMap;

use psao_codec::envelope::FrameBody;

use super::index::read_index;
use super::parity::Parity;
use super::{Damage, FOOTER_BYTES, FrameEntry, IndexEntry, IndexKind, Reader, ReaderError, parse_footer};
use crate::message::{Close, Gap, Message};
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
    /// The index names exactly the records of the file that it should.
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
    frames: Vec<FrameEntry>,
    index: Vec<IndexEntry>,
    stored_index: StoredIndex,
    types: BTreeMap<FrameType, TypeCount>,
    groups: u32,
    first_arrival: Option<Micros>,
    last_arrival: Option<Micros>,
    close: Option<Close>,
    damages: Vec<Damage>,
    gaps: Vec<Gap>,
    parity_end: u64,
}

impl Summary {
    /// Scans a whole file and checks its checksums.
    ///
    /// # Errors
    /// [`ReaderError`] when the bytes are not a recording that this version reads.
    pub fn scan(bytes: &[u8], limits: Limits) -> Result<Self, ReaderError> {
        let mut summary = Self {
            file_bytes: bytes.len() as u64,
            frames: Vec::new(),
            index: Vec::new(),
            stored_index: StoredIndex::Missing,
            types: BTreeMap::new(),
            groups: 0,
            first_arrival: None,
            last_arrival: None,
            close: None,
            damages: Vec::new(),
            gaps: Vec::new(),
            parity_end: 0,
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
            match header.kind {
                FrameType::INDEX => {
                    stored = Some(read_index(payload));
                    continue;
                }
                FrameType::PARITY => {
                    let stretch = Parity::parse(payload, record.offset()).map(|parity| parity.stretch());
                    if let Some(stretch) = stretch.filter(|stretch| stretch.start == summary.parity_end) {
                        summary.parity_end = stretch.end;
                    }
                    continue;
                }
                _ => {}
            }
            summary.first_arrival.get_or_insert(record.arrival);
            summary.last_arrival = summary.last_arrival.max(Some(record.arrival));
            let carries_state = header.kind.carries_state();
            let body = if carries_state { FrameBody::parse(payload, &limits.codec).ok() } else { None };
            let info = body.as_ref().map(FrameBody::info);
            summary.frames.extend(info.map(|info| FrameEntry::new(record.offset(), header, info)));
            summary.index.extend(IndexEntry::of(record.offset(), header.kind, payload, info));
            if carries_state {
                summary.groups += u32::from(group.replace(header.group) != Some(header.group));
            }
            match header.kind {
                FrameType::CLOSE => summary.close = Close::from_payload(payload).ok(),
                FrameType::GAP => summary.gaps.extend(Gap::from_payload(payload).ok()),
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
    pub fn frames(&self) -> &[FrameEntry] {
        &self.frames
    }

    /// Returns the index of the file as its records have it, in file order.
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

    /// Returns up to which offset parity records cover the file without a gap.
    #[must_use]
    pub const fn parity_end(&self) -> u64 {
        self.parity_end
    }

    /// Returns where the scene table and the edits begin that must be played before the record at `offset`, in order.
    pub(super) fn prerequisites_of(&self, offset: u64) -> impl Iterator<Item = &IndexEntry> + '_ {
        let end = self.index.partition_point(|entry| entry.offset < offset);
        let before = self.index.get(..end).unwrap_or_default();
        let start = before.iter().rposition(|entry| entry.kind == IndexKind::Scene).unwrap_or(0);
        let after = before.get(start..).unwrap_or_default().iter();
        after.filter(|entry| matches!(entry.kind, IndexKind::Scene | IndexKind::Edit))
    }

    /// Returns the bytes of all frames on the wire, headers included, without index and parity.
    #[must_use]
    pub fn wire_bytes(&self) -> u64 {
        let on_the_wire = |kind: &FrameType| !matches!(*kind, FrameType::INDEX | FrameType::PARITY);
        self.types.iter().filter(|(kind, _)| on_the_wire(kind)).map(|(_, count)| count.wire_bytes).sum()
    }

    /// Returns the keyframe from which to play in order to reach `frame`: the last one that is not after it.
    #[must_use]
    pub fn keyframe_before(&self, frame: FrameIndex) -> Option<&FrameEntry> {
        self.frames.iter().rfind(|entry| entry.keyframe && entry.frame <= frame)
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
