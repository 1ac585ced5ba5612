//! VALUES sections: AO of point blocks that arrive.

use super::{Block, BlockInfo, ByteReader, ReferenceError, index, rule, significant, varint_bytes};
use crate::range::{BitModel, Mixer, NumberModel, RangeDecoder, logistic};
use crate::surface::{BLOCK_POINTS, State};

/// What the range coder learns of the values of one frame.
pub(super) struct ValueDecoder {
    numbers: NumberModel,
    tables: [Vec<BitModel>; 4],
    mixer: Mixer<4>,
}

impl ValueDecoder {
    pub(super) fn new() -> ValueDecoder {
        let table = |contexts: usize| vec![BitModel::new(1 << 15); contexts * 256];
        ValueDecoder {
            numbers: NumberModel::new(),
            tables: [table(64), table(64), table(129 * 4), table(16)],
            mixer: Mixer::new(8 * 4),
        }
    }
}

/// Reads a VALUES section into `next`.
pub(super) fn read(
    next: &mut State,
    block: Block<'_>,
    models: &mut ValueDecoder,
) -> Result<(), ReferenceError> {
    let blocks_info = BlockInfo::all(next.layout());
    let expected = block.section.records as usize;
    if let Some(mut decoder) = block.decoder() {
        let mut runs = Vec::new();
        let mut end = 0_i64;
        for _ in 0..models.numbers.code(&mut decoder, 0) {
            let first = end + i64::from(models.numbers.code_signed(&mut decoder, 0));
            let count = models.numbers.code(&mut decoder, 0);
            let first = u32::try_from(first).map_err(|_| ReferenceError::Rule)?;
            claim(next, &blocks_info, &mut runs, (first, count))?;
            end = i64::from(first) + i64::from(count);
        }
        rule(points(&runs, &blocks_info) == expected)?;
        let mut known: Vec<bool> = next.present.clone();
        for block in blocks(&runs) {
            known[block] = false;
        }
        for block in blocks(&runs) {
            read_block(next, &blocks_info, &known, block, models, &mut decoder);
            known[block] = true;
        }
        let numbers: usize = runs.iter().map(|run| varint_bytes(run.0) + varint_bytes(run.1)).sum();
        return block.end(decoder, varint_bytes(runs.len() as u32) + numbers + expected);
    }
    let raw = block.raw()?;
    let mut bytes = ByteReader(&raw);
    let mut runs = Vec::new();
    for _ in 0..bytes.varint()? {
        let run = (bytes.varint()?, bytes.varint()?);
        claim(next, &blocks_info, &mut runs, run)?;
    }
    rule(points(&runs, &blocks_info) == expected)?;
    for block in blocks(&runs) {
        for point in 0..blocks_info[block].points {
            next.values[block * BLOCK_POINTS + point] = bytes.take(1)?[0];
        }
    }
    bytes.end()
}

/// Claims a run of blocks, none of which may have arrived before.
fn claim(
    next: &mut State,
    blocks_info: &[BlockInfo],
    runs: &mut Vec<(u32, u32)>,
    run: (u32, u32),
) -> Result<(), ReferenceError> {
    let blocks = u64::from(run.0)..u64::from(run.0) + u64::from(run.1);
    rule(run.1 > 0 && blocks.end <= blocks_info.len() as u64)?;
    for block in blocks {
        rule(!next.present[block as usize])?;
        next.present[block as usize] = true;
    }
    runs.push(run);
    Ok(())
}

fn blocks(runs: &[(u32, u32)]) -> Vec<usize> {
    runs.iter().flat_map(|(first, count)| (*first as usize..).take(*count as usize)).collect()
}

fn points(runs: &[(u32, u32)], blocks_info: &[BlockInfo]) -> usize {
    blocks(runs).into_iter().map(|block| blocks_info[block].points).sum()
}

/// Decodes the bytes of a block, point by point. `known` tells which blocks have their bytes already.
fn read_block(
    next: &mut State,
    blocks_info: &[BlockInfo],
    known: &[bool],
    block: usize,
    models: &mut ValueDecoder,
    decoder: &mut RangeDecoder<'_>,
) {
    let BlockInfo { instance, number, points } = blocks_info[block];
    let sibling = sibling_of(next, blocks_info, instance, number).filter(|sibling| known[*sibling]);
    for point in 0..points {
        let padded = block * BLOCK_POINTS + point;
        // The eight values before this one in the block and the one before it, the nearest first.
        let before = |back: usize| {
            let here = back <= point || number > 0 && known[block - 1];
            if here { next.values[padded - back] } else { 255 }
        };
        let past: Vec<usize> = (1..=8).map(|back| usize::from(before(back))).collect();
        let same = |point: usize| {
            sibling.map(|sibling| {
                next.values[sibling * BLOCK_POINTS + point] == next.values[block * BLOCK_POINTS + point]
            })
        };
        let alike = (0..point).rev().take(3).take_while(|before| same(*before) == Some(true)).count();
        let sibling = sibling.map(|sibling| usize::from(next.values[sibling * BLOCK_POINTS + point]));
        next.values[padded] = read_byte(&past, sibling, alike, models, decoder);
    }
}

/// Returns the same block of the previous instance of the same set.
fn sibling_of(state: &State, blocks_info: &[BlockInfo], instance: usize, number: usize) -> Option<usize> {
    let members = state.layout().members();
    let sibling = (0..instance).rev().find(|other| members[*other].set == members[instance].set)?;
    blocks_info.iter().position(|info| info.instance == sibling && info.number == number)
}

fn read_byte(
    past: &[usize],
    sibling: Option<usize>,
    alike: usize,
    models: &mut ValueDecoder,
    decoder: &mut RangeDecoder<'_>,
) -> u8 {
    let steps: usize = (0..4).map(|at| past[at].abs_diff(past[at + 1])).sum();
    let open = 2 * usize::from(past[0] == 255) + usize::from(past[1] == 255);
    // The bits so far, after a leading 1.
    let mut node = 1;
    for depth in 0..8 {
        let at = [
            index([((2 * past[0] + past[1] + past[2]) / 16, 64), (node, 256)]),
            index([(past[0] / 4, 64), (node, 256)]),
            index([(sibling.map_or(128, |sibling| sibling / 2), 129), (alike, 4), (node, 256)]),
            index([(significant(steps as u64), 16), (node, 256)]),
        ];
        let [a, b, c, d] = &mut models.tables;
        let inputs = [&mut a[at[0]], &mut b[at[1]], &mut c[at[2]], &mut d[at[3]]];
        let situation = index([(depth, 8), (open, 4)]);
        node = 2 * node + usize::from(models.mixer.code(logistic(), decoder, situation, inputs, false));
    }
    (node - 256) as u8
}
