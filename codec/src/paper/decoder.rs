//! The decoder of profile `paper`: it applies a frame body completely or not at all.
//!
//! A first pass checks every record and computes the hash of the resulting state. Only if it matches the server's does
//! a second pass write. Both are linear in the records.

use super::{Bucket, Cell, Layout, POINTS_PER_CELL, PointFormat, Pose, RecordError, State};
use crate::block::Decompressor;
use crate::envelope::{
    FrameBody, FrameError, FrameInfo, FrameKind, HASH_OFFSET, PACKING_OFFSET, Profile, SectionBlock,
    SectionInfo, SectionTag, check_follows,
};
use crate::hash::RecordKind;
use crate::wire::{narrow_words, words};
use crate::{Limits, StateHash};

/// Applies one frame body to `state`. [`Decoder::apply`] is cheaper for many frames.
///
/// # Errors
/// Those of [`Decoder::apply`].
pub fn apply(state: &mut State, body: &[u8], limits: &Limits) -> Result<FrameInfo, FrameError> {
    Decoder::new().decode(state, body, limits)
}

/// Applies frame bodies. It keeps its buffers between frames.
#[derive(Debug, Default)]
pub struct Decoder {
    decompressor: Decompressor,
    poses: Vec<u8>,
    buckets: Vec<u8>,
    cells: Vec<u8>,
}

impl Decoder {
    /// Creates a decoder that has allocated nothing yet.
    #[must_use]
    pub fn new() -> Decoder {
        Decoder::default()
    }

    /// Parses a frame body and applies it: [`FrameBody::parse`], then [`Decoder::apply`].
    ///
    /// # Errors
    /// Those of [`Decoder::apply`].
    pub fn decode(
        &mut self,
        state: &mut State,
        bytes: &[u8],
        limits: &Limits,
    ) -> Result<FrameInfo, FrameError> {
        let body = FrameBody::parse(bytes, limits)?;
        self.apply(state, &body, limits)?;
        Ok(body.into_info())
    }

    /// Applies a frame body to `state`. It checks everything first, including the hash of the resulting state, and
    /// then writes.
    ///
    /// Its buffers grow to the largest section seen, at most `limits.max_block_bytes` each.
    ///
    /// # Errors
    /// [`FrameError`] tells what is wrong and where; `state` is then unchanged.
    pub fn apply(
        &mut self,
        state: &mut State,
        body: &FrameBody<'_>,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        let info = body.info();
        check_follows(info, Profile::PAPER, state.frame())?;
        check_packing(state, info)?;
        self.decompress(state.layout(), body, limits)?;
        let computed = self.check(state, info.kind)?;
        if computed != info.hash {
            return Err(FrameError::Hash { offset: HASH_OFFSET, stored: info.hash, computed });
        }
        self.write(state, info.kind);
        state.hash = computed;
        state.frame = Some(info.frame);
        Ok(())
    }

