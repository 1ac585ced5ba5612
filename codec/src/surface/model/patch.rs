//! Model of patches for the range coder: which blocks, which points, then their bytes. Each byte is coded as a
//! difference from the mean of its parents and of its neighbours: those to the left, and those to the right that the patch
//! does not name. Both ends know these bytes whatever the client's last frame is. They do not share the earlier bytes of
//! named points.
//!
//! Each context paid on traces of two scenes. More inputs for which points change gained nothing.

use std::ops::Range;
use std::sync::Arc;

use super::change::ContextMixer;
use crate::range::{BinaryCoder, BitModel, NumberModel, SymbolClass, logistic};
use crate::surface::parents::Prediction;
use crate::surface::section::changes::ChangeError;
use crate::surface::section::patch::Patch;
use crate::surface::section::point_mask::{PointMask, SetBits};
use crate::surface::{BLOCK_POINTS, Geometry, Layout, PaddedIndex};

/// Number of blocks that one decision can skip.
const GROUP_BLOCKS: usize = 16;
/// Weights of the neighbours to either side from which a byte is guessed, the nearest first.
const NEIGHBOUR_WEIGHTS: [u32; 3] = [6, 3, 2];
/// Weight of the mean of the parents.
const PARENTS_WEIGHT: u32 = 12;
/// Number of classes of a difference of bytes. The class is the number of significant bits.
const DIFFERENCE_CLASSES: usize = 9;
/// Number of classes of the distance between the byte coded before and the guess, in eighths: -16 to 16.
const LEAN_CLASSES: usize = 33;

/// What the range coder learns of a patch. Every patch starts a fresh model.
pub(crate) struct PatchModel {
    numbers: NumberModel,
    groups: [BitModel; 2],
    blocks: [BitModel; 8],
    points: ContextMixer<2>,
    bytes: ByteModel,
}

/// What it learns of the bytes, and the last ones.
struct ByteModel {
    sizes: ContextMixer<4>,
    signs: ContextMixer<4>,
    seconds: [BitModel; DIFFERENCE_CLASSES],
    /// The last byte; 255 before the first.
    last: u8,
    /// Classes of the last two differences, the latest first.
    classes: [usize; 2],
    /// Signs before: whether the last bytes that differed from their guess were below it. The latest is the lowest
    /// bit.
    signs_before: usize,
}

impl PatchModel {
    pub(crate) fn new() -> PatchModel {
        let half = 1 << 15;
        PatchModel {
            numbers: NumberModel::new(),
            groups: [BitModel::new(half); 2],
            blocks: [BitModel::new(half); 8],
            points: ContextMixer::new([256, 9], 1, 1 << 14),
            bytes: ByteModel {
                sizes: ContextMixer::new(
                    [
                        DIFFERENCE_CLASSES * 8,
                        DIFFERENCE_CLASSES * DIFFERENCE_CLASSES * 8,
                        32 * 8,
                        LEAN_CLASSES * 8,
                    ],
                    8,
                    half,
                ),
                signs: ContextMixer::new([32, 8 * 4, LEAN_CLASSES * 2, 64], 8, half),
                seconds: [BitModel::new(half); DIFFERENCE_CLASSES],
                last: 255,
                classes: [0; 2],
                signs_before: 0,
            },
        }
    }

    /// Codes the number of frames that a patch reaches back. It comes before all else.
    pub(crate) fn back<B: BinaryCoder>(&mut self, coder: &mut B, source: u32) -> u32 {
        self.numbers.code(coder, source)
    }

