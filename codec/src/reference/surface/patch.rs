//! PATCH sections: the newest AO of points, for clients that missed frames.

use std::collections::BTreeSet;

use super::changes::read_point_mask;
use super::parents::{self, Parent};
use super::{Block, BlockInfo, ByteReader, ReferenceError, index, rule, significant, varint_bytes};
use crate::envelope::FrameIndex;
use crate::range::{BinaryCoder, BitModel, Mixer, NumberModel, RangeDecoder, logistic};
use crate::surface::{BLOCK_POINTS, State};

/// Reads a PATCH section of frame `frame` into `next`, which holds what `state` does.
pub(super) fn read(
    state: &State,
    next: &mut State,
    frame: FrameIndex,
    block: Block<'_>,
) -> Result<(), ReferenceError> {
    let last = state.frame().map_or(0, |last| u64::from(last.0));
    let reaches = |back: u32| back <= frame.0 && last + u64::from(back) >= u64::from(frame.0);
    let blocks_info = BlockInfo::all(state.layout());
    let expected = block.section.records as usize;
    let Some(decoder) = block.decoder() else {
        let raw = block.raw()?;
        let mut bytes = ByteReader(&raw);
        rule(reaches(bytes.varint()?))?;
        let mut runs = Vec::new();
        for _ in 0..bytes.varint()? {
            runs.push((bytes.varint()?, bytes.varint()?));
        }
        let arrived = claim(next, &runs)?;
        let named = read_point_mask(&mut bytes, state.present.len())?;
        rule(named.len() == expected)?;
        let mut points = BTreeSet::new();
        for padded in named {
            rule(next.present[padded / BLOCK_POINTS] && is_point(&blocks_info, padded))?;
            next.values[padded] = bytes.take(1)?[0];
            points.insert(padded);
        }
        rule(are_complete(&points, &arrived, &blocks_info))?;
        return bytes.end();
    };
    let mut patch = PatchDecoder::new(decoder);
    let mut numbers = NumberModel::new();
    let back = numbers.code(&mut patch.decoder, 0);
    rule(reaches(back))?;
    let count = numbers.code(&mut patch.decoder, 0);
    rule(count as usize <= expected)?;
    let mut runs: Vec<(u32, u32)> = Vec::new();
    for _ in 0..count {
        let end = runs.last().map_or(0, |(first, count)| first + count);
        let first = end.checked_add(numbers.code(&mut patch.decoder, 0)).ok_or(ReferenceError::Rule)?;
        runs.push((first, numbers.code(&mut patch.decoder, 0)));
        let last = runs.last().map(|(first, count)| (*count, first.checked_add(*count)));
        rule(last.is_some_and(|(count, end)| {
            count > 0 && end.is_some_and(|end| end as usize <= blocks_info.len())
        }))?;
    }
    let arrived = claim(next, &runs)?;
    patch.points(next, &blocks_info);
    let named: Vec<usize> = (0..patch.named.len()).filter(|padded| patch.named[*padded]).collect();
    rule(named.len() == expected)?;
    rule(are_complete(&named.iter().copied().collect(), &arrived, &blocks_info))?;
    // The points whose bytes both ends know.
    let mut known: Vec<bool> = (0..patch.named.len())
        .map(|padded| {
            next.present[padded / BLOCK_POINTS] && is_point(&blocks_info, padded) && !patch.named[padded]
        })
        .collect();
    let parents = parents::of_state(state);
    let mut blocks = 0;
    for (at, padded) in named.iter().enumerate() {
        blocks += usize::from(at == 0 || named[at - 1] / BLOCK_POINTS < padded / BLOCK_POINTS);
        let near = around(next, &blocks_info, &known, (*padded, &parents[*padded]));
        next.values[*padded] = patch.byte(near);
        known[*padded] = true;
    }
    let run_bytes: usize =
        runs.iter().map(|(first, count)| varint_bytes(*first) + varint_bytes(*count)).sum();
    let head_bytes = varint_bytes(back) + varint_bytes(count) + run_bytes;
    let bytes = head_bytes + state.present.len().div_ceil(8) + 8 * blocks + named.len();
    block.end(patch.decoder, bytes)
}

