//! Reading the records of a recording past any damage.

use super::{
    FILE_HEADER_BYTES, FILE_MAGIC, FILE_VERSION, FOOTER_BYTES, RECORD_HEAD_BYTES, RecordError, has_valid_crc,
    parse_footer,
};
use crate::framer::{Split, split_frame};
use crate::{FRAME_MAGIC, HEADER_BYTES, Limits, Micros, WireFrame, WireFrameError};

/// Smallest record in bytes: its head and a frame without payload.
const MIN_RECORD_BYTES: usize = RECORD_HEAD_BYTES + HEADER_BYTES;

/// Limit of the payload bytes of false records that a reader checks, in multiples of the file's length. Accidental
/// damage costs one check per lost frame; only a file made to slow readers down reaches this bound.
const FALSE_RECORD_FACTOR: u64 = 16;

/// One frame of a recording, borrowed from the file's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a> {
    /// Arrival at the recorder, in microseconds since the start of the recording.
    pub arrival: Micros,
    /// The wire frame. Its `offset` counts from the start of the file.
    pub frame: WireFrame<'a>,
}

impl Record<'_> {
    /// Returns the offset of the record in the file, in bytes.
    #[must_use]
    pub const fn offset(&self) -> u64 {
        self.frame.offset - RECORD_HEAD_BYTES as u64
    }

    /// Returns the bytes of the frame on the wire.
    #[must_use]
    pub const fn wire_bytes(&self) -> u64 {
        self.frame.bytes.len() as u64
    }

    /// Returns the bytes of the record in the file.
    #[must_use]
    pub const fn record_bytes(&self) -> u64 {
        (RECORD_HEAD_BYTES + self.frame.bytes.len()) as u64
    }
}

/// Why bytes cannot be read as a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReaderError {
    /// The bytes hold neither a file header nor a record.
    #[error("not a psao recording: no file header and no whole record in its {length} bytes")]
    NotARecording {
        /// Bytes of the file.
        length: usize,
    },
    /// A newer program wrote the recording.
    #[error(
        "the recording has format version {found}, this program reads {FILE_VERSION}: update this program"
    )]
    Version {
        /// Version in the file header.
        found: u16,
    },
    /// The file header has unknown flags, which could change the format.
    #[error("the recording has unknown flags {found:#06x}: update this program")]
    Flags {
        /// Flags in the file header.
        found: u16,
    },
}

/// Kind of damage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DamageKind {
    /// The file header is damaged, but the file has records.
    #[error("the file header is damaged")]
    FileHeader,
    /// The file ends inside a record, as after a killed recorder or a full disk.
    #[error("the file ends inside a record")]
    CutOff,
    /// The length of a frame reaches beyond the end of the file, although whole records follow.
    #[error("the length of a frame is damaged")]
    Length,
    /// The arrival time of a record does not match its checksum.
    #[error("the arrival time of a record does not fit its checksum")]
    Arrival,
    /// The frame of a record is damaged.
    #[error("{0}")]
    Frame(WireFrameError),
    /// The file has so many false records that reading on would take too long. The rest is skipped.
    #[error("too many false records; the rest of the file is given up")]
    TooManyFalseRecords,
}

/// A stretch of a recording that could not be read. Reading continues behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{lost_bytes} bytes lost at offset {offset}: {kind}")]
pub struct Damage {
    /// Offset of the first lost byte in the file.
    pub offset: u64,
    /// Kind of damage at `offset`.
    pub kind: DamageKind,
    /// Bytes up to the next whole record or the end of the file.
    pub lost_bytes: u64,
}

/// Iterates over the records of a recording without copying. An `Err` is a damaged stretch. It is reported once, and
/// iteration continues with the next whole record.
///
/// The time is linear in the file's length, whatever its content.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    limits: Limits,
    at: usize,
    /// Payload bytes of false records that may still be checked.
    check_budget: u64,
}

/// Position of a reader in its file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Position {
    at: usize,
    /// Payload bytes of false records that may still be checked.
    check_budget: u64,
}

/// Returns whether `head` is a file header with a valid checksum.
fn is_file_header(head: &[u8; FILE_HEADER_BYTES]) -> bool {
    head.starts_with(&FILE_MAGIC) && has_valid_crc(head)
}

