//! Model of changes for the range coder: which point blocks, which points, their signs and sizes. The contexts of a
//! decision are what the parents of the point, its neighbours along the curve and the point itself did, in this frame and
//! in earlier ones.

use std::sync::Arc;

use super::history::{History, NEVER};
use crate::memory;
use crate::range::{BinaryCoder, BitModel, Logistic, MAX_WEIGHT, Mixer, NumberModel, SymbolClass, logistic};
use crate::surface::parents::Prediction;
use crate::surface::prediction::{NextValues, Predictor};
use crate::surface::section::changes::{ChangeError, Changes, MAX_LEVEL};
use crate::surface::{BLOCK_POINTS, Geometry, Layout, PaddedIndex};

/// Number of blocks that one decision can skip.
const GROUP_BLOCKS: usize = 16;
/// Levels beyond this one are coded as a number.
const UNARY_SIZES: usize = 12;

/// What the coder has learned of the changes of a stream.
#[derive(Debug, PartialEq)]
pub(crate) struct ChangeModel {
    pub(crate) groups: Vec<BitModel>,
    pub(crate) block: ContextMixer<3>,
    pub(crate) point: ContextMixer<5>,
    pub(crate) sign: ContextMixer<5>,
    pub(crate) size: ContextMixer<4>,
    pub(crate) large: NumberModel,
}

/// `N` tables of bit models, and the mixer that weighs one input from each.
#[derive(Debug, PartialEq)]
pub(crate) struct ContextMixer<const N: usize> {
    pub(crate) tables: [Vec<BitModel>; N],
    pub(crate) mixer: Mixer<N>,
}

/// Implemented by hand so that `clone_from` reuses allocations: a decoder copies the model once a frame.
/// [`ContextMixer`] and [`Mixer`] do the same.
impl Clone for ChangeModel {
    fn clone(&self) -> ChangeModel {
        let ChangeModel { groups, block, point, sign, size, large } = self;
        ChangeModel {
            groups: groups.clone(),
            block: block.clone(),
            point: point.clone(),
            sign: sign.clone(),
            size: size.clone(),
            large: large.clone(),
        }
    }

    fn clone_from(&mut self, other: &ChangeModel) {
        let ChangeModel { groups, block, point, sign, size, large } = self;
        groups.clone_from(&other.groups);
        block.clone_from(&other.block);
        point.clone_from(&other.point);
        sign.clone_from(&other.sign);
        size.clone_from(&other.size);
        large.clone_from(&other.large);
    }
}

impl<const N: usize> Clone for ContextMixer<N> {
    fn clone(&self) -> ContextMixer<N> {
        ContextMixer { tables: self.tables.clone(), mixer: self.mixer.clone() }
    }

    fn clone_from(&mut self, other: &ContextMixer<N>) {
        self.tables.clone_from(&other.tables);
        self.mixer.clone_from(&other.mixer);
    }
}

impl<const N: usize> ContextMixer<N> {
    pub(crate) fn new(sizes: [usize; N], situations: usize, one: u32) -> ContextMixer<N> {
        ContextMixer {
            tables: sizes.map(|size| vec![BitModel::new(one); size]),
            mixer: Mixer::new(situations),
        }
    }

    /// Returns the number of heap bytes in use.
    fn heap_bytes(&self) -> usize {
        self.tables.iter().map(memory::list).sum::<usize>() + self.mixer.heap_bytes()
    }

    fn push_words(&self, words: &mut Vec<u32>) {
        words.extend(self.tables.iter().flatten().map(|model| model.0));
        words.extend(self.mixer.weights.iter().flatten().map(|weight| *weight as u32));
    }

    fn take_words(&mut self, words: &mut impl Iterator<Item = (usize, u32)>) -> Result<(), (usize, u32)> {
        take_models(self.tables.iter_mut().flatten(), words)?;
        for (weight, (at, word)) in self.mixer.weights.iter_mut().flatten().zip(words) {
            *weight = word as i32;
            if weight.unsigned_abs() > MAX_WEIGHT.unsigned_abs() {
                return Err((at, word));
            }
        }
        Ok(())
    }

