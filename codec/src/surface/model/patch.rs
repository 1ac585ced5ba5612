//! Patches by the range coder: which blocks, which points, then their bytes, each as its difference from what the points
//! around it have: those to the left, and those to the right that the patch leaves alone. Both sides know these, whichever
//! frame a client is at; what the points had before, they do not.
//!
//! The contexts are those that paid on traces of two scenes. More opinions on which points change gained nothing.

use std::ops::Range;

use super::change::Opinions;
use crate::range::{Bits, Number, Slot, Subject, logistic};
use crate::surface::section::marks::{Marks, SetBits};
use crate::surface::section::patch::Patch;
use crate::surface::{BLOCK_POINTS, Layout};

/// Blocks that one decision can pass over.
const GROUP: usize = 16;
/// Points to either side that a byte is guessed from, and how much each counts, the nearest first.
const WEIGHTS: [u32; 3] = [6, 3, 2];
/// Classes of a difference of bytes: how many significant bits it has.
const CLASSES: usize = 9;
/// Classes of how far the byte coded before is from the guess, in eighths: -16 to 16.
const LEANS: usize = 33;

/// What the range coder learns of one patch. It starts afresh with every one.
pub(crate) struct PatchModel {
    numbers: Number,
    groups: [Slot; 2],
    blocks: [Slot; 8],
    points: Opinions<2>,
    bytes: ByteModel,
}

/// What it learns of the bytes, and what the last ones were.
struct ByteModel {
    sizes: Opinions<4>,
    signs: Opinions<4>,
    seconds: [Slot; CLASSES],
    /// The last byte; 255 before the first.
    last: u8,
    /// Classes of the last two differences, the latest first.
    classes: [usize; 2],
    /// Whether the last bytes that were not as guessed were darker, the latest in the lowest bit.
    ways: usize,
}

impl PatchModel {
    pub(crate) fn new() -> PatchModel {
        let half = 1 << 15;
        PatchModel {
            numbers: Number::new(),
            groups: [Slot::new(half); 2],
            blocks: [Slot::new(half); 8],
            points: Opinions::new([256, 9], 1, 1 << 14),
            bytes: ByteModel {
                sizes: Opinions::new([CLASSES * 8, CLASSES * CLASSES * 8, 32 * 8, LEANS * 8], 8, half),
                signs: Opinions::new([32, 8 * 4, LEANS * 2, 64], 8, half),
                seconds: [Slot::new(half); CLASSES],
                last: 255,
                classes: [0; 2],
                ways: 0,
            },
        }
    }

    /// Codes how far a patch reaches back; it goes before all else.
    pub(crate) fn back<B: Bits>(&mut self, bits: &mut B, wanted: u32) -> u32 {
        self.numbers.code(bits, wanted)
    }

    /// Codes the points of a patch. A writer gives it in `wanted`; both sides find it in `found`. `values` has the bytes of
    /// all slots, and is brought up to date; those of slots that change are not looked at before. A reader stops after more
    /// than `most` points, or when `stop` says that nothing sensible follows.
    pub(crate) fn code<B: Bits>(
        &mut self,
        bits: &mut B,
        (layout, present): (&Layout, &[bool]),
        values: &mut [u8],
        (wanted, found): (&Patch, &mut Patch),
        most: usize,
        stop: impl Fn(&B) -> bool,
    ) {
        found.clear();
        self.marks(bits, (layout, present), (&wanted.marks, &mut found.marks), most, &stop);
        let mut given = wanted.bytes.iter();
        for (block, mask) in found.marks.iter() {
            if stop(bits) {
                return;
            }
            let block = block as usize;
            let instance = layout.slots_of(layout.owner(block));
            let first = block * BLOCK_POINTS;
            let goes_on = first > instance.start && present[block - 1];
            let slots = if goes_on { instance } else { first..instance.end };
            for at in SetBits(mask) {
                let slot = first + at as usize;
                let given = given.next().copied().unwrap_or(0);
                let byte = self.bytes.code(bits, &Around::of(values, &slots, slot, mask), given);
                values[slot] = byte;
                found.bytes.push(byte);
            }
        }
    }

    /// Codes which points.
    fn marks<B: Bits>(
        &mut self,
        bits: &mut B,
        (layout, present): (&Layout, &[bool]),
        (wanted, found): (&Marks, &mut Marks),
        most: usize,
        stop: impl Fn(&B) -> bool,
    ) {
        let mut given = wanted.iter().peekable();
        let (mut count, mut before) = (0, false);
        for first in (0..present.len()).step_by(GROUP) {
            let group = first..present.len().min(first + GROUP);
            if !present[group.clone()].contains(&true) {
                continue;
            }
            bits.about(Subject::Blocks);
            let slot = &mut self.groups[usize::from(before)];
            before =
                bits.bit(slot.one(), given.peek().is_some_and(|(block, _)| (*block as usize) < group.end));
            slot.learn(before);
            for block in group.filter(|block| before && present[*block]) {
                let given = given.next_if(|(given, _)| *given as usize == block).map_or(0, |(_, mask)| mask);
                let prior = found.iter().next_back().filter(|(last, _)| *last as usize + 1 == block);
                let mask = self.mask(bits, layout.block_len(block), prior.map_or(0, |(_, mask)| mask), given);
                if mask != 0 {
                    found.blocks.push(block as u32);
                    found.masks.push(mask);
                    count += mask.count_ones() as usize;
                }
            }
            if count > most || stop(bits) {
                return;
            }
        }
    }