    /// Decompresses every section into its buffer. The buffers of missing sections become empty.
    fn decompress(
        &mut self,
        layout: &Layout,
        body: &FrameBody<'_>,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        for buffer in [&mut self.poses, &mut self.buckets, &mut self.cells] {
            buffer.clear();
        }
        for block in body.blocks() {
            self.decompress_section(layout, &block, limits)?;
        }
        Ok(())
    }

    fn decompress_section(
        &mut self,
        layout: &Layout,
        block: &SectionBlock<'_>,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        let SectionBlock { section: SectionInfo { tag, coder, records, raw_bytes, .. }, offset, bytes } =
            *block;
        let places = places(layout, tag);
        if records > places {
            return Err(FrameError::TooManyRecords { offset, section: tag, records, places });
        }
        let out = match tag {
            SectionTag::POSES => &mut self.poses,
            SectionTag::BUCKETS => &mut self.buckets,
            _ => &mut self.cells,
        };
        self.decompressor
            .decompress(bytes, coder, raw_bytes, limits.max_block_bytes, out)
            .map_err(|source| FrameError::Block { offset, section: tag, source })
    }

    /// Checks every record and returns the hash of the resulting state.
    fn check(&self, state: &State, kind: FrameKind) -> Result<StateHash, FrameError> {
        let layout = state.layout();
        let is_delta = kind == FrameKind::Delta;
        let mut hash = if is_delta { state.hash } else { StateHash::default() };
        for entry in SectionRecords::<4, 7>::new(SectionTag::POSES, &self.poses, layout) {
            let SectionRecord { record, raw_offset, offset, words } = entry?;
            let pose = Pose::from_words(words);
            pose.check(offset)
                .map_err(|error| refused(SectionTag::POSES, record, raw_offset, error.into()))?;
            let old = if is_delta { state.poses[offset as usize] } else { Pose::IDENTITY };
            hash = hash.replace(RecordKind::Pose, offset, &old.hash_words(), &pose.hash_words());
        }
        for entry in SectionRecords::<4, 16>::new(SectionTag::BUCKETS, &self.buckets, layout) {
            let SectionRecord { record, raw_offset, offset, words } = entry?;
            Bucket::from_words(&words)
                .check(layout.cell_capacity())
                .map_err(|error| refused(SectionTag::BUCKETS, record, raw_offset, error.into()))?;
            let old = if is_delta { state.buckets[offset as usize].to_words() } else { [0; 16] };
            hash = hash.replace(RecordKind::Bucket, offset, &old, &words);
        }
        match layout.format() {
            PointFormat::Bits32 => self.check_cells::<4>(state, is_delta, hash),
            PointFormat::Bits24 => self.check_cells::<3>(state, is_delta, hash),
            PointFormat::Bits16 => self.check_cells::<2>(state, is_delta, hash),
        }
    }

    /// Checks the cells, with points of `WIDTH` bytes, and returns the hash that includes them.
    fn check_cells<const WIDTH: usize>(
        &self,
        state: &State,
        is_delta: bool,
        mut hash: StateHash,
    ) -> Result<StateHash, FrameError> {
        let layout = state.layout();
        for entry in SectionRecords::<WIDTH, POINTS_PER_CELL>::new(SectionTag::CELLS, &self.cells, layout) {
            let SectionRecord { record, raw_offset, offset, words } = entry?;
            let old = if is_delta { state.cells[offset as usize] } else { Cell::default() };
            let new = old.xor(&words);
            if let Some(slot) = Cell::first_fault::<WIDTH>(&new) {
                return Err(refused(SectionTag::CELLS, record, raw_offset, RecordError::Cell { slot }));
            }
            hash = hash.replace(RecordKind::Cell, offset, old.words(), &new);
        }
        Ok(hash)
    }

    /// Writes the records that [`Decoder::check`] has passed.
    fn write(&self, state: &mut State, kind: FrameKind) {
        if kind == FrameKind::Key {
            state.clear();
        }
        for record in self.poses.chunks_exact(32) {
            let [offset] = words(record);
            state.poses[offset as usize] = Pose::from_words(words(&record[4..]));
        }
        for record in self.buckets.chunks_exact(68) {
            let [offset] = words(record);
            state.buckets[offset as usize] = Bucket::from_words(&words(&record[4..]));
        }
        match state.layout().format() {
            PointFormat::Bits32 => self.write_cells::<4>(state),
            PointFormat::Bits24 => self.write_cells::<3>(state),
            PointFormat::Bits16 => self.write_cells::<2>(state),
        }
    }

    fn write_cells<const WIDTH: usize>(&self, state: &mut State) {
        for record in self.cells.chunks_exact(4 + WIDTH * POINTS_PER_CELL) {
            let [offset] = words(record);
            let cell = &mut state.cells[offset as usize];
            *cell = Cell::from_words(cell.xor(&narrow_words(&record[4..], WIDTH)));
        }
    }
}

/// Returns the error of a record.
fn refused(section: SectionTag, record: u32, raw_offset: usize, error: RecordError) -> FrameError {
    FrameError::Record { section, record, raw_offset, problem: error.into() }
}

