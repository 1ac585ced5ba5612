//! The reference of the decisions of [`crate::surface::Encoder`]: which points a frame sends, and what clients hold
//! then.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use super::BlockInfo;
use super::changes::moved;
use super::parents::{self, Parent};
use super::values::without_parents;
use crate::envelope::FrameKind;
use crate::surface::{EncoderSettings, Geometry, GeometrySource, Layout, NO_VALUE};

/// Decides as [`crate::surface::Encoder`] does. It writes nothing and keeps no lists of due points.
#[derive(Debug, Clone)]
pub struct SurfaceReferenceEncoder {
    layout: Arc<Layout>,
    settings: EncoderSettings,
    /// Parents of each point.
    parents: Vec<Vec<Parent>>,
    /// Points of each block.
    blocks: Vec<Range<usize>>,
    /// Blocks that were set and that clients do not have, in the order in which they were first set.
    arriving: Vec<usize>,
    /// By block: the levels of blocks below it, at most 2, as of the last frame.
    below: Vec<u8>,
    /// Bytes as last set, by point.
    latest: Vec<Option<u8>>,
    /// Thresholds set with them; `None` for points that may have any byte.
    given: Vec<Option<u8>>,
    /// Bytes of clients, by point.
    held: Vec<Option<u8>>,
    /// Weight of a difference, by point.
    weights: Vec<u64>,
    /// Number of consecutive frames after which the point was not within its threshold.
    waited: Vec<u64>,
}

/// What a delta does to the points that clients have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReferenceDelta {
    /// Points that are sent.
    pub sent: Vec<u32>,
    /// Bytes of clients afterwards, by point; `None` if clients do not have it.
    pub held: Vec<Option<u8>>,
}

impl SurfaceReferenceEncoder {
    /// Creates an encoder in which nothing was set or sent. `geometry` has one geometry for each set.
    #[must_use]
    pub fn new(
        layout: Arc<Layout>,
        geometry: &[Arc<Geometry>],
        settings: EncoderSettings,
    ) -> SurfaceReferenceEncoder {
        let points = layout.points() as usize;
        let threshold = settings.threshold.max(1);
        let settings = settings
            .with_threshold(threshold)
            .with_finest_threshold(settings.finest_threshold.max(threshold))
            .with_arrival_threshold(settings.arrival_threshold.max(1).min(threshold));
        let carried = settings.geometry == GeometrySource::Sent;
        let geometry: Vec<_> = geometry.iter().map(|set| carried.then(|| Arc::clone(set))).collect();
        let starts: Vec<usize> =
            (0..layout.members().len()).map(|instance| layout.points_of(instance as u32).start).collect();
        let mut first = 0;
        let mut blocks = Vec::new();
        for BlockInfo { points, .. } in BlockInfo::all(&layout) {
            blocks.push(first..first + points);
            first += points;
        }
        SurfaceReferenceEncoder {
            parents: parents::of_instances(&layout, &geometry, &starts, points),
            arriving: Vec::new(),
            below: vec![0; blocks.len()],
            blocks,
            latest: vec![None; points],
            given: vec![None; points],
            held: vec![None; points],
            weights: vec![1; points],
            waited: vec![0; points],
            settings,
            layout,
        }
    }

    /// Sets the AO of a point, as [`crate::surface::Encoder::set_ao`].
    pub fn set_ao(&mut self, point: u32, ao: u8) -> Option<bool> {
        self.set_ao_within(point, ao, 0)
    }

    /// Sets the AO of a point, as [`crate::surface::Encoder::set_ao_within`].
    pub fn set_ao_within(&mut self, point: u32, ao: u8, threshold: u8) -> Option<bool> {
        let at = point as usize;
        *self.latest.get_mut(at)? = Some(ao);
        self.given[at] = Some(threshold.max(self.settings.threshold));
        let Some(held) = self.held[at] else {
            let block = self.block(at);
            if !self.arriving.contains(&block) {
                self.arriving.push(block);
            }
            return Some(true);
        };
        Some(self.differs(at, held))
    }

    /// Lets a point have any byte, as [`crate::surface::Encoder::release`]. It has no byte that was last set.
    pub fn release(&mut self, point: u32) {
        if let Some(given) = self.given.get_mut(point as usize) {
            *given = None;
        }
    }

