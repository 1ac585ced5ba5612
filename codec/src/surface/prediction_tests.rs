//! Tests of frames whose points are predicted from their parents, against the reference.

use std::sync::Arc;

use proptest::prelude::*;

use super::cells::CellIndex;
use super::model::value::ValueModel;
use super::prediction::NextValues;
use super::section::changes::Changes;
use super::section::values::{ClientValues, Values};
use super::tests::{CODERS, meta};
use super::*;
use crate::block::{BlockCoder, CoderId};
use crate::envelope::{FrameError, FrameKind, HASH_OFFSET, SectionInfo, SectionTag, assemble};
use crate::range::RangeEncoder;
use crate::reference::apply_surface;
use crate::testing::{lattice, reseal};
use crate::{Limits, StateHash};

/// Number of points of the set with levels.
const POINTS: u32 = 600;

/// Returns a set of three charts and four levels, some points of which are at one node, and a set of one level.
fn sets() -> Vec<Arc<Geometry>> {
    let layout = lattice(3, 0.08);
    let point = |n: u32| {
        let spread = |by: u32| (n * by % 256) as f32 / 256.0;
        let [x, z] = if n.is_multiple_of(20) { [0.5; 2] } else { [spread(29), spread(47)] };
        RestPoint { position: [x, spread(3) / 50.0, z], normal: [0.0, 1.0, 0.0], chart: n % 3 }
    };
    let round = |count: u32| {
        let points: Vec<RestPoint> = (0..count).map(point).collect();
        Arc::new(Geometry::round(layout, &points).geometry)
    };
    vec![round(POINTS), round(70)]
}

/// Returns the encoder of a stream with two instances of the set with levels, and one of the other.
fn stream(threshold: u8) -> Encoder {
    let geometry = sets();
    assert_eq!(geometry[0].layout().levels.count(), 4);
    let layouts = geometry.iter().map(|geometry| *geometry.layout()).collect();
    let members = [0, 1, 0].map(|set| Member { set }).to_vec();
    let layout = Arc::new(Layout::new(layouts, members, &Limits::default()).unwrap());
    Encoder::new(layout, geometry, EncoderSettings::new(threshold, GeometrySource::Sent)).unwrap()
}

/// Pseudo-random numbers from a seed.
struct Dice(u32);

impl Dice {
    fn roll(&mut self, sides: u32) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) % sides
    }

    /// Returns a byte: often none, open or that of a neighbourhood.
    fn byte(&mut self) -> u8 {
        match self.roll(8) {
            0 => NO_VALUE,
            1 => 255,
            2 => self.roll(256) as u8,
            _ => 100 + self.roll(60) as u8,
        }
    }
}

/// Returns the state of clients that have some blocks of a stream.
fn some_blocks(dice: &mut Dice) -> State {
    let mut encoder = stream(1 + dice.roll(20) as u8);
    for point in 0..encoder.state().layout().points() {
        if dice.roll(60) == 0 {
            encoder.set_ao(point, dice.byte()).unwrap();
        }
    }
    encoder.finish(meta(FrameKind::Key, 0), BlockCoder::Range).unwrap();
    encoder.state().clone()
}

/// Returns a delta of one section.
fn body(
    tag: SectionTag,
    coder: CoderId,
    records: usize,
    raw_bytes: usize,
    block: &[u8],
    frame: u32,
) -> Vec<u8> {
    let section = SectionInfo {
        tag,
        coder,
        records: records as u32,
        raw_bytes: raw_bytes as u32,
        wire_bytes: block.len() as u32,
    };
    let meta = meta(FrameKind::Delta, frame);
    assemble(&meta, frame_ids(FrameKind::Delta), StateHash(7), vec![section], block).body
}

/// Returns some changes to points of present blocks: some have no effect, or go where none may.
fn random_changes(state: &State, dice: &mut Dice, wild: bool) -> Changes {
    let mut changes =
        Changes { quantum: 1 + dice.roll(if wild { 255 } else { 12 }) as u8, ..Changes::default() };
    let (often, most) = (2 + dice.roll(30), 1 + dice.roll(if wild { 255 } else { 3 }) as i16);
    for block in (0..state.present.len()).filter(|block| state.present[*block]) {
        if dice.roll(3) == 0 {
            continue;
        }
        for index in state.block_range(block).map(PaddedIndex) {
            if dice.roll(often) == 0 {
                let level = 1 + dice.roll(most as u32) as i16;
                let downwards = !wild && state.values[index.0] > 80 && dice.roll(2) == 0;
                changes.push(index, if downwards || wild && dice.roll(2) == 0 { -level } else { level });
            }
        }
    }
    changes
}