    #[inline]
    pub(crate) fn code<B: BinaryCoder>(
        &mut self,
        logistic: &Logistic,
        coder: &mut B,
        situation: usize,
        at: [usize; N],
        source: bool,
    ) -> bool {
        let inputs = std::array::from_fn(|n| logistic.stretch(self.tables[n][at[n]]));
        let bit = self.mixer.code_inputs(logistic, coder, situation, inputs, source);
        for (table, at) in self.tables.iter_mut().zip(at) {
            table[at].learn(bit);
        }
        bit
    }
}

fn take_models<'a>(
    models: impl IntoIterator<Item = &'a mut BitModel>,
    words: &mut impl Iterator<Item = (usize, u32)>,
) -> Result<(), (usize, u32)> {
    for (model, (at, word)) in models.into_iter().zip(words) {
        *model = BitModel::from_word(word).ok_or((at, word))?;
    }
    Ok(())
}

/// The part of the state before a frame that the models may look at.
#[derive(Clone, Copy)]
pub(crate) struct StateView<'a> {
    pub(crate) layout: &'a Layout,
    /// AO bytes, by padded index.
    pub(crate) values: &'a [u8],
    /// By block: whether its values were received.
    pub(crate) present: &'a [bool],
    pub(crate) history: &'a History,
    /// By set: the points that came with frames.
    pub(crate) geometry: &'a [Option<Arc<Geometry>>],
}

impl ChangeModel {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        let ChangeModel { groups, block, point, sign, size, .. } = self;
        memory::list(groups) + block.heap_bytes() + point.heap_bytes() + sign.heap_bytes() + size.heap_bytes()
    }

    /// Creates a fresh model.
    pub(crate) fn new() -> ChangeModel {
        ChangeModel {
            groups: vec![BitModel::new(1 << 13); 12],
            block: ContextMixer::new([8 * 8 * 8, 65 * 2, 8 * 8], 8, 1 << 13),
            point: ContextMixer::new(
                [9 * 9 * 16, 256 * 3, 16 * 16 * 9, 256 * 12, PARENT_CONTEXTS * 6 * 3],
                36,
                13_107,
            ),
            sign: ContextMixer::new([17 * 9, 17 * 17, 256 * 3, 17 * 3, PARENT_CONTEXTS * 3 * 3], 1, 1 << 15),
            size: ContextMixer::new(
                [12 * UNARY_SIZES * 12, 12 * UNARY_SIZES * 9, 12 * UNARY_SIZES, 512 * UNARY_SIZES],
                UNARY_SIZES,
                26_214,
            ),
            large: NumberModel::new(),
        }
    }

    /// Returns everything learned, as words: the bit models of the groups; for blocks, points, signs and sizes the bit
    /// models of the tables and then the weights, situation after situation; the bit models of large sizes.
    pub(crate) fn words(&self) -> Vec<u32> {
        let mut words = Vec::new();
        words.extend(self.groups.iter().map(|model| model.0));
        self.block.push_words(&mut words);
        self.point.push_words(&mut words);
        self.sign.push_words(&mut words);
        self.size.push_words(&mut words);
        words.extend(self.large.models().map(|model| model.0));
        words
    }

    /// Sets everything learned from the words of [`ChangeModel::words`], of which there are as many. The error has the
    /// index and value of an impossible word.
    pub(crate) fn set_words(&mut self, words: impl Iterator<Item = u32>) -> Result<(), (usize, u32)> {
        let mut words = words.enumerate();
        take_models(&mut self.groups, &mut words)?;
        self.block.take_words(&mut words)?;
        self.point.take_words(&mut words)?;
        self.sign.take_words(&mut words)?;
        self.size.take_words(&mut words)?;
        take_models(self.large.models_mut(), &mut words)
    }

    /// Codes the changes of a frame, and makes them in `next`. A decoder stops after more than `most` changes, or when
    /// `stop` returns true because nothing sensible follows. The error is the first change that does not fit the state.
    pub(crate) fn code<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        view: StateView<'_>,
        source: &Changes,
        (coded, next): (&mut Changes, &mut NextValues),
        most: usize,
        stop: impl Fn(&B) -> bool,
    ) -> Result<(), ChangeError> {
        coded.clear();
        coded.quantum = coder.plain(8, source.quantum.into()) as u8;
        let predictor = Predictor::new(view.layout, view.geometry, view.values, next, coded.quantum);
        let mut coding = ChangeCoder {
            logistic: logistic(),
            model: self,
            coder,
            view,
            source: ChangeCursor::new(source),
            coded,
            predictor,
        };
        let blocks = view.present.len();
        let mut before = false;
        for first in (0..blocks).step_by(GROUP_BLOCKS) {
            let group = first..blocks.min(first + GROUP_BLOCKS);
            before = coding.group(group, before);
            if coding.coded.levels.len() > most || stop(coding.coder) {
                break;
            }
        }
        coding.predictor.finish()
    }
}

