//! Tests of change logs and patches of synthetic streams.

use proptest::prelude::*;

use super::tests::{CODERS, ao, meta, refuse};
use super::*;
use crate::block::{BlockCoder, CoderId};
use crate::envelope::{FrameError, FrameIndex, FrameKind, SectionInfo, SectionTag, assemble, inspect};
use crate::testing::reseal;
use crate::{self as of_either, ContentError, Limits};

/// One frame of a story: points and the AO that is set.
type AoValues = Vec<(u32, u8)>;

/// A stream and all its frames.
struct Story {
    encoder: Encoder,
    log: ChangeLog,
    /// The state after every frame.
    states: Vec<State>,
    bodies: Vec<Vec<u8>>,
}

impl Story {
    fn new(source: GeometrySource) -> Story {
        let encoder = tests::stream(source, 6);
        let log = ChangeLog::new(encoder.state());
        Story { encoder, log, states: Vec::new(), bodies: Vec::new() }
    }

    /// Writes a frame with a given index: indices need not be consecutive.
    fn frame(&mut self, kind: FrameKind, coder: BlockCoder, values: &AoValues) {
        for (point, ao) in values {
            self.encoder.set_ao(*point, *ao);
        }
        let number = 3 + 2 * self.states.len() as u32;
        self.bodies.push(self.encoder.finish(meta(kind, number), coder).unwrap().body);
        self.log.record(self.encoder.state());
        self.states.push(self.encoder.state().clone());
    }

    fn last(&self) -> &State {
        self.states.last().unwrap()
    }

    fn patch(&self, base: FrameIndex, coder: BlockCoder, context: bool) -> Option<Vec<u8>> {
        let meta = meta(FrameKind::Delta, self.last().frame.unwrap().0);
        patch(self.encoder.state(), &self.log, base, meta, coder, context).unwrap()
    }

    /// The reference of [`ChangeLog::changed_since`]: it looks at all states after `base`.
    fn missed(&self, base: usize) -> Option<Vec<(u32, u64)>> {
        let states = &self.states[base..];
        if !states.iter().all(|state| state.received == states[0].received) {
            return None;
        }
        let mut masks = vec![0; states[0].present.len()];
        for pair in states.windows(2) {
            for index in
                (0..pair[0].values.len()).filter(|index| pair[0].values[*index] != pair[1].values[*index])
            {
                masks[index / BLOCK_POINTS] |= 1 << (index % BLOCK_POINTS);
            }
            for block in (0..masks.len()).filter(|block| !pair[0].present[*block] && pair[1].present[*block])
            {
                masks[block] = u64::MAX >> (BLOCK_POINTS - pair[0].layout.block_len(block));
            }
        }
        Some((0..).zip(masks).filter(|(_, mask)| *mask != 0).collect())
    }
}

/// Returns values of all points at a given time except those of the last ball.
fn shadow(time: u32) -> AoValues {
    (0..430).map(|point| (point, ao(point, time))).collect()
}

/// Returns a keyframe and five deltas.
fn short(coder: BlockCoder) -> Story {
    let mut story = Story::new(GeometrySource::Sent);
    for time in 0..6 {
        let kind = if time == 0 { FrameKind::Key } else { FrameKind::Delta };
        story.frame(kind, coder, &shadow(time));
    }
    story
}

fn tags(body: &[u8]) -> Vec<SectionTag> {
    inspect(body, &Limits::default()).unwrap().sections.iter().map(|section| section.tag).collect()
}

#[test]
fn the_range_coder_takes_the_fewest_bytes() {
    let story = short(BlockCoder::Range);
    let base = story.states[1].frame.unwrap();
    let [range, others @ ..] = CODERS.map(|coder| story.patch(base, coder, false).unwrap().len());
    assert!(others.iter().all(|other| range < *other), "{range} {others:?}");
}