fn changes_body(state: &State, changes: &Changes, coded: bool, frame: u32) -> Vec<u8> {
    let blocks = state.present.len();
    let mut block = Vec::new();
    if coded {
        let mut encoder = RangeEncoder::new(&mut block);
        let made = (&mut Changes::default(), &mut NextValues::default());
        // What does not fit is refused by those who read it.
        let _ = state.model.clone().code(&mut encoder, state.view(), changes, made, usize::MAX, |_| false);
        encoder.finish();
    } else {
        changes.write_plain(blocks, &mut block);
    }
    let coder = if coded { CoderId::RANGE } else { CoderId::STORED };
    body(SectionTag::CHANGES, coder, changes.levels.len(), changes.plain_bytes(blocks), &block, frame)
}

/// Returns a delta in which absent blocks arrive, in any order.
fn values_body(state: &State, dice: &mut Dice, coded: bool, frame: u32) -> Option<Vec<u8>> {
    let mut absent: Vec<usize> = (0..state.present.len()).filter(|block| !state.present[*block]).collect();
    let mut values = Values { quantum: 1 + dice.roll(20) as u8, ..Values::default() };
    for _ in 0..absent.len().min(1 + dice.roll(4) as usize) {
        let block = absent.swap_remove(dice.roll(absent.len() as u32) as usize);
        values.push(block);
        for _ in state.block_range(block) {
            values.bytes.push(dice.byte());
            values.thresholds.push(1 + dice.roll(9) as u8);
        }
    }
    let (records, raw_bytes) = (values.bytes.len(), values.plain_bytes());
    let (mut bytes, mut present, mut block) = (state.values.clone(), state.present.clone(), Vec::new());
    let clients = ClientValues { geometry: &state.geometry, bytes: &mut bytes, present: &mut present };
    if coded {
        let mut encoder = RangeEncoder::new(&mut block);
        let pair = (&values, &mut Values::default());
        ValueModel::new()
            .code(&mut encoder, &state.layout, clients, pair, records as u32, |_| false)
            .unwrap();
        encoder.finish();
    } else {
        values.write_plain(&state.layout, clients, &mut block);
    }
    let coder = if coded { CoderId::RANGE } else { CoderId::STORED };
    (records > 0).then(|| body(SectionTag::VALUES, coder, records, raw_bytes, &block, frame))
}

/// Applies a body with a wrong hash by decoder and reference, which must agree. If only the hash is wrong, it is
/// corrected, and both must take it. Returns the state afterwards.
fn agree(state: &State, mut body: Vec<u8>) -> Option<State> {
    let limits = Limits::default();
    let mut after = state.clone();
    let mut decoder = Decoder::new();
    let error = decoder.decode(&mut after, &body, &limits).unwrap_err();
    assert!(&after == state);
    let FrameError::Hash { computed, .. } = error else {
        assert!(apply_surface(state, &body, &limits).is_err(), "only the decoder refuses: {error}");
        return None;
    };
    body[HASH_OFFSET..HASH_OFFSET + 8].copy_from_slice(&computed.0.to_le_bytes());
    reseal(&mut body);
    decoder.decode(&mut after, &body, &limits).unwrap();
    assert!(apply_surface(state, &body, &limits).as_ref() == Ok(&after), "they differ");
    assert_eq!(after.hash(), after.full_hash());
    Some(after)
}

