//! The encoder of profile `surface`: it decides which points are sent, and writes the frames.

use std::sync::Arc;

use bitvec::vec::BitVec;

use super::budget::{Budget, BudgetQueue, PendingFrame, Postponed};
use super::keyframe::ParcelWriter;
use super::prediction::NextValues;
use super::section::changes::Changes;
use super::section::writer::SectionWriter;
use super::state::{geometry_words, value_words};
use super::targets::{Targets, quantum_of};
use super::{Geometry, GeometryError, Layout, State, frame_ids};
use crate::block::BlockCoder;
use crate::envelope::{EncodeError, EncodedFrame, FrameKind, FrameMeta, assemble};
use crate::hash::RecordKind;
use crate::{StateHash, memory};

/// Settings of an encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct EncoderSettings {
    /// A change of a point is sent if otherwise its AO byte would differ by at least this much from that of clients, 1 to
    /// 255; 0 counts as 1.
    pub threshold: u8,
    /// Whether the stream carries the geometry, or clients make it from the scene.
    pub geometry: GeometrySource,
    /// The threshold of points of the finest level that clients have around them, at least `threshold`. Points of the next
    /// coarser level have the mean of both. A picture takes the mean of many such points, so it shows less of their error.
    pub finest_threshold: u8,
    /// The threshold of points that arrive, 1 to `threshold`: clients see less noise where nothing moves. Open points arrive
    /// exactly.
    pub arrival_threshold: u8,
    /// Byte budget of deltas. Without one, every point is sent as soon as it differs by the threshold.
    pub budget: Option<Budget>,
}

/// Source of the clients' geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeometrySource {
    /// Keyframes carry it, and points are predicted from those of coarser levels.
    Sent,
    /// Clients make it from the scene and pass it to [`State::share_geometry`]. A program without the scene can decode the
    /// AO, too, so points are not predicted from each other.
    Shared,
}

impl EncoderSettings {
    /// Returns settings without a budget. The finest points may be off by twice as much, and points that arrive by 1.
    #[must_use]
    pub const fn new(threshold: u8, geometry: GeometrySource) -> Self {
        let arrival_threshold = if threshold < 2 { threshold } else { 2 };
        let finest_threshold = threshold.saturating_add(threshold.saturating_sub(1));
        Self { threshold, finest_threshold, arrival_threshold, geometry, budget: None }
    }

    setters! {
        const fn:
        with_threshold: threshold as u8,
        with_finest_threshold: finest_threshold as u8,
        with_arrival_threshold: arrival_threshold as u8,
        with_geometry: geometry as GeometrySource,
        with_budget: budget as Option<Budget>,
    }

    /// Returns the quantum, the step in which AO bytes change: 1.5 times the threshold, rounded down. A change
    /// overshoots a slow drift by a third of the step, so that the next change is needed later.
    #[must_use]
    pub fn quantum(&self) -> u8 {
        quantum_of(self.threshold).max(1)
    }

    /// Returns the largest difference between the AO byte last set and the one of clients after the frame, for any point:
    /// the largest threshold less 1. [`Encoder::threshold`] has that of each point.
    /// With a [`Budget`] a point may be off by more for up to [`Budget::longest_age`] frames.
    #[must_use]
    pub fn max_error(&self) -> u8 {
        self.threshold.max(self.finest_threshold).saturating_sub(1)
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
    targets: Targets,
    /// The AO of clients after the frame that is being written.
    next: NextValues,
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
        let arrival_threshold = settings.arrival_threshold.clamp(1, threshold);
        let finest_threshold = settings.finest_threshold.max(threshold);
        let settings = EncoderSettings { threshold, finest_threshold, arrival_threshold, ..settings };
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
            targets: Targets::new(&sent.layout, &settings),
            next: NextValues::default(),
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
        let Encoder { sent, geometry, targets, next, arriving, is_arriving, changes, writer, queue, .. } =
            self;
        let carried = geometry.iter().zip(&sent.geometry).map(|(ours, theirs)| match (ours, theirs) {
            (Some(ours), Some(theirs)) if Arc::ptr_eq(ours, theirs) => 0,
            (ours, _) => ours.as_ref().map_or(0, |geometry| geometry.heap_bytes()),
        });
        let points = carried.sum::<usize>() + memory::list(geometry) + targets.heap_bytes();
        let blocks = memory::list(arriving) + memory::bits(is_arriving);
        let queue = queue.as_ref().map_or(0, |queue| queue.heap_bytes());
        sent.heap_bytes()
            + points
            + blocks
            + next.heap_bytes()
            + changes.heap_bytes()
            + writer.heap_bytes()
            + queue
    }

    /// Sets the AO of a point: 1 closed to 255 open, or [`NO_VALUE`](super::NO_VALUE) for a point that clients leave
    /// out. Returns whether it differs from the clients' value by its threshold, or `None` if there is no such point.
    /// Then the next frame sends it, unless its parents tell enough; it also differs if its block was never sent, or
    /// if it gets or loses its value. With a [`Budget`] it may have to wait.
    ///
    /// All points of a block are sent together the first time, blocks in the order in which they were first set.
    /// Points of it that were not set are sent as their parents predict them, or as the points before.
    #[inline]
    pub fn set_ao(&mut self, point: u32, ao: u8) -> Option<bool> {
        self.set_ao_within(point, ao, self.settings.threshold)
    }

