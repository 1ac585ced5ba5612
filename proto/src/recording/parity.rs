//! Parity records: a damaged stretch of a recording is made whole again from the bytes around it.

use std::collections::BTreeMap;
use std::ops::Range;

use super::{RECORD_HEAD_BYTES, Reader, record_head};
use crate::{FrameType, Group, HEADER_BYTES, Limits, Micros, Sequence, write_frame};

/// Bytes of the file that a parity record covers: the stretch of this number, from the start of the file. The last one
/// may be shorter.
const STRETCH_BYTES: usize = 128 << 10;
/// Number of chunks of a whole stretch.
const CHUNKS: usize = 128;
/// Smallest and largest chunk in bytes.
const CHUNK_BYTES: [usize; 2] = [64, 1024];
/// Bytes of a payload before the checksums.
const PARITY_HEAD_BYTES: usize = 16;
/// Largest number of times that a damaged file is gone through: a parity record may be whole only after a repair.
const PASSES: usize = 3;
/// Bytes of the shortest stretch of which anything can be repaired: each parity needs a second chunk.
const MIN_STRETCH_BYTES: usize = 3 * CHUNK_BYTES[0] + 1;

/// A damaged stretch of a file that has its written bytes again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repaired {
    /// Offset of the first byte that differed.
    pub offset: u64,
    /// Bytes from there to the last one that differed.
    pub bytes: u64,
}

/// The end of a file, of which no parity record was written yet.
#[derive(Debug)]
pub(super) struct ParityWriter {
    /// Offset of `pending` in the file.
    from: u64,
    pending: Vec<u8>,
    /// Bytes of `pending` that parity records cover since the last push.
    covered: usize,
    /// Bytes of `pending` before the last push.
    before: usize,
}

impl ParityWriter {
    /// Starts with the first bytes of the file.
    pub(super) fn new(head: &[u8]) -> Self {
        Self { from: 0, pending: head.to_vec(), covered: 0, before: head.len() }
    }

    /// Takes the next bytes of the file. Returns the parity records that follow them, which it has taken, too.
    pub(super) fn push(&mut self, arrival: Micros, bytes: &[u8]) -> Vec<u8> {
        self.pending.drain(..self.covered);
        self.pending.shrink_to(2 * STRETCH_BYTES);
        self.from += std::mem::take(&mut self.covered) as u64;
        self.before = self.pending.len();
        self.pending.extend_from_slice(bytes);
        let mut out = Vec::new();
        while let Some(stretch) = self.pending.get(self.covered..self.covered + STRETCH_BYTES) {
            let record = record(arrival, &payload(self.from + self.covered as u64, stretch));
            self.covered += STRETCH_BYTES;
            self.pending.extend_from_slice(&record);
            out.extend(record);
        }
        out
    }

    /// Returns the parity record of the last stretch, which is too short for [`push`](Self::push).
    pub(super) fn finish(&self, arrival: Micros) -> Vec<u8> {
        let rest = self.pending.get(self.covered..).unwrap_or_default();
        if rest.len() < MIN_STRETCH_BYTES {
            return Vec::new();
        }
        record(arrival, &payload(self.from + self.covered as u64, rest))
    }

    /// Forgets the bytes of the last push, which were not written after all. More calls have no effect.
    pub(super) fn take_back(&mut self) {
        self.pending.truncate(self.before);
        self.covered = 0;
    }
}

/// Returns the size of the chunks of a stretch, in bytes.
fn chunk_bytes(stretch: usize) -> usize {
    let [least, most] = CHUNK_BYTES;
    stretch.div_ceil(CHUNKS).next_power_of_two().clamp(least, most)
}

/// Returns the payload of the parity record of `bytes`, which start at `from` in the file.
fn payload(from: u64, bytes: &[u8]) -> Vec<u8> {
    let chunk = chunk_bytes(bytes.len());
    let mut out = from.to_le_bytes().to_vec();
    out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
    out.extend_from_slice(&(chunk as u32).to_le_bytes());
    out.extend(bytes.chunks(chunk).flat_map(|chunk| crc32c::crc32c(chunk).to_le_bytes()));
    for parity in parities(bytes, chunk) {
        out.extend(parity);
    }
    out
}

/// Returns the complement of the exclusive or of the chunks with even numbers, and that of the others. A short chunk ends
/// in zeros. Without the complement, the parity of a single chunk would be a copy, in which a reader that looks for
/// records behind damage would find them again.
fn parities(bytes: &[u8], chunk: usize) -> [Vec<u8>; 2] {
    let mut parities = [vec![0xff; chunk], vec![0xff; chunk]];
    for (number, chunk) in bytes.chunks(chunk).enumerate() {
        parities[number % 2].iter_mut().zip(chunk).for_each(|(sum, byte)| *sum ^= byte);
    }
    parities
}

