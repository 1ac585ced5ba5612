//! The header of a frame body: 28 fixed bytes, the number of changed points, the section table.
//!
//! | byte | field |
//! |---|---|
//! | 0 | profile: u8 |
//! | 1 | packing: u8 |
//! | 2 | kind: u8 |
//! | 3 | sections: u8 |
//! | 4 | frame index: u32 |
//! | 8 | time, microseconds: u64 |
//! | 16 | state hash after the frame: u64 |
//! | 24 | CRC32C of the body with these four bytes zero: u32 |
//! | 28 | changed points: varint |
//! | | for each section: tag u8, coder u8, records varint, raw bytes varint, stored bytes varint |

use super::{
    FrameError, FrameIndex, FrameInfo, FrameKind, FrameRules, Packing, Profile, SectionInfo, SectionTag,
    StreamTime,
};
use crate::block::CoderId;
use crate::profiles::{rules_of, rules_of_section};
use crate::wire::{Reader, varint_bytes, write_varint};
use crate::{Limits, StateHash};

pub(crate) const PACKING_OFFSET: usize = 1;
pub(crate) const KIND_OFFSET: usize = 2;
pub(crate) const FRAME_OFFSET: usize = 4;
pub(crate) const HASH_OFFSET: usize = 16;
/// Start of the checksum.
pub(crate) const CRC_OFFSET: usize = 24;
/// Value of the checksum field while the checksum is computed.
const BLANK_CRC: [u8; 4] = [0; 4];

/// Reads the header of a whole body, and checks the lengths of the blocks and the checksum.
pub(super) fn read_checked(body: &[u8], limits: &Limits) -> Result<FrameInfo, FrameError> {
    if body.len() > limits.max_frame_bytes as usize {
        return Err(FrameError::TooLong { bytes: body.len(), limit: limits.max_frame_bytes });
    }
    let (info, stored) = read_header(body, limits)?;
    let mut reader = Reader::new(body);
    reader.take("header", info.header_bytes as usize)?;
    for section in &info.sections {
        reader.take("block", section.wire_bytes as usize)?;
    }
    reader.end()?;
    let computed = body_crc(body);
    if stored != computed {
        return Err(FrameError::Checksum { offset: CRC_OFFSET, stored, computed });
    }
    Ok(info)
}

/// Reads the header at the start of `body`, which may be incomplete. Also returns the stored checksum, which only a
/// complete body can be checked against.
pub(crate) fn read_header(body: &[u8], limits: &Limits) -> Result<(FrameInfo, u32), FrameError> {
    let mut reader = Reader::new(body);
    let rules = read_profile(&mut reader)?;
    let profile = rules.profile();
    let packing = read_packing(&mut reader, rules)?;
    let kind = reader.u8("frame kind")?;
    let kind = FrameKind::from_id(kind).ok_or(FrameError::Kind { offset: KIND_OFFSET, found: kind })?;
    let section_count = reader.u8("section count")?;
    let frame = FrameIndex(reader.u32("frame index")?);
    let time = StreamTime(reader.u64("time")?);
    let hash = StateHash(reader.u64("state hash")?);
    let stored = reader.u32("checksum")?;
    let changed_points = reader.varint("changed points")?;
    let mut sections = Vec::new();
    // The last line, if a frame must not end with it.
    let mut unfinished = None;
    for _ in 0..section_count {
        let previous = sections.last().map(|section: &SectionInfo| section.tag);
        let start = reader.offset();
        let section = read_section(&mut reader, limits)?;
        check_section(start, rules, (packing, kind), previous, &section)?;
        unfinished = (!rules.may_be_last(section.tag, kind)).then_some((start, section.tag));
        sections.push(section);
    }
    if let Some((offset, found)) = unfinished {
        return Err(FrameError::SectionMisplaced { offset, found, profile, kind });
    }
    let header_bytes = reader.offset() as u32;
    Ok((
        FrameInfo { profile, packing, kind, frame, time, hash, changed_points, header_bytes, sections },
        stored,
    ))
}

