//! Parity records: a damaged stretch of a recording is made whole again from the bytes around it.

use super::{RECORD_HEAD_BYTES, Reader, record_head};
use crate::{FrameType, Group, HEADER_BYTES, Limits, Micros, Sequence, write_frame};

/// Largest number of bytes that a parity record covers.
const COVERED_BYTES: usize = 128 << 10;
/// Number of chunks into which they are cut, about.
const CHUNKS: usize = 128;
/// Smallest and largest chunk in bytes.
const CHUNK_BYTES: [usize; 2] = [64, 1024];
/// Bytes of a payload before the checksums.
const PARITY_HEAD_BYTES: usize = 16;

/// A stretch of a file that was damaged, and is as it was written again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repaired {
    /// Offset of the first byte that differed.
    pub offset: u64,
    /// Bytes from there to the last one that differed.
    pub bytes: u64,
}

/// The bytes of a file that no parity record covers yet.
#[derive(Debug, Default)]
pub(super) struct ParityWriter {
    /// Offset of the first one in the file.
    from: u64,
    pending: Vec<u8>,
    /// Number of them before the last record.
    before: usize,
    /// Whether the parity records that follow the last record cover all of them.
    covered: bool,
}

impl ParityWriter {
    /// Takes the next bytes of the file, which start at `offset`. Returns the parity records to append, if it is time.
    pub(super) fn push(&mut self, offset: u64, arrival: Micros, bytes: &[u8]) -> Vec<u8> {
        if std::mem::take(&mut self.covered) {
            self.pending.clear();
        }
        if self.pending.is_empty() {
            self.from = offset;
        }
        self.before = self.pending.len();
        self.pending.extend_from_slice(bytes);
        if self.pending.len() >= COVERED_BYTES { self.cover(arrival) } else { Vec::new() }
    }

    /// Returns the parity records of all bytes that have none.
    pub(super) fn cover(&mut self, arrival: Micros) -> Vec<u8> {
        let mut out = Vec::new();
        if std::mem::replace(&mut self.covered, true) || self.pending.is_empty() {
            return out;
        }
        let parts = self.pending.len().div_ceil(COVERED_BYTES);
        let mut from = self.from;
        for part in self.pending.chunks(self.pending.len().div_ceil(parts)) {
            out.extend(record(arrival, &payload(from, part)));
            from += part.len() as u64;
        }
        out
    }

    /// Forgets the last bytes, which were not written after all.
    pub(super) fn take_back(&mut self) {
        self.pending.truncate(self.before);
        self.covered = false;
    }
}