/// Returns the record of a payload.
fn record(arrival: Micros, payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(RECORD_HEAD_BYTES + HEADER_BYTES + payload.len());
    record_head(arrival, &mut out);
    // A payload of a few KiB is never too long.
    let _ = write_frame(&mut out, FrameType::PARITY, Group(0), Sequence(0), payload);
    out
}

/// A parity record that was read.
pub(super) struct Parity<'a> {
    from: usize,
    length: usize,
    chunk: usize,
    checksums: &'a [[u8; 4]],
    sums: [&'a [u8]; 2],
}

impl<'a> Parity<'a> {
    /// Parses the payload of a record at `offset`. Returns `None` for other payloads, and for a stretch that does not end
    /// before the record.
    pub(super) fn parse(payload: &'a [u8], offset: u64) -> Option<Self> {
        let (&[f0, f1, f2, f3, f4, f5, f6, f7, l0, l1, l2, l3, c0, c1, c2, c3], rest) =
            payload.split_first_chunk::<PARITY_HEAD_BYTES>()?;
        let from = u64::from_le_bytes([f0, f1, f2, f3, f4, f5, f6, f7]);
        let length = u32::from_le_bytes([l0, l1, l2, l3]);
        let before = from.checked_add(length.into()).is_some_and(|end| end <= offset);
        let (from, length) = (usize::try_from(from).ok()?, usize::try_from(length).ok()?);
        let chunk = usize::try_from(u32::from_le_bytes([c0, c1, c2, c3])).ok()?;
        let is_stretch = from % STRETCH_BYTES == 0 && (1..=STRETCH_BYTES).contains(&length);
        if !(before && is_stretch && chunk == chunk_bytes(length)) {
            return None;
        }
        let (checksums, sums) = rest.split_at_checked(4 * length.div_ceil(chunk))?;
        let (even, odd) = sums.split_at_checked(chunk)?;
        (odd.len() == chunk).then_some(Self {
            from,
            length,
            chunk,
            checksums: checksums.as_chunks().0,
            sums: [even, odd],
        })
    }

    /// Returns the covered bytes of the file.
    pub(super) fn stretch(&self) -> Range<u64> {
        self.from as u64..(self.from + self.length) as u64
    }

    /// Makes chunks whole again: of those with even numbers one, and of the others one. Adds what was changed.
    fn repair(&self, file: &mut [u8], repaired: &mut Vec<Repaired>) {
        let Some(stretch) = file.get_mut(self.from..self.from + self.length) else { return };
        for kind in 0..2 {
            let Some((number, whole)) = self.rebuilt(stretch, kind) else { continue };
            let start = number * self.chunk;
            let bad = &mut stretch[start..start + whole.len()];
            let differ = |at: &usize| bad[*at] != whole[*at];
            let first = (0..whole.len()).find(differ).unwrap_or_default();
            let last = (0..whole.len()).rfind(differ).unwrap_or_default();
            repaired.push(Repaired {
                offset: (self.from + start + first) as u64,
                bytes: (last - first + 1) as u64,
            });
            bad.copy_from_slice(&whole);
        }
    }

    /// Returns the number of the only bad chunk among those with even (0) or odd (1) numbers, and its written bytes.
    fn rebuilt(&self, stretch: &[u8], kind: usize) -> Option<(usize, Vec<u8>)> {
        let is_right = |number: usize, bytes: &[u8]| {
            self.checksums.get(number) == Some(&crc32c::crc32c(bytes).to_le_bytes())
        };
        let chunks = || stretch.chunks(self.chunk).enumerate().skip(kind).step_by(2);
        let mut bad = chunks().filter(|&(number, chunk)| !is_right(number, chunk));
        let ((number, chunk), None) = (bad.next()?, bad.next()) else { return None };
        // Without a second chunk, which is right, the record may be of another file.
        if chunks().count() < 2 {
            return None;
        }
        let mut whole: Vec<u8> = self.sums[kind].iter().map(|byte| !byte).collect();
        for (_, other) in chunks().filter(|&(other, _)| other != number) {
            whole.iter_mut().zip(other).for_each(|(sum, byte)| *sum ^= byte);
        }
        whole.truncate(chunk.len());
        is_right(number, &whole).then_some((number, whole))
    }
}

