//! CHANGES sections: which points a delta changes, and by how much.

use std::collections::BTreeSet;

use super::parents::{self, Mean, Parent};
use super::{Block, BlockInfo, ByteReader, ReferenceError, index, rule, significant, varint_bytes};
use crate::range::{BinaryCoder, BitModel, RangeDecoder, logistic};
use crate::surface::{BLOCK_POINTS, ChangeModel, ContextMixer, History, NEVER, State};

/// Changes of one frame.
pub(super) struct Changes {
    quantum: i32,
    /// By padded index; 0 where no level is sent.
    levels: Vec<i32>,
    /// Bytes after the frame, by padded index.
    after: Vec<u8>,
    model: ChangeModel,
}

/// Reads a CHANGES section for `state`.
pub(super) fn read(state: &State, block: Block<'_>) -> Result<Changes, ReferenceError> {
    let parents = parents::of_state(state);
    let changes = match block.decoder() {
        Some(decoder) => {
            let (changes, decoder) = decode(state, &parents, decoder);
            block.end(decoder, changes.plain_bytes(state))?;
            changes
        }
        None => read_plain(state, &parents, &block.raw()?)?,
    };
    let found = changes.levels.iter().filter(|level| **level != 0).count();
    rule(found == block.section.records as usize && changes.quantum > 0)?;
    let blocks_info = BlockInfo::all(state.layout());
    for (padded, level) in changes.levels.iter().enumerate().filter(|(_, level)| **level != 0) {
        let (block, place) = (padded / BLOCK_POINTS, padded % BLOCK_POINTS);
        rule(state.present[block] && place < blocks_info[block].points)?;
        let (_, predicted) = changes.predict(state, &parents, padded);
        rule(level.abs() <= 255 && changes.after[padded] != predicted)?;
        rule(predicted != 0 || *level > 0)?;
    }
    Ok(changes)
}

fn read_plain(state: &State, parents: &[Vec<Parent>], raw: &[u8]) -> Result<Changes, ReferenceError> {
    let mut changes = Changes::none(state);
    let mut bytes = ByteReader(raw);
    changes.quantum = bytes.take(1)?[0].into();
    let named = read_point_mask(&mut bytes, state.present.len())?;
    let mut levels = vec![0; state.values.len()];
    for padded in named {
        let folded = bytes.varint()? as i32;
        let level = if folded % 2 == 0 { folded / 2 } else { -(folded / 2) - 1 };
        rule((-255..=255).contains(&level) && level != 0)?;
        levels[padded] = level;
    }
    for (padded, level) in levels.into_iter().enumerate() {
        changes.set(state, parents, padded, level);
    }
    bytes.end()?;
    Ok(changes)
}

/// Reads a bit for every block, and one for every point of the blocks whose bit is set. Returns the padded indices of
/// the points whose bit is set.
pub(super) fn read_point_mask(
    bytes: &mut ByteReader<'_>,
    blocks: usize,
) -> Result<Vec<usize>, ReferenceError> {
    let bitmap = bytes.take(blocks.div_ceil(8))?;
    let named: Vec<usize> =
        (0..8 * bitmap.len()).filter(|block| bitmap[block / 8] >> (block % 8) & 1 == 1).collect();
    let mut padded = Vec::new();
    for block in named {
        let mask = bytes.take(8)?;
        let points = (0..BLOCK_POINTS).filter(|point| mask[point / 8] >> (point % 8) & 1 == 1);
        let before = padded.len();
        padded.extend(points.map(|point| block * BLOCK_POINTS + point));
        rule(block < blocks && padded.len() > before)?;
    }
    Ok(padded)
}

impl Changes {
    pub(super) fn none(state: &State) -> Changes {
        let (levels, after) = (vec![0; state.values.len()], state.values.clone());
        Changes { quantum: 0, levels, after, model: state.model.clone() }
    }

    /// Returns what the parents of a point do in this frame, and the byte of the point before its level is added.
    fn predict(&self, state: &State, parents: &[Vec<Parent>], padded: usize) -> (Mean, u8) {
        let change = parents::mean_change(&parents[padded], &state.values, &self.after);
        (change, parents::followed(state.values[padded], change))
    }

    /// Sets the level of a point. All points before it are set.
    fn set(&mut self, state: &State, parents: &[Vec<Parent>], padded: usize, level: i32) {
        let (_, predicted) = self.predict(state, parents, padded);
        self.levels[padded] = level;
        self.after[padded] = moved(predicted, level, self.quantum);
    }

    /// Returns the length of the plain layout in bytes.
    fn plain_bytes(&self, state: &State) -> usize {
        let blocks = self.levels.chunks(BLOCK_POINTS).filter(|block| block.iter().any(|level| *level != 0));
        let folded = |level: &i32| if *level < 0 { -2 * level - 1 } else { 2 * level };
        let levels = self.levels.iter().filter(|level| **level != 0).map(|level| folded(level) as u32);
        1 + state.present.len().div_ceil(8) + 8 * blocks.count() + levels.map(varint_bytes).sum::<usize>()
    }

