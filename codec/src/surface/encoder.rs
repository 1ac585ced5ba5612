//! The encoder of profile `surface`: it decides which points are sent, and writes the frames.

use std::sync::Arc;

use bitvec::vec::BitVec;

use super::budget::{Budget, BudgetQueue, PendingFrame, Postponed};
use super::keyframe::ParcelWriter;
use super::section::changes::{Changes, REMOVAL};
use super::section::point_mask::SetBits;
use super::section::writer::SectionWriter;
use super::state::{geometry_words, value_words};
use super::{Geometry, GeometryError, Layout, NO_VALUE, PaddedIndex, State, frame_ids};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, EncodedFrame, FrameKind, FrameMeta, assemble};
use crate::hash::RecordKind;
use crate::{StateHash, memory};

/// Settings of an encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct EncoderSettings {
    /// A point is sent if its AO byte differs by at least this much from that of clients, 1 to 255; 0 counts as 1.
    pub threshold: u8,
    /// Whether the stream carries the geometry, or clients make it from the scene.
    pub geometry: GeometrySource,
    /// Byte budget of deltas. Without one, every point is sent as soon as it differs by the threshold.
    pub budget: Option<Budget>,
}

/// Source of the clients' geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeometrySource {
    /// Keyframes carry it.
    Sent,
    /// Clients make it from the scene and pass it to [`State::share_geometry`].
    Shared,
}

impl EncoderSettings {
    /// Returns settings without a budget.
    #[must_use]
    pub const fn new(threshold: u8, geometry: GeometrySource) -> Self {
        Self { threshold, geometry, budget: None }
    }

    setters! {
        const fn:
        with_threshold: threshold as u8,
        with_geometry: geometry as GeometrySource,
        with_budget: budget as Option<Budget>,
    }

    /// Returns the quantum, the step in which AO bytes change: 1.5 times the threshold, rounded down. A change
    /// overshoots a slow drift by a third of the step, so that the next change is needed later.
    #[must_use]
    pub fn quantum(&self) -> u8 {
        self.threshold.saturating_add(self.threshold / 2).max(1)
    }

    /// Returns the largest difference between the AO byte last set and the one of clients after the frame. It is below
    /// the threshold: a larger difference is sent, and then the result is within half a [`quantum`](Self::quantum). For a
    /// point that was set by [`Encoder::set_ao_within`] it is below the threshold given there.
    /// With a [`Budget`] it holds for the byte set up to [`Budget::longest_age`] frames before.
    #[must_use]
    pub fn max_error(&self) -> u8 {
        self.threshold.saturating_sub(1)
    }
}

/// Tracks the state of clients and writes the changes.
///
/// All calls are deterministic: the same calls in the same order give the same bytes.
#[derive(Debug)]
pub struct Encoder {
    sent: State,
    settings: EncoderSettings,
    geometry: Vec<Option<Arc<Geometry>>>,
    /// AO bytes as last set, by padded index.
    latest: Vec<u8>,
    /// Points of present blocks that differ by the threshold, by block.
    dirty: Vec<u64>,
    /// Blocks that were set but not sent yet, in the order in which they were first set.
    arriving: Vec<u32>,
    is_arriving: BitVec,
    /// Instance of the point last set; the next one is mostly of the same.
    instance: usize,
    changes: Changes,
    writer: SectionWriter,
    /// The points that wait, if there is a budget.
    queue: Option<Box<BudgetQueue>>,
}