    /// Codes the runs of blocks that arrived. A decoder refuses more than `most` of them.
    pub(crate) fn arrivals<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        blocks: usize,
        (source, coded): (&[(u32, u32)], &mut Patch),
        most: usize,
    ) -> Result<(), ChangeError> {
        coded.arrivals.clear();
        let runs = self.numbers.code(coder, source.len() as u32) as usize;
        if runs > most {
            return Err(ChangeError::Count { expected: most as u32, found: runs });
        }
        let mut end = 0_u32;
        for run in 0..runs {
            let (first, count) = source.get(run).copied().unwrap_or((end, 0));
            let first = end.wrapping_add(self.numbers.code(coder, first.wrapping_sub(end)));
            let count = self.numbers.code(coder, count);
            coded.push_run((first, count), blocks)?;
            end = first + count;
        }
        Ok(())
    }

    /// Codes the points of a patch. `values` has the bytes of all padded indices and is updated; the old bytes of
    /// named points are not used. A decoder stops after more than `most` points, or when `stop` returns true because
    /// nothing sensible follows.
    pub(crate) fn code<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        (layout, present): (&Layout, &[bool]),
        (geometry, values): (&[Option<Arc<Geometry>>], &mut [u8]),
        (source, coded): (&Patch, &mut Patch),
        most: usize,
        stop: impl Fn(&B) -> bool,
    ) {
        coded.points.clear();
        coded.bytes.clear();
        self.points(coder, (layout, present), (&source.points, &mut coded.points), most, &stop);
        let mut given = source.bytes.iter();
        for (block, mask) in coded.points.iter() {
            if stop(coder) {
                return;
            }
            let block = block as usize;
            let owner = layout.owner(block);
            let instance = layout.padded_range(owner);
            let geometry = geometry[layout.members()[owner].set as usize].as_ref();
            let parents =
                geometry.and_then(|geometry| geometry.parents(block - instance.start / BLOCK_POINTS));
            let start = instance.start;
            let first = block * BLOCK_POINTS;
            let continues = first > instance.start && present[block - 1];
            let range = if continues { instance } else { first..instance.end };
            for at in SetBits(mask) {
                let index = PaddedIndex::new(block, at as usize);
                let given = given.next().copied().unwrap_or(0);
                let parents = parents.and_then(|parents| parents.points[at as usize].value(&values[start..]));
                let byte =
                    self.bytes.code(coder, &Neighbours::of(values, &range, index, mask, parents), given);
                values[index.0] = byte;
                coded.bytes.push(byte);
            }
        }
    }

    /// Codes which points the patch names.
    fn points<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        (layout, present): (&Layout, &[bool]),
        (source, coded): (&PointMask, &mut PointMask),
        most: usize,
        stop: impl Fn(&B) -> bool,
    ) {
        let mut given = source.iter().peekable();
        let (mut count, mut before) = (0, false);
        for first in (0..present.len()).step_by(GROUP_BLOCKS) {
            let group = first..present.len().min(first + GROUP_BLOCKS);
            if !present[group.clone()].contains(&true) {
                continue;
            }
            coder.set_class(SymbolClass::Blocks);
            let model = &mut self.groups[usize::from(before)];
            before =
                coder.bit(model.one(), given.peek().is_some_and(|(block, _)| (*block as usize) < group.end));
            model.learn(before);
            for block in group.filter(|block| before && present[*block]) {
                let given = given.next_if(|(given, _)| *given as usize == block).map_or(0, |(_, mask)| mask);
                let prior = coded.iter().next_back().filter(|(last, _)| *last as usize + 1 == block);
                let mask =
                    self.mask(coder, layout.block_len(block), prior.map_or(0, |(_, mask)| mask), given);
                if mask != 0 {
                    coded.blocks.push(block as u32);
                    coded.masks.push(mask);
                    count += mask.count_ones() as usize;
                }
            }
            if count > most || stop(coder) {
                return;
            }
        }
    }

    /// Codes which of the `points` points of a block are named. `prior` has those of the block numbered one lower.
    fn mask<B: BinaryCoder>(&mut self, coder: &mut B, points: usize, prior: u64, source: u64) -> u64 {
        coder.set_class(SymbolClass::Blocks);
        let model = &mut self.blocks[significant(prior.count_ones())];
        let any = coder.bit(model.one(), source != 0);
        model.learn(any);
        if !any {
            return 0;
        }
        coder.set_class(SymbolClass::Points);
        // The nearest is the lowest bit.
        let mut past = (prior >> 56) as u8;
        past = past.reverse_bits();
        let mut mask = 0;
        for at in 0..points {
            let inputs = [usize::from(past), past.count_ones() as usize];
            let bit = self.points.code(logistic(), coder, 0, inputs, source >> at & 1 == 1);
            mask |= u64::from(bit) << at;
            past = past << 1 | u8::from(bit);
        }
        mask
    }
}