    /// Sets the AO of a point as [`set_ao`](Self::set_ao) does, but with a threshold of its own: for points that pictures
    /// need less exactly. One that is at most that of the settings counts as that. The next call of `set_ao` brings the point
    /// back within the threshold of the settings.
    pub fn set_ao_within(&mut self, point: u32, ao: u8, threshold: u8) -> Option<bool> {
        let layout = &self.sent.layout;
        if !layout.points_of(self.instance as u32).contains(&(point as usize)) {
            self.instance = layout.instance_of(point)?;
        }
        let index = layout.padded_index_in(self.instance, point);
        let block = index.block();
        if !self.sent.present[block] {
            self.targets.take(index, ao, threshold);
            if !self.is_arriving.replace(block, true) {
                self.arriving.push(block as u32);
            }
            return Some(true);
        }
        Some(self.targets.set(index, ao, threshold, self.sent.values[index.0]))
    }

    /// Says that the AO of a point is no longer known, because it is out of view. Its byte is then as its parents predict it,
    /// within any error, until the point is set again.
    pub fn release(&mut self, point: u32) {
        if let Some(index) = self.sent.layout.padded_index(point) {
            self.targets.release(index);
        }
    }

    /// Returns the threshold of a point: its AO byte differs by less from the one of clients after a frame without a
    /// [`Budget`]. It is 255 for one that was [released](Self::release). `None` if there is no such point, or clients do not
    /// have it.
    #[must_use]
    pub fn threshold(&self, point: u32) -> Option<u8> {
        let index = self.sent.layout.padded_index(point).filter(|index| self.sent.present[index.block()])?;
        Some(self.targets.threshold(index))
    }

    /// Returns how many points the next frame brings within their threshold: those of blocks that were never sent, and those
    /// that differ. Some of the latter follow from their parents. With a [`Budget`] some may have to wait.
    #[must_use]
    pub fn pending_points(&self) -> u32 {
        let layout = &self.sent.layout;
        let arriving: usize = self.arriving.iter().map(|block| layout.block_len(*block as usize)).sum();
        self.targets.differing_points() + arriving as u32
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
        &self.targets.latest()[self.sent.layout.padded_range(instance as usize)]
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
    /// ever set, as blocks that arrive. It starts a group: the coder context becomes fresh.
    ///
    /// The header of a delta has the number of points in the frame instead of `meta.changed_points`.
    ///
    /// # Errors
    /// [`EncodeError`]; the state of clients is then unchanged, and the next call writes all that this one should have.
    pub fn finish(&mut self, mut meta: FrameMeta, coder: BlockCoder) -> Result<EncodedFrame, EncodeError> {
        let (frame, last) = (meta.frame, self.sent.frame);
        if let Some(last) = last.filter(|last| *last >= frame) {
            return Err(EncodeError::FrameOrder { frame, last });
        }
        self.writer.clear();
        for block in &self.arriving {
            self.targets.arrive(&self.sent, &self.geometry, *block as usize);
        }
        match meta.kind {
            FrameKind::Delta if last.is_none() => return Err(EncodeError::NoKeyframe { frame }),
            FrameKind::Delta => meta.changed_points = self.finish_delta(coder)?,
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
        let mut next = self.sent.empty();
        self.write_parcels(&mut next, &order, coder)?;
        next.hash = next.full_hash();
        self.sent = next;
        self.targets.clear();
        self.arriving.clear();
        self.is_arriving.fill(false);
        if let Some(queue) = &mut self.queue {
            queue.clear();
        }
        Ok(())
    }

    /// Writes the sections of a delta. Returns the number of points in them.
    fn finish_delta(&mut self, coder: BlockCoder) -> Result<u32, EncodeError> {
        let mut hash = self.sent.hash;
        let mut next = None;
        if !self.arriving.is_empty() {
            let arriving = self.arriving.clone();
            let mut with = self.sent.without_context();
            self.write_parcels(&mut with, &arriving, coder)?;
            hash = hash_with_arrivals(&self.sent, &with);
            next = Some(with);
        }
        self.write_changes(coder)?;
        // Nothing can fail from here on.
        self.sent.hash = self.sent.hash_after(hash, &self.next);
        self.targets.update(&self.sent, &self.next);
        self.sent.commit(&self.changes, &self.next);
        if let Some(next) = next {
            // The changes are to blocks that were there before; now the arrivals are added.
            for block in &self.arriving {
                let range = next.block_range(*block as usize);
                self.sent.values[range.clone()].copy_from_slice(&next.values[range]);
                self.sent.present[*block as usize] = true;
                self.is_arriving.set(*block as usize, false);
            }
            self.sent.geometry = next.geometry;
            self.sent.received = next.received;
            self.arriving.clear();
        }
        Ok(self.writer.points())
    }

    /// Writes the changes, or those that fit the budget, which are then left in `changes`.
    fn write_changes(&mut self, coder: BlockCoder) -> Result<(), EncodeError> {
        let Encoder { sent, changes, writer, targets, next, queue, .. } = self;
        targets.choose(sent, (changes, next), |_| true);
        if let Some(queue) = queue {
            return queue.write(PendingFrame { writer, sent, targets, next, coder }, changes);
        }
        if !changes.levels.is_empty() {
            let (known, model) = sent.view_and_model();
            writer.changes(known, model, changes, coder, usize::MAX)?;
        }
        Ok(())
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
        .write(&mut self.writer, order, self.targets.arrivals(), coder)?;
        let own = self.geometry.iter().zip(&next.received);
        for (held, (own, received)) in next.geometry.iter_mut().zip(own) {
            if *received {
                held.clone_from(own);
            }
        }
        Ok(())
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