    /// Makes the changes of `state` in `next`, which may have arrivals already.
    pub(super) fn make(self, state: &State, next: &mut State) {
        let (mut age, mut period) = (Vec::new(), Vec::new());
        let (mut last, mut activity) = (Vec::new(), Vec::new());
        for (padded, &level) in self.levels.iter().enumerate() {
            let past = Past::of(state, padded);
            if state.present[padded / BLOCK_POINTS] {
                next.values[padded] = self.after[padded];
            }
            if level == 0 {
                age.push(past.age.saturating_add(1));
                period.push(past.period);
                last.push(past.last as i8);
                activity.push(state.history.activity[padded]);
            } else {
                // An age that cannot be told from a longer one counts as never.
                let waited = if past.age < NEVER - 1 { past.age } else { NEVER };
                let left = faded(state.history.activity[padded], waited);
                age.push(0);
                period.push(waited);
                last.push(level.clamp(-127, 127) as i8);
                activity.push(((3 * left + (32 * level.unsigned_abs()).min(255) + 2) / 4) as u8);
            }
        }
        next.history = History::from_parts(age, period, last, activity);
        next.model = self.model;
    }
}

/// Returns the byte at a level from another byte.
pub(super) fn moved(byte: u8, level: i32, quantum: i32) -> u8 {
    match (byte, level) {
        (_, 0) => byte,
        (_, -255) => 0,
        (0, _) => (1 + (level - 1) * quantum).clamp(1, 255) as u8,
        _ => (i32::from(byte) + level * quantum).clamp(1, 255) as u8,
    }
}

/// Returns the activity left after a number of frames without a change. Three quarters are left after each frame, for
/// nineteen frames.
fn faded(activity: u8, frames: u8) -> u32 {
    if frames >= 20 {
        return 0;
    }
    // 256 times (3/4)^frames, rounded.
    let (three, four) = (3_u64.pow(frames.into()), 4_u64.pow(frames.into()));
    let share = (2 * 256 * three + four) / (2 * four);
    (u32::from(activity) * share as u32) / 256
}

/// The history of a point.
struct Past {
    age: u8,
    period: u8,
    last: i32,
    activity: u32,
}

impl Past {
    fn of(state: &State, padded: usize) -> Past {
        let history = &state.history;
        let age = history.age[padded];
        let activity = faded(history.activity[padded], age);
        Past { age, period: history.period[padded], last: history.last[padded].into(), activity }
    }

    /// Returns the level of the last frame; 0 for none.
    fn recent(&self) -> i32 {
        if self.age == 0 { self.last } else { 0 }
    }
}

/// Decodes the changes of the range coder. Returns the decoder too. It does not check whether the changes are valid.
fn decode<'a>(
    state: &State,
    parents: &[Vec<Parent>],
    decoder: RangeDecoder<'a>,
) -> (Changes, RangeDecoder<'a>) {
    let blocks_info = BlockInfo::all(state.layout());
    let mut walk = ChangeDecoder {
        state,
        parents,
        blocks_info,
        decoder,
        changes: Changes::none(state),
        stretch: Vec::new(),
        point: None,
    };
    walk.changes.quantum = walk.decoder.plain(8, 0) as i32;
    let blocks: Vec<usize> = (0..state.present.len()).collect();
    let mut before = false;
    for group in blocks.chunks(16) {
        before = walk.group(group, before);
    }
    (walk.changes, walk.decoder)
}

struct ChangeDecoder<'a, 'b> {
    state: &'a State,
    /// By padded index.
    parents: &'a [Vec<Parent>],
    blocks_info: Vec<BlockInfo>,
    decoder: RangeDecoder<'b>,
    changes: Changes,
    /// Levels of the points before the current one, as far back as they count.
    stretch: Vec<i32>,
    /// The current point.
    point: Option<Situation>,
}

/// What the contexts of a point have in common.
struct Situation {
    instance: usize,
    /// What the parents do in this frame, and the byte that this predicts.
    change: Mean,
    value: usize,
    past: Past,
    /// Number of points that changed and that darkened: among the eight before, in this frame; among the eight around,
    /// in the last frame.
    now: usize,
    now_darker: usize,
    recent: usize,
    recent_darker: usize,
    /// Levels of the eight before, the nearest first.
    before: Vec<i32>,
    /// Whether it is the first point of its instance.
    first: bool,
    around: u32,
}

impl ChangeDecoder<'_, '_> {
    /// Returns the number of points of a block that changed in the last frame.
    fn recent(&self, block: usize) -> usize {
        let ages = self.state.history.age.chunks(BLOCK_POINTS).nth(block).unwrap_or_default();
        ages.iter().filter(|age| **age == 0).count()
    }