    /// Codes which of the `points` of a block; `prior` are those of the block numbered one lower.
    fn mask<B: Bits>(&mut self, bits: &mut B, points: usize, prior: u64, wanted: u64) -> u64 {
        bits.about(Subject::Blocks);
        let slot = &mut self.blocks[significant(prior.count_ones())];
        let any = bits.bit(slot.one(), wanted != 0);
        slot.learn(any);
        if !any {
            return 0;
        }
        bits.about(Subject::Points);
        // The nearest in the lowest bit.
        let mut past = (prior >> 56) as u8;
        past = past.reverse_bits();
        let mut mask = 0;
        for at in 0..points {
            let opinions = [usize::from(past), past.count_ones() as usize];
            let bit = self.points.code(logistic(), bits, 0, opinions, wanted >> at & 1 == 1);
            mask |= u64::from(bit) << at;
            past = past << 1 | u8::from(bit);
        }
        mask
    }
}

impl ByteModel {
    /// Codes one byte.
    fn code<B: Bits>(&mut self, bits: &mut B, around: &Around, wanted: u8) -> u8 {
        let guess = around.guess;
        let difference = i32::from(wanted) - i32::from(guess);
        let lean = (16 + (i32::from(self.last) - i32::from(guess)) / 8).clamp(0, 32) as usize;
        bits.about(Subject::Sizes);
        let class = self.class(bits, around, lean, significant(difference.unsigned_abs()));
        self.classes = [class, self.classes[0]];
        self.last = guess;
        if class > 0 {
            bits.about(Subject::Ways);
            let darker = self.darker(bits, guess, class, lean, difference < 0);
            bits.about(Subject::Sizes);
            let size = self.rest(bits, class, difference.unsigned_abs()) as u8;
            self.ways = self.ways << 1 & 63 | usize::from(darker);
            self.last = if darker { guess.wrapping_sub(size) } else { guess.wrapping_add(size) };
        }
        self.last
    }

    /// Codes how many significant bits a difference has, 0 to 8.
    fn class<B: Bits>(&mut self, bits: &mut B, around: &Around, lean: usize, wanted: usize) -> usize {
        let [last, before] = self.classes;
        for class in 0..CLASSES - 1 {
            let at = [
                significant(around.spread.into()) * 8 + class,
                (last * CLASSES + before) * 8 + class,
                usize::from(around.guess / 8) * 8 + class,
                lean * 8 + class,
            ];
            if !self.sizes.code(logistic(), bits, class, at, class < wanted) {
                return class;
            }
        }
        CLASSES - 1
    }

    /// Codes whether a byte is below the guess.
    fn darker<B: Bits>(&mut self, bits: &mut B, guess: u8, class: usize, lean: usize, wanted: bool) -> bool {
        let at = [
            usize::from(guess / 8),
            (class - 1) * 4 + (self.ways & 3),
            lean * 2 + (self.ways & 1),
            self.ways,
        ];
        match guess {
            255 => true,
            0 => false,
            _ => self.signs.code(logistic(), bits, class - 1, at, wanted),
        }
    }

    /// Codes a difference of which the significant bits are counted.
    fn rest<B: Bits>(&mut self, bits: &mut B, class: usize, wanted: u32) -> u32 {
        let Some(below) = (class as u32).checked_sub(2) else { return 1 };
        let slot = &mut self.seconds[class];
        let second = bits.bit(slot.one(), wanted >> below & 1 == 1);
        slot.learn(second);
        (2 | u32::from(second)) << below | bits.plain(below, wanted & ((1 << below) - 1))
    }
}

/// What is known around a point.
struct Around {
    /// The weighted mean of the bytes there; 255 if there are none.
    guess: u8,
    /// How far they are apart.
    spread: u8,
}

impl Around {
    /// What is known around a slot, in whose block the points of `mask` come; of other `slots` nothing is looked at.
    fn of(values: &[u8], slots: &Range<usize>, slot: usize, mask: u64) -> Around {
        let at = slot % BLOCK_POINTS;
        let end = slots.end.min(slot - at + BLOCK_POINTS);
        let (mut sum, mut weights) = (0, 0);
        let (mut low, mut high) = (255, 0);
        let mut note = |byte: u8, weight: u32| {
            sum += u32::from(byte) * weight;
            weights += weight;
            (low, high) = (low.min(byte), high.max(byte));
        };
        for (distance, weight) in (1..).zip(WEIGHTS) {
            if slot >= slots.start + distance {
                note(values[slot - distance], weight);
            }
            if slot + distance < end && mask >> (at + distance) & 1 == 0 {
                note(values[slot + distance], weight);
            }
        }
        if weights == 0 {
            return Around { guess: 255, spread: 255 };
        }
        Around { guess: ((sum + weights / 2) / weights) as u8, spread: high - low }
    }
}

/// Significant bits of a number: 0, 1, 2, 2, 3 ..
fn significant(value: u32) -> usize {
    (u32::BITS - value.leading_zeros()) as usize
}