/// Returns the payload of the parity record of `bytes`, which start at `from` in the file.
fn payload(from: u64, bytes: &[u8]) -> Vec<u8> {
    let [least, most] = CHUNK_BYTES;
    let chunk = (bytes.len() / CHUNKS).next_power_of_two().clamp(least, most);
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

fn record(arrival: Micros, payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(RECORD_HEAD_BYTES + HEADER_BYTES + payload.len());
    record_head(arrival, &mut out);
    // A payload of a few KiB is never too long.
    let _ = write_frame(&mut out, FrameType::PARITY, Group(0), Sequence(0), payload);
    out
}

/// A parity record that was read.
struct Parity<'a> {
    from: usize,
    length: usize,
    chunk: usize,
    checksums: &'a [[u8; 4]],
    sums: [&'a [u8]; 2],
}

impl<'a> Parity<'a> {
    /// Parses a payload. Returns `None` if it is none, or covers bytes outside a file of `file_bytes`.
    fn parse(payload: &'a [u8], file_bytes: usize) -> Option<Self> {
        let (&[f0, f1, f2, f3, f4, f5, f6, f7, l0, l1, l2, l3, c0, c1, c2, c3], rest) =
            payload.split_first_chunk::<PARITY_HEAD_BYTES>()?;
        let from = usize::try_from(u64::from_le_bytes([f0, f1, f2, f3, f4, f5, f6, f7])).ok()?;
        let length = usize::try_from(u32::from_le_bytes([l0, l1, l2, l3])).ok()?;
        let chunk = usize::try_from(u32::from_le_bytes([c0, c1, c2, c3])).ok()?;
        let [least, most] = CHUNK_BYTES;
        let possible = chunk.is_power_of_two() && (least..=most).contains(&chunk);
        if !possible || length > COVERED_BYTES || from.checked_add(length)? > file_bytes {
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

    /// Makes chunks whole again: of those with even numbers one, and of the others one. Adds what was changed.
    fn repair(&self, file: &mut [u8], repaired: &mut Vec<Repaired>) {
        let Some(covered) = file.get_mut(self.from..self.from + self.length) else { return };
        for (parity, sum) in self.sums.iter().enumerate() {
            let is_bad = |&(number, chunk): &(usize, &[u8])| {
                number % 2 == parity
                    && self.checksums.get(number) != Some(&crc32c::crc32c(chunk).to_le_bytes())
            };
            let mut bad = covered.chunks(self.chunk).enumerate().filter(is_bad).map(|(number, _)| number);
            let (Some(number), None) = (bad.next(), bad.next()) else { continue };
            let mut whole: Vec<u8> = sum.iter().map(|byte| !byte).collect();
            let others = covered.chunks(self.chunk).enumerate();
            for (_, chunk) in others.filter(|&(other, _)| other % 2 == parity && other != number) {
                whole.iter_mut().zip(chunk).for_each(|(sum, byte)| *sum ^= byte);
            }
            let start = number * self.chunk;
            let end = (start + self.chunk).min(self.length);
            whole.truncate(end - start);
            if self.checksums.get(number) == Some(&crc32c::crc32c(&whole).to_le_bytes()) {
                let bad = &mut covered[start..end];
                let differ: Vec<usize> = (0..bad.len()).filter(|&at| bad[at] != whole[at]).collect();
                if let (Some(first), Some(last)) = (differ.first(), differ.last()) {
                    let offset = (self.from + start + first) as u64;
                    repaired.push(Repaired { offset, bytes: (last - first + 1) as u64 });
                }
                bad.copy_from_slice(&whole);
            }
        }
    }
}

/// Returns the number of bytes that a parity payload covers in a file of `file_bytes`; 0 if it is none.
pub(super) fn covered_bytes(payload: &[u8], file_bytes: usize) -> u64 {
    Parity::parse(payload, file_bytes).map_or(0, |parity| parity.length as u64)
}

/// Makes damaged stretches of a recording whole again, as far as its parity records can. Returns what was changed, in
/// the order of the file.
///
/// A whole file is read once and not changed. In every 128 KiB, any stretch of up to 1 KiB can be repaired; in the last
/// and shorter part of a file, of as much as 1/128 of it. What is repaired has the checksum that was written.
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
    for payload in parity_payloads(file, limits) {
        if let Some(parity) = Parity::parse(&payload, file.len()) {
            parity.repair(file, &mut repaired);
        }
    }
    repaired.sort_by_key(|stretch| stretch.offset);
    repaired
}

/// Returns the payloads of the parity records; none if nothing is damaged.
fn parity_payloads(file: &[u8], limits: Limits) -> Vec<Vec<u8>> {
    let Ok(reader) = Reader::with_limits(file, limits) else { return Vec::new() };
    let mut damaged = false;
    let mut payloads = Vec::new();
    for item in reader {
        match item {
            Ok(record) if record.frame.header.kind == FrameType::PARITY => {
                payloads.push(record.frame.payload().to_vec());
            }
            Ok(_) => {}
            Err(_) => damaged = true,
        }
    }
    if damaged { payloads } else { Vec::new() }
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
    fn covered(file: &[u8]) -> Vec<std::ops::Range<usize>> {
        let records = Reader::new(file).unwrap().map(Result::unwrap);
        let parities = records.filter(|record| record.frame.header.kind == FrameType::PARITY);
        let stretch = |payload: &[u8]| {
            let parity = Parity::parse(payload, file.len()).unwrap();
            parity.from..parity.from + parity.length
        };
        parities.map(|record| stretch(record.frame.payload())).collect()
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
    fn parity_covers_every_byte_before_the_index_once_and_costs_little() {
        for sizes in [&[0; 9][..], &[100; 4_000], &[300_000, 10, 131_072, 70_000, 70_000, 5]] {
            let (file, end) = file_of(sizes);
            let stretches = covered(&file);
            let mut bytes = vec![0_u8; end];
            for stretch in &stretches {
                assert!(stretch.len() <= COVERED_BYTES);
                bytes[stretch.clone()].iter_mut().for_each(|count| *count += 1);
            }
            assert!(bytes.iter().all(|&count| count <= 1));
            let parity = Summary::scan(&file, Limits::default()).unwrap().count(FrameType::PARITY);
            let covered: usize = stretches.iter().map(ExactSizeIterator::len).sum();
            assert_eq!(covered + parity.record_bytes as usize, end, "and nothing but parity has none");
            assert!(parity.record_bytes as usize <= covered / 32 + 240, "{parity:?} for {covered}");
        }
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
        let good = payload(16, &[7; 1000]);
        assert!(Parity::parse(&good, 1016).is_some());
        assert!(Parity::parse(&good, 1015).is_none(), "beyond the file");
        for end in 0..good.len() {
            assert!(Parity::parse(&good[..end], 1016).is_none(), "cut at {end}");
        }
        for (place, byte) in [(7, 0xff), (10, 3), (12, 65), (13, 0x10)] {
            let mut bad = good.clone();
            bad[place] = byte;
            assert!(Parity::parse(&bad, 1 << 20).is_none(), "byte {place}");
        }
    }

    proptest! {
        #[test]
        fn one_stretch_in_each_part_comes_back_and_more_is_never_made_worse(
            sizes in prop::collection::vec(0_usize..100_000, 1..12),
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
                let chunk = (covered.len() / CHUNKS).next_power_of_two().clamp(CHUNK_BYTES[0], CHUNK_BYTES[1]);
                let end = (start + bytes.min(chunk)).min(covered.end);
                bad[start..end].iter_mut().for_each(|byte| *byte ^= flip);
                hit[part] += 1;
            }
            let wrong = |file: &[u8], part: &std::ops::Range<usize>, with: &[u8]| {
                part.clone().filter(|&at| file[at] != with[at]).count()
            };
            let before: Vec<usize> = parts.iter().map(|part| wrong(&bad, part, &file)).collect();
            repair(&mut bad, Limits::default());
            for ((part, hit), before) in parts.iter().zip(hit).zip(before) {
                let after = wrong(&bad, part, &file);
                prop_assert!(after <= before);
                prop_assert!(hit > 1 || after == 0, "{} bytes of {:?} left", after, part);
            }
        }
    }
}
