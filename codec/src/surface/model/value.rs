//! Model of values for the range coder: AO that arrives for the first time, or again with a keyframe.
//!
//! Each byte is eight decisions, high bit first. Their inputs are the values before it along the curve, and the value
//! at the same place of the previous instance of the same set.

use crate::range::{BinaryCoder, NumberModel, logistic};
use crate::surface::model::change::ContextMixer;
use crate::surface::section::values::{ArrivalCheck, ClientValues, ValueError, Values};
use crate::surface::{BLOCK_POINTS, Layout};

/// What the range coder learns of the values of one frame, section after section. Every frame starts a fresh model.
pub(crate) struct ValueModel {
    numbers: NumberModel,
    bytes: ContextMixer<4>,
}

/// Number of earlier points that are looked at.
const PAST_VALUES: usize = 8;
/// Their weights in the mean, the nearest first.
const MEAN_WEIGHTS: [u32; 3] = [2, 1, 1];
/// Stands for an unknown value.
const UNKNOWN_VALUE: u8 = 255;

impl ValueModel {
    pub(crate) fn new() -> ValueModel {
        let half = 1 << 15;
        ValueModel {
            numbers: NumberModel::new(),
            bytes: ContextMixer::new([64 * 256, 64 * 256, 129 * 4 * 256, 16 * 256], 8 * 4, half),
        }
    }

    /// Codes values; `records` is their number. `values` has the bytes of all padded indices, and `present` tells
    /// which blocks were there before. Both are updated.
    pub(crate) fn code<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        layout: &Layout,
        clients: ClientValues<'_>,
        (source, coded): (&Values, &mut Values),
        records: u32,
        stop: impl Fn(&B) -> bool,
    ) -> Result<(), ValueError> {
        let ClientValues { bytes: values, present } = clients;
        coded.clear();
        let count = self.numbers.code(coder, source.runs.len() as u32);
        let before = present.to_vec();
        let mut arrivals = ArrivalCheck::new(layout, present, records);
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
        arrivals.end()?;
        let mut known = before;
        let mut taken = 0;
        for (first, count) in coded.runs.clone() {
            for block in first as usize..(first + count) as usize {
                self.block(
                    coder,
                    layout,
                    values,
                    &known,
                    block,
                    source.bytes.get(taken..).unwrap_or_default(),
                );
                let range = block * BLOCK_POINTS..block * BLOCK_POINTS + layout.block_len(block);
                taken += range.len();
                coded.bytes.extend_from_slice(&values[range]);
                known[block] = true;
                if stop(coder) {
                    return Err(ValueError::Ends { field: "the values", offset: coded.bytes.len() });
                }
            }
        }
        Ok(())
    }

    fn block<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        layout: &Layout,
        values: &mut [u8],
        known: &[bool],
        block: usize,
        source: &[u8],
    ) {
        let instance = layout.owner(block);
        let first = block * BLOCK_POINTS;
        let blocks = layout.blocks_of(instance as u32);
        let mut past = [UNKNOWN_VALUE; PAST_VALUES];
        if block > blocks.start && known[block - 1] {
            past = std::array::from_fn(|n| values[first - 1 - n]);
        }
        let sibling = layout
            .previous_of_set(instance)
            .map(|sibling| layout.blocks_of(sibling).start + block - blocks.start);
        let sibling = sibling.filter(|sibling| known[*sibling]).map(|sibling| sibling * BLOCK_POINTS);
        // How many of the last values were equal to those of the sibling.
        let mut alike = 0;
        for at in 0..layout.block_len(block) {
            let sibling = sibling.map(|sibling| values[sibling + at]);
            let source = source.get(at).copied().unwrap_or(0);
            let value = self.byte(coder, &past, sibling, alike, source);
            values[first + at] = value;
            past.copy_within(0..PAST_VALUES - 1, 1);
            past[0] = value;
            alike = if sibling == Some(value) { (alike + 1).min(3) } else { 0 };
        }
    }

    fn byte<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        past: &[u8; PAST_VALUES],
        sibling: Option<u8>,
        alike: usize,
        source: u8,
    ) -> u8 {
        let mean: u32 = past.iter().zip(MEAN_WEIGHTS).map(|(value, weight)| u32::from(*value) * weight).sum();
        let rough: u32 = past.windows(2).take(4).map(|pair| u32::from(pair[0].abs_diff(pair[1]))).sum();
        let rough = (32 - rough.leading_zeros()) as usize;
        let sibling = sibling.map_or(128, |sibling| usize::from(sibling / 2));
        let open = usize::from(past[0] == 255) * 2 + usize::from(past[1] == 255);
        let mut node = 1;
        for depth in 0..8 {
            let at = [
                (mean / 16) as usize * 256 + node,
                usize::from(past[0] / 4) * 256 + node,
                (sibling * 4 + alike) * 256 + node,
                rough * 256 + node,
            ];
            let bit = source >> (7 - depth) & 1 == 1;
            let bit = self.bytes.code(logistic(), coder, depth * 4 + open, at, bit);
            node = node << 1 | usize::from(bit);
        }
        node as u8
    }
}
