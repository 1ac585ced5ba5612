//! VALUES sections: AO of point blocks that arrive for the first time, or again with a keyframe.
//!
//! The plain layout is the quantum, a byte of 1 to 255; the number of runs of blocks as a varint; for each run its first
//! block and its number of blocks, two varints; then one byte a point, run after run: its AO byte less the predicted one,
//! modulo 256.

use std::sync::Arc;

use crate::surface::arrival::{ArrivalPredictor, PointGuess};
use crate::surface::{Geometry, Layout, NO_VALUE};
use crate::wire::{Reader, WireError, varint_bytes, write_varint};

/// Blocks and the bytes of their points.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Values {
    /// Step between bytes that are not as predicted, 1 to 255.
    pub(crate) quantum: u8,
    /// First block and number of blocks of each run.
    pub(crate) runs: Vec<(u32, u32)>,
    /// Bytes of the points of all runs, in order.
    pub(crate) bytes: Vec<u8>,
    /// Threshold of each: a byte that differs by less from its prediction may be sent as that. Only an encoder has them.
    pub(crate) thresholds: Vec<u8>,
}

/// Returns the level nearest to a byte with a value, in quanta from its prediction.
#[inline]
pub(crate) fn nearest_level(byte: u8, predicted: u8, quantum: u8) -> i16 {
    let level = (u16::from(byte.abs_diff(predicted)) + u16::from(quantum) / 2) / u16::from(quantum);
    if byte < predicted { -(level as i16) } else { level as i16 }
}

/// Returns the level that is sent for a byte with a value: 0 if it differs by less than `threshold` from its prediction. The
/// byte of an open point is reached exactly, because no byte is above it.
#[inline]
pub(crate) fn arrival_level(byte: u8, predicted: u8, threshold: u8, quantum: u8) -> i16 {
    let away = byte.abs_diff(predicted);
    match byte {
        _ if away < threshold => 0,
        u8::MAX => away.div_ceil(quantum).into(),
        _ => nearest_level(byte, predicted, quantum),
    }
}

/// Returns the byte at a level from its prediction.
#[inline]
pub(crate) fn arrival_byte(predicted: u8, level: i16, quantum: u8) -> u8 {
    (i32::from(predicted) + i32::from(level) * i32::from(quantum)).clamp(1, 255) as u8
}

/// What clients have of the points, while values are being written or read.
pub(crate) struct ClientValues<'a> {
    /// By set: the points that came with frames.
    pub(crate) geometry: &'a [Option<Arc<Geometry>>],
    /// AO bytes, by padded index.
    pub(crate) bytes: &'a mut [u8],
    /// By block: whether its values were received.
    pub(crate) present: &'a mut [bool],
}

/// Why values were refused. An offset counts bytes of the plain layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueError {
    /// The section ends inside a field.
    #[error("it ends inside {field}, which starts at its byte {offset}")]
    Ends {
        /// The field.
        field: &'static str,
        /// Start of the field.
        offset: usize,
    },
    /// A run is empty, has blocks outside the layout, or has a block that was already received.
    #[error("{count} blocks from {first} on: an empty run, not part of the stream, or already received")]
    Run {
        /// First block.
        first: u32,
        /// Number of blocks.
        count: u32,
    },
    /// The quantum is 0.
    #[error("its quantum is 0")]
    Quantum,
    /// The number of points differs from the section table.
    #[error("{found} points, the section table says {expected}")]
    Count {
        /// Number by the section table.
        expected: u32,
        /// Number in the section.
        found: usize,
    },
}

impl Values {
    pub(crate) fn clear(&mut self) {
        self.runs.clear();
        self.bytes.clear();
        self.thresholds.clear();
    }

    /// Adds a block. It comes after all earlier ones.
    pub(crate) fn push(&mut self, block: usize) {
        match self.runs.last_mut() {
            Some((first, count)) if (*first + *count) as usize == block => *count += 1,
            _ => self.runs.push((block as u32, 1)),
        }
    }

