//! AO of blocks that come for the first time, or again with a keyframe.
//!
//! The plain layout of a VALUES section is a varint, how many runs of blocks there are; for each run two varints, its
//! first block and how many blocks it has; then one byte a point, run after run. By the range coder, each byte is
//! eight decisions, high bit first, with what came before along the curve and what the instance before it of the same
//! set has at the same place as opinions.

use super::change_model::Opinions;
use super::{BLOCK_POINTS, Layout};
use crate::range::{Bits, Number, logistic};
use crate::wire::{VarintFault, read_varint, varint_bytes, write_varint};

/// Blocks and the bytes of their points.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Values {
    /// First block and number of blocks of each run.
    pub(crate) runs: Vec<(u32, u32)>,
    /// Bytes of the points of all runs, in order.
    pub(crate) bytes: Vec<u8>,
}

/// What is wrong with values; an offset counts bytes of the plain layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueProblem {
    /// It ends inside a field.
    #[error("it ends inside {field}, which starts at its byte {offset}")]
    Ends {
        /// The field.
        field: &'static str,
        /// Where the field starts.
        offset: usize,
    },
    /// A run without blocks, with blocks that the layout has not, or with one that came already.
    #[error("{count} blocks from {first} on: none, not the stream's, or here already")]
    Run {
        /// First block.
        first: u32,
        /// Number of blocks.
        count: u32,
    },
    /// Another number of points than the section table says.
    #[error("{found} points, the section table says {expected}")]
    Count {
        /// By the section table.
        expected: u32,
        /// In the section.
        found: usize,
    },
}

impl Values {
    pub(crate) fn clear(&mut self) {
        self.runs.clear();
        self.bytes.clear();
    }

    /// Adds a block after those before it.
    pub(crate) fn push(&mut self, block: usize, bytes: &[u8]) {
        match self.runs.last_mut() {
            Some((first, count)) if (*first + *count) as usize == block => *count += 1,
            _ => self.runs.push((block as u32, 1)),
        }
        self.bytes.extend_from_slice(bytes);
    }

    /// Every block, in order.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|(first, count)| *first as usize..(*first + *count) as usize)
    }

    /// Puts the bytes where they belong in those of all slots.
    pub(crate) fn scatter(&self, layout: &Layout, values: &mut [u8]) {
        let mut rest = self.bytes.as_slice();
        for block in self.blocks() {
            let first = block * BLOCK_POINTS;
            let (bytes, after) = rest.split_at(layout.block_len(block));
            values[first..first + bytes.len()].copy_from_slice(bytes);
            rest = after;
        }
    }

    /// Bytes of the plain layout.
    pub(crate) fn plain_bytes(&self) -> usize {
        let run = |(first, count): &(u32, u32)| varint_bytes(*first) + varint_bytes(*count);
        let runs: usize = self.runs.iter().map(run).sum();
        varint_bytes(self.runs.len() as u32) + runs + self.bytes.len()
    }

    /// Appends the plain layout.
    pub(crate) fn write_plain(&self, out: &mut Vec<u8>) {
        write_varint(out, self.runs.len() as u32);
        for (first, count) in &self.runs {
            write_varint(out, *first);
            write_varint(out, *count);
        }
        out.extend_from_slice(&self.bytes);
    }

    /// Reads the plain layout: `records` points of blocks that `present` does not have yet. Notes the blocks there.
    pub(crate) fn read_plain(
        &mut self,
        raw: &[u8],
        layout: &Layout,
        present: &mut [bool],
        records: u32,
    ) -> Result<(), ValueProblem> {
        self.clear();
        let mut offset = 0;
        let mut number = || match read_varint(&raw[offset..]) {
            Ok((value, length)) => {
                offset += length;
                Ok(value)
            }
            Err(VarintFault::Ends | VarintFault::Malformed(_)) => {
                Err(ValueProblem::Ends { field: "a run of blocks", offset })
            }
        };
        let mut arrivals = Arrivals::new(layout, present, records);
        for _ in 0..number()? {
            let run = (number()?, number()?);
            arrivals.add(run)?;
            self.runs.push(run);
        }
        arrivals.end()?;
        let bytes = &raw[offset..];
        if bytes.len() != records as usize {
            return Err(ValueProblem::Count { expected: records, found: bytes.len() });
        }
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }
}

/// Checks runs of blocks one after the other.
struct Arrivals<'a> {
    layout: &'a Layout,
    present: &'a mut [bool],
    expected: u32,
    points: usize,
}

impl<'a> Arrivals<'a> {
    fn new(layout: &'a Layout, present: &'a mut [bool], expected: u32) -> Arrivals<'a> {
        Arrivals { layout, present, expected, points: 0 }
    }

    fn add(&mut self, (first, count): (u32, u32)) -> Result<(), ValueProblem> {
        let end = first as usize + count as usize;
        if count == 0 || end > self.present.len() {
            return Err(ValueProblem::Run { first, count });
        }
        for block in first as usize..end {
            if std::mem::replace(&mut self.present[block], true) {
                return Err(ValueProblem::Run { first, count });
            }
            self.points += self.layout.block_len(block);
        }
        // Checked at every run, so that no list of runs is longer than it has points.
        if self.points > self.expected as usize { self.end() } else { Ok(()) }
    }

    fn end(&self) -> Result<(), ValueProblem> {
        let (expected, found) = (self.expected, self.points);
        if found == expected as usize { Ok(()) } else { Err(ValueProblem::Count { expected, found }) }
    }
}