/// Reads the changes of an encoder in order. Those of a decoder are empty.
struct ChangeCursor<'a> {
    changes: &'a Changes,
    block: usize,
    level: usize,
}

impl<'a> ChangeCursor<'a> {
    fn new(changes: &'a Changes) -> ChangeCursor<'a> {
        ChangeCursor { changes, block: 0, level: 0 }
    }

    /// Returns whether a block from the next one on, before `end`, changes.
    fn any_before(&self, end: usize) -> bool {
        self.changes.points.blocks.get(self.block).is_some_and(|block| (*block as usize) < end)
    }

    /// Returns the points of this block that change.
    fn mask(&mut self, block: usize) -> u64 {
        if self.changes.points.blocks.get(self.block) != Some(&(block as u32)) {
            return 0;
        }
        self.block += 1;
        self.changes.points.masks[self.block - 1]
    }

    fn level(&mut self) -> i16 {
        self.level += 1;
        self.changes.levels.get(self.level - 1).copied().unwrap_or(0)
    }
}

/// The past: the eight points coded before, in this frame.
#[derive(Clone, Copy, Default)]
struct Past {
    /// Points that changed; the nearest is the lowest bit.
    changed: u8,
    /// Points among them that became darker.
    darker: u8,
    /// Sizes of the changes, a byte each; the nearest is the lowest.
    sizes: u64,
}

impl Past {
    #[inline]
    fn push(&mut self, level: i16) {
        self.changed = self.changed << 1 | u8::from(level != 0);
        self.darker = self.darker << 1 | u8::from(level < 0);
        self.sizes = self.sizes << 8 | u64::from(level.unsigned_abs().min(255));
    }
}

/// What earlier frames tell about the points of a block and those next to it.
struct BlockNeighbours {
    /// Points that changed in the last frame: bit 4 is the first of the block, bits 0 to 3 are those before it.
    recent: u128,
    darker: u128,
    /// Faded activity, from four points before the first of the block on.
    activity: [u8; BLOCK_POINTS + 8],
    /// Sums of the faded activity of all points before.
    sums: [u16; BLOCK_POINTS + 9],
}

/// A point while it is coded.
#[derive(Clone, Copy)]
struct PointContext {
    index: PaddedIndex,
    instance: usize,
    /// Whether it is the first of its instance.
    alone: bool,
    /// What its parents predict.
    change: Prediction,
    /// Its byte by that prediction.
    value: u8,
}

struct ChangeCoder<'a, B: BinaryCoder> {
    logistic: &'static Logistic,
    model: &'a mut ChangeModel,
    coder: &'a mut B,
    view: StateView<'a>,
    source: ChangeCursor<'a>,
    coded: &'a mut Changes,
    predictor: Predictor<'a>,
}

