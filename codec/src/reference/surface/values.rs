//! VALUES sections: AO of point blocks that arrive.

use super::parents::{self, Mean, Parent};
use super::{Block, BlockInfo, ByteReader, ReferenceError, index, rule, significant, varint_bytes};
use crate::range::{BinaryCoder, BitModel, Mixer, NumberModel, RangeDecoder, logistic};
use crate::surface::{BLOCK_POINTS, NO_VALUE, State};

/// What the range coder learns of the values of one frame.
pub(super) struct ValueDecoder {
    numbers: NumberModel,
    missing: Vec<BitModel>,
    tables: [Vec<BitModel>; 4],
    mixer: Mixer<4>,
    large: NumberModel,
    /// Levels of the points with a value so far.
    levels: Vec<i32>,
    /// Of every point so far: whether its byte is that of its sibling.
    alike: Vec<bool>,
}

impl ValueDecoder {
    pub(super) fn new() -> ValueDecoder {
        let table = |contexts: usize| vec![BitModel::new(1 << 15); contexts * 14];
        ValueDecoder {
            numbers: NumberModel::new(),
            missing: vec![BitModel::new(1 << 12); 3 * 3 * 2],
            tables: [table(7 * 6), table(18 * 4), table(32 * 12), table(5 * 5 * 3)],
            mixer: Mixer::new(14),
            large: NumberModel::new(),
            levels: Vec::new(),
            alike: Vec::new(),
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
    let mut arrivals =
        Arrivals { known: next.present.clone(), parents: parents::of_state(next), blocks_info };
    let expected = block.section.records as usize;
    if let Some(mut decoder) = block.decoder() {
        let quantum = decoder.plain(8, 0) as i32;
        rule(quantum > 0)?;
        let runs = read_runs(next, &arrivals.blocks_info, models, &mut decoder)?;
        rule(points(&runs, &arrivals.blocks_info) == expected)?;
        arrivals.read(next, &runs, |guess| Ok(models.byte(&mut decoder, quantum, &guess)))?;
        let numbers: usize = runs.iter().map(|run| varint_bytes(run.0) + varint_bytes(run.1)).sum();
        return block.end(decoder, 1 + varint_bytes(runs.len() as u32) + numbers + expected);
    }
    let raw = block.raw()?;
    let mut bytes = ByteReader(&raw);
    rule(bytes.take(1)?[0] > 0)?;
    let mut runs = Vec::new();
    for _ in 0..bytes.varint()? {
        let run = (bytes.varint()?, bytes.varint()?);
        claim(next, &arrivals.blocks_info, &mut runs, run)?;
    }
    rule(points(&runs, &arrivals.blocks_info) == expected)?;
    arrivals.read(next, &runs, |guess| Ok(guess.predicted.wrapping_add(bytes.take(1)?[0])))?;
    bytes.end()
}

fn read_runs(
    next: &mut State,
    blocks_info: &[BlockInfo],
    models: &mut ValueDecoder,
    decoder: &mut RangeDecoder<'_>,
) -> Result<Vec<(u32, u32)>, ReferenceError> {
    let mut runs = Vec::new();
    let mut end = 0_i64;
    for _ in 0..models.numbers.code(decoder, 0) {
        let first = end + i64::from(models.numbers.code_signed(decoder, 0));
        let count = models.numbers.code(decoder, 0);
        let first = u32::try_from(first).map_err(|_| ReferenceError::Rule)?;
        claim(next, blocks_info, &mut runs, (first, count))?;
        end = i64::from(first) + i64::from(count);
    }
    Ok(runs)
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

/// Blocks that arrive.
struct Arrivals {
    blocks_info: Vec<BlockInfo>,
    /// By padded index.
    parents: Vec<Vec<Parent>>,
    /// By block: whether its bytes are known already.
    known: Vec<bool>,
}

/// What is known of a point before its byte.
struct Guess {
    /// Of the parents with a value.
    parents: Option<Mean>,
    predicted: u8,
    /// The byte before it in the set, and that of the same point of the previous instance of the set.
    before: Option<u8>,
    sibling: Option<u8>,
    level: usize,
}

impl Arrivals {
    /// Sets every point of the runs to the byte that `byte` returns.
    fn read(
        &mut self,
        next: &mut State,
        runs: &[(u32, u32)],
        mut byte: impl FnMut(Guess) -> Result<u8, ReferenceError>,
    ) -> Result<(), ReferenceError> {
        for block in blocks(runs) {
            for point in 0..self.blocks_info[block].points {
                let guess = self.guess(next, block, point);
                next.values[block * BLOCK_POINTS + point] = byte(guess)?;
            }
            self.known[block] = true;
        }
        Ok(())
    }

    fn guess(&self, next: &State, block: usize, point: usize) -> Guess {
        let BlockInfo { instance, number, .. } = self.blocks_info[block];
        let padded = block * BLOCK_POINTS + point;
        // The points before it in its block and, if that is known, in the block before.
        let known = |back: usize| back <= point || number > 0 && self.known[block - 1];
        let before = |back: usize| known(back).then(|| next.values[padded - back]);
        let parents = parents::mean_value(&self.parents[padded], &next.values);
        let sibling = self.sibling(next, instance, number).filter(|sibling| self.known[*sibling]);
        let set = next.layout().members()[instance].set as usize;
        let ends = next.layout().sets()[set].levels.ends();
        Guess {
            parents,
            predicted: parents.map_or_else(|| without_parents([1, 2, 3].map(before)), |mean| mean.mean as u8),
            before: before(1),
            sibling: sibling.map(|sibling| next.values[sibling * BLOCK_POINTS + point]),
            level: ends.iter().filter(|end| **end as usize <= number * BLOCK_POINTS + point).count(),
        }
    }

    /// Returns the same block of the previous instance of the same set.
    fn sibling(&self, state: &State, instance: usize, number: usize) -> Option<usize> {
        let members = state.layout().members();
        let sibling = (0..instance).rev().find(|other| members[*other].set == members[instance].set)?;
        self.blocks_info.iter().position(|info| info.instance == sibling && info.number == number)
    }
}

/// Returns the prediction of a point of which no parent has a value, from the three bytes before it.
pub(super) fn without_parents(before: [Option<u8>; 3]) -> u8 {
    let open = |byte: Option<u8>| byte.filter(|byte| *byte != NO_VALUE).map_or(255, u32::from);
    let [nearest, second, third] = before.map(open);
    ((nearest + nearest + second + third) / 4) as u8
}

impl ValueDecoder {
    /// Reads the byte of a point.
    fn byte(&mut self, decoder: &mut RangeDecoder<'_>, quantum: i32, guess: &Guess) -> u8 {
        let class = |byte: Option<u8>| match byte {
            None => 0,
            Some(NO_VALUE) => 1,
            Some(_) => 2,
        };
        let with_parents = usize::from(guess.parents.is_some());
        let at = index([(class(guess.before), 3), (class(guess.sibling), 3), (with_parents, 2)]);
        let missing = decoder.bit(self.missing[at].one(), false);
        self.missing[at].learn(missing);
        let mut byte = NO_VALUE;
        if !missing {
            let level = self.level(decoder, quantum, guess);
            self.levels.push(level);
            byte = (i32::from(guess.predicted) + level * quantum).clamp(1, 255) as u8;
        }
        self.alike.push(guess.sibling == Some(byte));
        byte
    }

    fn level(&mut self, decoder: &mut RangeDecoder<'_>, quantum: i32, guess: &Guess) -> i32 {
        let rows = self.rows(quantum, guess);
        let mut decide = |decision: usize| {
            let [a, b, c, d] = &mut self.tables;
            let [row_a, row_b, row_c, row_d] = rows;
            let inputs = [
                &mut a[index([row_a, (decision, 14)])],
                &mut b[index([row_b, (decision, 14)])],
                &mut c[index([row_c, (decision, 14)])],
                &mut d[index([row_d, (decision, 14)])],
            ];
            self.mixer.code(logistic(), decoder, decision, inputs, false)
        };
        if !decide(0) {
            return 0;
        }
        let darker = match guess.predicted {
            255 => true,
            1 => false,
            _ => decide(1),
        };
        let mut size = 1;
        while size <= 12 && decide(1 + size) {
            size += 1;
        }
        if size > 12 {
            size += self.large.code(decoder, 0).min(255) as usize;
        }
        if darker { -(size as i32) } else { size as i32 }
    }

    /// Returns the contexts of a level, each with its number of values.
    fn rows(&self, quantum: i32, guess: &Guess) -> [(usize, usize); 4] {
        let mut past = self.levels.iter().rev().copied().chain([0, 0]);
        let (last, before) = (past.next().unwrap_or(0), past.next().unwrap_or(0));
        let class = |number: i32, most: usize| significant(number.unsigned_abs().into()).min(most);
        let activity = class(last.abs() + before.abs(), 5);
        let spread = guess.parents.map_or(6, |parents| class(parents.spread / 2, 5));
        let away = match guess.sibling {
            None | Some(NO_VALUE) => 17,
            Some(sibling) => {
                let difference = i32::from(sibling) - i32::from(guess.predicted);
                let quanta = (difference.abs() + quantum / 2) / quantum;
                (8 + (quanta * difference.signum()).clamp(-8, 8)) as usize
            }
        };
        let alike = self.alike.iter().rev().take(3).take_while(|alike| **alike).count();
        let sign = (1 + last.signum()) as usize;
        [
            (index([(spread, 7), (activity, 6)]), 7 * 6),
            (index([(away, 18), (alike, 4)]), 18 * 4),
            (index([(usize::from(guess.predicted) / 8, 32), (guess.level, 12)]), 32 * 12),
            (index([(class(last, 4), 5), (class(before, 4), 5), (sign, 3)]), 5 * 5 * 3),
        ]
    }
}