#[test]
fn what_the_bits_of_a_patch_are_spent_on_adds_up_to_the_block() {
    let story = short(BlockCoder::Range);
    let body = story.patch(story.states[1].frame.unwrap(), BlockCoder::Range, false).unwrap();
    let bits = 8.0 * f64::from(inspect(&body, &Limits::default()).unwrap().sections[0].wire_bytes);
    let BitBreakdown { blocks, points, signs, sizes } =
        bit_breakdown(&story.states[2], &body, &Limits::default()).unwrap().unwrap();
    assert!([blocks, points, signs, sizes].iter().all(|part| *part > 0.0));
    assert!((blocks + points + signs + sizes - bits).abs() < 12.0, "{bits}");
}

#[test]
fn a_patch_of_nothing_names_a_point_all_the_same() {
    let mut story = short(BlockCoder::Range);
    let base = story.last().frame.unwrap();
    assert_eq!(story.patch(base, BlockCoder::Range, true), None);
    story.frame(FrameKind::Delta, BlockCoder::Range, &Vec::new());
    assert_eq!(story.log.changed_since(base).unwrap().count(), 0);
    let body = story.patch(base, BlockCoder::Range, true).unwrap();
    let info = inspect(&body, &Limits::default()).unwrap();
    assert_eq!(info.section(SectionTag::PATCH).unwrap().records, 1);
    let mut log = of_either::ChangeLog::new(&story.states[0]);
    story.states.iter().for_each(|state| log.record(state));
    let meta = meta(FrameKind::Delta, info.frame.0);
    let same = of_either::patch(story.last(), &log, base, meta, BlockCoder::Range, true);
    assert_eq!(same, Ok(Some(body.clone())), "whoever carries streams of either profile");
    let mut state = story.states[story.states.len() - 2].clone();
    Decoder::new().decode(&mut state, &body, &Limits::default()).unwrap();
    assert_eq!(&state, story.last());
}

#[test]
fn what_was_learned_is_left_out_when_it_is_nothing() {
    let mut story = short(BlockCoder::Range);
    let base = story.states[4].frame.unwrap();
    let tags_of = |story: &Story, context| tags(&story.patch(base, BlockCoder::Range, context).unwrap());
    assert_eq!(tags_of(&story, true), [SectionTag::CONTEXT, SectionTag::PATCH]);
    assert_eq!(tags_of(&story, false), [SectionTag::PATCH]);
    // A new group with the same blocks can be reached from the old one.
    story.frame(FrameKind::Key, BlockCoder::Range, &shadow(9));
    assert_eq!(tags_of(&story, true), [SectionTag::PATCH]);
}

#[test]
fn without_a_way_there_is_no_patch() {
    let empty = Story::new(GeometrySource::Sent);
    assert!(empty.log.changed_since(FrameIndex(0)).is_none());
    let mut story = Story::new(GeometrySource::Sent);
    for _ in 0..2 {
        story.frame(FrameKind::Key, BlockCoder::Range, &Vec::new());
    }
    let base = story.states[0].frame.unwrap();
    assert_eq!(story.patch(base, BlockCoder::Range, false), None, "there is no point");
    let mut story = short(BlockCoder::Range);
    let base = story.states[4].frame.unwrap();
    assert!(story.patch(base, BlockCoder::Range, false).is_some());
    for other in [0, u32::MAX].map(FrameIndex) {
        assert_eq!(story.patch(other, BlockCoder::Range, false), None, "nobody knows that frame");
    }
    let log = story.log.clone();
    story.frame(FrameKind::Delta, BlockCoder::Range, &shadow(7));
    let meta = meta(FrameKind::Delta, story.last().frame.unwrap().0);
    let behind = patch(story.last(), &log, base, meta, BlockCoder::Range, false);
    assert_eq!(behind, Ok(None), "the log has not followed");
    // The other ball arrives; its points are there already.
    story.frame(FrameKind::Delta, BlockCoder::Range, &vec![(559, 9)]);
    let body = story.patch(base, BlockCoder::Range, false).expect("a block came");
    let mut state = story.states[4].clone();
    Decoder::new().decode(&mut state, &body, &Limits::default()).unwrap();
    assert_eq!((&state.present, &state.values), (&story.last().present, &story.last().values));
    // A set that comes is not in a patch.
    let mut story = Story::new(GeometrySource::Sent);
    story.frame(FrameKind::Key, BlockCoder::Range, &vec![(0, 9)]);
    let base = story.last().frame.unwrap();
    story.frame(FrameKind::Delta, BlockCoder::Range, &vec![(300, 9)]);
    assert_eq!(story.patch(base, BlockCoder::Range, false), None, "a set came");
}