impl Encoder {
    /// Creates an encoder in which no AO was set yet. `geometry` has one geometry for each set, in order.
    ///
    /// # Errors
    /// [`GeometryError`] if the geometries are not those of the layout.
    pub fn new(
        layout: Arc<Layout>,
        geometry: Vec<Arc<Geometry>>,
        settings: EncoderSettings,
    ) -> Result<Encoder, GeometryError> {
        let threshold = settings.threshold.max(1);
        let settings = EncoderSettings { threshold, ..settings };
        let mut check = State::new(Arc::clone(&layout));
        for (geometry, set) in geometry.iter().zip(0..) {
            check.share_geometry(set, Arc::clone(geometry))?;
        }
        if geometry.len() < layout.sets().len() {
            return Err(GeometryError::NoSet { set: geometry.len() as u32 });
        }
        let carried =
            |geometry: Arc<Geometry>| (settings.geometry == GeometrySource::Sent).then_some(geometry);
        let sent = match settings.geometry {
            GeometrySource::Sent => State::new(layout),
            GeometrySource::Shared => check,
        };
        Ok(Encoder {
            latest: vec![255; sent.values.len()],
            dirty: vec![0; sent.present.len()],
            arriving: Vec::new(),
            is_arriving: BitVec::repeat(false, sent.present.len()),
            instance: 0,
            geometry: geometry.into_iter().map(carried).collect(),
            changes: Changes::default(),
            writer: SectionWriter::default(),
            queue: settings.budget.map(|budget| Box::new(BudgetQueue::new(budget, sent.present.len()))),
            settings,
            sent,
        })
    }