/// Makes damaged stretches of a recording whole again, as far as its parity records can. Returns what was changed, in
/// the order of the file.
///
/// A whole file is read once and not changed, a damaged one up to three times. The time is linear in its length, whatever
/// its content. In every 128 KiB, up
/// to 1 KiB in a row can be repaired. In a shorter last part it is 1/128 of it, and at least 64 bytes. What is repaired has
/// the checksum that was written.
///
/// ```
/// use psao_proto::recording::repair;
/// # let file = psao_proto::sample::recording(10, 4)?;
/// let mut damaged = file.clone();
/// damaged[200] ^= 1;
/// let repaired = repair(&mut damaged, psao_proto::Limits::default());
/// assert_eq!((repaired[0].offset, repaired[0].bytes), (200, 1));
/// assert_eq!(damaged, file);
/// # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
/// ```
pub fn repair(file: &mut [u8], limits: Limits) -> Vec<Repaired> {
    let mut repaired = Vec::new();
    for _ in 0..PASSES {
        let before = repaired.len();
        for (offset, payload) in parity_records(file, limits).into_values() {
            // A copy, since the record may lie in what it helps to repair.
            let payload = file.get(payload).map(<[u8]>::to_vec).unwrap_or_default();
            if let Some(parity) = Parity::parse(&payload, offset) {
                parity.repair(file, &mut repaired);
            }
        }
        if repaired.len() == before {
            break;
        }
    }
    repaired.sort_by_key(|stretch| stretch.offset);
    repaired
}