#[test]
fn a_change_log_of_something_else_begins_anew() {
    let story = short(BlockCoder::Range);
    // Back to an earlier frame, or to the same one with other content.
    let mut log = story.log.clone();
    log.record(story.last());
    assert_eq!(log, story.log);
    log.record(&story.states[2]);
    assert_eq!(log, ChangeLog::new(&story.states[2]));
    let mut other = story.last().clone();
    other.values[70] ^= 1;
    let mut log = story.log.clone();
    log.record(&other);
    assert_eq!(log, ChangeLog::new(&other));
    let layout = Layout::new(Vec::new(), Vec::new(), &Limits::default()).unwrap();
    let mut none = State::new(std::sync::Arc::new(layout));
    none.frame = Some(FrameIndex(99));
    log.record(&none);
    assert_eq!(log, ChangeLog::new(&none));
}

#[test]
fn every_prefix_and_every_flipped_bit_of_a_patch_is_refused() {
    let story = short(BlockCoder::Range);
    for coder in CODERS {
        let mut decoder = Decoder::new();
        for context in [false, true] {
            let body = story.patch(story.states[2].frame.unwrap(), coder, context).unwrap();
            let state = &story.states[3];
            for end in (0..body.len()).step_by(1 + body.len() / 400) {
                refuse(&mut decoder, state, &body[..end], &Limits::default());
            }
            for bit in (0..body.len() * 8).step_by(1 + body.len() / 200) {
                let mut changed = body.clone();
                changed[bit / 8] ^= 1 << (bit % 8);
                refuse(&mut decoder, state, &changed, &Limits::default());
            }
        }
    }
}

#[test]
fn flipped_bits_of_a_patch_under_a_right_checksum_are_refused_or_harmless() {
    let story = short(BlockCoder::Range);
    for coder in CODERS {
        let mut decoder = Decoder::new();
        let body = story.patch(story.states[2].frame.unwrap(), coder, false).unwrap();
        for bit in (0..body.len() * 8).step_by(1 + body.len() / 500) {
            let mut changed = body.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            reseal(&mut changed);
            let mut found = story.states[3].clone();
            match decoder.decode(&mut found, &changed, &Limits::default()) {
                Ok(_) => assert_eq!(found.values, story.last().values, "bit {bit}"),
                Err(_) => assert_eq!(found, story.states[3], "bit {bit}"),
            }
        }
    }
}

/// Returns a body of these sections, all stored.
fn body(kind: FrameKind, sections: &[(SectionTag, u32, &[u8])]) -> Vec<u8> {
    let table = sections.iter().map(|(tag, records, block)| SectionInfo {
        tag: *tag,
        coder: CoderId::STORED,
        records: *records,
        raw_bytes: block.len() as u32,
        wire_bytes: block.len() as u32,
    });
    let ids = frame_ids(kind);
    let blocks: Vec<u8> = sections.iter().flat_map(|(_, _, block)| block.iter().copied()).collect();
    assemble(&meta(kind, 14), ids, crate::StateHash(7), table.collect(), &blocks).body
}