/// Returns the points whose byte differs.
fn differing(before: &State, after: &State) -> usize {
    before.values.iter().zip(&after.values).filter(|(before, after)| before != after).count()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn decoder_and_reference_agree_on_frames_of_any_changes(seed: u32, wild: bool) {
        let mut dice = Dice(seed);
        let mut state = some_blocks(&mut dice);
        for frame in 1..14 {
            let coded = dice.roll(3) > 0;
            if dice.roll(4) == 0 && let Some(body) = values_body(&state, &mut dice, coded, frame) {
                state = agree(&state, body).unwrap();
                continue;
            }
            let changes = random_changes(&state, &mut dice, wild);
            if !changes.levels.is_empty() {
                state = agree(&state, changes_body(&state, &changes, coded, frame)).unwrap_or(state);
            }
        }
    }

    #[test]
    fn points_follow_their_parents_without_a_level_of_their_own(seed: u32, coder in 0_usize..4) {
        let mut dice = Dice(seed);
        let mut encoder = stream(6);
        let points = encoder.state().layout().points();
        (0..points).for_each(|point| { encoder.set_ao(point, 150).unwrap(); });
        encoder.finish(meta(FrameKind::Key, 0), CODERS[coder]).unwrap();
        let before = encoder.state().clone();
        let darker = 20 + dice.roll(80) as u8;
        (0..points).for_each(|point| { encoder.set_ao(point, 150 - darker).unwrap(); });
        let body = encoder.finish(meta(FrameKind::Delta, 1), CODERS[coder]).unwrap();
        let after = apply_surface(&before, &body.body, &Limits::default()).unwrap();
        prop_assert!(&after == encoder.state());
        let sent = body.info.section(SectionTag::CHANGES).unwrap().records as usize;
        prop_assert_eq!(differing(&before, &after), points as usize);
        prop_assert!(sent < points as usize / 2, "{sent} of {points}");
    }

    #[test]
    fn a_search_visits_the_highest_points_of_each_cell(
        places in prop::collection::vec((0_u32..3, prop::array::uniform3(0_u32..40)), 1..400),
        edge in 1_u32..30, chart in 0_u32..3, node in prop::array::uniform3(0_u32..40),
    ) {
        let index = CellIndex::new(edge, places.len() as u32, |point| places[point as usize]);
        let mut found: Vec<u32> = index.around(chart, node).collect();
        found.sort_unstable();
        let cell = |node: [u32; 3]| node.map(|axis| axis / edge);
        let near = |at: &usize| {
            let beside = cell(places[*at].1).into_iter().zip(cell(node)).all(|(a, b)| a.abs_diff(b) <= 1);
            let higher = places[at + 1..].iter().filter(|(of, node)| *of == chart && cell(*node) == cell(places[*at].1));
            places[*at].0 == chart && beside && higher.count() < 16
        };
        prop_assert!(found.into_iter().map(|at| at as usize).eq((0..places.len()).filter(near)));
    }
}

#[test]
fn points_at_one_node_cost_no_more_than_a_few() {
    let index = CellIndex::new(5, 100_000, |_| (0, [(1 << 21) - 1; 3]));
    assert!(index.around(0, [(1 << 21) - 1; 3]).eq(99_984..100_000));
    assert_eq!(index.around(1, [(1 << 21) - 1; 3]).count(), 0);
    assert_eq!(index.around(0, [0; 3]).count(), 0);
}

#[test]
fn patches_of_predicted_points_are_read_alike() {
    let mut encoder = stream(5);
    let mut dice = Dice(3);
    let points = encoder.state().layout().points();
    let mut log = ChangeLog::new(encoder.state());
    let mut states = Vec::new();
    for frame in 0..6 {
        // Blocks of every instance arrive until the last frame; the first one brings the sets.
        for point in (0..points).filter(|point| frame > 0 || point.is_multiple_of(101)) {
            if dice.roll(150) == 0 || frame == 0 {
                encoder.set_ao(point, dice.byte()).unwrap();
            }
        }
        let kind = if frame == 0 { FrameKind::Key } else { FrameKind::Delta };
        encoder.finish(meta(kind, frame), BlockCoder::Range).unwrap();
        log.record(encoder.state());
        states.push(encoder.state().clone());
    }
    let (last, behind) = states.split_last().unwrap();
    for (base, state) in behind.iter().enumerate() {
        for coder in CODERS {
            let meta = meta(FrameKind::Delta, 5);
            let body = patch(last, &log, state.frame.unwrap(), meta, coder, true).unwrap().unwrap();
            let mut after = state.clone();
            Decoder::new().decode(&mut after, &body, &Limits::default()).unwrap();
            assert!(&after == last, "{coder:?} {base}");
            assert!(apply_surface(state, &body, &Limits::default()).as_ref() == Ok(last), "{coder:?} {base}");
        }
    }
    assert!(behind[0].present_points() < last.present_points());
}