/// What the range coder learns of one frame's values, section after section. It starts afresh with every frame.
pub(crate) struct ValueModel {
    numbers: Number,
    bytes: Opinions<4>,
}

/// Points before the one at hand that are looked at.
const PAST: usize = 8;
/// Weights of those in the mean, the nearest first.
const WEIGHTS: [u32; 3] = [2, 1, 1];
/// Where no value is known.
const UNKNOWN: u8 = 255;

impl ValueModel {
    pub(crate) fn new() -> ValueModel {
        let half = 1 << 15;
        ValueModel {
            numbers: Number::new(),
            bytes: Opinions::new([64 * 256, 64 * 256, 129 * 4 * 256, 16 * 256], 8 * 4, half),
        }
    }

    /// Codes values. A writer gives them in `wanted`, and `records` is their number; both sides find them in `found`.
    /// `values` has the bytes of all slots, `present` the blocks that were there before; both are brought up to date.
    pub(crate) fn code<B: Bits>(
        &mut self,
        bits: &mut B,
        layout: &Layout,
        (values, present): (&mut [u8], &mut [bool]),
        (wanted, found): (&Values, &mut Values),
        records: u32,
        stop: impl Fn(&B) -> bool,
    ) -> Result<(), ValueProblem> {
        found.clear();
        let count = self.numbers.code(bits, wanted.runs.len() as u32);
        let before = present.to_vec();
        let mut arrivals = Arrivals::new(layout, present, records);
        let mut end = 0_u32;
        for run in 0..count as usize {
            let (first, count) = wanted.runs.get(run).copied().unwrap_or((0, 0));
            let gap = self.numbers.code_signed(bits, first.wrapping_sub(end) as i32);
            let first = end.wrapping_add_signed(gap);
            let count = self.numbers.code(bits, count);
            arrivals.add((first, count))?;
            end = first + count;
            found.runs.push((first, count));
        }
        arrivals.end()?;
        let mut known = before;
        let mut taken = 0;
        for (first, count) in found.runs.clone() {
            for block in first as usize..(first + count) as usize {
                self.block(
                    bits,
                    layout,
                    values,
                    &known,
                    block,
                    wanted.bytes.get(taken..).unwrap_or_default(),
                );
                let slots = block * BLOCK_POINTS..block * BLOCK_POINTS + layout.block_len(block);
                taken += slots.len();
                found.bytes.extend_from_slice(&values[slots]);
                known[block] = true;
                if stop(bits) {
                    return Err(ValueProblem::Ends { field: "the values", offset: found.bytes.len() });
                }
            }
        }
        Ok(())
    }

    fn block<B: Bits>(
        &mut self,
        bits: &mut B,
        layout: &Layout,
        values: &mut [u8],
        known: &[bool],
        block: usize,
        wanted: &[u8],
    ) {
        let instance = layout.owner(block);
        let first = block * BLOCK_POINTS;
        let blocks = layout.blocks_of(instance as u32);
        let mut past = [UNKNOWN; PAST];
        if block > blocks.start && known[block - 1] {
            past = std::array::from_fn(|n| values[first - 1 - n]);
        }
        let twin = layout.twin(instance).map(|twin| layout.blocks_of(twin).start + block - blocks.start);
        let twin = twin.filter(|twin| known[*twin]).map(|twin| twin * BLOCK_POINTS);
        // How many of the last values were those of the twin.
        let mut alike = 0;
        for at in 0..layout.block_len(block) {
            let twin = twin.map(|twin| values[twin + at]);
            let wanted = wanted.get(at).copied().unwrap_or(0);
            let value = self.byte(bits, &past, twin, alike, wanted);
            values[first + at] = value;
            past.copy_within(0..PAST - 1, 1);
            past[0] = value;
            alike = if twin == Some(value) { (alike + 1).min(3) } else { 0 };
        }
    }

    fn byte<B: Bits>(
        &mut self,
        bits: &mut B,
        past: &[u8; PAST],
        twin: Option<u8>,
        alike: usize,
        wanted: u8,
    ) -> u8 {
        let mean: u32 = past.iter().zip(WEIGHTS).map(|(value, weight)| u32::from(*value) * weight).sum();
        let rough: u32 = past.windows(2).take(4).map(|pair| u32::from(pair[0].abs_diff(pair[1]))).sum();
        let rough = (32 - rough.leading_zeros()) as usize;
        let twin = twin.map_or(128, |twin| usize::from(twin / 2));
        let open = usize::from(past[0] == 255) * 2 + usize::from(past[1] == 255);
        let mut node = 1;
        for depth in 0..8 {
            let at = [
                (mean / 16) as usize * 256 + node,
                usize::from(past[0] / 4) * 256 + node,
                (twin * 4 + alike) * 256 + node,
                rough * 256 + node,
            ];
            let bit = wanted >> (7 - depth) & 1 == 1;
            let bit = self.bytes.code(logistic(), bits, depth * 4 + open, at, bit);
            node = node << 1 | usize::from(bit);
        }
        node as u8
    }
}
