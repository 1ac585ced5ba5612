//! The bodies that a decoder must refuse, each for one reason.

use psao_codec::Limits;
use psao_codec::envelope::inspect;

use super::Vector;

const HASH: usize = 16;
const CHECKSUM: usize = 24;
/// The first line of the section table, where the changed points take one byte.
const TABLE: usize = 29;

const POSES: u8 = 1;
const BUCKETS: u8 = 2;
const CELLS: u8 = 3;
const GEOMETRY: u8 = 4;
const VALUES: u8 = 5;
const CHANGES: u8 = 6;
const CONTEXT: u8 = 7;
const PATCH: u8 = 8;
const STORED: u8 = 0;
const LZ4: u8 = 1;
const ZSTD: u8 = 2;
const RANGE: u8 = 3;

/// A line of the section table, without raw and stored bytes, and the block.
type Section<'a> = (u8, u8, u32, &'a [u8]);

pub(super) fn vectors(accepted: &[Vector]) -> Vec<Vector> {
    let find = |name: &str| accepted.iter().find(|vector| vector.name == name).unwrap();
    let mut refused = Refused { all: vec![], layout: "tiny" };
    headers(&mut refused, &find("tiny-stored-delta").body);
    tables(&mut refused);
    blocks(&mut refused, &find("tiny-range-delta").body);
    changes(&mut refused);
    values(&mut refused);
    geometry(&mut refused, &find("tiny-stored-key").body);
    context(&mut refused);
    patches(&mut refused);
    refused.layout = "pair";
    cut_short(&mut refused, &find("pair-range-key").body);
    refused.layout = "hall";
    patches_by_range(&mut refused, find("patch-range-first"));
    refused.layout = "paper-32";
    paper(&mut refused, find("paper-32-stored-delta"));
    refused.all
}

struct Refused {
    all: Vec<Vector>,
    layout: &'static str,
}

impl Refused {
    fn add(&mut self, name: &str, after: Option<&str>, body: Vec<u8>) {
        let (name, after) = (format!("refused-{name}"), after.map(str::to_owned));
        self.all.push(Vector { name, layout: self.layout, after, body, full: false });
    }

    /// A body after the keyframe of the specification's example.
    fn after_key(&mut self, name: &str, body: Vec<u8>) {
        self.add(name, Some("tiny-stored-key"), body);
    }
}

/// Puts the right checksum into a body.
fn sealed(mut body: Vec<u8>) -> Vec<u8> {
    body[CHECKSUM..CHECKSUM + 4].fill(0);
    let crc = crc32c::crc32c(&body);
    body[CHECKSUM..CHECKSUM + 4].copy_from_slice(&crc.to_le_bytes());
    body
}

/// `body` with other bytes at a place, and the right checksum.
fn with(body: &[u8], at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut body = body.to_vec();
    body[at..at + bytes.len()].copy_from_slice(bytes);
    sealed(body)
}

fn varint(out: &mut Vec<u8>, mut value: usize) {
    while value >= 128 {
        out.push(value as u8 | 128);
        value >>= 7;
    }
    out.push(value as u8);
}