    fn block(&self, point: usize) -> usize {
        self.blocks.iter().take_while(|block| block.end <= point).count()
    }

    /// Returns the byte that clients should have of a point, if its threshold says so.
    fn target(&self, point: usize) -> u8 {
        self.latest[point].unwrap_or(255)
    }

    fn threshold_of(&self, point: usize) -> u8 {
        let Some(given) = self.given[point] else { return 255 };
        let EncoderSettings { threshold, finest_threshold, .. } = self.settings;
        let block = self.block(point);
        let usual = match self.below[block] {
            _ if !self.has_parents(point) => threshold,
            0 => finest_threshold,
            1 => ((u16::from(threshold) + u16::from(finest_threshold)) / 2) as u8,
            _ => threshold,
        };
        usual.max(given)
    }

    /// Returns whether points of the set of a point may have parents.
    fn has_parents(&self, point: usize) -> bool {
        let (instances, layout) = (0..self.layout.members().len() as u32, &self.layout);
        let instance =
            instances.into_iter().find(|instance| layout.points_of(*instance).contains(&point)).unwrap_or(0);
        let set = layout.members()[instance as usize].set as usize;
        self.settings.geometry == GeometrySource::Sent && !layout.sets()[set].levels.ends().is_empty()
    }

    /// Returns whether a byte of clients is not within the threshold of a point.
    fn differs(&self, point: usize, held: u8) -> bool {
        let target = self.target(point);
        if self.given[point].is_none() {
            return false;
        }
        if held == NO_VALUE || target == NO_VALUE {
            return held != target;
        }
        held.abs_diff(target) >= self.threshold_of(point)
    }

    /// Returns the threshold of a point, as [`crate::surface::Encoder::threshold`].
    #[must_use]
    pub fn threshold(&self, point: u32) -> Option<u8> {
        self.held(point).map(|_| self.threshold_of(point as usize))
    }

    /// Returns the number of points, as [`crate::surface::Encoder::pending_points`].
    #[must_use]
    pub fn pending_points(&self) -> u32 {
        let arriving: usize = self.arriving.iter().map(|block| self.blocks[*block].len()).sum();
        let differ = |point: &usize| self.held[*point].is_some_and(|held| self.differs(*point, held));
        ((0..self.held.len()).filter(differ).count() + arriving) as u32
    }

    /// Returns what the next delta does if only some points may change, and those that must not wait.
    #[must_use]
    pub fn delta(&self, may_change: &[u32]) -> ReferenceDelta {
        let allowed: BTreeSet<usize> = may_change.iter().map(|point| *point as usize).collect();
        self.delta_of(|point| allowed.contains(&point) || self.waited[point] >= self.longest_age())
    }

    fn longest_age(&self) -> u64 {
        self.settings.budget.map_or(0, |budget| u64::from(budget.longest_age))
    }

    fn delta_of(&self, may_change: impl Fn(usize) -> bool) -> ReferenceDelta {
        let before: Vec<u8> = self.held.iter().map(|held| held.unwrap_or(NO_VALUE)).collect();
        let mut after = before.clone();
        let mut sent = Vec::new();
        for point in (0..before.len()).filter(|point| self.held[*point].is_some()) {
            let change = parents::mean_change(&self.parents[point], &before, &after);
            let predicted = parents::followed(before[point], change);
            after[point] = predicted;
            if self.differs(point, predicted) && may_change(point) {
                sent.push(point as u32);
                after[point] = self.nearest(predicted, self.target(point));
            }
        }
        let held = self.held.iter().zip(after).map(|(held, after)| held.map(|_| after)).collect();
        ReferenceDelta { sent, held }
    }

    /// Returns the points that the next delta sends if all fit.
    #[must_use]
    pub fn due(&self) -> Vec<u32> {
        self.delta_of(|_| true).sent
    }

    /// Sets the weight of a block, as [`crate::surface::Encoder::set_weight`].
    pub fn set_weight(&mut self, instance: u32, block: usize, weight: u16) {
        let of_instance = self.layout.blocks_of(instance);
        if let Some(block) = of_instance.into_iter().nth(block) {
            self.weights[self.blocks[block].clone()].fill(u64::from(weight.max(1)));
        }
    }

