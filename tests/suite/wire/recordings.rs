//! Recordings, whole and damaged.

use psao_proto::message::{Close, CloseCode, Gap, GapReason, Message, Report, Scene};
use psao_proto::recording::{IndexKind, Summary, Writer};
use psao_proto::{FrameIndex, FrameType, Limits, Micros, Profile};

use super::accepted::{empty_body, wire};
use super::messages::{INSTANCE, instances, paper_info, report};
use super::{Case, CaseKind};

/// Bytes of the file header, and of a footer.
const ENVELOPE_BYTES: usize = 16;
/// Bytes of a record before its frame.
const RECORD_HEAD_BYTES: usize = 12;

/// A recording and where its records start.
#[derive(Clone)]
struct SampleRecording {
    file: Vec<u8>,
    starts: Vec<usize>,
}

impl SampleRecording {
    /// Creates a recording of `frames`, 16,667 microseconds apart. A finished one has parity and an index.
    fn of(frames: &[Vec<u8>], finished: bool) -> SampleRecording {
        let (mut writer, mut file) = Writer::new(Limits::default());
        let mut starts = vec![];
        for (frame, number) in frames.iter().zip(0..) {
            starts.push(file.len());
            file.extend(writer.append(Micros(number * 16_667), frame).unwrap());
        }
        if finished {
            starts.push(file.len());
            file.extend(writer.finish().unwrap());
            starts.push(index_start(&file));
        }
        SampleRecording { file, starts }
    }

    /// Returns the file with `bits` of the byte at `at` flipped.
    fn flipped(&self, at: usize, bits: u8) -> Vec<u8> {
        let mut file = self.file.clone();
        file[at] ^= bits;
        file
    }

    /// Returns the file up to the start of a record.
    fn until(&self, record: usize) -> &[u8] {
        &self.file[..self.starts[record]]
    }

    /// Returns the file from the start of a record to the end.
    fn from(&self, record: usize) -> &[u8] {
        &self.file[self.starts[record]..]
    }
}

fn message<M: Message>(message: &M, place: (u32, u32)) -> Vec<u8> {
    wire(M::KIND, place, &message.to_payload().unwrap())
}

/// Returns the frames of a stream of two groups, from scene table to CLOSE.
fn frames() -> Vec<Vec<u8>> {
    let body = |kind, frame| empty_body(Profile::PAPER, kind, frame);
    let late = Report { frame: FrameIndex(3), ..report() };
    vec![
        message(&Scene::Info(paper_info()), (0, 0)),
        message(&instances(0, &[INSTANCE; 2]), (0, 0)),
        wire(FrameType::KEYFRAME, (1, 0), &body(1, 0)),
        wire(FrameType::UPDATE, (1, 1), &body(2, 1)),
        wire(FrameType::KEYFRAME, (2, 0), &body(1, 2)),
        wire(FrameType::UPDATE, (2, 1), &body(2, 3)),
        message(&late, (2, 1)),
        message(&Close::new(CloseCode::DONE, "the end"), (2, 1)),
    ]
}

pub(super) fn cases() -> Vec<Case> {
    let mut files = whole();
    files.extend(indexes());
    files.extend(cut());
    files.extend(damaged());
    files.extend(parity());
    files.extend(refused());
    files
        .into_iter()
        .map(|(name, bytes)| Case { name: format!("recording-{name}"), kind: CaseKind::Recording, bytes })
        .collect()
}