/// Claims runs of blocks that arrived, in ascending order. Returns their blocks.
fn claim(next: &mut State, runs: &[(u32, u32)]) -> Result<Vec<usize>, ReferenceError> {
    let mut arrived: Vec<usize> = Vec::new();
    for (first, count) in runs {
        let blocks = *first as usize..*first as usize + *count as usize;
        rule(!blocks.is_empty() && blocks.end <= next.present.len())?;
        rule(arrived.last().is_none_or(|last| *last < blocks.start))?;
        next.present[blocks.clone()].fill(true);
        arrived.extend(blocks);
    }
    Ok(arrived)
}

/// Returns whether all points of some blocks are in a set.
fn are_complete(points: &BTreeSet<usize>, blocks: &[usize], blocks_info: &[BlockInfo]) -> bool {
    let mut all = blocks
        .iter()
        .flat_map(|block| (0..blocks_info[*block].points).map(move |at| block * BLOCK_POINTS + at));
    all.all(|padded| points.contains(&padded))
}

fn is_point(blocks_info: &[BlockInfo], padded: usize) -> bool {
    padded % BLOCK_POINTS < blocks_info[padded / BLOCK_POINTS].points
}

/// Returns guess and spread: of the known bytes of three points to either side, but none beyond the end of the block, and
/// of the mean of the parents that have a value.
fn around(
    next: &State,
    blocks_info: &[BlockInfo],
    known: &[bool],
    (padded, parents): (usize, &[Parent]),
) -> (u8, u8) {
    let block = padded / BLOCK_POINTS;
    let mut seen = Vec::new();
    for (distance, weight) in [(1, 6), (2, 3), (3, 2)] {
        let before = padded.checked_sub(distance);
        let before =
            before.filter(|other| blocks_info[other / BLOCK_POINTS].instance == blocks_info[block].instance);
        let after = Some(padded + distance).filter(|other| other / BLOCK_POINTS == block);
        for other in before.into_iter().chain(after).filter(|other| known[*other]) {
            seen.push((u32::from(next.values[other]), weight));
        }
    }
    if let Some(mean) = parents::mean_value(parents, &next.values) {
        seen.push((mean.mean as u32, 12));
    }
    let (Some((low, _)), Some((high, _))) = (seen.iter().min(), seen.iter().max()) else { return (255, 255) };
    let weights: u32 = seen.iter().map(|(_, weight)| weight).sum();
    let sum: u32 = seen.iter().map(|(byte, weight)| byte * weight).sum();
    (((2 * sum + weights) / (2 * weights)) as u8, (high - low) as u8)
}

struct PatchDecoder<'a> {
    decoder: RangeDecoder<'a>,
    groups: Vec<BitModel>,
    blocks: Vec<BitModel>,
    points: ([Vec<BitModel>; 2], Mixer<2>),
    sizes: ([Vec<BitModel>; 4], Mixer<4>),
    signs: ([Vec<BitModel>; 4], Mixer<4>),
    seconds: Vec<BitModel>,
    /// By padded index: whether the patch names the point.
    named: Vec<bool>,
    /// The bytes so far, the classes of their differences, and the signs of the differences that are not 0.
    coded: Vec<u8>,
    classes: Vec<usize>,
    coded_signs: Vec<bool>,
}