    /// Returns the points that the next delta sends if all fit, in the order of a budget, and how many of them must not
    /// wait.
    #[must_use]
    pub fn ranked(&self) -> (Vec<u32>, usize) {
        let longest = self.longest_age();
        let (forced, mut others): (Vec<u32>, Vec<u32>) =
            self.due().into_iter().partition(|point| self.waited[*point as usize] >= longest);
        others.sort_by_key(|point| Reverse(self.priority(*point)));
        (forced.iter().chain(&others).copied().collect(), forced.len())
    }

    /// Returns how many points, in the order of a budget, explain a delta of `sent` points: the smallest number such that
    /// clients hold `values` if only these may change, and those that must not wait. `None` if no number does. `values`
    /// has the bytes of all points after the frame.
    #[must_use]
    pub fn explain(&self, sent: usize, values: &[u8]) -> Option<usize> {
        let (ranked, forced) = self.ranked();
        (forced..=ranked.len()).find(|count| {
            let delta = self.delta(&ranked[..*count]);
            let holds = |(held, now): (&Option<u8>, &u8)| held.is_none_or(|held| held == *now);
            delta.sent.len() == sent && delta.held.iter().zip(values).all(holds)
        })
    }

    /// Returns how many of the points must not wait that a delta sends if only some points may change, and those.
    #[must_use]
    pub fn late(&self, may_change: &[u32]) -> u32 {
        let sent = self.delta(may_change).sent;
        sent.iter().filter(|point| self.waited(**point) >= self.longest_age()).count() as u32
    }

    /// Returns the product of difference, weight and age.
    #[must_use]
    pub fn priority(&self, point: u32) -> u64 {
        let at = point as usize;
        let target = self.target(at);
        let difference = match self.held[at] {
            Some(held) if held != target && (held == NO_VALUE || target == NO_VALUE) => 255,
            Some(held) => held.abs_diff(target),
            None => 0,
        };
        u64::from(difference) * self.weights[at] * (self.waited[at] + 1)
    }

    /// Returns the number of consecutive frames after which a point was not within its threshold.
    #[must_use]
    pub fn waited(&self, point: u32) -> u64 {
        self.waited.get(point as usize).copied().unwrap_or(0)
    }

    /// Begins a frame: blocks that arrive count as being below others. The result is that of
    /// [`crate::surface::Encoder::finish`] if it fails.
    pub fn begin(&mut self) {
        self.below = self.levels_below();
    }

    /// Updates the clients by the frame that was begun. In a delta only these points may change, and those that must not
    /// wait.
    pub fn finish(&mut self, kind: FrameKind, may_change: &[u32]) {
        let arriving = std::mem::take(&mut self.arriving);
        if kind == FrameKind::Key {
            let here = (0..self.blocks.len()).filter(|block| self.has_arrived(*block));
            let order: Vec<usize> = arriving.into_iter().chain(here).collect();
            self.waited.fill(0);
            self.held = self.arrived(vec![None; self.held.len()], &order);
        } else {
            let held = self.delta(may_change).held;
            let waits = |point: usize| held[point].is_some_and(|held| self.differs(point, held));
            let waited = |(point, waited): (usize, &u64)| if waits(point) { waited + 1 } else { 0 };
            self.waited = self.waited.iter().enumerate().map(waited).collect();
            // Blocks arrive in the state before the frame.
            let arrived = self.arrived(self.held.clone(), &arriving);
            self.held = held.into_iter().zip(arrived).map(|(held, arrived)| held.or(arrived)).collect();
        }
    }

    fn has_arrived(&self, block: usize) -> bool {
        self.held[self.blocks[block].start].is_some()
    }

    /// Returns the bytes of clients after blocks have arrived.
    fn arrived(&self, mut held: Vec<Option<u8>>, order: &[usize]) -> Vec<Option<u8>> {
        let starts: BTreeSet<usize> = (0..self.layout.members().len() as u32)
            .map(|instance| self.layout.points_of(instance).start)
            .collect();
        let mut values: Vec<u8> = held.iter().map(|held| held.unwrap_or(NO_VALUE)).collect();
        for point in order.iter().flat_map(|block| self.blocks[*block].clone()) {
            let start = *starts.range(..=point).next_back().unwrap_or(&0);
            let before = |back: usize| held[start..point].iter().rev().nth(back - 1).copied().flatten();
            let parents = parents::mean_value(&self.parents[point], &values);
            let predicted =
                parents.map_or_else(|| without_parents([1, 2, 3].map(before)), |mean| mean.mean as u8);
            values[point] = self.arriving_byte(point, predicted);
            held[point] = Some(values[point]);
        }
        held
    }

