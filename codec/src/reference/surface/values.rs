//! AO of blocks that come.

use super::{Block, Bytes, Refused, Spot, index, rule, significant, varint_bytes};
use crate::range::{Mixer, Number, RangeDecoder, Slot, logistic};
use crate::surface::{BLOCK_POINTS, State};

/// What the range coder learns of the values of one frame.
pub(super) struct Coder {
    numbers: Number,
    tables: [Vec<Slot>; 4],
    mixer: Mixer<4>,
}

impl Coder {
    pub(super) fn new() -> Coder {
        let table = |contexts: usize| vec![Slot::new(1 << 15); contexts * 256];
        Coder {
            numbers: Number::new(),
            tables: [table(64), table(64), table(129 * 4), table(16)],
            mixer: Mixer::new(8 * 4),
        }
    }
}

/// Reads a VALUES section into `next`.
pub(super) fn read(next: &mut State, block: Block<'_>, coder: &mut Coder) -> Result<(), Refused> {
    let spots = Spot::all(next.layout());
    let expected = block.section.records as usize;
    if let Some(mut bits) = block.bits() {
        let mut runs = Vec::new();
        let mut end = 0_i64;
        for _ in 0..coder.numbers.code(&mut bits, 0) {
            let first = end + i64::from(coder.numbers.code_signed(&mut bits, 0));
            let count = coder.numbers.code(&mut bits, 0);
            let first = u32::try_from(first).map_err(|_| Refused::Rule)?;
            claim(next, &spots, &mut runs, (first, count))?;
            end = i64::from(first) + i64::from(count);
        }
        rule(points(&runs, &spots) == expected)?;
        let mut known: Vec<bool> = next.present.clone();
        for block in blocks(&runs) {
            known[block] = false;
        }
        for block in blocks(&runs) {
            read_block(next, &spots, &known, block, coder, &mut bits);
            known[block] = true;
        }
        let numbers: usize = runs.iter().map(|run| varint_bytes(run.0) + varint_bytes(run.1)).sum();
        return block.end(bits, varint_bytes(runs.len() as u32) + numbers + expected);
    }
    let raw = block.raw()?;
    let mut bytes = Bytes(&raw);
    let mut runs = Vec::new();
    for _ in 0..bytes.varint()? {
        let run = (bytes.varint()?, bytes.varint()?);
        claim(next, &spots, &mut runs, run)?;
    }
    rule(points(&runs, &spots) == expected)?;
    for block in blocks(&runs) {
        for point in 0..spots[block].points {
            next.values[block * BLOCK_POINTS + point] = bytes.take(1)?[0];
        }
    }
    bytes.end()
}

/// Notes a run of blocks, none of which may have come before.
fn claim(
    next: &mut State,
    spots: &[Spot],
    runs: &mut Vec<(u32, u32)>,
    run: (u32, u32),
) -> Result<(), Refused> {
    let blocks = u64::from(run.0)..u64::from(run.0) + u64::from(run.1);
    rule(run.1 > 0 && blocks.end <= spots.len() as u64)?;
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

fn points(runs: &[(u32, u32)], spots: &[Spot]) -> usize {
    blocks(runs).into_iter().map(|block| spots[block].points).sum()
}

/// Decodes the bytes of a block, point by point; `known` says which blocks have theirs already.
fn read_block(
    next: &mut State,
    spots: &[Spot],
    known: &[bool],
    block: usize,
    coder: &mut Coder,
    bits: &mut RangeDecoder<'_>,
) {
    let Spot { instance, number, points } = spots[block];
    let twin = twin_of(next, spots, instance, number).filter(|twin| known[*twin]);
    for point in 0..points {
        let slot = block * BLOCK_POINTS + point;
        // The eight values before this one in the block and the one before it, the nearest first.
        let before = |back: usize| {
            let here = back <= point || number > 0 && known[block - 1];
            if here { next.values[slot - back] } else { 255 }
        };
        let past: Vec<usize> = (1..=8).map(|back| usize::from(before(back))).collect();
        let same = |point: usize| {
            twin.map(|twin| {
                next.values[twin * BLOCK_POINTS + point] == next.values[block * BLOCK_POINTS + point]
            })
        };
        let alike = (0..point).rev().take(3).take_while(|before| same(*before) == Some(true)).count();
        let twin = twin.map(|twin| usize::from(next.values[twin * BLOCK_POINTS + point]));
        next.values[slot] = read_byte(&past, twin, alike, coder, bits);
    }
}

/// The same block of the last instance before this one that has the same set.
fn twin_of(state: &State, spots: &[Spot], instance: usize, number: usize) -> Option<usize> {
    let members = state.layout().members();
    let twin = (0..instance).rev().find(|other| members[*other].set == members[instance].set)?;
    spots.iter().position(|spot| spot.instance == twin && spot.number == number)
}

fn read_byte(
    past: &[usize],
    twin: Option<usize>,
    alike: usize,
    coder: &mut Coder,
    bits: &mut RangeDecoder<'_>,
) -> u8 {
    let steps: usize = (0..4).map(|at| past[at].abs_diff(past[at + 1])).sum();
    let open = 2 * usize::from(past[0] == 255) + usize::from(past[1] == 255);
    // The bits so far, after a leading 1.
    let mut node = 1;
    for depth in 0..8 {
        let at = [
            index([((2 * past[0] + past[1] + past[2]) / 16, 64), (node, 256)]),
            index([(past[0] / 4, 64), (node, 256)]),
            index([(twin.map_or(128, |twin| twin / 2), 129), (alike, 4), (node, 256)]),
            index([(significant(steps as u64), 16), (node, 256)]),
        ];
        let [a, b, c, d] = &mut coder.tables;
        let slots = [&mut a[at[0]], &mut b[at[1]], &mut c[at[2]], &mut d[at[3]]];
        let situation = index([(depth, 8), (open, 4)]);
        node = 2 * node + usize::from(coder.mixer.code(logistic(), bits, situation, slots, false));
    }
    (node - 256) as u8
}