impl ByteModel {
    /// Codes one byte.
    fn code<B: BinaryCoder>(&mut self, coder: &mut B, neighbours: &Neighbours, source: u8) -> u8 {
        let guess = neighbours.guess;
        let difference = i32::from(source) - i32::from(guess);
        let lean = (16 + (i32::from(self.last) - i32::from(guess)) / 8).clamp(0, 32) as usize;
        coder.set_class(SymbolClass::Sizes);
        let class = self.class(coder, neighbours, lean, significant(difference.unsigned_abs()));
        self.classes = [class, self.classes[0]];
        self.last = guess;
        if class > 0 {
            coder.set_class(SymbolClass::Signs);
            let darker = self.darker(coder, guess, class, lean, difference < 0);
            coder.set_class(SymbolClass::Sizes);
            let size = self.rest(coder, class, difference.unsigned_abs()) as u8;
            self.signs_before = self.signs_before << 1 & 63 | usize::from(darker);
            self.last = if darker { guess.wrapping_sub(size) } else { guess.wrapping_add(size) };
        }
        self.last
    }

    /// Codes the class of a difference: its number of significant bits, 0 to 8.
    fn class<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        neighbours: &Neighbours,
        lean: usize,
        source: usize,
    ) -> usize {
        let [last, before] = self.classes;
        for class in 0..DIFFERENCE_CLASSES - 1 {
            let at = [
                significant(neighbours.spread.into()) * 8 + class,
                (last * DIFFERENCE_CLASSES + before) * 8 + class,
                usize::from(neighbours.guess / 8) * 8 + class,
                lean * 8 + class,
            ];
            if !self.sizes.code(logistic(), coder, class, at, class < source) {
                return class;
            }
        }
        DIFFERENCE_CLASSES - 1
    }

    /// Codes the sign of a difference: whether a byte is below its guess.
    fn darker<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        guess: u8,
        class: usize,
        lean: usize,
        source: bool,
    ) -> bool {
        let at = [
            usize::from(guess / 8),
            (class - 1) * 4 + (self.signs_before & 3),
            lean * 2 + (self.signs_before & 1),
            self.signs_before,
        ];
        match guess {
            255 => true,
            0 => false,
            _ => self.signs.code(logistic(), coder, class - 1, at, source),
        }
    }

    /// Codes the size of a difference of a known class.
    fn rest<B: BinaryCoder>(&mut self, coder: &mut B, class: usize, source: u32) -> u32 {
        let Some(below) = (class as u32).checked_sub(2) else { return 1 };
        let model = &mut self.seconds[class];
        let second = coder.bit(model.one(), source >> below & 1 == 1);
        model.learn(second);
        (2 | u32::from(second)) << below | coder.plain(below, source & ((1 << below) - 1))
    }
}

/// What the neighbours of a point tell.
struct Neighbours {
    /// Weighted mean of their bytes and the parents' mean; 255 if there are none.
    guess: u8,
    /// Difference of their largest and smallest byte; 255 if there are none.
    spread: u8,
}

impl Neighbours {
    /// Returns the neighbours of a point of whose block the patch names `mask`. Only neighbours in `range` count.
    fn of(
        values: &[u8],
        range: &Range<usize>,
        index: PaddedIndex,
        mask: u64,
        parents: Option<Prediction>,
    ) -> Neighbours {
        let PaddedIndex(index) = index;
        let at = index % BLOCK_POINTS;
        let end = range.end.min(index - at + BLOCK_POINTS);
        let (mut sum, mut weights) = (0, 0);
        let (mut low, mut high) = (255, 0);
        let mut note = |byte: u8, weight: u32| {
            sum += u32::from(byte) * weight;
            weights += weight;
            (low, high) = (low.min(byte), high.max(byte));
        };
        for (distance, weight) in (1..).zip(NEIGHBOUR_WEIGHTS) {
            if index >= range.start + distance {
                note(values[index - distance], weight);
            }
            if index + distance < end && mask >> (at + distance) & 1 == 0 {
                note(values[index + distance], weight);
            }
        }
        if let Some(parents) = parents {
            note(parents.mean as u8, PARENTS_WEIGHT);
        }
        if weights == 0 {
            return Neighbours { guess: 255, spread: 255 };
        }
        Neighbours { guess: ((sum + weights / 2) / weights) as u8, spread: high - low }
    }
}

/// Returns the number of significant bits: 0, 1, 2, 2, 3 ..
fn significant(value: u32) -> usize {
    (u32::BITS - value.leading_zeros()) as usize
}