impl<'a> Reader<'a> {
    /// Creates a reader of a whole file with the default limits.
    ///
    /// # Errors
    /// [`ReaderError`] when the bytes are not a recording that this version reads.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ReaderError> {
        Self::with_limits(bytes, Limits::default())
    }

    /// Creates a reader of a whole file that refuses frames over `limits`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_limits(bytes: &'a [u8], limits: Limits) -> Result<Self, ReaderError> {
        let check_budget = FALSE_RECORD_FACTOR.saturating_mul(bytes.len() as u64);
        let mut reader = Self { bytes, limits, at: 0, check_budget };
        match bytes.first_chunk::<FILE_HEADER_BYTES>() {
            Some(head) if is_file_header(head) => {
                let version = u16::from_le_bytes([head[8], head[9]]);
                let flags = u16::from_le_bytes([head[10], head[11]]);
                if version != FILE_VERSION {
                    return Err(ReaderError::Version { found: version });
                }
                if flags != 0 {
                    return Err(ReaderError::Flags { found: flags });
                }
                reader.at = FILE_HEADER_BYTES;
            }
            // The records behind a damaged header must stay readable.
            _ => {
                let check_budget = reader.check_budget;
                if reader.find_record(0).is_none() {
                    return Err(ReaderError::NotARecording { length: bytes.len() });
                }
                reader.check_budget = check_budget;
            }
        }
        Ok(reader)
    }

    /// Continues at the position of another reader of the same bytes.
    pub(super) const fn resume(bytes: &'a [u8], limits: Limits, position: Position) -> Self {
        Self { bytes, limits, at: position.at, check_budget: position.check_budget }
    }

    /// Returns the reader's position.
    pub(super) const fn position(&self) -> Position {
        Position { at: self.at, check_budget: self.check_budget }
    }

    /// Moves to the record at `offset`, a value of [`Record::offset`] or of an index. It is checked like any other
    /// record.
    pub fn seek(&mut self, offset: u64) {
        self.at = usize::try_from(offset).map_or(self.bytes.len(), |at| at.min(self.bytes.len()));
    }

    /// Moves back to the start of the file.
    pub(super) fn rewind(&mut self) {
        let head = self.bytes.first_chunk::<FILE_HEADER_BYTES>();
        self.at = if head.is_some_and(is_file_header) { FILE_HEADER_BYTES } else { 0 };
    }

    /// Returns the offset in the file at which the next item is read, in bytes.
    #[must_use]
    pub const fn offset(&self) -> u64 {
        self.at as u64
    }

    /// Returns the bytes of the file.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Reads the record at `at`.
    fn record_at(&mut self, at: usize) -> Result<Record<'a>, RecordError> {
        let bytes = self.bytes.get(at..).unwrap_or_default();
        // Fewer bytes than a footer are a record or footer that was cut off.
        if bytes.len() < FOOTER_BYTES {
            return Err(RecordError::Ends);
        }
        let Some((&[a0, a1, a2, a3, a4, a5, a6, a7, c0, c1, c2, c3], rest)) =
            bytes.split_first_chunk::<RECORD_HEAD_BYTES>()
        else {
            return Err(RecordError::Ends);
        };
        let arrival = [a0, a1, a2, a3, a4, a5, a6, a7];
        if u32::from_le_bytes([c0, c1, c2, c3]) != crc32c::crc32c(&arrival) {
            return Err(RecordError::Arrival);
        }
        match split_frame(rest, &self.limits) {
            Ok(Split::Whole(header, bytes)) => {
                let offset = (at + RECORD_HEAD_BYTES) as u64;
                let frame = WireFrame { header, offset, bytes };
                Ok(Record { arrival: Micros(u64::from_le_bytes(arrival)), frame })
            }
            Ok(Split::Partial(_)) => Err(RecordError::Ends),
            Err(fault) => {
                if matches!(fault, WireFrameError::Checksum { .. }) {
                    // The header that was just checked holds the length.
                    let length =
                        rest.get(4..8).and_then(|l| l.first_chunk()).map_or(0, |l| u32::from_le_bytes(*l));
                    self.check_budget = self.check_budget.saturating_sub(u64::from(length));
                }
                Err(RecordError::Frame(fault))
            }
        }
    }

    /// Returns the first offset from `from` on at which a whole record or a footer starts.
    fn find_record(&mut self, from: usize) -> Option<usize> {
        let last = self.bytes.len().checked_sub(MIN_RECORD_BYTES.min(FOOTER_BYTES))?;
        let magic = FRAME_MAGIC.to_le_bytes();
        (from..=last).find(|&at| {
            let here = self.bytes.get(at..).unwrap_or_default();
            if here.get(RECORD_HEAD_BYTES..RECORD_HEAD_BYTES + 2) == Some(&magic[..]) {
                return self.check_budget > 0 && self.record_at(at).is_ok();
            }
            at > 0 && here.first_chunk().is_some_and(|foot| parse_footer(foot).is_some())
        })
    }

    /// Skips a footer at the current position. Returns whether there was one.
    fn skip_footer(&mut self) -> bool {
        let here = self.bytes.get(self.at..).unwrap_or_default();
        let found = here.first_chunk().is_some_and(|foot| parse_footer(foot).is_some());
        if found {
            self.at += FOOTER_BYTES;
        }
        found
    }
}