impl<B: BinaryCoder> ChangeCoder<'_, B> {
    /// Codes a group of blocks and returns whether any of them changed. `before` is that result for the previous
    /// group.
    fn group(&mut self, group: std::ops::Range<usize>, before: bool) -> bool {
        let view = self.view;
        if !view.present[group.clone()].contains(&true) {
            return false;
        }
        let active = view.history.recent[group.clone()].iter().filter(|mask| **mask != 0).count();
        self.coder.set_class(SymbolClass::Blocks);
        let model = &mut self.model.groups[significant(active) * 2 + usize::from(before)];
        let any_changed = self.coder.bit(model.one(), self.source.any_before(group.end));
        model.learn(any_changed);
        let mut past = Past::default();
        for block in group.filter(|block| view.present[*block]) {
            if any_changed {
                past = self.block(block, past);
            } else {
                let predicted = self.predictor.block(block);
                self.predictor.follow(block, &predicted);
            }
        }
        any_changed
    }

    /// Codes a block and returns the past after it. `past` is that of the block before, if it is of the same instance
    /// and group.
    fn block(&mut self, block: usize, past: Past) -> Past {
        let recent = &self.view.history.recent;
        let count = |mask: u64| significant(mask.count_ones() as usize);
        let own = recent[block].count_ones() as usize;
        let next = recent.get(block + 1).map_or(0, |mask| count(*mask));
        let coded = self.coded.points.blocks.last().zip(self.coded.points.masks.last());
        let before = match coded {
            Some((last, mask)) if *last as usize + 1 == block => count(*mask),
            _ => 0,
        };
        let predicted = self.predictor.block(block);
        let at = [
            (significant(own) * 8 + before) * 8 + next,
            own * 2 + usize::from(before > 0),
            significant(predicted.moved).min(7) * 8 + significant(own),
        ];
        let mask = self.source.mask(block);
        self.coder.set_class(SymbolClass::Blocks);
        let any_changed = self.model.block.code(self.logistic, self.coder, significant(own), at, mask != 0);
        if !any_changed {
            self.predictor.follow(block, &predicted);
            return Past::default();
        }
        let first = block * BLOCK_POINTS;
        let instance = self.view.layout.owner(block);
        let range = self.view.layout.padded_range(instance);
        let neighbours = self.neighbours(block, &range);
        let mut past = if first == range.start { Past::default() } else { past };
        for index in first..range.end.min(first + BLOCK_POINTS) {
            let changes = mask >> (index - first) & 1 == 1;
            let alone = index == range.start;
            let index = PaddedIndex(index);
            let change = self.predictor.change(&predicted, index);
            let value = self.predictor.predicted(index, change);
            let level = self.point(
                PointContext { index, instance, alone, change, value },
                &neighbours,
                past,
                changes,
            );
            self.predictor.set(index, value, level);
            if level != 0 {
                self.coded.push(index, level);
            }
            past.push(level);
        }
        past
    }

    fn neighbours(&self, block: usize, range: &std::ops::Range<usize>) -> BlockNeighbours {
        let history = self.view.history;
        let first = block * BLOCK_POINTS;
        let window = |masks: &[u64]| {
            let before = if first > range.start { masks[block - 1] >> 60 } else { 0 };
            let after = if first + BLOCK_POINTS < range.end { masks[block + 1] & 15 } else { 0 };
            u128::from(before) | u128::from(masks[block]) << 4 | u128::from(after) << 68
        };
        let mut activity = [0; BLOCK_POINTS + 8];
        for (at, activity) in activity.iter_mut().enumerate() {
            let index = first + at;
            if index >= range.start + 4 && index < range.end + 4 {
                *activity = history.faded_activity(PaddedIndex(index - 4));
            }
        }
        let mut sums = [0; BLOCK_POINTS + 9];
        for (at, activity) in activity.iter().enumerate() {
            sums[at + 1] = sums[at] + u16::from(*activity);
        }
        BlockNeighbours { recent: window(&history.recent), darker: window(&history.darker), activity, sums }
    }

    /// Codes a point and returns its level, 0 if none is sent.
    #[inline]
    fn point(&mut self, point: PointContext, neighbours: &BlockNeighbours, past: Past, source: bool) -> i16 {
        let PointContext { index, instance, alone, change, value } = point;
        let history = self.view.history;
        let place = index.0 % BLOCK_POINTS;
        // Four points to either side, without the point itself.
        let side = |window: u128| ((window >> place) as u32 & 0b1_1110_1111).count_ones() as usize;
        let recent = side(neighbours.recent);
        let darker = side(neighbours.darker);
        let now = past.changed.count_ones() as usize;
        let few = [0, 1, 2, 3, 4, 4, 5, 5, 5][now];
        let value = usize::from(value);
        let parents = parent_context(change);
        let (age, last) = (history.age[index.0], history.last[index.0]);
        let phase = phase(age, history.period[index.0]);
        let own = neighbours.activity[place + 4];
        let near = u32::from(neighbours.sums[place + 9] - neighbours.sums[place] - u16::from(own)) / 8;
        let nearest = if alone { 2 } else { usize::from(past.changed & 1) };
        let at = [
            (now * 9 + recent) * 16 + phase,
            value * 3 + nearest,
            (half_octave(own.into()) * 16 + half_octave(near)) * 9 + now,
            (instance & 255) * 12 + few * 2 + usize::from(age == 0),
            (parents * 6 + few) * 3 + nearest,
        ];
        let situation = few * 6 + age_class(age);
        self.coder.set_class(SymbolClass::Points);
        if !self.model.point.code(self.logistic, self.coder, situation, at, source) {
            return 0;
        }
        let level = if source { self.source.level() } else { 0 };
        let balance = 8 + now - 2 * past.darker.count_ones() as usize;
        let trend = 8 + recent - 2 * darker;
        let last_sign = (i32::from(last.signum()) + 1) as usize;
        let near_sign = match (past.changed & 1, past.darker & 1) {
            (0, _) => 1,
            (_, 1) => 0,
            _ => 2,
        };
        let darkens = match value {
            255 => true,
            0 => false,
            _ => {
                let at = [
                    balance * 9 + last_sign * 3 + near_sign,
                    balance * 17 + trend,
                    value * 3 + last_sign,
                    trend * 3 + last_sign,
                    (parents * 3 + near_sign) * 3 + last_sign,
                ];
                self.coder.set_class(SymbolClass::Signs);
                self.model.sign.code(self.logistic, self.coder, 0, at, level < 0)
            }
        };
        let sizes: usize = past.sizes.to_le_bytes().iter().map(|size| usize::from(*size)).sum();
        let usual = (2 * sizes).checked_div(now).map_or(0, |mean| significant(mean).min(11));
        let at = |step: usize| {
            [
                (usual * UNARY_SIZES + step) * 12 + significant(usize::from(last.unsigned_abs())),
                (usual * UNARY_SIZES + step) * 9 + significant(own.into()),
                step * 12 + usize::from(history.recent_level(index).unsigned_abs()).min(11),
                (value * 2 + usize::from(darkens)) * UNARY_SIZES + step,
            ]
        };
        let size = self.size(at, level.unsigned_abs().saturating_sub(1).into()) as i16;
        if darkens { -1 - size } else { 1 + size }
    }

    /// Codes the size of a change minus 1.
    #[inline]
    fn size(&mut self, at: impl Fn(usize) -> [usize; 4], source: u32) -> u32 {
        self.coder.set_class(SymbolClass::Sizes);
        for step in 0..UNARY_SIZES {
            let more = (step as u32) < source;
            if !self.model.size.code(self.logistic, self.coder, step, at(step), more) {
                return step as u32;
            }
        }
        let beyond = source.saturating_sub(UNARY_SIZES as u32);
        let beyond = self.model.large.code(self.coder, beyond);
        // A level that is too large stays too large. It is refused with the others.
        beyond.min(MAX_LEVEL as u32) + UNARY_SIZES as u32
    }
}