/// A body with these sections; the raw bytes are the block's length, or what `raw` says.
fn body(ids: [u8; 3], sections: &[Section<'_>], raw: Option<usize>) -> Vec<u8> {
    let mut body = vec![ids[0], ids[1], ids[2], sections.len() as u8, 9, 0, 0, 0];
    body.resize(TABLE, 0);
    for (tag, coder, records, block) in sections {
        body.extend_from_slice(&[*tag, *coder]);
        varint(&mut body, *records as usize);
        varint(&mut body, raw.unwrap_or(block.len()));
        varint(&mut body, block.len());
    }
    for (_, _, _, block) in sections {
        body.extend_from_slice(block);
    }
    sealed(body)
}

fn key(sections: &[Section<'_>]) -> Vec<u8> {
    body([2, 0, 1], sections, None)
}

fn delta(sections: &[Section<'_>]) -> Vec<u8> {
    body([2, 0, 2], sections, None)
}

/// One section, stored.
fn one(tag: u8, records: u32, block: &[u8]) -> Vec<u8> {
    delta(&[(tag, STORED, records, block)])
}

fn headers(refused: &mut Refused, good: &[u8]) {
    let mut damaged = good.to_vec();
    *damaged.last_mut().unwrap() ^= 1;
    refused.after_key("checksum", damaged);
    refused.after_key("hash", with(good, HASH, &[good[HASH] ^ 1]));
    refused.after_key("order", with(good, 4, &[1]));
    refused.add("no-keyframe", None, good.to_vec());
    refused.after_key("profile-unknown", with(good, 0, &[3]));
    refused.after_key("profile-other", body([1, 1, 2], &[], None));
    refused.after_key("packing", with(good, 1, &[1]));
    refused.after_key("kind", with(good, 2, &[3]));
    let mut long = good.to_vec();
    long.push(0);
    refused.after_key("trailing", sealed(long));
    refused.after_key("truncated", sealed(good[..good.len() - 1].to_vec()));
    let mut varint = good.to_vec();
    varint.splice(28..29, [0x81, 0]);
    refused.after_key("varint", sealed(varint));
}

/// A change that is sound: point 1 from 200 to 104.
const SOUND: [u8; 11] = [12, 1, 2, 0, 0, 0, 0, 0, 0, 0, 15];

fn tables(refused: &mut Refused) {
    let change: Section<'_> = (CHANGES, STORED, 1, &SOUND);
    let values: Section<'_> = (VALUES, STORED, 3, &[1, 1, 0, 1, 9, 9, 9]);
    refused.after_key("section-unknown", one(9, 1, &SOUND));
    refused.after_key("section-twice", delta(&[change, change]));
    refused.after_key("section-order", delta(&[change, values]));
    refused.after_key("section-of-paper", one(POSES, 1, &[0; 32]));
    refused.add("changes-in-key", None, key(&[change]));
    refused.after_key("context-in-delta", one(CONTEXT, 1, &[0; 64]));
    refused.after_key("coder-unknown", delta(&[(CHANGES, 4, 1, &SOUND)]));
    refused.add("coder-of-context", None, key(&[(CONTEXT, RANGE, 1, &[0; 64])]));
    refused.after_key("no-records", one(CHANGES, 0, &SOUND));
}

fn blocks(refused: &mut Refused, range: &[u8]) {
    refused.after_key("stored-length", body([2, 0, 2], &[(CHANGES, STORED, 1, &SOUND)], Some(12)));
    refused.after_key("lz4-damaged", body([2, 0, 2], &[(CHANGES, LZ4, 1, &[0xF0, 1, 2])], Some(11)));
    // A frame of raw bytes: without its size; with it, and a byte more; with another size.
    let frame = |header: &[u8], after: &[u8]| {
        let size = [(SOUND.len() as u8) << 3 | 1, 0, 0];
        [&[0x28, 0xB5, 0x2F, 0xFD], header, &size, &SOUND, after].concat()
    };
    let zstd = |block: &[u8]| body([2, 0, 2], &[(CHANGES, ZSTD, 1, block)], Some(11));
    refused.after_key("zstd-unsized", zstd(&frame(&[0x00, 0x50], &[])));
    refused.after_key("zstd-trailing", zstd(&frame(&[0x20, 11], &[0])));
    refused.after_key("zstd-size", zstd(&frame(&[0x20, 12], &[])));
    let block = &range[range.len() - 5..];
    let coded = |records, block: &[u8], raw| body([2, 0, 2], &[(CHANGES, RANGE, records, block)], Some(raw));
    refused.after_key("range-long", coded(1, &[block, &[0; 5]].concat(), 11));
    refused.after_key("range-plain-length", coded(1, block, 12));
    refused.after_key("range-count", coded(2, block, 11));
}

/// Values of which the last bytes are missing: whatever is read instead is more than is there.
fn cut_short(refused: &mut Refused, good: &[u8]) {
    let info = inspect(good, &Limits::default()).unwrap();
    let section = info.sections[0];
    let start = info.header_bytes as usize;
    let block = &good[start..start + section.wire_bytes as usize - 20];
    let sections = [(VALUES, RANGE, section.records, block)];
    refused.add("range-short", None, body([2, 0, 1], &sections, Some(section.raw_bytes as usize)));
}

fn changes(refused: &mut Refused) {
    let mut change =
        |name: &str, records, block: &[u8]| refused.after_key(name, one(CHANGES, records, block));
    change("quantum", 1, &[0, 1, 2, 0, 0, 0, 0, 0, 0, 0, 15]);
    change("change-of-no-block", 1, &[12, 2, 2, 0, 0, 0, 0, 0, 0, 0, 15]);
    change("change-of-no-point", 1, &[12, 1, 8, 0, 0, 0, 0, 0, 0, 0, 15]);
    change("change-of-nothing", 1, &[12, 1, 2, 0, 0, 0, 0, 0, 0, 0, 0]);
    // Point 0 is at 255 already.
    change("change-beyond-the-end", 1, &[12, 1, 1, 0, 0, 0, 0, 0, 0, 0, 2]);
    change("change-too-large", 1, &[12, 1, 2, 0, 0, 0, 0, 0, 0, 0, 0xFF, 3]);
    change("change-count", 2, &SOUND);
    change("change-mask-empty", 1, &[12, 1, 0, 0, 0, 0, 0, 0, 0, 0, 15]);
    change("change-trailing", 1, &[&SOUND[..], &[0]].concat());
    change("change-ends", 1, &SOUND[..10]);
    // The block comes with the very frame that changes it.
    let arrival: Section<'_> = (VALUES, STORED, 3, &[1, 1, 0, 1, 9, 200, 9]);
    refused.add("change-of-arrival", Some("tiny-nothing"), delta(&[arrival, (CHANGES, STORED, 1, &SOUND)]));
}

fn values(refused: &mut Refused) {
    refused.after_key("values-here-already", one(VALUES, 3, &[1, 1, 0, 1, 9, 9, 9]));
    let mut values =
        |name: &str, records, block: &[u8]| refused.add(name, None, key(&[(VALUES, STORED, records, block)]));
    values("values-quantum", 3, &[0, 1, 0, 1, 9, 9, 9]);
    values("values-run-empty", 3, &[1, 2, 0, 0, 0, 1, 9, 9, 9]);
    values("values-no-block", 3, &[1, 1, 1, 1, 9, 9, 9]);
    values("values-twice", 6, &[1, 2, 0, 1, 0, 1, 9, 9, 9, 9, 9, 9]);
    values("values-count", 4, &[1, 1, 0, 1, 9, 9, 9, 9]);
    values("values-short", 3, &[1, 1, 0, 1, 9, 9]);
}

fn geometry(refused: &mut Refused, good: &[u8]) {
    // The block of the example: 46 B after the header.
    let block = &good[39..85];
    refused.after_key("geometry-here-already", one(GEOMETRY, 3, block));
    let mut changed = |name: &str, bytes: &[(usize, u8)]| {
        let mut block = block.to_vec();
        bytes.iter().for_each(|(at, byte)| block[*at] = *byte);
        refused.add(name, None, key(&[(GEOMETRY, STORED, 3, &block)]));
    };
    changed("geometry-no-set", &[(0, 1)]);
    changed("geometry-outside", &[(5, 4)]);
    // x: 0, 1, 3; z: 0, 2, 2.
    changed("geometry-order", &[(5, 1), (6, 2), (9, 0), (12, 0)]);
    changed("geometry-normal", &[(34, 1)]);
    changed("geometry-chart", &[(37, 1)]);
    changed("geometry-digest", &[(31, 0xF6)]);
    refused.add("geometry-count", None, key(&[(GEOMETRY, STORED, 4, block)]));
    refused.add("geometry-ends", None, key(&[(GEOMETRY, STORED, 3, &block[..45])]));
}

fn context(refused: &mut Refused) {
    // Zeros are a fresh model; 64 slots have 256 B before it.
    let mut context = |name: &str, at: usize, bytes: &[u8], more: usize| {
        let mut plain = vec![0; 4 * 64 + 81_068 + more];
        plain[at..at + bytes.len()].copy_from_slice(bytes);
        let mut packed = vec![];
        lz4_zeros(&plain, &mut packed);
        refused.add(name, None, body([2, 0, 1], &[(CONTEXT, LZ4, 1, &packed)], Some(plain.len())));
    };
    context("context-length", 0, &[], 1);
    context("context-last", 2 * 64 + 5, &[0x80], 0);
    context("context-uses", 256, &[0, 1], 0);
    // The first weight of the blocks: after 12 + 512 + 130 + 64 words.
    context("context-weight", 256 + 4 * 718, &[0, 0, 0x20], 0);
}

/// A patch that is sound but for its hash: point 1 gets 104. Its frame is 9, that of the keyframe 1.
const PATCHED: [u8; 12] = [8, 0, 1, 2, 0, 0, 0, 0, 0, 0, 0, 104];

fn patches(refused: &mut Refused) {
    let sound: Section<'_> = (PATCH, STORED, 1, &PATCHED);
    refused.add("patch-in-key", None, key(&[sound]));
    refused.after_key("patch-after-changes", delta(&[(CHANGES, STORED, 1, &SOUND), sound]));
    refused.after_key("patch-after-values", delta(&[(VALUES, STORED, 3, &[1, 1, 0, 1, 9, 9, 9]), sound]));
    refused.after_key("patch-twice", delta(&[sound, sound]));
    refused.add("patch-without-keyframe", None, delta(&[sound]));
    refused.after_key("patch-hash", delta(&[sound]));
    let mut patch = |name: &str, records, block: &[u8]| refused.after_key(name, one(PATCH, records, block));
    let with = |at: usize, byte: u8| {
        let mut block = PATCHED;
        block[at] = byte;
        block
    };
    patch("patch-too-late", 1, &with(0, 7));
    patch("patch-from-now", 1, &with(0, 0));
    patch("patch-before-all", 1, &with(0, 10));
    patch("patch-of-no-block", 1, &with(2, 2));
    patch("patch-of-no-point", 1, &with(3, 8));
    patch("patch-mask-empty", 1, &with(3, 0));
    patch("patch-count", 2, &PATCHED);
    patch("patch-ends", 1, &PATCHED[..11]);
    patch("patch-trailing", 1, &[&PATCHED[..], &[0]].concat());
    let arriving = |runs: &[u8]| [&PATCHED[..1], runs, &PATCHED[2..]].concat();
    patch("patch-run-empty", 1, &arriving(&[1, 0, 0]));
    patch("patch-run-beyond", 1, &arriving(&[1, 0, 2]));
    patch("patch-run-twice", 1, &arriving(&[2, 0, 1, 0, 1]));
    patch("patch-run-in-part", 1, &arriving(&[1, 0, 1]));
    refused.add("patch-of-absent", Some("tiny-nothing"), one(PATCH, 1, &PATCHED));
}

/// A patch by the range coder with bytes too many, of other records, of another plain length.
fn patches_by_range(refused: &mut Refused, good: &Vector) {
    let info = inspect(&good.body, &Limits::default()).unwrap();
    let section = info.sections[0];
    let block = &good.body[info.header_bytes as usize..];
    let mut forged = |name: &str, records, raw, block: &[u8]| {
        // The frame of the vector, so that it reaches back as far.
        let body = with(&body([2, 0, 2], &[(PATCH, RANGE, records, block)], Some(raw)), 4, &good.body[4..8]);
        refused.add(name, good.after.as_deref(), body);
    };
    let (records, raw) = (section.records, section.raw_bytes as usize);
    forged("patch-range-long", records, raw, &[block, &[0; 5]].concat());
    forged("patch-range-short", records, raw, &block[..block.len() - 20]);
    forged("patch-range-count", records + 1, raw, block);
    forged("patch-range-plain-length", records, raw + 1, block);
}

/// LZ4 by hand: every byte that is not zero and its neighbours as literals, the zeros as matches one byte back.
fn lz4_zeros(plain: &[u8], out: &mut Vec<u8>) {
    let mut at = 0;
    while at < plain.len() {
        let literals = plain[at..].iter().position(|byte| *byte == 0).unwrap_or(plain.len() - at) + 1;
        let zeros = plain[at + literals..].iter().take_while(|byte| **byte == 0).count();
        let last = at + literals + zeros == plain.len();
        // A block ends with at least five literals, and no match starts in its last twelve bytes.
        let matched = if last { zeros - 12 } else { zeros };
        sequence(out, &plain[at..at + literals], matched);
        at += literals + matched;
        if last {
            out.push(12 << 4);
            out.extend_from_slice(&plain[at..]);
            return;
        }
    }
}

fn sequence(out: &mut Vec<u8>, literals: &[u8], matched: usize) {
    let length = matched - 4;
    out.push((literals.len() as u8) << 4 | length.min(15) as u8);
    out.extend_from_slice(literals);
    out.extend_from_slice(&[1, 0]);
    if length >= 15 {
        let rest = length - 15;
        out.resize(out.len() + rest / 255, 255);
        out.push((rest % 255) as u8);
    }
}

fn paper(refused: &mut Refused, good: &Vector) {
    let stand = |sections: &[Section<'_>]| body([1, 1, 2], sections, None);
    let after = good.after.as_deref();
    let mut add = |name: &str, body| refused.add(&format!("paper-{name}"), after, body);
    add("hash", with(&good.body, HASH, &[good.body[HASH] ^ 1]));
    add("packing", body([1, 2, 2], &[], None));
    add("section-of-surface", stand(&[(CHANGES, STORED, 1, &SOUND)]));
    add("coder", stand(&[(POSES, RANGE, 1, &[0; 32])]));
    add("raw-length", stand(&[(POSES, STORED, 1, &[0; 33])]));
    add("too-many", stand(&[(POSES, STORED, 3, &[0; 96])]));
    // Offset, then the words.
    let record = |offset: u8, size: usize, words: &[(usize, u32)]| {
        let mut record = vec![0; size];
        record[0] = offset;
        for (at, word) in words {
            record[4 + 4 * at..8 + 4 * at].copy_from_slice(&word.to_le_bytes());
        }
        record
    };
    let one = 1.0_f32.to_bits();
    let pose = |offset, words: &[(usize, u32)]| record(offset, 32, &[&[(6, one)], words].concat());
    add("offset-order", stand(&[(POSES, STORED, 2, &[pose(1, &[]), pose(0, &[])].concat())]));
    add("offset-range", stand(&[(POSES, STORED, 1, &pose(2, &[]))]));
    add("pose-infinite", stand(&[(POSES, STORED, 1, &pose(0, &[(1, f32::INFINITY.to_bits())]))]));
    add("pose-length", stand(&[(POSES, STORED, 1, &pose(0, &[(3, one)]))]));
    let bucket = |words: &[(usize, u32)]| record(0, 68, words);
    let used = |cell: u32, points: u32, count: u32| cell | points << 22 | count << 27;
    for (name, words) in [
        ("bucket-cell", [(0, 7), (1, used(24, 1, 1))]),
        ("bucket-points", [(0, 7), (1, used(0, 8, 1))]),
        ("bucket-count", [(0, 7), (1, used(0, 1, 2))]),
        ("bucket-gap", [(2, 7), (3, used(0, 1, 0))]),
        ("bucket-unused", [(0, 7), (2, 7)]),
    ] {
        add(name, stand(&[(BUCKETS, STORED, 1, &bucket(&words))]));
    }
    // Cell 23 is empty, so the record is the cell.
    add("cell-gap", stand(&[(CELLS, STORED, 1, &record(23, 32, &[(1, 1 << 31)]))]));
    add("cell-unused", stand(&[(CELLS, STORED, 1, &record(23, 32, &[(0, 1)]))]));
}