#[test]
fn a_patch_is_alone_in_its_delta() {
    use SectionTag as Tag;
    let state = short(BlockCoder::Range).states.remove(5);
    let refused = |kind, tags: &[Tag]| {
        let sections: Vec<_> = tags.iter().map(|tag| (*tag, 1, &[0_u8; 4][..])).collect();
        refuse(&mut Decoder::new(), &state, &body(kind, &sections), &Limits::default())
    };
    for previous in [Tag::GEOMETRY, Tag::VALUES, Tag::CHANGES] {
        for found in [Tag::PATCH, Tag::CONTEXT] {
            // The second line of the table.
            let expected = FrameError::SectionBeside { offset: 34, found, previous };
            assert_eq!(refused(FrameKind::Delta, &[previous, found]), expected);
        }
    }
    let error = refused(FrameKind::Delta, &[Tag::PATCH, Tag::PATCH]);
    assert!(matches!(error, FrameError::SectionOrder { .. }), "{error}");
    for (kind, tag) in [(FrameKind::Key, Tag::PATCH), (FrameKind::Delta, Tag::CONTEXT)] {
        let error = refused(kind, &[tag]);
        assert!(matches!(error, FrameError::SectionMisplaced { found, .. } if found == tag), "{error}");
    }
}

#[test]
fn patches_that_do_not_suit_are_refused_by_name() {
    let mut story = Story::new(GeometrySource::Sent);
    for time in 0..2 {
        let kind = if time == 0 { FrameKind::Key } else { FrameKind::Delta };
        // The second ball is blocks 8 and 9, or it would be if it came.
        let values = shadow(time).into_iter().filter(|(point, _)| *point < 300);
        story.frame(kind, BlockCoder::Stored, &values.collect());
    }
    let state = story.last();
    let blocks = state.present.len();
    let refused = |records, block: &[u8]| {
        let body = body(FrameKind::Delta, &[(SectionTag::PATCH, records, block)]);
        refuse(&mut Decoder::new(), state, &body, &Limits::default())
    };
    // The state is of frame 5, the patch of frame 14.
    let plain = |back: u8, block: usize, mask: u64| {
        let mut raw = vec![back, 0];
        raw.resize(2 + blocks.div_ceil(8), 0);
        raw[2 + block / 8] |= 1 << (block % 8);
        raw.extend(mask.to_le_bytes());
        raw.resize(raw.len() + mask.count_ones() as usize, 200);
        raw
    };
    for back in [0, 8, 15] {
        let error = refused(1, &plain(back, 0, 1));
        let expected = (u32::from(back), FrameIndex(5));
        let FrameError::PatchBase { back, last, .. } = error else { unreachable!("{error}") };
        assert_eq!((back, last), expected);
    }
    let problem = |error: FrameError| match error {
        FrameError::Content {
            section: SectionTag::PATCH,
            problem: ContentError::Surface(SectionError::Changes(error)),
            ..
        } => error,
        other => unreachable!("{other}"),
    };
    let (block, mask) = (4, 1 << 63);
    assert_eq!(problem(refused(1, &plain(9, 4, mask))), ChangeError::Mask { block, mask });
    assert_eq!(problem(refused(1, &plain(9, 4, 0))), ChangeError::Mask { block, mask: 0 });
    assert_eq!(problem(refused(1, &plain(9, 6, 1))), ChangeError::Absent { block: 6 });
    let count = ChangeError::Count { expected: 2, found: 1 };
    assert_eq!(problem(refused(2, &plain(9, 0, 1))), count);
    let mut raw = plain(9, 0, 3);
    let offset = raw.len() - 2;
    assert_eq!(problem(refused(2, &raw[..=offset])), ChangeError::Ends { field: "the values", offset });
    raw.push(0);
    let (offset, extra) = (offset + 2, 1);
    assert_eq!(problem(refused(2, &raw)), ChangeError::Trailing { offset, extra });
    let hash = refused(2, &raw[..offset]);
    assert!(matches!(hash, FrameError::Hash { .. }), "{hash}");
    let arriving = |runs: &[u8], block, mask: u64| {
        let mut raw = plain(9, block, mask);
        raw.splice(1..2, runs.iter().copied());
        raw
    };
    for (runs, first, count) in [([1, 3, 0], 3, 0), ([1, 7, 9], 7, 9), ([1, 200, 1], 200, 1)] {
        let error = problem(refused(1, &arriving(&runs, 0, 1)));
        assert_eq!(error, ChangeError::Arrivals { first, count });
    }
    let disordered = ChangeError::Arrivals { first: 6, count: 1 };
    assert_eq!(problem(refused(1, &arriving(&[2, 6, 2, 6, 1], 0, 1))), disordered);
    assert_eq!(
        problem(refused(1, &arriving(&[1, 6, 1], 0, 1))),
        ChangeError::Missing { block: 6, missing: u64::MAX }
    );
    let missing = u64::MAX ^ 5;
    assert_eq!(problem(refused(2, &arriving(&[1, 6, 1], 6, 5))), ChangeError::Missing { block: 6, missing });
    let hash = refused(64, &arriving(&[1, 6, 1], 6, u64::MAX));
    assert!(matches!(hash, FrameError::Hash { .. }), "{hash}");
}