    /// Returns the heap bytes in use for the stream: the state of clients with points and layout, the AO set, and
    /// buffers kept between frames.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        let Encoder { sent, geometry, latest, dirty, arriving, is_arriving, changes, writer, queue, .. } =
            self;
        let carried = geometry.iter().zip(&sent.geometry).map(|(ours, theirs)| match (ours, theirs) {
            (Some(ours), Some(theirs)) if Arc::ptr_eq(ours, theirs) => 0,
            (ours, _) => ours.as_ref().map_or(0, |geometry| geometry.heap_bytes()),
        });
        let points = carried.sum::<usize>() + memory::list(geometry) + memory::list(latest);
        let blocks = memory::list(dirty) + memory::list(arriving) + memory::bits(is_arriving);
        let queue = queue.as_ref().map_or(0, |queue| queue.heap_bytes());
        sent.heap_bytes() + points + blocks + changes.heap_bytes() + writer.heap_bytes() + queue
    }

    /// Sets the AO of a point: 1 closed to 255 open, or [`NO_VALUE`] for a point that clients leave out. Returns whether the
    /// next frame sends it, or `None` if there is no such point. It is sent if its block was never sent, if it differs from
    /// the clients' value by the threshold, or if it gets or loses its value. With a [`Budget`] it may then have to wait.
    ///
    /// All points of a block are sent together the first time, blocks in the order in which they were first set.
    /// Points of it that were not set are sent as open.
    #[inline]
    pub fn set_ao(&mut self, point: u32, ao: u8) -> Option<bool> {
        self.set_ao_within(point, ao, self.settings.threshold)
    }

    /// Sets the AO of a point as [`set_ao`](Self::set_ao) does, but with a threshold of its own, which is at least that of the
    /// settings: for points that pictures need less exactly. The next call of `set_ao` brings the point back within the
    /// threshold of the settings.
    pub fn set_ao_within(&mut self, point: u32, ao: u8, threshold: u8) -> Option<bool> {
        let threshold = threshold.max(self.settings.threshold);
        let layout = &self.sent.layout;
        if !layout.points_of(self.instance as u32).contains(&(point as usize)) {
            self.instance = layout.instance_of(point)?;
        }
        let index = layout.padded_index_in(self.instance, point);
        let (block, bit) = (index.block(), index.bit());
        self.latest[index.0] = ao;
        if !self.sent.present[block] {
            if !self.is_arriving.replace(block, true) {
                self.arriving.push(block as u32);
            }
            return Some(true);
        }
        let held = self.sent.values[index.0];
        let differs = (ao == NO_VALUE) != (held == NO_VALUE) || ao.abs_diff(held) >= threshold;
        self.dirty[block] = if differs { self.dirty[block] | bit } else { self.dirty[block] & !bit };
        Some(differs)
    }

    /// Returns how many points the next frame will send: those of blocks that were never sent, and those that differ
    /// by the threshold. With a [`Budget`] some of them may have to wait.
    #[must_use]
    pub fn pending_points(&self) -> u32 {
        let layout = &self.sent.layout;
        let arriving: usize = self.arriving.iter().map(|block| layout.block_len(*block as usize)).sum();
        let changed: u32 = self.dirty.iter().map(|mask| mask.count_ones()).sum();
        changed + arriving as u32
    }

    /// Sets the weight of an instance's block `block`, which counts if not all points fit a [`Budget`]: with twice the
    /// weight, a difference counts twice. Weights are 1 at first; 0 counts as 1. The call has no effect if there is no
    /// such block, or no budget.
    pub fn set_weight(&mut self, instance: u32, block: usize, weight: u16) {
        let blocks = self.sent.layout.blocks_of(instance);
        let weights = self.queue.as_mut().and_then(|queue| queue.weights_mut().get_mut(blocks));
        if let Some(found) = weights.and_then(|weights| weights.get_mut(block)) {
            *found = weight.max(1);
        }
    }

    /// Returns the weight of an instance's block, see [`Encoder::set_weight`]. `None` if there is no such block, or no
    /// budget.
    #[must_use]
    pub fn weight(&self, instance: u32, block: usize) -> Option<u16> {
        let blocks = self.sent.layout.blocks_of(instance);
        self.queue.as_ref()?.weights().get(blocks)?.get(block).copied()
    }

    /// Returns what the last finished frame postponed; `None` without a [`Budget`].
    #[must_use]
    pub fn postponed(&self) -> Option<&Postponed> {
        self.queue.as_ref().map(|queue| queue.postponed())
    }

    /// Returns the AO bytes of an instance's points as last set, in the order of its set's geometry; 255 where none
    /// was set. Clients hold [`State::values`] of [`Encoder::state`].
    #[must_use]
    pub fn latest(&self, instance: u32) -> &[u8] {
        if instance as usize >= self.sent.layout.members().len() {
            return &[];
        }
        &self.latest[self.sent.layout.padded_range(instance as usize)]
    }

    /// Returns the state of clients after the last finished frame.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.sent
    }

    /// Returns the settings.
    #[must_use]
    pub fn settings(&self) -> &EncoderSettings {
        &self.settings
    }

    /// Writes the frame that brings clients from the last finished frame to now. A keyframe holds every block that was
    /// ever set, with the bytes last set. It starts a group: the coder context becomes fresh.
    ///
    /// With a [`Budget`], a delta may postpone points. While points wait, the header has the number of points in the
    /// frame instead of `meta.changed_points`.
    ///
    /// # Errors
    /// [`EncodeError`]; the encoder is then unchanged.
    pub fn finish(&mut self, mut meta: FrameMeta, coder: BlockCoder) -> Result<EncodedFrame, EncodeError> {
        let (frame, last) = (meta.frame, self.sent.frame);
        if let Some(last) = last.filter(|last| *last >= frame) {
            return Err(EncodeError::FrameOrder { frame, last });
        }
        self.writer.clear();
        match meta.kind {
            FrameKind::Delta if last.is_none() => return Err(EncodeError::NoKeyframe { frame }),
            FrameKind::Delta => meta.changed_points = self.finish_delta(meta, coder)?,
            FrameKind::Key => self.finish_key(coder)?,
        }
        self.sent.frame = Some(frame);
        let ids = frame_ids(meta.kind);
        let sections = std::mem::take(&mut self.writer.sections);
        let frame = assemble(&meta, ids, self.sent.hash, sections, &self.writer.blocks);
        if let Some(queue) = &mut self.queue {
            queue.set_used(frame.body.len());
        }
        Ok(frame)
    }

    fn finish_key(&mut self, coder: BlockCoder) -> Result<(), EncodeError> {
        let layout = Arc::clone(&self.sent.layout);
        let here = (0..layout.blocks() as u32).filter(|block| self.sent.present[*block as usize]);
        let order: Vec<u32> = self.arriving.iter().copied().chain(here).collect();
        let mut next = State::new(layout);
        if self.settings.geometry == GeometrySource::Shared {
            next.geometry.clone_from(&self.sent.geometry);
        }
        self.write_parcels(&mut next, &order, coder)?;
        next.hash = next.full_hash();
        self.sent = next;
        self.dirty.fill(0);
        self.arriving.clear();
        self.is_arriving.fill(false);
        if let Some(queue) = &mut self.queue {
            queue.clear();
        }
        Ok(())
    }

    /// Writes the sections of a delta. Returns the number of changed points for its header.
    fn finish_delta(&mut self, meta: FrameMeta, coder: BlockCoder) -> Result<u32, EncodeError> {
        let mut hash = self.sent.hash;
        let mut next = None;
        if !self.arriving.is_empty() {
            let arriving = self.arriving.clone();
            let mut with = self.sent.without_context();
            self.write_parcels(&mut with, &arriving, coder)?;
            hash = hash_with_arrivals(&self.sent, &with);
            next = Some(with);
        }
        let changed_points = self.write_changes(meta, coder)?;
        // Nothing can fail from here on.
        for (block, mask) in self.changes.points.iter() {
            self.dirty[block as usize] &= !mask;
        }
        self.sent.hash = self.sent.hash_after(hash, &self.changes);
        self.sent.commit(&self.changes);
        if let Some(next) = next {
            // The changes are to blocks that were there before; now the arrivals are added.
            for block in self.arriving.drain(..) {
                let range = next.block_range(block as usize);
                self.sent.values[range.clone()].copy_from_slice(&next.values[range]);
                self.sent.present[block as usize] = true;
                self.is_arriving.set(block as usize, false);
            }
            self.sent.geometry = next.geometry;
            self.sent.received = next.received;
        }
        Ok(changed_points)
    }

    /// Writes the changes, or those that fit the budget, which are then left in `changes`. Returns the number of
    /// changed points for the header.
    fn write_changes(&mut self, meta: FrameMeta, coder: BlockCoder) -> Result<u32, EncodeError> {
        self.collect_changes();
        let Encoder { sent, changes, writer, latest, queue, .. } = self;
        if let Some(queue) = queue {
            return queue.write(PendingFrame { writer, sent, latest, meta, coder }, changes);
        }
        if !changes.levels.is_empty() {
            let (known, model) = sent.view_and_model();
            writer.changes(known, model, changes, coder, usize::MAX)?;
        }
        Ok(meta.changed_points)
    }

    /// Writes blocks and the geometry they need, and updates `next` except for its hash.
    fn write_parcels(
        &mut self,
        next: &mut State,
        order: &[u32],
        coder: BlockCoder,
    ) -> Result<(), EncodeError> {
        let layout = Arc::clone(&next.layout);
        ParcelWriter {
            layout: &layout,
            geometry: &self.geometry,
            sent: &mut next.received,
            bytes: &mut next.values,
            present: &mut next.present,
        }
        .write(&mut self.writer, order, &self.latest, coder)?;
        let own = self.geometry.iter().zip(&next.received);
        for (held, (own, received)) in next.geometry.iter_mut().zip(own) {
            if *received {
                held.clone_from(own);
            }
        }
        Ok(())
    }

    /// Collects the changes of the points that differ by the threshold.
    fn collect_changes(&mut self) {
        let quantum = i32::from(self.settings.quantum());
        self.changes.clear();
        self.changes.quantum = quantum as u8;
        for (block, dirty) in self.dirty.iter().enumerate() {
            for bit in SetBits(*dirty) {
                let index = PaddedIndex::new(block, bit as usize);
                self.changes.push(index, level(self.sent.values[index.0], self.latest[index.0], quantum));
            }
        }
    }
}

/// Returns the level that takes a point's byte nearest to another one.
fn level(from: u8, to: u8, quantum: i32) -> i16 {
    let nearest = |difference: i32| (difference + quantum / 2) / quantum;
    match (from, to) {
        (_, NO_VALUE) => REMOVAL,
        (NO_VALUE, _) => 1 + nearest(i32::from(to) - 1) as i16,
        _ => {
            let difference = i32::from(to) - i32::from(from);
            (nearest(difference.abs()).max(1) * difference.signum()) as i16
        }
    }
}

/// Returns the hash of `before` with the arrivals of `after`.
pub(super) fn hash_with_arrivals(before: &State, after: &State) -> StateHash {
    let mut hash = before.hash;
    for (set, layout) in after.layout.sets().iter().enumerate() {
        if after.received[set] && !before.received[set] {
            hash = hash.insert(RecordKind::Geometry, set as u32, &geometry_words(layout.digest));
        }
    }
    for block in (0..after.present.len()).filter(|block| after.present[*block] && !before.present[*block]) {
        for index in after.block_range(block) {
            hash = hash.insert(RecordKind::Value, index as u32, &value_words(after.values[index]));
        }
    }
    hash
}