/// Checks that points are packed as in the layout.
fn check_packing(state: &State, info: &FrameInfo) -> Result<(), FrameError> {
    let (found, expected) = (info.packing, state.layout().format().packing());
    if found == expected {
        return Ok(());
    }
    Err(FrameError::Packing { offset: PACKING_OFFSET, found, expected })
}

/// Returns the number of places that the offsets of a section can name.
fn places(layout: &Layout, tag: SectionTag) -> u32 {
    match tag {
        // `Limits::max_instances` is a u32, so the count fits.
        SectionTag::POSES => layout.instances().len() as u32,
        SectionTag::BUCKETS => layout.bucket_total(),
        SectionTag::CELLS => layout.cell_capacity(),
        _ => 0,
    }
}

/// A record of a section: an offset in range and above the one before it, and `N` words.
struct SectionRecord<const N: usize> {
    record: u32,
    raw_offset: usize,
    offset: u32,
    words: [u32; N],
}

/// The records of a section with words of `WIDTH` bytes. It checks each offset.
struct SectionRecords<'a, const WIDTH: usize, const N: usize> {
    tag: SectionTag,
    places: u32,
    raw: &'a [u8],
    record: u32,
    next_offset: u32,
}

impl<'a, const WIDTH: usize, const N: usize> SectionRecords<'a, WIDTH, N> {
    fn new(tag: SectionTag, raw: &'a [u8], layout: &Layout) -> SectionRecords<'a, WIDTH, N> {
        SectionRecords { tag, places: places(layout, tag), raw, record: 0, next_offset: 0 }
    }
}

impl<const WIDTH: usize, const N: usize> Iterator for SectionRecords<'_, WIDTH, N> {
    type Item = Result<SectionRecord<N>, FrameError>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        let size = 4 + WIDTH * N;
        let (bytes, rest) = self.raw.split_at_checked(size)?;
        let (section, record, found) = (self.tag, self.record, words::<1>(bytes)[0]);
        let raw_offset = record as usize * size;
        if found >= self.places {
            return Some(Err(FrameError::OffsetRange {
                section,
                record,
                raw_offset,
                found,
                places: self.places,
            }));
        }
        if found < self.next_offset {
            let previous = self.next_offset - 1;
            return Some(Err(FrameError::OffsetOrder { section, record, raw_offset, found, previous }));
        }
        self.raw = rest;
        self.record += 1;
        self.next_offset = found + 1;
        let words = narrow_words(&bytes[4..], WIDTH);
        Some(Ok(SectionRecord { record, raw_offset, offset: found, words }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ContentError;
    use crate::block::{BlockCoder, BlockError, CoderId, Compressor};
    use crate::envelope::FrameIndex;
    use crate::envelope::Packing;
    use crate::paper::{BucketError, PoseError, Records, write_body};
    use crate::testing::{Story, layout, layout_of, meta, refuse, reseal, story, story_of};

    const CODERS: [BlockCoder; 3] = [BlockCoder::Stored, BlockCoder::Lz4, BlockCoder::Zstd { level: 15 }];

    fn limits() -> Limits {
        Limits::default()
    }

    #[test]
    fn frames_bring_the_client_to_the_state_of_the_server() {
        for (format, coder) in
            PointFormat::ALL.into_iter().flat_map(|format| CODERS.map(|coder| (format, coder)))
        {
            let Story { empty: mut state, after_key, after_delta, key, delta } = story_of(format, coder);
            let mut decoder = Decoder::new();
            let applied = decoder.decode(&mut state, &key.body, &limits()).unwrap();
            assert_eq!((&applied, &state), (&key.info, &after_key));
            let applied = decoder.decode(&mut state, &delta.body, &limits()).unwrap();
            assert_eq!((&applied, &state), (&delta.info, &after_delta));
            let poses = applied.section(SectionTag::POSES).unwrap();
            assert_eq!((poses.records, state.hash()), (2, state.full_hash()));
            let cells = delta.info.section(SectionTag::CELLS).unwrap();
            assert_eq!(cells.raw_bytes as usize, cells.records as usize * (4 + 7 * format.bytes()));
            // A keyframe replaces every state.
            decoder.decode(&mut state, &key.body, &limits()).unwrap();
            assert_eq!(state, after_key);
        }
    }

    #[test]
    fn every_prefix_and_every_further_byte_is_refused() {
        for (format, coder) in PointFormat::ALL.into_iter().zip(CODERS) {
            let Story { empty, after_key, key, delta, .. } = story_of(format, coder);
            for (state, mut body) in [(&empty, key.body), (&after_key, delta.body)] {
                for end in 0..body.len() {
                    refuse(state, &body[..end], &limits());
                }
                body.push(0);
                let offset = body.len() - 1;
                assert_eq!(refuse(state, &body, &limits()), FrameError::Trailing { offset, extra: 1 });
            }
        }
    }

    #[test]
    fn every_flipped_bit_is_refused() {
        for (format, coder) in PointFormat::ALL.into_iter().zip(CODERS) {
            let Story { empty, after_key, key, delta, .. } = story_of(format, coder);
            for (state, body) in [(&empty, key.body), (&after_key, delta.body)] {
                for bit in 0..body.len() * 8 {
                    let mut changed = body.clone();
                    changed[bit / 8] ^= 1 << (bit % 8);
                    refuse(state, &changed, &limits());
                }
            }
        }
    }

    #[test]
    fn every_flipped_bit_under_a_right_checksum_is_refused_or_harmless() {
        // The frame index, the time, the changed points and bits that a coder ignores are harmless.
        for (format, coder) in PointFormat::ALL.into_iter().rev().zip(CODERS) {
            let Story { empty, after_key, after_delta, key, delta } = story_of(format, coder);
            for (state, after, body) in
                [(&empty, &after_key, key.body), (&after_key, &after_delta, delta.body)]
            {
                for bit in 0..body.len() * 8 {
                    let mut changed = body.clone();
                    changed[bit / 8] ^= 1 << (bit % 8);
                    reseal(&mut changed);
                    let mut found = state.clone();
                    if apply(&mut found, &changed, &limits()).is_ok() {
                        found.frame = after.frame;
                        assert_eq!(&found, after, "bit {bit}");
                    } else {
                        assert_eq!(&found, state, "bit {bit}");
                    }
                }
            }
        }
    }

    #[test]
    fn frames_of_another_packing_are_refused() {
        for format in PointFormat::ALL {
            let body = story_of(format, BlockCoder::default()).key.body;
            for other in PointFormat::ALL.into_iter().filter(|other| *other != format) {
                let (found, expected) = (format.packing(), other.packing());
                let error = refuse(&State::new(layout_of(other)), &body, &limits());
                assert_eq!(error, FrameError::Packing { offset: 1, found, expected });
            }
        }
        let error = FrameError::Packing { offset: 1, found: Packing::BITS_16, expected: Packing::BITS_24 };
        assert!(error.to_string().contains("16-bit points, the stream was announced with 24-bit points"));
    }

    #[test]
    fn deltas_need_the_state_before_them() {
        let Story { empty, after_key, after_delta, delta, .. } = story(BlockCoder::default());
        assert_eq!(refuse(&empty, &delta.body, &limits()), FrameError::NoKeyframe { offset: 2 });
        let (found, last) = (FrameIndex(4), FrameIndex(4));
        assert_eq!(
            refuse(&after_delta, &delta.body, &limits()),
            FrameError::FrameOrder { offset: 4, found, last }
        );
        let mut other = after_key;
        other.cells[0] = Cell::from_words(other.cells[0].xor(&[1, 0, 0, 0, 0, 0, 0]));
        other.hash = other.full_hash();
        let error = refuse(&other, &delta.body, &limits());
        assert!(matches!(error, FrameError::Hash { offset: 16, .. }), "{error}");
    }

    fn is_translation(problem: ContentError) -> bool {
        matches!(problem, ContentError::Paper(RecordError::Pose(PoseError::Translation { .. })))
    }

    /// Returns the error for a keyframe of these records with a hash that no state has.
    fn forged(fill: impl FnOnce(&mut Records)) -> FrameError {
        let mut records = Records::new(PointFormat::Bits32);
        fill(&mut records);
        let meta = meta(FrameKind::Key, 0);
        let hash = StateHash(0x0BAD);
        let frame =
            write_body(&meta, FrameKind::Key, hash, &records, &mut Compressor::new(), BlockCoder::Stored)
                .unwrap();
        refuse(&State::new(layout()), &frame.body, &limits())
    }

    #[test]
    fn records_that_break_a_rule_are_named() {
        let (section, point) = (SectionTag::CELLS, [1 << 31, 0, 0, 0, 0, 0, 0]);
        let error = forged(|records| [5, 5].into_iter().for_each(|at| records.push_cell(at, &point)));
        let (record, raw_offset) = (1, 32);
        assert_eq!(error, FrameError::OffsetOrder { section, record, raw_offset, found: 5, previous: 5 });
        let error = forged(|records| [7, 64].into_iter().for_each(|at| records.push_cell(at, &point)));
        assert_eq!(error, FrameError::OffsetRange { section, record, raw_offset, found: 64, places: 64 });
        let hole = [1 << 31, 0, 1 << 31, 0, 0, 0, 0];
        let error = forged(|records| records.push_cell(7, &hole));
        assert_eq!(error, refused(section, 0, 0, RecordError::Cell { slot: 2 }));
        let error = forged(|records| (0..65).for_each(|at| records.push_cell(at, &point)));
        assert!(matches!(error, FrameError::TooManyRecords { records: 65, places: 64, .. }), "{error}");
        let mut words = [0; 16];
        words[1] = (1 << 27) | (8 << 22);
        let error = forged(|records| records.push_bucket(3, &Bucket::from_words(&words)));
        let problem = BucketError::Points { entry: 0, points: 8 };
        assert_eq!(error, refused(SectionTag::BUCKETS, 0, 0, problem.into()));
        let pose = Pose { translation: [0.0, f32::NAN, 0.0], ..Pose::IDENTITY };
        let error = forged(|records| records.push_pose(1, pose));
        let expected = matches!(error, FrameError::Record { section: SectionTag::POSES, record: 0, problem, .. } if is_translation(problem));
        assert!(expected, "{error}");
        let error = forged(|records| records.push_cell(7, &point));
        assert!(matches!(error, FrameError::Hash { stored: StateHash(0x0BAD), .. }), "{error}");
    }

    #[test]
    fn a_block_that_lies_is_refused() {
        let Story { empty, key, .. } = story(BlockCoder::Stored);
        let mut body = key.body;
        // The coder of the first section.
        body[30] = 2;
        reseal(&mut body);
        let error = refuse(&empty, &body, &limits());
        let FrameError::Block { offset, section: SectionTag::POSES, source } = error else {
            panic!("{error}")
        };
        assert_eq!(offset, key.info.header_bytes as usize);
        assert!(matches!(source, BlockError::Corrupt { coder: CoderId::ZSTD, .. }), "{source}");
    }

    #[test]
    fn a_decoder_goes_on_after_a_bad_frame() {
        let Story { empty: mut state, after_delta, key, delta, .. } = story(BlockCoder::default());
        let mut decoder = Decoder::new();
        decoder.decode(&mut state, &key.body, &limits()).unwrap();
        let mut bad = delta.body.clone();
        bad[16] ^= 1;
        reseal(&mut bad);
        assert!(matches!(decoder.decode(&mut state, &bad, &limits()), Err(FrameError::Hash { .. })));
        decoder.decode(&mut state, &delta.body, &limits()).unwrap();
        assert_eq!(state, after_delta);
    }
}