    /// Returns the byte and the threshold of every point, in order.
    pub(crate) fn targets(&self) -> impl Iterator<Item = (u8, u8)> + '_ {
        self.bytes.iter().copied().zip(self.thresholds.iter().copied())
    }

    /// Returns every block, in order.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|(first, count)| *first as usize..(*first + *count) as usize)
    }

    /// Returns the length of the plain layout in bytes.
    pub(crate) fn plain_bytes(&self) -> usize {
        let run = |(first, count): &(u32, u32)| varint_bytes(*first) + varint_bytes(*count);
        let runs: usize = self.runs.iter().map(run).sum();
        1 + varint_bytes(self.runs.len() as u32) + runs + self.bytes.len()
    }

    /// Appends the plain layout to `out`, and updates what clients have.
    pub(crate) fn write_plain(&self, layout: &Layout, clients: ClientValues<'_>, out: &mut Vec<u8>) {
        out.push(self.quantum);
        write_varint(out, self.runs.len() as u32);
        for (first, count) in &self.runs {
            write_varint(out, *first);
            write_varint(out, *count);
        }
        let mut targets = self.targets();
        let ClientValues { geometry, bytes, present } = clients;
        let mut arrivals = ArrivalPredictor::new(layout, geometry, bytes);
        for block in self.blocks() {
            arrivals.block(block, present, |PointGuess { predicted, .. }| {
                let byte = match targets.next() {
                    None | Some((NO_VALUE, _)) => NO_VALUE,
                    Some((target, threshold)) => {
                        let level = arrival_level(target, predicted, threshold, self.quantum);
                        arrival_byte(predicted, level, self.quantum)
                    }
                };
                out.push(byte.wrapping_sub(predicted));
                byte
            });
            present[block] = true;
        }
    }

    /// Reads the plain layout: `records` points of blocks that clients do not have yet. It updates what they have.
    pub(crate) fn read_plain(
        &mut self,
        raw: &[u8],
        layout: &Layout,
        clients: ClientValues<'_>,
        records: u32,
    ) -> Result<(), ValueError> {
        self.clear();
        let ClientValues { geometry, bytes, present } = clients;
        let mut reader = Reader::new(raw);
        self.quantum = reader.take("the quantum", 1)?[0];
        if self.quantum == 0 {
            return Err(ValueError::Quantum);
        }
        let field = "a run of blocks";
        let mut known = present.to_vec();
        let mut arrivals = ArrivalCheck::new(layout, present, records);
        for _ in 0..reader.varint(field)? {
            let run = (reader.varint(field)?, reader.varint(field)?);
            arrivals.add(run)?;
            self.runs.push(run);
        }
        arrivals.end()?;
        let found = reader.remaining();
        if found != records as usize {
            return Err(ValueError::Count { expected: records, found });
        }
        let mut differences = reader.take("the values", found)?.iter().copied();
        let mut arrivals = ArrivalPredictor::new(layout, geometry, bytes);
        for block in self.runs.iter().flat_map(|(first, count)| *first as usize..(*first + *count) as usize) {
            arrivals.block(block, &known, |PointGuess { predicted, .. }| {
                let byte = predicted.wrapping_add(differences.next().unwrap_or_default());
                self.bytes.push(byte);
                byte
            });
            known[block] = true;
        }
        Ok(())
    }
}

impl From<WireError> for ValueError {
    fn from(WireError { field, offset, .. }: WireError) -> ValueError {
        ValueError::Ends { field, offset }
    }
}

/// Checks runs of blocks one after the other.
pub(crate) struct ArrivalCheck<'a> {
    layout: &'a Layout,
    present: &'a mut [bool],
    expected: u32,
    points: usize,
}

impl<'a> ArrivalCheck<'a> {
    pub(crate) fn new(layout: &'a Layout, present: &'a mut [bool], expected: u32) -> ArrivalCheck<'a> {
        ArrivalCheck { layout, present, expected, points: 0 }
    }

    pub(crate) fn add(&mut self, (first, count): (u32, u32)) -> Result<(), ValueError> {
        let end = first as usize + count as usize;
        if count == 0 || end > self.present.len() {
            return Err(ValueError::Run { first, count });
        }
        for block in first as usize..end {
            if std::mem::replace(&mut self.present[block], true) {
                return Err(ValueError::Run { first, count });
            }
            self.points += self.layout.block_len(block);
        }
        // Checked after every run, so that a list of runs is never longer than its number of points.
        if self.points > self.expected as usize { self.end() } else { Ok(()) }
    }

    pub(crate) fn end(&self) -> Result<(), ValueError> {
        let (expected, found) = (self.expected, self.points);
        if found == expected as usize { Ok(()) } else { Err(ValueError::Count { expected, found }) }
    }
}