    /// Reads a group of blocks and returns whether any of them changed.
    fn group(&mut self, group: &[usize], before: bool) -> bool {
        if group.iter().all(|block| !self.state.present[*block]) {
            return false;
        }
        let active = group.iter().filter(|block| self.recent(**block) > 0).count();
        let model = &mut self.changes.model.groups
            [index([(significant(active as u64), 6), (usize::from(before), 2)])];
        let any_changed = self.decoder.bit(model.one(), false);
        model.learn(any_changed);
        self.stretch.clear();
        for block in group.iter().filter(|block| self.state.present[**block]) {
            if any_changed {
                self.block(*block);
            } else {
                self.follow(*block);
            }
        }
        any_changed
    }

    /// Lets the points of a block without a level follow their parents.
    fn follow(&mut self, block: usize) {
        for padded in block * BLOCK_POINTS..block * BLOCK_POINTS + self.blocks_info[block].points {
            self.changes.set(self.state, self.parents, padded, 0);
        }
    }

    /// Returns the number of other blocks in which a point of this block has a parent and a byte has changed.
    fn moved_parents(&self, block: usize) -> usize {
        let points = &self.parents[block * BLOCK_POINTS..(block + 1) * BLOCK_POINTS];
        let blocks: BTreeSet<usize> =
            points.iter().flatten().map(|parent| parent.place / BLOCK_POINTS).collect();
        let has_moved = |other: &&usize| {
            let mut points = **other * BLOCK_POINTS..(**other + 1) * BLOCK_POINTS;
            **other != block && points.any(|at| self.changes.after[at] != self.state.values[at])
        };
        blocks.iter().filter(has_moved).count()
    }

    fn block(&mut self, block: usize) {
        let class = |count: usize| significant(count as u64);
        let own = self.recent(block);
        let before = match block.checked_sub(1) {
            Some(before) => {
                let levels = &self.changes.levels[before * BLOCK_POINTS..block * BLOCK_POINTS];
                levels.iter().filter(|level| **level != 0).count()
            }
            None => 0,
        };
        let at = [
            index([(class(own), 8), (class(before), 8), (class(self.recent(block + 1)), 8)]),
            index([(own, 65), (usize::from(before > 0), 2)]),
            index([(class(self.moved_parents(block)).min(7), 8), (class(own), 8)]),
        ];
        if !decide(&mut self.changes.model.block, &mut self.decoder, class(own), at) {
            self.stretch.clear();
            self.follow(block);
            return;
        }
        let BlockInfo { number, points, .. } = self.blocks_info[block];
        if number == 0 {
            self.stretch.clear();
        }
        for padded in block * BLOCK_POINTS..block * BLOCK_POINTS + points {
            self.point = Some(self.situation(padded));
            let level = self.level();
            self.changes.set(self.state, self.parents, padded, level);
            self.stretch.push(level);
        }
    }

    fn situation(&self, padded: usize) -> Situation {
        let (state, blocks_info) = (self.state, &self.blocks_info);
        let BlockInfo { instance, number, .. } = blocks_info[padded / BLOCK_POINTS];
        let of_instance = |padded: &usize| {
            blocks_info.get(padded / BLOCK_POINTS).map(|info| info.instance) == Some(instance)
        };
        let is_point = |padded: &usize| padded % BLOCK_POINTS < blocks_info[padded / BLOCK_POINTS].points;
        let others = (padded.saturating_sub(4)..=padded + 4).filter(|other| *other != padded);
        let around: Vec<usize> = others.filter(of_instance).collect();
        let changed = |padded: &&usize| state.history.age[**padded] == 0;
        let before: Vec<i32> = self.stretch.iter().rev().take(8).copied().collect();
        let (change, predicted) = self.changes.predict(state, self.parents, padded);
        Situation {
            instance,
            change,
            value: predicted.into(),
            past: Past::of(state, padded),
            now: before.iter().filter(|level| **level != 0).count(),
            now_darker: before.iter().filter(|level| **level < 0).count(),
            recent: around.iter().filter(changed).count(),
            recent_darker: around
                .iter()
                .filter(changed)
                .filter(|padded| state.history.last[**padded] < 0)
                .count(),
            before,
            first: number == 0 && padded.is_multiple_of(BLOCK_POINTS),
            around: around
                .iter()
                .filter(|padded| is_point(padded))
                .map(|padded| Past::of(state, *padded).activity)
                .sum(),
        }
    }

