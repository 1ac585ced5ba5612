//! Recordings, whole and damaged.

use psao_proto::message::{Close, CloseCode, Gap, GapReason, Message, Report, Scene};
use psao_proto::recording::{Summary, Writer};
use psao_proto::{FrameIndex, FrameType, Limits, Micros, Profile};

use super::accepted::{empty_body, wire};
use super::messages::{INSTANCE, instances, paper_info, report};
use super::{Case, What};

/// Bytes of the file header, and of a footer.
const SIXTEEN: usize = 16;
/// Bytes of a record before its frame.
const HEAD: usize = 12;

/// A recording and where its records start.
#[derive(Clone)]
struct Film {
    file: Vec<u8>,
    starts: Vec<usize>,
}

impl Film {
    /// Of these frames, 16,667 microseconds apart; with an index when it is finished.
    fn of(frames: &[Vec<u8>], finished: bool) -> Film {
        let (mut writer, mut file) = Writer::new(Limits::default());
        let mut starts = vec![];
        for (frame, number) in frames.iter().zip(0..) {
            starts.push(file.len());
            file.extend(writer.append(Micros(number * 16_667), frame).unwrap());
        }
        if finished {
            starts.push(file.len());
            file.extend(writer.finish().unwrap());
        }
        Film { file, starts }
    }

    /// The file with bits of a byte changed.
    fn flipped(&self, at: usize, bits: u8) -> Vec<u8> {
        let mut file = self.file.clone();
        file[at] ^= bits;
        file
    }

    /// The file up to the start of a record.
    fn until(&self, record: usize) -> &[u8] {
        &self.file[..self.starts[record]]
    }

    /// The file from the start of a record on.
    fn from(&self, record: usize) -> &[u8] {
        &self.file[self.starts[record]..]
    }
}

fn message<M: Message>(message: &M, place: (u32, u32)) -> Vec<u8> {
    wire(M::KIND, place, &message.to_payload().unwrap())
}

/// A stream of two groups, from its scene to its end.
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
    files.extend(refused());
    files
        .into_iter()
        .map(|(name, bytes)| Case { name: format!("recording-{name}"), what: What::Recording, bytes })
        .collect()
}