type File = (&'static str, Vec<u8>);

fn whole() -> Vec<File> {
    let frames = frames();
    let unclosed = SampleRecording::of(&frames[..5], false);
    let odd = [
        &frames[2],
        &wire(FrameType(99), (1, 0), b"of a later version"),
        &wire(FrameType::KEYFRAME, (2, 0), b"no body"),
        // A record with a bad message is still a whole record.
        &wire(FrameType::CLOSE, (2, 0), b"bad"),
        &wire(FrameType::UPDATE, (u32::MAX, u32::MAX), &empty_body(Profile::SURFACE, 2, u32::MAX)),
    ];
    let odd: Vec<Vec<u8>> = odd.into_iter().cloned().collect();
    let gap = Gap {
        first_lost: FrameIndex(1),
        last_lost: FrameIndex(1),
        frames: 1,
        bytes: 49,
        reason: GapReason::SLOW,
    };
    let (one, end) = (message(&gap, (0, 0)), message(&Gap { frames: 0, ..gap }, (0, 0)));
    let gaps = [&frames[..3], &[one], &frames[4..6], &[end]].concat();
    let (mut writer, mut clocks) = Writer::new(Limits::default());
    for (frame, arrival) in frames.iter().zip([u64::MAX, 5, 5, 0]) {
        clocks.extend(writer.append(Micros(arrival), frame).unwrap());
    }
    vec![
        ("whole", SampleRecording::of(&frames, true).file),
        ("no-index", SampleRecording::of(&frames, false).file),
        ("no-header", unclosed.file[ENVELOPE_BYTES..].to_vec()),
        ("unclosed", unclosed.file),
        ("unclosed-indexed", SampleRecording::of(&frames[..5], true).file),
        ("of-nothing", SampleRecording::of(&[], false).file),
        ("of-nothing-indexed", SampleRecording::of(&[], true).file),
        ("gaps", SampleRecording::of(&gaps, true).file),
        ("odd-frames", SampleRecording::of(&odd, true).file),
        ("odd-clocks", clocks),
    ]
}

fn indexes() -> Vec<File> {
    let frames = frames();
    let (sample, all) = (SampleRecording::of(&frames[..4], true), SampleRecording::of(&frames, false));
    let more = [&sample.file[..], all.from(4)].concat();
    let film_with = |at: usize, byte: u8| {
        let (mut file, start) = (sample.file.clone(), sample.starts[5]);
        file[start + RECORD_HEAD_BYTES + 20 + at] = byte;
        reseal(&mut file, start);
        file
    };
    let odd = wire(FrameType::INDEX, (0, 0), &[0; 33]);
    let odd = SampleRecording::of(&[&frames[..4], &[odd]].concat(), false).file;
    let footer = &sample.file[sample.file.len() - ENVELOPE_BYTES..];
    vec![
        ("old-index", more.clone()),
        // The second index covers all records, including the first index.
        ("two-indexes", two_indexes(more)),
        // In the entry of the scene table: another type, a padding byte, a time. In that of a keyframe: another time.
        ("index-type", film_with(20, 10)),
        ("index-padding", film_with(23, 1)),
        ("index-time-of-scene", film_with(8, 1)),
        ("index-time", film_with(24 + 8, 1)),
        ("index-length", odd),
        ("no-footer", sample.file[..sample.file.len() - ENVELOPE_BYTES].to_vec()),
        ("footer-of-nothing", [sample.until(4), footer].concat()),
        ("footer-first", [&sample.file[..ENVELOPE_BYTES], footer, sample.from(0)].concat()),
        ("footer-alone", [&sample.file[..ENVELOPE_BYTES], footer].concat()),
    ]
}

/// Writes the right checksum into the frame of the record at `start`, which ends at the footer.
fn reseal(file: &mut [u8], start: usize) {
    let end = file.len() - ENVELOPE_BYTES;
    seal(file, start, end);
}

/// Writes the right checksum into the frame of the record from `start` to `end`.
fn seal(file: &mut [u8], start: usize, end: usize) {
    let frame = start + RECORD_HEAD_BYTES;
    let crc = crc32c::crc32c_append(crc32c::crc32c(&file[frame..frame + 16]), &file[frame + 20..end]);
    file[frame + 16..frame + 20].copy_from_slice(&crc.to_le_bytes());
}

/// Returns the file with another index and footer at its end.
fn two_indexes(mut file: Vec<u8>) -> Vec<u8> {
    let summary = Summary::scan(&file, Limits::default()).unwrap();
    let mut payload = vec![];
    for entry in summary.index() {
        let (time, frame, kind) = match entry.kind {
            IndexKind::Scene => (0, 0, 4),
            IndexKind::Edit => (0, 0, 6),
            IndexKind::Keyframe { time, frame } => (time.micros(), frame.0, 7),
        };
        payload.extend_from_slice(&entry.offset.to_le_bytes());
        payload.extend_from_slice(&time.to_le_bytes());
        payload.extend_from_slice(&frame.to_le_bytes());
        payload.extend_from_slice(&[kind, 0, 0, 0]);
    }
    let offset = file.len() as u64;
    file.extend_from_slice(&[0; 8]);
    file.extend_from_slice(&crc32c::crc32c(&[0; 8]).to_le_bytes());
    file.extend(wire(FrameType::INDEX, (0, 0), &payload));
    let footer = [&offset.to_le_bytes()[..], &0x1d0a_a05e_u32.to_le_bytes()].concat();
    let crc = crc32c::crc32c(&footer);
    [&file[..], &footer, &crc.to_le_bytes()].concat()
}

/// Recordings with one damaged byte, whose parity is odd or covers more than one stretch.
fn parity() -> Vec<File> {
    let sample = SampleRecording::of(&frames(), true);
    let (start, end) = (sample.starts[8], sample.starts[9]);
    let damaged = sample.starts[3] + RECORD_HEAD_BYTES + 22;
    let parity_with = |at: usize, byte: u8| {
        let mut file = sample.file[..end].to_vec();
        file[start + RECORD_HEAD_BYTES + 20 + at] = byte;
        seal(&mut file, start, end);
        file[damaged] ^= 1;
        file
    };
    let chunks = |parity: usize| {
        let mut file = sample.file.clone();
        file[damaged] ^= 1;
        file[damaged + 64 * parity] ^= 2;
        file
    };
    let long = SampleRecording::of(&vec![wire(FrameType(99), (1, 0), &[0x5a; 45_000]); 4], false);
    let mut two = long.file.clone();
    for at in [60, 100_001] {
        two[at] ^= 0xff;
    }
    let mut burst = long.file.clone();
    burst[100_500..101_500].fill(0);
    vec![
        // Offset, length, chunk; a checksum of the damaged chunk, and of another.
        ("parity-beyond-the-file", parity_with(2, 1)),
        ("parity-of-too-much", parity_with(10, 3)),
        ("parity-chunk-of-65", parity_with(12, 65)),
        ("parity-chunk-of-32", parity_with(12, 32)),
        ("parity-chunk-of-128", parity_with(12, 128)),
        ("parity-of-another-length", parity_with(8, 1)),
        ("parity-that-does-not-fit", parity_with(16 + 4 * (damaged / 64), 1)),
        ("parity-with-two-in-one", chunks(2)),
        ("parity-with-one-in-each", chunks(1)),
        ("parity-twice", two),
        ("parity-burst", burst),
        ("parity-of-another-file", [&sample.file[..], &sample.file].concat()),
    ]
}

/// Returns where the index record of a finished recording starts, as its footer says.
fn index_start(file: &[u8]) -> usize {
    let footer = &file[file.len() - ENVELOPE_BYTES..];
    u64::from_le_bytes(*footer.first_chunk().unwrap()) as usize
}

fn cut() -> Vec<File> {
    let sample = SampleRecording::of(&frames(), true);
    let end = sample.file.len();
    vec![
        ("cut-in-payload", sample.file[..sample.starts[7] - 3].to_vec()),
        ("cut-in-frame-header", sample.file[..sample.starts[6] + RECORD_HEAD_BYTES + 7].to_vec()),
        ("cut-in-arrival", sample.file[..sample.starts[6] + 5].to_vec()),
        ("cut-after-arrival", sample.file[..sample.starts[6] + RECORD_HEAD_BYTES].to_vec()),
        ("cut-in-parity", sample.file[..sample.starts[8] + 50].to_vec()),
        ("cut-in-index", sample.file[..sample.starts[9] + 50].to_vec()),
        ("cut-in-footer", sample.file[..end - 1].to_vec()),
        ("cut-after-a-byte", sample.file[..sample.starts[5] + 1].to_vec()),
        // Up to 15 trailing bytes count as cut off. With 16 bytes the arrival counts as damaged.
        ("cut-15-bytes", [sample.until(6), &[0xee; 15]].concat()),
        ("damaged-16-bytes", [sample.until(6), &[0xee; 16]].concat()),
    ]
}

fn damaged() -> Vec<File> {
    let sample = SampleRecording::of(&frames(), true);
    let frame = |record: usize| sample.starts[record] + RECORD_HEAD_BYTES;
    let mut reach = sample.flipped(frame(3) + 6, 1);
    let twice = {
        let mut file = sample.flipped(frame(2) + 25, 1);
        file[frame(5) + 25] ^= 1;
        file
    };
    let beside = {
        let mut file = sample.flipped(frame(3) + 25, 1);
        file[frame(4) + 25] ^= 1;
        file
    };
    // Half a record, then the whole record again, as by a recorder that retries.
    let half = [sample.until(5), &sample.from(5)[..40], sample.from(4)].concat();
    let junk = [sample.until(3), b"what a faulty disk wrote", sample.from(3)].concat();
    let scrap = [sample.until(3), &[0; 3], sample.from(3)].concat();
    let sealed_magic = {
        let mut file = sample.flipped(0, 0x80);
        let crc = crc32c::crc32c(&file[..12]);
        file[12..ENVELOPE_BYTES].copy_from_slice(&crc.to_le_bytes());
        file
    };
    let last = sample.file.len() - ENVELOPE_BYTES;
    reach.truncate(sample.starts[8]);
    vec![
        ("damaged-header", sample.flipped(9, 1)),
        ("damaged-header-magic", sealed_magic),
        ("damaged-header-and-record", {
            let mut file = sample.flipped(9, 1);
            file[frame(0) + 30] ^= 1;
            file
        }),
        ("damaged-first", sample.flipped(frame(0) + 30, 1)),
        ("damaged-arrival", sample.flipped(sample.starts[3] + 2, 4)),
        ("damaged-arrival-checksum", sample.flipped(sample.starts[3] + 9, 4)),
        ("damaged-frame-magic", sample.flipped(frame(3), 1)),
        ("damaged-frame-type", sample.flipped(frame(3) + 2, 0x10)),
        ("damaged-frame-flags", sample.flipped(frame(3) + 3, 1)),
        ("damaged-frame-checksum", sample.flipped(frame(3) + 17, 1)),
        ("damaged-frame-payload", sample.flipped(frame(3) + 22, 1)),
        // A length over the limit of all frames, one beyond the end of the file, one that is too short.
        ("damaged-length-over", sample.flipped(frame(3) + 7, 0x80)),
        ("damaged-length-beyond", reach),
        ("damaged-length-less", sample.flipped(frame(3) + 4, 1)),
        ("damaged-last-length", sample.flipped(frame(9) + 6, 1)),
        ("damaged-parity", sample.flipped(frame(8) + 40, 1)),
        ("damaged-index", sample.flipped(frame(9) + 30, 1)),
        ("damaged-footer", sample.flipped(last + 3, 1)),
        ("damaged-footer-magic", sample.flipped(last + 9, 1)),
        ("damaged-twice", twice),
        ("damaged-beside", beside),
        ("half-a-record", half),
        ("junk", junk),
        ("scrap", scrap),
        ("hopeless", hopeless(&SampleRecording::of(&frames(), false))),
    ]
}

/// Returns a file of false records that overlap, followed by a good record. A reader must checksum each false record as
/// a whole to refuse it.
fn hopeless(sample: &SampleRecording) -> Vec<u8> {
    let (count, room) = (120, 4_000_u32);
    let mut file = sample.until(3).to_vec();
    for _ in 0..count {
        file.extend_from_slice(&[0; 8]);
        file.extend_from_slice(&crc32c::crc32c(&[0; 8]).to_le_bytes());
        let mut head = wire(FrameType::KEYFRAME, (1, 0), &[]);
        head[4..8].copy_from_slice(&room.to_le_bytes());
        file.extend_from_slice(&head);
    }
    file.resize(file.len() + room as usize, 0x33);
    file.extend_from_slice(sample.from(3));
    file
}

fn refused() -> Vec<File> {
    let sample = SampleRecording::of(&frames(), true);
    let sealed = |at: usize, bits: u8| {
        let mut file = sample.flipped(at, bits);
        let crc = crc32c::crc32c(&file[..12]);
        file[12..ENVELOPE_BYTES].copy_from_slice(&crc.to_le_bytes());
        file
    };
    let footer = sample.file[sample.file.len() - ENVELOPE_BYTES..].to_vec();
    vec![
        ("refused-version", sealed(8, 3)),
        ("refused-version-0", sealed(8, 1)),
        ("refused-flags", sealed(11, 0x40)),
        ("refused-empty", vec![]),
        ("refused-short", sample.file[..15].to_vec()),
        ("refused-text", b"# Recordings\n\nA recording is the frames of a stream as they were.\n".to_vec()),
        ("refused-footer", footer),
        // Wire frames have no arrival time before them.
        ("refused-frames", frames().concat()),
        ("refused-half", sample.file[1..sample.starts[1] - 1].to_vec()),
    ]
}