    /// Returns the byte with which a point arrives: the predicted one if it is near enough, or else the nearest byte at a
    /// number of quanta from it. Of two, the one further away.
    fn arriving_byte(&self, point: usize, predicted: u8) -> u8 {
        let EncoderSettings { threshold, arrival_threshold, .. } = self.settings;
        let target = self.target(point);
        let away = u32::from(target.abs_diff(predicted));
        let near_enough = match self.given[point] {
            None => return predicted,
            // Open points arrive exactly.
            Some(given) if given == threshold && target == 255 => 1,
            Some(given) if given == threshold => arrival_threshold,
            Some(_) => threshold,
        };
        if target == NO_VALUE || away < u32::from(near_enough) {
            return if target == NO_VALUE { NO_VALUE } else { predicted };
        }
        if target == 255 {
            return 255;
        }
        let quantum = u32::from(arrival_threshold.saturating_add(arrival_threshold / 2));
        let steps = (0..256).rev().min_by_key(|steps| away.abs_diff(steps * quantum)).unwrap_or(0);
        let step = (steps * quantum).min(255) as u8;
        if target < predicted {
            predicted.saturating_sub(step).max(1)
        } else {
            predicted.saturating_add(step)
        }
    }

    /// Returns for each block how many levels of blocks are below it that have arrived or will, at most 2. A block is below
    /// another one if a point of it has a parent there, and its first point is of a finer level.
    fn levels_below(&self) -> Vec<u8> {
        let levels: Vec<u8> = BlockInfo::all(&self.layout)
            .iter()
            .map(|info| {
                let set = self.layout.members()[info.instance].set as usize;
                let first = info.number * crate::surface::BLOCK_POINTS;
                let ends = self.layout.sets()[set].levels;
                ends.ends().iter().filter(|end| **end as usize <= first).count() as u8
            })
            .collect();
        let mut below = vec![0_u8; self.blocks.len()];
        loop {
            let mut next = below.clone();
            let arrives = |block: &usize| self.has_arrived(*block) || self.arriving.contains(block);
            for child in (0..below.len()).filter(|block| arrives(block) || below[*block] > 0) {
                let parents = self.parents[self.blocks[child].clone()].iter().flatten();
                for block in parents.map(|parent| self.block(parent.place)) {
                    if levels[block] < levels[child] {
                        next[block] = next[block].max((below[child] + 1).min(2));
                    }
                }
            }
            if next == below {
                return below;
            }
            below = next;
        }
    }

    /// Returns the byte after a change: of the bytes that a change can reach, except the one before, the nearest to the byte
    /// set. Of two, the one further away. A value goes at once.
    fn nearest(&self, from: u8, target: u8) -> u8 {
        let quantum = i32::from(self.settings.quantum());
        let reached = |level: i32| i32::from(moved(from, level, quantum));
        let away = |level: i32| {
            // A byte that is limited is judged as if it was not.
            let start = if from == NO_VALUE { 1 - quantum } else { i32::from(from) };
            (start + level * quantum).abs_diff(target.into())
        };
        match (from, target) {
            (_, NO_VALUE) => NO_VALUE,
            (NO_VALUE, _) => {
                (1..=255).rev().min_by_key(|level| away(*level)).map_or(target, |level| reached(level) as u8)
            }
            _ => {
                let sign = i32::from(target).cmp(&i32::from(from)) as i32;
                let level = (1..=254).rev().min_by_key(|size| away(sign * size)).unwrap_or(1);
                reached(sign * level) as u8
            }
        }
    }

    /// Returns the byte of a point that clients hold; `None` if none was received.
    #[must_use]
    pub fn held(&self, point: u32) -> Option<u8> {
        *self.held.get(point as usize)?
    }

    /// Returns the byte of a point as last set; `None` if none was, or if the point was released.
    #[must_use]
    pub fn latest(&self, point: u32) -> Option<u8> {
        self.given.get(point as usize).copied().flatten().and(self.latest[point as usize])
    }
}