fn read_profile(reader: &mut Reader<'_>) -> Result<&'static dyn FrameRules, FrameError> {
    let offset = reader.offset();
    let found = Profile(reader.u8("profile")?);
    rules_of(found).ok_or(FrameError::ProfileUnknown { offset, found })
}

fn read_packing(reader: &mut Reader<'_>, rules: &dyn FrameRules) -> Result<Packing, FrameError> {
    let found = Packing(reader.u8("packing")?);
    if rules.has_packing(found) {
        Ok(found)
    } else {
        Err(FrameError::PackingUnknown { offset: PACKING_OFFSET, found })
    }
}

/// Reads one line of the section table. It checks what concerns no other line.
fn read_section(reader: &mut Reader<'_>, limits: &Limits) -> Result<SectionInfo, FrameError> {
    let offset = reader.offset();
    let tag = SectionTag(reader.u8("section tag")?);
    let owner = rules_of_section(tag).ok_or(FrameError::SectionUnknown { offset, found: tag })?;
    let offset = reader.offset();
    let coder = CoderId(reader.u8("block coder")?);
    if !owner.may_use(tag, coder) {
        return Err(FrameError::Coder { offset, section: tag, found: coder });
    }
    let offset = reader.offset();
    let records = reader.varint("record count")?;
    if records == 0 {
        return Err(FrameError::NoRecords { offset, section: tag });
    }
    let offset = reader.offset();
    let raw_bytes = reader.varint("raw length")?;
    if raw_bytes > limits.max_block_bytes {
        let limit = limits.max_block_bytes;
        return Err(FrameError::BlockTooLarge { offset, section: tag, found: raw_bytes, limit });
    }
    let wire_bytes = reader.varint("stored length")?;
    Ok(SectionInfo { tag, coder, records, raw_bytes, wire_bytes })
}

/// Checks a line of the section table, which starts at byte `start`, against the frame and the line before it.
fn check_section(
    start: usize,
    rules: &dyn FrameRules,
    (packing, kind): (Packing, FrameKind),
    previous: Option<SectionTag>,
    section: &SectionInfo,
) -> Result<(), FrameError> {
    let found = section.tag;
    let profile = rules.profile();
    if !rules.sections().contains(&found) || !rules.may_be_in(found, kind) {
        return Err(FrameError::SectionMisplaced { offset: start, found, profile, kind });
    }
    if let Some(previous) = previous.filter(|previous| !rules.is_ordered(*previous, found)) {
        return Err(FrameError::SectionOrder { offset: start, found, previous });
    }
    if let Some(previous) = previous.filter(|previous| !rules.may_follow(*previous, found, kind)) {
        return Err(FrameError::SectionBeside { offset: start, found, previous });
    }
    if let Some(size) = rules.record_bytes(found, packing) {
        let expected = u64::from(section.records) * u64::from(size);
        if expected != u64::from(section.raw_bytes) {
            // The raw length follows tag, coder and records.
            let offset = start + 2 + varint_bytes(section.records);
            return Err(FrameError::RawLength { offset, section: found, expected, found: section.raw_bytes });
        }
    }
    Ok(())
}

/// Writes the header that [`read_header`] reads, with a zero checksum. It ignores `info.header_bytes`.
pub(crate) fn write_header(out: &mut Vec<u8>, info: &FrameInfo) {
    out.extend_from_slice(&[info.profile.0, info.packing.0, info.kind.id(), info.sections.len() as u8]);
    out.extend_from_slice(&info.frame.0.to_le_bytes());
    out.extend_from_slice(&info.time.0.to_le_bytes());
    out.extend_from_slice(&info.hash.0.to_le_bytes());
    out.extend_from_slice(&BLANK_CRC);
    write_varint(out, info.changed_points);
    for section in &info.sections {
        out.extend_from_slice(&[section.tag.0, section.coder.0]);
        write_varint(out, section.records);
        write_varint(out, section.raw_bytes);
        write_varint(out, section.wire_bytes);
    }
}

/// Returns the length of the header that [`write_header`] writes, in bytes.
pub(crate) fn header_bytes(sections: &[SectionInfo], changed_points: u32) -> usize {
    let line = |section: &SectionInfo| {
        let SectionInfo { records, raw_bytes, wire_bytes, .. } = *section;
        2 + [records, raw_bytes, wire_bytes].map(varint_bytes).iter().sum::<usize>()
    };
    CRC_OFFSET + 4 + varint_bytes(changed_points) + sections.iter().map(line).sum::<usize>()
}

/// Returns the CRC32C of the body with zero checksum bytes. `body` holds at least the fixed header.
pub(crate) fn body_crc(body: &[u8]) -> u32 {
    let (before, rest) = body.split_at(CRC_OFFSET);
    let crc = crc32c::crc32c_append(crc32c::crc32c(before), &BLANK_CRC);
    crc32c::crc32c_append(crc, &rest[BLANK_CRC.len()..])
}

/// Checks that a frame can follow a state of `profile` at frame `last`. Any keyframe of that profile can; a delta must
/// be newer than the state.
pub(crate) fn check_follows(
    info: &FrameInfo,
    profile: Profile,
    last: Option<FrameIndex>,
) -> Result<(), FrameError> {
    if info.profile != profile {
        return Err(FrameError::ProfileOther { offset: 0, found: info.profile, expected: profile });
    }
    match (info.kind, last) {
        (FrameKind::Key, _) => Ok(()),
        (FrameKind::Delta, None) => Err(FrameError::NoKeyframe { offset: KIND_OFFSET }),
        (FrameKind::Delta, Some(last)) if info.frame > last => Ok(()),
        (FrameKind::Delta, Some(last)) => {
            Err(FrameError::FrameOrder { offset: FRAME_OFFSET, found: info.frame, last })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::BlockCoder;
    use crate::envelope::inspect;
    use crate::testing::{reseal, story};

    fn small(body: &[u8]) -> Result<FrameInfo, FrameError> {
        inspect(body, &Limits::default())
    }

    /// Returns `body` with the byte at `at` replaced and its checksum corrected.
    fn with(body: &[u8], at: usize, byte: u8) -> Result<FrameInfo, FrameError> {
        let mut changed = body.to_vec();
        changed[at] = byte;
        reseal(&mut changed);
        small(&changed)
    }

    #[test]
    fn inspect_reads_what_the_encoder_says() {
        for coder in [BlockCoder::Stored, BlockCoder::Lz4, BlockCoder::default()] {
            let story = story(coder);
            for frame in [story.key, story.delta] {
                assert_eq!(small(&frame.body).as_ref(), Ok(&frame.info));
                assert_eq!(frame.info.body_bytes(), frame.body.len() as u64);
                assert_eq!(frame.info.sections.len(), 3);
            }
        }
    }

    #[test]
    fn ids_that_are_unknown_are_named() {
        let body = story(BlockCoder::Stored).key.body;
        for found in [0, 3, 255].map(Profile) {
            assert_eq!(with(&body, 0, found.0), Err(FrameError::ProfileUnknown { offset: 0, found }));
        }
        // A body of one profile that says it is of the other has the other's packing missing.
        let found = Packing::BITS_32;
        assert_eq!(with(&body, 0, 2), Err(FrameError::PackingUnknown { offset: 1, found }));
        for found in [0, 4, 9, 255].map(Packing) {
            assert_eq!(with(&body, 1, found.0), Err(FrameError::PackingUnknown { offset: 1, found }));
        }
        for found in [0, 3, 255] {
            assert_eq!(with(&body, 2, found), Err(FrameError::Kind { offset: 2, found }));
        }
    }

    #[test]
    fn the_section_table_is_checked_line_by_line() {
        let Story { body, .. } = Story::new();
        // Line 0 is at byte 29: tag, coder, records (1 byte), raw bytes (1 byte), stored bytes (1 byte).
        let (section, found) = (SectionTag::POSES, SectionTag(9));
        assert_eq!(with(&body, 29, 9), Err(FrameError::SectionUnknown { offset: 29, found }));
        for found in [CoderId::RANGE, CoderId(77)] {
            assert_eq!(with(&body, 30, found.0), Err(FrameError::Coder { offset: 30, section, found }));
        }
        assert_eq!(with(&body, 31, 0), Err(FrameError::NoRecords { offset: 31, section }));
        assert_eq!(
            with(&body, 31, 2),
            Err(FrameError::RawLength { offset: 32, section, expected: 64, found: 32 })
        );
        let (offset, found, previous) = (34, SectionTag::POSES, SectionTag::POSES);
        assert_eq!(with(&body, 34, 1), Err(FrameError::SectionOrder { offset, found, previous }));
        // A known packing that the lengths do not fit: a cell of 24-bit points has 25 B.
        let (section, expected, found) = (SectionTag::CELLS, 25, 32);
        assert_eq!(
            with(&body, 1, Packing::BITS_24.0),
            Err(FrameError::RawLength { offset: 42, section, expected, found })
        );
        let problem = crate::VarintError::NotShortest;
        let mut long = body.clone();
        long.splice(28..29, [0x81, 0]);
        reseal(&mut long);
        let expected = FrameError::Varint { field: "changed points", offset: 28, problem };
        assert_eq!(small(&long), Err(expected));
    }

    #[test]
    fn lengths_are_checked_against_each_other_and_the_limits() {
        let Story { body, blocks } = Story::new();
        assert_eq!(
            with(&body, 33, 33),
            Err(FrameError::Truncated { field: "block", offset: blocks + 33 + 68, missing: 1 })
        );
        assert_eq!(with(&body, 33, 31), Err(FrameError::Trailing { offset: body.len() - 1, extra: 1 }));
        let limits = Limits { max_block_bytes: 67, ..Limits::default() };
        let (offset, section) = (37, SectionTag::BUCKETS);
        assert_eq!(
            inspect(&body, &limits),
            Err(FrameError::BlockTooLarge { offset, section, found: 68, limit: 67 })
        );
        let limit = body.len() as u32 - 1;
        let limits = Limits { max_frame_bytes: limit, ..Limits::default() };
        assert_eq!(inspect(&body, &limits), Err(FrameError::TooLong { bytes: body.len(), limit }));
    }

    #[test]
    fn the_checksum_covers_every_bit() {
        let Story { body, .. } = Story::new();
        for bit in 0..body.len() * 8 {
            let mut changed = body.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(small(&changed).is_err(), "bit {bit}");
        }
        let mut changed = body.clone();
        *changed.last_mut().unwrap() ^= 1;
        let stored = body_crc(&body);
        let computed = body_crc(&changed);
        assert_eq!(small(&changed), Err(FrameError::Checksum { offset: 24, stored, computed }));
    }

    /// A stored keyframe with one record in each section.
    struct Story {
        body: Vec<u8>,
        blocks: usize,
    }

    impl Story {
        fn new() -> Story {
            let frame = crate::paper::example::key();
            Story { blocks: frame.info.header_bytes as usize, body: frame.body }
        }
    }
}