/// Number of contexts of what the parents did.
const PARENT_CONTEXTS: usize = 9 * 5;

/// Returns the context of what the parents of a point did: their mean change, signed, and how far they disagree.
#[inline]
fn parent_context(change: Prediction) -> usize {
    let size = match change.mean.unsigned_abs() {
        0 => 0,
        1..=2 => 1,
        3..=5 => 2,
        6..=10 => 3,
        _ => 4,
    };
    let mean = if change.mean < 0 { 4 - size } else { 4 + size };
    let spread = match change.spread {
        0 => 0,
        1..=4 => 1,
        5..=9 => 2,
        10..=19 => 3,
        _ => 4,
    };
    mean * 5 + spread
}

/// Returns the number of significant bits: 0, 1, 2, 2, 3 ..
#[inline]
fn significant(value: usize) -> usize {
    (usize::BITS - value.leading_zeros()) as usize
}

/// Returns a class of a number, two an octave and 16 for bytes: 0, 1, 2, 3, 4-5, 6-7, 8-11, 12-15 ..
#[inline]
fn half_octave(value: u32) -> usize {
    if value < 4 {
        return value as usize;
    }
    let high = value.ilog2();
    (2 * high + (value >> (high - 1) & 1)) as usize
}

/// Returns the class of an age, of six.
#[inline]
fn age_class(age: u8) -> usize {
    match age {
        0 => 0,
        1 => 1,
        2..=3 => 2,
        4..=7 => 3,
        8..=20 => 4,
        _ => 5,
    }
}

/// Returns the phase of a point between regular changes: the quarters of its last period that have passed, at most 13.
/// It is 14 if the last change is too long ago, and 15 if there was at most one.
#[inline]
fn phase(age: u8, period: u8) -> usize {
    match (age, period) {
        (_, NEVER) => 15,
        (NEVER, _) => 14,
        _ => ((u32::from(age) + 1) * 4 / (u32::from(period) + 1)).min(13) as usize,
    }
}