impl<'a> Iterator for Reader<'a> {
    type Item = Result<Record<'a>, Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        let fault = loop {
            if self.at >= self.bytes.len() {
                return None;
            }
            match self.record_at(self.at) {
                Ok(record) => {
                    self.at += RECORD_HEAD_BYTES + record.frame.bytes.len();
                    return Some(Ok(record));
                }
                Err(fault) if !self.skip_footer() => break fault,
                Err(_) => {}
            }
        };
        let start = self.at;
        let next = self.find_record(start + 1);
        self.at = next.unwrap_or(self.bytes.len());
        let kind = match fault {
            _ if next.is_none() && self.check_budget == 0 => DamageKind::TooManyFalseRecords,
            _ if start < FILE_HEADER_BYTES => DamageKind::FileHeader,
            RecordError::Ends if next.is_some() => DamageKind::Length,
            RecordError::Ends => DamageKind::CutOff,
            RecordError::Arrival => DamageKind::Arrival,
            RecordError::Frame(fault) => DamageKind::Frame(fault),
        };
        Some(Err(Damage { offset: start as u64, kind, lost_bytes: (self.at - start) as u64 }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Writer, file_header};
    use super::*;
    use crate::{FrameType, Group, Sequence, write_frame};

    fn frame(kind: FrameType, payload: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        write_frame(&mut out, kind, Group(1), Sequence(0), payload).unwrap();
        out
    }

    /// Returns a recording of four frames and the offsets of its records, including the index.
    fn sample(finish: bool) -> (Vec<u8>, Vec<u64>) {
        let (mut writer, mut file) = Writer::new(Limits::default());
        let mut starts = Vec::new();
        for (number, payload) in [&b"first"[..], b"", b"third frame", b"last"].iter().enumerate() {
            starts.push(file.len() as u64);
            let kind = FrameType(8 + number as u8);
            file.extend(writer.append(Micros(number as u64 * 1000), &frame(kind, payload)).unwrap());
        }
        if finish {
            // The index; the file is too short for parity.
            starts.push(file.len() as u64);
            file.extend(writer.finish().unwrap());
        }
        assert_eq!(writer.file_bytes(), file.len() as u64);
        (file, starts)
    }

    fn read(file: &[u8]) -> (Vec<u64>, Vec<Damage>) {
        let (mut records, mut damages) = (Vec::new(), Vec::new());
        for item in Reader::new(file).unwrap() {
            match item {
                Ok(record) => records.push(record.offset()),
                Err(damage) => damages.push(damage),
            }
        }
        (records, damages)
    }

    #[test]
    fn whole_files_have_every_record_and_no_damage() {
        for finish in [false, true] {
            let (file, starts) = sample(finish);
            assert_eq!(read(&file), (starts, vec![]));
        }
        assert_eq!(read(&file_header()), (vec![], vec![]));
    }

    #[test]
    fn a_file_cut_anywhere_keeps_its_whole_records() {
        let (file, starts) = sample(true);
        let mut ends: Vec<u64> = starts[1..].to_vec();
        ends.push((file.len() - FOOTER_BYTES) as u64);
        for end in FILE_HEADER_BYTES..file.len() {
            let whole = ends.iter().filter(|&&e| e <= end as u64).count();
            let (records, damages) = read(&file[..end]);
            assert_eq!(records, starts[..whole], "cut at {end}");
            let kept = if whole == 0 { FILE_HEADER_BYTES as u64 } else { ends[whole - 1] };
            let lost = end as u64 - kept;
            let expected = Damage { offset: kept, kind: DamageKind::CutOff, lost_bytes: lost };
            assert_eq!(damages, if lost == 0 { vec![] } else { vec![expected] }, "cut at {end}");
        }
        for end in 0..FILE_HEADER_BYTES {
            assert_eq!(
                Reader::new(&file[..end]).unwrap_err(),
                ReaderError::NotARecording { length: end },
                "cut at {end}"
            );
        }
    }

    #[test]
    fn a_flipped_bit_costs_one_record_and_is_reported() {
        let (file, starts) = sample(true);
        for bit in 0..file.len() * 8 {
            let mut bad = file.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            let place = (bit / 8) as u64;
            let (records, damages) = read(&bad);
            assert_eq!(damages.len(), 1, "bit {bit}: {damages:?}");
            let damage = damages[0];
            assert!(
                (damage.offset..damage.offset + damage.lost_bytes).contains(&place),
                "bit {bit}: {damage}"
            );
            let hit = starts.iter().rposition(|&s| s <= place && place < (file.len() - FOOTER_BYTES) as u64);
            let expected: Vec<u64> =
                starts.iter().enumerate().filter(|&(n, _)| Some(n) != hit).map(|(_, &s)| s).collect();
            assert_eq!(records, expected, "bit {bit}");
        }
    }

    #[test]
    fn damage_says_what_and_how_much() {
        let (file, starts) = sample(false);
        let kinds = |at: u64, xor: u8| {
            let mut bad = file.clone();
            bad[at as usize] ^= xor;
            read(&bad).1[0]
        };
        assert_eq!(kinds(0, 1).kind, DamageKind::FileHeader);
        assert_eq!(kinds(starts[1] + 3, 1).kind, DamageKind::Arrival);
        assert_eq!(
            kinds(starts[2] + 12 + 4, 1).kind,
            DamageKind::Frame(WireFrameError::Checksum {
                kind: FrameType::REPORT,
                found: crc32c::crc32c_append(
                    crc32c::crc32c(&{
                        let mut head = file[starts[2] as usize + 12..starts[2] as usize + 28].to_vec();
                        head[4] ^= 1;
                        head
                    }),
                    &file[starts[2] as usize + 32..starts[2] as usize + 32 + 10],
                ),
                expected: u32::from_le_bytes(*file[starts[2] as usize + 28..].first_chunk().unwrap()),
            })
        );
        assert_eq!(kinds(starts[2] + 12 + 5, 1).kind, DamageKind::Length);
        let damage = kinds(starts[2] + 12 + 3, 0x80);
        assert_eq!(damage.kind, DamageKind::Frame(WireFrameError::Flags { found: 0x80 }));
        assert_eq!((damage.offset, damage.lost_bytes), (starts[2], starts[3] - starts[2]));
    }

    #[test]
    fn foreign_and_newer_files_are_refused() {
        assert!(matches!(Reader::new(&[7; 5000]), Err(ReaderError::NotARecording { length: 5000 })));
        let (file, _) = sample(false);
        for (at, error) in [(8, ReaderError::Version { found: 3 }), (10, ReaderError::Flags { found: 2 })] {
            let mut newer = file.clone();
            newer[at] ^= 2;
            let crc = crc32c::crc32c(&newer[..12]).to_le_bytes();
            newer[12..16].copy_from_slice(&crc);
            assert_eq!(Reader::new(&newer).unwrap_err(), error);
        }
    }

    #[test]
    fn records_after_an_index_are_read_too() {
        let (mut file, mut starts) = sample(true);
        let (more, more_starts) = sample(false);
        let shift = (file.len() - FILE_HEADER_BYTES) as u64;
        file.extend_from_slice(&more[FILE_HEADER_BYTES..]);
        starts.extend(more_starts.iter().map(|s| s + shift));
        assert_eq!(read(&file), (starts, vec![]));
    }

    /// A file of false records, each of which claims all bytes after it, must not take quadratic time. The reader gives
    /// up after a fixed multiple of the file's length.
    #[test]
    fn a_file_of_false_records_is_given_up() {
        let mut file = file_header().to_vec();
        let count = 400;
        for number in 0..count {
            let time = [0u8; 8];
            let mut head = frame(FrameType::UPDATE, &[]);
            let rest = (count - number - 1) * 32;
            head[4..8].copy_from_slice(&(rest as u32).to_le_bytes());
            file.extend(time);
            file.extend(crc32c::crc32c(&time).to_le_bytes());
            file.extend(head);
        }
        let (records, damages) = read(&file);
        assert!(records.is_empty(), "{records:?}");
        assert_eq!(damages.last().unwrap().kind, DamageKind::TooManyFalseRecords);
    }
}