/// Returns offsets and payloads of the parity records, the first of each stretch; none if nothing is damaged.
fn parity_records(file: &[u8], limits: Limits) -> BTreeMap<usize, (u64, Range<usize>)> {
    let mut records = BTreeMap::new();
    let Ok(reader) = Reader::with_limits(file, limits) else { return records };
    let mut damaged = false;
    for item in reader {
        let Ok(record) = item else {
            damaged = true;
            continue;
        };
        if record.frame.header.kind != FrameType::PARITY {
            continue;
        }
        let (offset, payload) = (record.offset(), record.frame.payload());
        if let Some(parity) = Parity::parse(payload, offset) {
            let end = (offset + record.record_bytes()) as usize;
            records.entry(parity.from).or_insert((offset, end - payload.len()..end));
        }
    }
    if damaged { records } else { BTreeMap::new() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::recording::{Summary, Writer};
    use crate::{Numbering, sample};

    /// Returns a recording of records of these sizes, and the offset of its index.
    fn file_of(sizes: &[usize]) -> (Vec<u8>, usize) {
        let mut numbering = Numbering::default();
        let (mut writer, mut file) = Writer::new(Limits::default());
        for (number, &size) in (0..).zip(sizes) {
            let body: Vec<u8> = (0..size).map(|at| (at * at / 7 + number) as u8).collect();
            let frame = numbering.update(&body).unwrap();
            if number % 5 == 3 {
                writer.append(Micros(0), &frame).unwrap();
                writer.take_back();
            }
            file.extend(writer.append(Micros(number as u64), &frame).unwrap());
        }
        file.extend(writer.finish().unwrap());
        let mut records = Reader::new(&file).unwrap().map(Result::unwrap);
        let index = records.find(|record| record.frame.header.kind == FrameType::INDEX);
        let end = index.map(|record| record.offset() as usize);
        (file, end.unwrap())
    }

    /// Returns the stretches of a file that parity covers.
    fn covered(file: &[u8]) -> Vec<Range<usize>> {
        let records = Reader::new(file).unwrap().map(Result::unwrap);
        let parities = records.filter(|record| record.frame.header.kind == FrameType::PARITY);
        let stretch = |record: crate::recording::Record<'_>| {
            let stretch = Parity::parse(record.frame.payload(), record.offset()).unwrap().stretch();
            stretch.start as usize..stretch.end as usize
        };
        parities.map(stretch).collect()
    }

    #[test]
    fn every_changed_byte_of_the_sample_comes_back() {
        let file = sample::recording(10, 4).unwrap();
        let [covered] = &covered(&file)[..] else { panic!("one parity record") };
        assert_eq!(covered.start, 0);
        for place in 0..file.len() {
            let mut bad = file.clone();
            bad[place] ^= 0x11;
            let repaired = repair(&mut bad, Limits::default());
            if covered.contains(&place) {
                assert_eq!(repaired, [Repaired { offset: place as u64, bytes: 1 }]);
                assert_eq!(bad, file, "byte {place}");
            } else {
                assert!(repaired.is_empty() && bad[covered.clone()] == file[covered.clone()], "byte {place}");
            }
        }
    }

    #[test]
    fn parity_covers_the_file_up_to_its_last_record_and_costs_little() {
        for sizes in
            [&[0; 9][..], &[100; 4_000], &[3_000; 500], &[60_000; 40], &[300_000, 10, 131_072, 70_000, 5]]
        {
            let (file, end) = file_of(sizes);
            let stretches = covered(&file);
            for (number, stretch) in stretches.iter().enumerate() {
                assert_eq!(stretch.start, number * STRETCH_BYTES);
                assert!(stretch.len() == STRETCH_BYTES || number + 1 == stretches.len());
            }
            let parity = Summary::scan(&file, Limits::default()).unwrap().count(FrameType::PARITY);
            let last = stretches.last().unwrap().end;
            // The record of the last stretch follows it.
            assert!(end - last <= 3_000, "{last} of {end}");
            assert!(parity.record_bytes as usize <= end / 45 + 3_000, "{parity:?} of {end}");
        }
    }

    #[test]
    fn parity_of_another_file_changes_nothing() {
        let file = sample::recording(10, 4).unwrap();
        // Joined by hand, cut at the start, and with bytes lost in the middle.
        let joined = [&file[..], &file].concat();
        let cut = [&file[..300], &file[420..]].concat();
        let head = [&[0x55; 40][..], &file].concat();
        for bytes in [joined, cut, head] {
            let mut same = bytes.clone();
            assert_eq!(repair(&mut same, Limits::default()), []);
            assert!(same == bytes);
        }
    }

    #[test]
    fn a_record_that_was_taken_back_leaves_no_trace() {
        let frame = Numbering::default().update(&[7; 500]).unwrap();
        let (mut writer, _) = Writer::new(Limits::default());
        let (mut other, mut file) = Writer::new(Limits::default());
        other.take_back();
        for _ in 0..300 {
            let bytes = writer.append(Micros(1), &frame).unwrap();
            other.append(Micros(2), &frame).unwrap();
            other.take_back();
            other.take_back();
            assert_eq!(other.append(Micros(1), &frame).unwrap(), bytes);
            file.extend(bytes);
        }
        file.extend(other.finish().unwrap());
        assert_eq!(covered(&file).len(), 2);
        file[3] ^= 1;
        assert_eq!(repair(&mut file, Limits::default()).len(), 1, "the file header is covered");
    }

    #[test]
    fn a_whole_file_is_left_alone_whatever_its_parity_says() {
        let file = sample::recording(4, 2).unwrap();
        let mut same = file.clone();
        assert_eq!(repair(&mut same, Limits::default()), []);
        assert_eq!(same, file);
        assert_eq!(repair(&mut b"not a recording".to_vec(), Limits::default()), []);
    }

    #[test]
    fn payloads_that_are_none_are_refused() {
        let good = payload(0, &[7; 1000]);
        assert!(Parity::parse(&good, 1000).is_some());
        assert!(Parity::parse(&good, 999).is_none(), "not before it");
        for end in 0..good.len() {
            assert!(Parity::parse(&good[..end], 1000).is_none(), "cut at {end}");
        }
        for (place, byte) in [(0, 64), (7, 0xff), (10, 3), (12, 65), (12, 128), (13, 0x10)] {
            let mut bad = good.clone();
            bad[place] = byte;
            assert!(Parity::parse(&bad, 1 << 20).is_none(), "byte {place}");
        }
    }

    proptest! {
        #[test]
        fn one_stretch_in_each_part_comes_back_and_more_is_never_made_worse(
            sizes in prop::collection::vec(300_usize..100_000, 1..12),
            stretches in prop::collection::vec((any::<prop::sample::Index>(), 1_usize..1024, 1_u8..), 1..4),
        ) {
            let (file, _) = file_of(&sizes);
            let parts = covered(&file);
            let mut bad = file.clone();
            let mut hit = vec![0; parts.len()];
            for (place, bytes, flip) in stretches {
                let part = place.index(parts.len());
                let covered = &parts[part];
                let start = covered.start + place.index(covered.len());
                let end = (start + bytes.min(chunk_bytes(covered.len()))).min(covered.end);
                bad[start..end].iter_mut().for_each(|byte| *byte ^= flip);
                hit[part] += 1;
            }
            let wrong = |file: &[u8], part: &Range<usize>, with: &[u8]| {
                part.clone().filter(|&at| file[at] != with[at]).count()
            };
            let before: Vec<usize> = parts.iter().map(|part| wrong(&bad, part, &file)).collect();
            repair(&mut bad, Limits::default());
            for (number, (part, before)) in parts.iter().zip(before).enumerate() {
                let after = wrong(&bad, part, &file);
                prop_assert!(after <= before);
                // Its parity record is in a later part.
                let can_be_repaired = hit[number..].iter().all(|&hits| hits <= 1);
                prop_assert!(!can_be_repaired || after == 0, "{} bytes of {:?} left", after, part);
            }
        }
    }
}
