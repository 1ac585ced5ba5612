//! Model of values for the range coder: AO that arrives for the first time, or again with a keyframe.
//!
//! Of each point it codes whether it has a value, and then how many quanta it is from its prediction.

use super::change::ContextMixer;
use crate::range::{BinaryCoder, BitModel, NumberModel, logistic};
use crate::surface::arrival::{ArrivalPredictor, PointGuess};
use crate::surface::section::values::{
    ArrivalCheck, ClientValues, ValueError, Values, arrival_byte, arrival_level, nearest_level,
};
use crate::surface::{Layout, MAX_LEVELS, NO_VALUE};

/// What the range coder learns of the values of one frame, section after section. Every frame starts a fresh model.
pub(crate) struct ValueModel {
    numbers: NumberModel,
    /// Whether a point has no value.
    missing: [BitModel; 18],
    levels: ContextMixer<4>,
    large: NumberModel,
    recent: Recent,
}

/// The levels of the points coded before, in this frame.
#[derive(Debug, Clone, Copy, Default)]
struct Recent {
    /// The last one and the one before it.
    levels: [i16; 2],
    /// How many of the last values were equal to those of the sibling, at most 3.
    alike: usize,
}

/// Decisions of a level: whether it is 0, its sign, then whether its size is larger than 1, 2 ..
const DECISIONS: usize = 14;
/// Sizes beyond this one are coded as a number.
const UNARY_SIZES: u16 = 12;
/// Number of classes of what the sibling tells: -8 to 8 quanta, and none.
const SIBLING_CLASSES: usize = 18;

impl ValueModel {
    pub(crate) fn new() -> ValueModel {
        let half = 1 << 15;
        ValueModel {
            numbers: NumberModel::new(),
            missing: [BitModel::new(1 << 12); 18],
            levels: ContextMixer::new(
                [
                    7 * 6 * DECISIONS,
                    SIBLING_CLASSES * 4 * DECISIONS,
                    32 * MAX_LEVELS * DECISIONS,
                    5 * 5 * 3 * DECISIONS,
                ],
                DECISIONS,
                half,
            ),
            large: NumberModel::new(),
            recent: Recent::default(),
        }
    }

    /// Codes values; `records` is their number. What clients have is updated.
    pub(crate) fn code<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        layout: &Layout,
        clients: ClientValues<'_>,
        (source, coded): (&Values, &mut Values),
        records: u32,
        stop: impl Fn(&B) -> bool,
    ) -> Result<(), ValueError> {
        let ClientValues { geometry, bytes: values, present } = clients;
        coded.clear();
        let quantum = coder.plain(8, source.quantum.into()) as u8;
        if quantum == 0 {
            return Err(ValueError::Quantum);
        }
        coded.quantum = quantum;
        let mut known = present.to_vec();
        self.runs(coder, ArrivalCheck::new(layout, present, records), (source, coded))?;
        let mut targets = source.targets();
        let mut arrivals = ArrivalPredictor::new(layout, geometry, values);
        for (first, count) in coded.runs.clone() {
            for block in first as usize..(first + count) as usize {
                arrivals.block(block, &known, |guess| {
                    let byte = self.point(coder, quantum, guess, targets.next().unwrap_or_default());
                    coded.bytes.push(byte);
                    byte
                });
                known[block] = true;
                if stop(coder) {
                    return Err(ValueError::Ends { field: "the values", offset: coded.bytes.len() });
                }
            }
        }
        Ok(())
    }

    fn runs<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        mut arrivals: ArrivalCheck<'_>,
        (source, coded): (&Values, &mut Values),
    ) -> Result<(), ValueError> {
        let count = self.numbers.code(coder, source.runs.len() as u32);
        let mut end = 0_u32;
        for run in 0..count as usize {
            let (first, count) = source.runs.get(run).copied().unwrap_or((0, 0));
            let gap = self.numbers.code_signed(coder, first.wrapping_sub(end) as i32);
            let first = end.wrapping_add_signed(gap);
            let count = self.numbers.code(coder, count);
            arrivals.add((first, count))?;
            end = first + count;
            coded.runs.push((first, count));
        }
        arrivals.end()
    }

    /// Codes a point and returns its byte.
    fn point<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        quantum: u8,
        guess: PointGuess,
        (target, threshold): (u8, u8),
    ) -> u8 {
        let class = |byte: Option<u8>| byte.map_or(0, |byte| if byte == NO_VALUE { 1 } else { 2 });
        let at = (class(guess.before) * 3 + class(guess.sibling)) * 2 + usize::from(guess.spread.is_some());
        let missing = coder.bit(self.missing[at].one(), target == NO_VALUE);
        self.missing[at].learn(missing);
        let byte = if missing {
            NO_VALUE
        } else {
            let level = arrival_level(target, guess.predicted, threshold, quantum);
            let level = self.level(coder, quantum, guess, level);
            self.recent.levels = [level, self.recent.levels[0]];
            arrival_byte(guess.predicted, level, quantum)
        };
        self.recent.alike = if guess.sibling == Some(byte) { (self.recent.alike + 1).min(3) } else { 0 };
        byte
    }

    /// Codes the level of a point with a value.
    fn level<B: BinaryCoder>(&mut self, coder: &mut B, quantum: u8, guess: PointGuess, source: i16) -> i16 {
        let Recent { levels: [last, before], alike } = self.recent;
        let size = |level: i16| significant(level.unsigned_abs().into()).min(4);
        let activity = significant(u32::from(last.unsigned_abs()) + u32::from(before.unsigned_abs())).min(5);
        let spread = guess.spread.map_or(6, |spread| significant(u32::from(spread / 2)).min(5));
        let sibling = guess
            .sibling
            .filter(|byte| *byte != NO_VALUE)
            .map_or(17, |byte| (nearest_level(byte, guess.predicted, quantum).clamp(-8, 8) + 8) as usize);
        let rows = [
            spread * 6 + activity,
            sibling * 4 + alike,
            usize::from(guess.predicted / 8) * MAX_LEVELS + usize::from(guess.level),
            (size(last) * 5 + size(before)) * 3 + (last.signum() + 1) as usize,
        ];
        let mut decide = |decision: usize, bit: bool| {
            let at = rows.map(|row| row * DECISIONS + decision);
            self.levels.code(logistic(), coder, decision, at, bit)
        };
        if !decide(0, source != 0) {
            return 0;
        }
        let darker = match guess.predicted {
            255 => true,
            1 => false,
            _ => decide(1, source < 0),
        };
        let wanted = source.unsigned_abs();
        let mut size = 1;
        while size <= UNARY_SIZES && decide(1 + usize::from(size), wanted > size) {
            size += 1;
        }
        if size > UNARY_SIZES {
            size += self.large.code(coder, u32::from(wanted.saturating_sub(size))).min(255) as u16;
        }
        if darker { -(size as i16) } else { size as i16 }
    }
}

/// Returns the number of significant bits: 0, 1, 2, 2, 3 ..
fn significant(value: u32) -> usize {
    (u32::BITS - value.leading_zeros()) as usize
}