impl<'a> PatchDecoder<'a> {
    fn new(decoder: RangeDecoder<'a>) -> PatchDecoder<'a> {
        let half = |count| vec![BitModel::new(1 << 15); count];
        let rare = |count| vec![BitModel::new(1 << 14); count];
        PatchDecoder {
            decoder,
            groups: half(2),
            blocks: half(8),
            points: ([rare(256), rare(9)], Mixer::new(1)),
            sizes: ([half(72), half(648), half(256), half(264)], Mixer::new(8)),
            signs: ([half(32), half(32), half(66), half(64)], Mixer::new(8)),
            seconds: half(9),
            named: Vec::new(),
            coded: Vec::new(),
            classes: Vec::new(),
            coded_signs: Vec::new(),
        }
    }

    /// Reads which points the patch names.
    fn points(&mut self, state: &State, blocks_info: &[BlockInfo]) {
        self.named = vec![false; state.values.len()];
        let mut before = false;
        let blocks: Vec<usize> = (0..blocks_info.len()).collect();
        for group in blocks.chunks(16) {
            let here: Vec<usize> = group.iter().copied().filter(|block| state.present[*block]).collect();
            if here.is_empty() {
                continue;
            }
            before = decide_plainly(&mut self.decoder, &mut self.groups[usize::from(before)]);
            for block in here.into_iter().filter(|_| before) {
                self.block(block, blocks_info[block].points);
            }
        }
    }

    fn block(&mut self, block: usize, points: usize) {
        let first = block * BLOCK_POINTS;
        let prior = self.named[first.saturating_sub(BLOCK_POINTS)..first].iter().filter(|named| **named);
        let class = significant(prior.count() as u64);
        if !decide_plainly(&mut self.decoder, &mut self.blocks[class]) {
            return;
        }
        for padded in first..first + points {
            // The eight points before: the nearest is worth 1, the next 2, and so on.
            let before: Vec<bool> = (1..=8)
                .map(|back| padded.checked_sub(back).is_some_and(|padded| self.named[padded]))
                .collect();
            let pattern = (0..8).map(|at| usize::from(before[at]) << at).sum::<usize>();
            let count = before.iter().filter(|named| **named).count();
            let ([a, b], mixer) = &mut self.points;
            let inputs = [&mut a[pattern], &mut b[count]];
            self.named[padded] = mixer.code(logistic(), &mut self.decoder, 0, inputs, false);
        }
    }

    /// Reads a byte.
    fn byte(&mut self, (guess, spread): (u8, u8)) -> u8 {
        let last = self.coded.last().copied().unwrap_or(255);
        let lean = ((i32::from(last) - i32::from(guess)) / 8).clamp(-16, 16) + 16;
        let lean = lean as usize;
        let class = self.class(guess, spread, lean);
        let mut byte = guess;
        if class > 0 {
            let darker = match guess {
                255 => true,
                0 => false,
                _ => self.darker(guess, class, lean),
            };
            let mut size = 1_u8;
            if class > 1 {
                size = 2 + u8::from(decide_plainly(&mut self.decoder, &mut self.seconds[class]));
                for _ in 2..class {
                    size = 2 * size + self.decoder.plain(1, 0) as u8;
                }
            }
            byte = if darker { guess.wrapping_sub(size) } else { guess.wrapping_add(size) };
            self.coded_signs.push(darker);
        }
        self.classes.push(class);
        self.coded.push(byte);
        byte
    }

    fn class(&mut self, guess: u8, spread: u8, lean: usize) -> usize {
        let mut past = self.classes.iter().rev().copied().chain([0, 0]);
        let (last, before) = (past.next().unwrap_or(0), past.next().unwrap_or(0));
        let mut class = 0;
        while class < 8 {
            let at = [
                index([(significant(spread.into()), 9), (class, 8)]),
                index([(last, 9), (before, 9), (class, 8)]),
                index([(usize::from(guess) / 8, 32), (class, 8)]),
                index([(lean, 33), (class, 8)]),
            ];
            if !decide_mixed(&mut self.decoder, &mut self.sizes, class, at) {
                break;
            }
            class += 1;
        }
        class
    }

    fn darker(&mut self, guess: u8, class: usize, lean: usize) -> bool {
        let sign = |back: usize| self.coded_signs.iter().rev().nth(back).is_some_and(|darker| *darker);
        let past = |count: usize| (0..count).map(|back| usize::from(sign(back)) << back).sum::<usize>();
        let at = [
            index([(usize::from(guess) / 8, 32)]),
            index([(class - 1, 8), (past(2), 4)]),
            index([(lean, 33), (past(1), 2)]),
            index([(past(6), 64)]),
        ];
        decide_mixed(&mut self.decoder, &mut self.signs, class - 1, at)
    }
}

fn decide_plainly(decoder: &mut RangeDecoder<'_>, model: &mut BitModel) -> bool {
    let yes = decoder.bit(model.one(), false);
    model.learn(yes);
    yes
}

fn decide_mixed(
    decoder: &mut RangeDecoder<'_>,
    (tables, mixer): &mut ([Vec<BitModel>; 4], Mixer<4>),
    situation: usize,
    at: [usize; 4],
) -> bool {
    let [a, b, c, d] = tables;
    mixer.code(
        logistic(),
        decoder,
        situation,
        [&mut a[at[0]], &mut b[at[1]], &mut c[at[2]], &mut d[at[3]]],
        false,
    )
}