type File = (&'static str, Vec<u8>);

fn whole() -> Vec<File> {
    let frames = frames();
    let unclosed = Film::of(&frames[..5], false);
    let odd = [
        &frames[2],
        &wire(FrameType(99), (1, 0), b"of a later version"),
        &wire(FrameType::KEYFRAME, (2, 0), b"no body"),
        // A message that is bad in itself is a whole record all the same.
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
        ("whole", Film::of(&frames, true).file),
        ("no-index", Film::of(&frames, false).file),
        ("no-header", unclosed.file[SIXTEEN..].to_vec()),
        ("unclosed", unclosed.file),
        ("unclosed-indexed", Film::of(&frames[..5], true).file),
        ("of-nothing", Film::of(&[], false).file),
        ("of-nothing-indexed", Film::of(&[], true).file),
        ("gaps", Film::of(&gaps, true).file),
        ("odd-frames", Film::of(&odd, true).file),
        ("odd-clocks", clocks),
    ]
}

fn indexes() -> Vec<File> {
    let frames = frames();
    let (film, all) = (Film::of(&frames[..4], true), Film::of(&frames, false));
    let more = [&film.file[..], all.from(4)].concat();
    let film_with = |at: usize, byte: u8| {
        let (mut file, start) = (film.file.clone(), film.starts[4]);
        file[start + HEAD + 20 + at] = byte;
        reseal(&mut file, start);
        file
    };
    let odd = wire(FrameType::INDEX, (0, 0), &[0; 33]);
    let odd = Film::of(&[&frames[..4], &[odd]].concat(), false).file;
    let footer = &film.file[film.file.len() - SIXTEEN..];
    vec![
        ("old-index", more.clone()),
        // The second index knows of all records, the first one's included.
        ("two-indexes", two_indexes(more)),
        // Of its first entry: another type, another byte at its end, another time.
        ("index-type", film_with(28, 10)),
        ("index-padding", film_with(31, 1)),
        ("index-time", film_with(8, 1)),
        ("index-length", odd),
        ("no-footer", film.file[..film.file.len() - SIXTEEN].to_vec()),
        ("footer-of-nothing", [film.until(4), footer].concat()),
        ("footer-first", [&film.file[..SIXTEEN], footer, film.from(0)].concat()),
        ("footer-alone", [&film.file[..SIXTEEN], footer].concat()),
    ]
}

/// Puts the right checksum into the frame of the record at `start`, which goes on to the footer.
fn reseal(file: &mut [u8], start: usize) {
    let (frame, end) = (start + HEAD, file.len() - SIXTEEN);
    let crc = crc32c::crc32c_append(crc32c::crc32c(&file[frame..frame + 16]), &file[frame + 20..end]);
    file[frame + 16..frame + 20].copy_from_slice(&crc.to_le_bytes());
}

/// The file with an index of its own at its end.
fn two_indexes(mut file: Vec<u8>) -> Vec<u8> {
    let summary = Summary::scan(&file, Limits::default()).unwrap();
    let mut payload = vec![];
    for entry in summary.index() {
        payload.extend_from_slice(&entry.offset.to_le_bytes());
        payload.extend_from_slice(&entry.time.micros().to_le_bytes());
        payload.extend_from_slice(&entry.frame.0.to_le_bytes());
        payload.extend_from_slice(&entry.group.0.to_le_bytes());
        payload.extend_from_slice(&entry.sequence.0.to_le_bytes());
        payload.extend_from_slice(&[if entry.keyframe { 7 } else { 8 }, 0, 0, 0]);
    }
    let offset = file.len() as u64;
    file.extend_from_slice(&[0; 8]);
    file.extend_from_slice(&crc32c::crc32c(&[0; 8]).to_le_bytes());
    file.extend(wire(FrameType::INDEX, (0, 0), &payload));
    let footer = [&offset.to_le_bytes()[..], &0x1d0a_a05e_u32.to_le_bytes()].concat();
    let crc = crc32c::crc32c(&footer);
    [&file[..], &footer, &crc.to_le_bytes()].concat()
}

fn cut() -> Vec<File> {
    let film = Film::of(&frames(), true);
    let end = film.file.len();
    vec![
        ("cut-in-payload", film.file[..film.starts[7] - 3].to_vec()),
        ("cut-in-frame-header", film.file[..film.starts[6] + HEAD + 7].to_vec()),
        ("cut-in-arrival", film.file[..film.starts[6] + 5].to_vec()),
        ("cut-after-arrival", film.file[..film.starts[6] + HEAD].to_vec()),
        ("cut-in-index", film.file[..film.starts[8] + 50].to_vec()),
        ("cut-in-footer", film.file[..end - 1].to_vec()),
        ("cut-after-a-byte", film.file[..film.starts[5] + 1].to_vec()),
        // Too few bytes for anything are cut off, whatever they are; one more is a damaged arrival.
        ("cut-15-bytes", [film.until(6), &[0xee; 15]].concat()),
        ("damaged-16-bytes", [film.until(6), &[0xee; 16]].concat()),
    ]
}

fn damaged() -> Vec<File> {
    let film = Film::of(&frames(), true);
    let frame = |record: usize| film.starts[record] + HEAD;
    let mut reach = film.flipped(frame(3) + 6, 1);
    let twice = {
        let mut file = film.flipped(frame(2) + 25, 1);
        file[frame(5) + 25] ^= 1;
        file
    };
    let beside = {
        let mut file = film.flipped(frame(3) + 25, 1);
        file[frame(4) + 25] ^= 1;
        file
    };
    // Half of a record that another recorder begins again.
    let half = [film.until(5), &film.from(5)[..40], film.from(4)].concat();
    let junk = [film.until(3), b"what a faulty disk wrote", film.from(3)].concat();
    let scrap = [film.until(3), &[0; 3], film.from(3)].concat();
    let sealed_magic = {
        let mut file = film.flipped(0, 0x80);
        let crc = crc32c::crc32c(&file[..12]);
        file[12..SIXTEEN].copy_from_slice(&crc.to_le_bytes());
        file
    };
    let last = film.file.len() - SIXTEEN;
    reach.truncate(film.starts[8]);
    vec![
        ("damaged-header", film.flipped(9, 1)),
        ("damaged-header-magic", sealed_magic),
        ("damaged-header-and-record", {
            let mut file = film.flipped(9, 1);
            file[frame(0) + 30] ^= 1;
            file
        }),
        ("damaged-first", film.flipped(frame(0) + 30, 1)),
        ("damaged-arrival", film.flipped(film.starts[3] + 2, 4)),
        ("damaged-arrival-checksum", film.flipped(film.starts[3] + 9, 4)),
        ("damaged-frame-magic", film.flipped(frame(3), 1)),
        ("damaged-frame-type", film.flipped(frame(3) + 2, 0x10)),
        ("damaged-frame-flags", film.flipped(frame(3) + 3, 1)),
        ("damaged-frame-checksum", film.flipped(frame(3) + 17, 1)),
        ("damaged-frame-payload", film.flipped(frame(3) + 22, 1)),
        // Over the limit of any frame; a little longer than the file; shorter than it is.
        ("damaged-length-over", film.flipped(frame(3) + 7, 0x80)),
        ("damaged-length-beyond", reach),
        ("damaged-length-less", film.flipped(frame(3) + 4, 1)),
        ("damaged-last-length", film.flipped(frame(8) + 6, 1)),
        ("damaged-index", film.flipped(frame(8) + 30, 1)),
        ("damaged-footer", film.flipped(last + 3, 1)),
        ("damaged-footer-magic", film.flipped(last + 9, 1)),
        ("damaged-twice", twice),
        ("damaged-beside", beside),
        ("half-a-record", half),
        ("junk", junk),
        ("scrap", scrap),
        ("hopeless", hopeless(&Film::of(&frames(), false))),
    ]
}

/// Starts of records that reach over many of the others, each with a checksum that only the whole of it can disprove, and
/// a good record behind them.
fn hopeless(film: &Film) -> Vec<u8> {
    let (count, room) = (120, 4_000_u32);
    let mut file = film.until(3).to_vec();
    for _ in 0..count {
        file.extend_from_slice(&[0; 8]);
        file.extend_from_slice(&crc32c::crc32c(&[0; 8]).to_le_bytes());
        let mut head = wire(FrameType::KEYFRAME, (1, 0), &[]);
        head[4..8].copy_from_slice(&room.to_le_bytes());
        file.extend_from_slice(&head);
    }
    file.resize(file.len() + room as usize, 0x33);
    file.extend_from_slice(film.from(3));
    file
}

fn refused() -> Vec<File> {
    let film = Film::of(&frames(), true);
    let sealed = |at: usize, bits: u8| {
        let mut file = film.flipped(at, bits);
        let crc = crc32c::crc32c(&file[..12]);
        file[12..SIXTEEN].copy_from_slice(&crc.to_le_bytes());
        file
    };
    let footer = film.file[film.file.len() - SIXTEEN..].to_vec();
    vec![
        ("refused-version", sealed(8, 3)),
        ("refused-version-0", sealed(8, 1)),
        ("refused-flags", sealed(11, 0x40)),
        ("refused-empty", vec![]),
        ("refused-short", film.file[..15].to_vec()),
        ("refused-text", b"# Recordings\n\nA recording is the frames of a stream as they were.\n".to_vec()),
        ("refused-footer", footer),
        // Frames as they were on the wire have no arrival before them.
        ("refused-frames", frames().concat()),
        ("refused-half", film.file[1..film.starts[1] - 1].to_vec()),
    ]
}