fn story() -> impl Strategy<Value = Vec<(u8, AoValues)>> {
    let values = prop::collection::vec((0_u32..560, any::<u8>()), 0..60);
    prop::collection::vec((any::<u8>(), values), 2..10)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn whoever_is_between_base_and_frame_is_brought_to_the_newest_state(
        frames in story(), source in any::<bool>(), coder in 0_usize..4, more in story(),
    ) {
        let source = if source { GeometrySource::Sent } else { GeometrySource::Shared };
        let mut story = Story::new(source);
        for (at, (kind, values)) in frames.iter().enumerate() {
            let key = at == 0 || kind % 16 == 0;
            let kind = if key { FrameKind::Key } else { FrameKind::Delta };
            story.frame(kind, CODERS[coder], values);
        }
        let last = story.last().clone();
        let mut readers = Vec::new();
        for base in 0..frames.len() {
            let missed = story.missed(base);
            let index = story.states[base].frame.unwrap();
            prop_assert_eq!(story.log.changed_since(index).map(Iterator::collect::<Vec<_>>), missed.clone());
            for context in [false, true] {
                let body = story.patch(index, CODERS[coder], context);
                let possible = missed.is_some() && index < last.frame.unwrap() && last.present.contains(&true);
                prop_assert_eq!(body.is_some(), possible);
                let Some(body) = body else { continue };
                let info = inspect(&body, &Limits::default()).unwrap();
                let count: u32 = missed.iter().flatten().map(|(_, mask)| mask.count_ones()).sum();
                prop_assert_eq!(info.section(SectionTag::PATCH).unwrap().records, count.max(1));
                for (at, state) in story.states.iter().enumerate().take(frames.len() - 1) {
                    let mut found = state.clone();
                    let applied = Decoder::new().decode(&mut found, &body, &Limits::default());
                    if at < base {
                        let refused = matches!(applied, Err(FrameError::PatchBase { .. }));
                        prop_assert!(refused, "{applied:?}");
                        prop_assert_eq!(&found, state);
                        continue;
                    }
                    prop_assert_eq!(applied.as_ref(), Ok(&info));
                    if context {
                        prop_assert_eq!(&found, &last);
                        readers.push(found);
                    } else {
                        let fresh = State::new(last.layout.clone());
                        prop_assert_eq!((&found.history, &found.model), (&fresh.history, &fresh.model));
                        (found.history, found.model) = (last.history.clone(), last.model.clone());
                        prop_assert_eq!(&found, &last);
                    }
                }
            }
        }
        // With what was learned, clients read the updates that all others read.
        for (_, values) in &more {
            story.frame(FrameKind::Delta, CODERS[coder], values);
            for reader in readers.iter_mut().take(3) {
                Decoder::new().decode(reader, story.bodies.last().unwrap(), &Limits::default()).unwrap();
                prop_assert_eq!(&*reader, story.last());
            }
        }
    }
}