    /// Reads the level of the current point; 0 if it does not change.
    fn level(&mut self) -> i32 {
        let Some(at) = &self.point else { return 0 };
        let model = &mut self.changes.model;
        let few = [0, 1, 2, 3, 4, 4, 5, 5, 5][at.now];
        let situation = index([(few, 6), (age_class(at.past.age), 6)]);
        if !decide(&mut model.point, &mut self.decoder, situation, at.changes(few)) {
            return 0;
        }
        let darkens = match at.value {
            255 => true,
            0 => false,
            _ => decide(&mut model.sign, &mut self.decoder, 0, at.sign()),
        };
        let mut size = 1;
        while size <= 12 && decide(&mut model.size, &mut self.decoder, size - 1, at.size(size - 1, darkens)) {
            size += 1;
        }
        if size > 12 {
            size += model.large.code(&mut self.decoder, 0).min(255) as usize;
        }
        if darkens { -(size as i32) } else { size as i32 }
    }
}

impl Situation {
    /// Returns the contexts of whether it changes.
    fn changes(&self, few: usize) -> [usize; 5] {
        let nearest = match self.before.first() {
            _ if self.first => 2,
            Some(level) if *level != 0 => 1,
            _ => 0,
        };
        let own = half_octave(self.past.activity);
        [
            index([(self.now, 9), (self.recent, 9), (phase(self.past.age, self.past.period), 16)]),
            index([(self.value, 256), (nearest, 3)]),
            index([(own, 16), (half_octave(self.around / 8), 16), (self.now, 9)]),
            index([(self.instance % 256, 256), (few, 6), (usize::from(self.past.age == 0), 2)]),
            index([(self.mean_class(), 9), (self.spread_class(), 5), (few, 6), (nearest, 3)]),
        ]
    }

    /// Returns the contexts of its sign.
    fn sign(&self) -> [usize; 5] {
        let balance = 8 + self.now - 2 * self.now_darker;
        let trend = 8 + self.recent - 2 * self.recent_darker;
        let last = (1 + self.past.last.signum()) as usize;
        let near = (1 + self.before.first().map_or(0, |level| level.signum())) as usize;
        [
            index([(balance, 17), (last, 3), (near, 3)]),
            index([(balance, 17), (trend, 17)]),
            index([(self.value, 256), (last, 3)]),
            index([(trend, 17), (last, 3)]),
            index([(self.mean_class(), 9), (self.spread_class(), 5), (near, 3), (last, 3)]),
        ]
    }

    /// Returns the class of the parents' mean change: 4 for no change, less than 4 for a darker one.
    fn mean_class(&self) -> usize {
        let size = [1, 3, 6, 11].iter().filter(|start| self.change.mean.abs() >= **start).count();
        if self.change.mean < 0 { 4 - size } else { 4 + size }
    }

    /// Returns the class of how far the changes of the parents lie apart.
    fn spread_class(&self) -> usize {
        [1, 5, 10, 20].iter().filter(|start| self.change.spread >= **start).count()
    }

    /// Returns the contexts of whether its size is above `step` + 1.
    fn size(&self, step: usize, darkens: bool) -> [usize; 4] {
        let sizes: u32 = self.before.iter().map(|level| level.unsigned_abs()).sum();
        let usual = (2 * sizes as usize).checked_div(self.now).unwrap_or(0);
        let usual = significant(usual as u64).min(11);
        let last = significant(self.past.last.unsigned_abs().into());
        let recent = (self.past.recent().unsigned_abs() as usize).min(11);
        [
            index([(usual, 12), (step, 12), (last, 12)]),
            index([(usual, 12), (step, 12), (significant(self.past.activity.into()), 9)]),
            index([(step, 12), (recent, 12)]),
            index([(self.value, 256), (usize::from(darkens), 2), (step, 12)]),
        ]
    }
}

/// Reads one mixed decision.
fn decide<const N: usize>(
    mixer: &mut ContextMixer<N>,
    decoder: &mut RangeDecoder<'_>,
    situation: usize,
    at: [usize; N],
) -> bool {
    let mut at = at.into_iter();
    let models: [&mut BitModel; N] =
        mixer.tables.each_mut().map(|table| &mut table[at.next().unwrap_or_default()]);
    mixer.mixer.code(logistic(), decoder, situation, models, false)
}

/// Returns the class of a number: 0, 1, 2, 3, 4-5, 6-7, 8-11, 12-15, 16-23 ..
fn half_octave(value: u32) -> usize {
    let mut starts = vec![1, 2, 3];
    starts.extend((2..8).flat_map(|octave| [4_u32 << (octave - 2), 6 << (octave - 2)]));
    starts.iter().filter(|start| value >= **start).count()
}

fn age_class(age: u8) -> usize {
    [1, 2, 4, 8, 21].iter().filter(|start| age >= **start).count()
}

/// Returns the phase: the quarters of the last period that have passed.
fn phase(age: u8, period: u8) -> usize {
    if period == NEVER {
        return 15;
    }
    if age == NEVER {
        return 14;
    }
    (4 * (usize::from(age) + 1) / (usize::from(period) + 1)).min(13)
}
