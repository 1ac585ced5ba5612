//! The state of a client of a `surface` stream.

use std::sync::Arc;

use bitvec::vec::BitVec;

use super::model::change::{ChangeModel, StateView};
use super::model::history::History;
use super::prediction::NextValues;
use super::section::changes::Changes;
use super::{BLOCK_POINTS, Geometry, GeometryDigest, GeometryError, Layout};
use crate::envelope::FrameIndex;
use crate::hash::RecordKind;
use crate::{StateHash, memory};

/// Geometry of the sets, AO of the points, the coder context, and the hash over everything received.
///
/// Only [`super::Decoder`] and the encoder change it, so that hash and content always agree.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    pub(crate) layout: Arc<Layout>,
    /// By set: the points that came with frames. Points of other sets have no parents, so that a client without their
    /// geometry can decode them, too.
    pub(crate) geometry: Vec<Option<Arc<Geometry>>>,
    /// By set: the points that a client made from the scene.
    shared: Vec<Option<Arc<Geometry>>>,
    /// By set: whether its geometry came with a frame. Then it is part of the hash.
    pub(crate) received: BitVec,
    /// By padded index; 0 where nothing was received.
    pub(crate) values: Vec<u8>,
    /// By block: whether its values were received. Bytes and not bits, because the coders test slices of it in every
    /// frame.
    pub(crate) present: Vec<bool>,
    pub(crate) history: History,
    pub(crate) model: ChangeModel,
    pub(crate) hash: StateHash,
    pub(crate) frame: Option<FrameIndex>,
}

impl State {
    /// Creates the empty state: no geometry, no AO, hash 0.
    ///
    /// It allocates 5 B a point, rounded up to whole blocks, and 81 kB. [`Layout::new`] has checked the sizes.
    #[must_use]
    pub fn new(layout: Arc<Layout>) -> State {
        let blocks = layout.blocks();
        State {
            geometry: vec![None; layout.sets().len()],
            shared: vec![None; layout.sets().len()],
            received: BitVec::repeat(false, layout.sets().len()),
            values: vec![0; blocks * BLOCK_POINTS],
            present: vec![false; blocks],
            history: History::new(blocks),
            model: ChangeModel::new(),
            hash: StateHash::default(),
            frame: None,
            layout,
        }
    }

    /// Returns the heap bytes in use, including the layout and the points received.
    pub(super) fn heap_bytes(&self) -> usize {
        let State { layout, geometry, shared, received, values, present, history, model, .. } = self;
        let points = geometry.iter().chain(shared).flatten().map(|geometry| geometry.heap_bytes());
        let points: usize = points.sum();
        let lists = memory::list(geometry)
            + memory::list(shared)
            + memory::bits(received)
            + memory::list(values)
            + memory::list(present);
        layout.heap_bytes() + points + lists + history.heap_bytes() + model.heap_bytes()
    }

    /// Returns the layout of the stream.
    #[must_use]
    pub fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    /// Returns the hash of everything received. Every frame updates it.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        self.hash
    }

    /// Returns the last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        self.frame
    }

    /// Returns the points of a set; `None` until they were received.
    #[must_use]
    pub fn geometry(&self, set: u32) -> Option<&Arc<Geometry>> {
        let at = set as usize;
        self.geometry.get(at)?.as_ref().or(self.shared[at].as_ref())
    }

    /// Sets the points of a set, for streams that do not carry them
    /// ([`GeometrySource::Shared`](super::GeometrySource)). Points that came with a frame stay.
    ///
    /// # Errors
    /// [`GeometryError`] if there is no such set, or the points are not those of the layout.
    pub fn share_geometry(&mut self, set: u32, geometry: Arc<Geometry>) -> Result<(), GeometryError> {
        let wanted = self.layout.sets().get(set as usize).ok_or(GeometryError::NoSet { set })?;
        if geometry.layout() != wanted || geometry.digest() != wanted.digest {
            return Err(GeometryError::Other { set });
        }
        self.shared[set as usize] = Some(geometry);
        Ok(())
    }

    /// Returns the AO bytes of an instance's points in the order of its set's geometry; 255 is open. Where
    /// [`State::is_present`] returns false nothing was received, and the bytes have no meaning.
    #[must_use]
    pub fn values(&self, instance: u32) -> &[u8] {
        if instance as usize >= self.layout.members().len() {
            return &[];
        }
        &self.values[self.layout.padded_range(instance as usize)]
    }

    /// Returns whether the AO of points `block * BLOCK_POINTS ..` of an instance was received.
    #[inline]
    #[must_use]
    pub fn is_present(&self, instance: u32, block: usize) -> bool {
        self.present[self.layout.blocks_of(instance)].get(block).is_some_and(|here| *here)
    }

    /// Returns the number of points whose AO was received.
    #[must_use]
    pub fn present_points(&self) -> u64 {
        let here = self.present.iter().enumerate().filter(|(_, here)| **here);
        here.map(|(block, _)| self.layout.block_len(block) as u64).sum()
    }

    /// Creates a state with this geometry and these values, all present, for tests of code that reads states.
    ///
    /// `geometry` is in the order of the sets, `values` in the order of point ids.
    #[must_use]
    pub fn from_parts(layout: Arc<Layout>, geometry: Vec<Arc<Geometry>>, values: &[u8]) -> State {
        let mut state = State::new(layout);
        state.geometry = geometry.into_iter().map(Some).collect();
        state.received.fill(true);
        for (value, point) in values.iter().zip(0..) {
            if let Some(index) = state.layout.padded_index(point) {
                state.values[index.0] = *value;
            }
        }
        state.present.fill(true);
        state.hash = state.full_hash();
        state
    }

    /// Computes the hash from scratch: the reference of [`State::hash`].
    #[must_use]
    pub fn full_hash(&self) -> StateHash {
        let mut hash = StateHash::default();
        for (at, received) in self.received.iter().enumerate() {
            if *received {
                hash = hash.insert(
                    RecordKind::Geometry,
                    at as u32,
                    &geometry_words(self.layout.sets()[at].digest),
                );
            }
        }
        for block in (0..self.present.len()).filter(|block| self.present[*block]) {
            for index in self.block_range(block) {
                hash = hash.insert(RecordKind::Value, index as u32, &value_words(self.values[index]));
            }
        }
        hash
    }

    /// Returns the empty state of the same stream, with the points that did not come with frames.
    pub(crate) fn empty(&self) -> State {
        State { shared: self.shared.clone(), ..State::new(Arc::clone(&self.layout)) }
    }

    /// Returns a copy with a fresh coder context, for blocks that arrive.
    pub(super) fn without_context(&self) -> State {
        let State { layout, geometry, shared, received, values, present, hash, frame, .. } = self;
        State {
            layout: Arc::clone(layout),
            geometry: geometry.clone(),
            shared: shared.clone(),
            received: received.clone(),
            values: values.clone(),
            present: present.clone(),
            history: History::new(0),
            model: ChangeModel::new(),
            hash: *hash,
            frame: *frame,
        }
    }

    /// Returns the padded indices of the points of a block.
    pub(super) fn block_range(&self, block: usize) -> std::ops::Range<usize> {
        block * BLOCK_POINTS..block * BLOCK_POINTS + self.layout.block_len(block)
    }

    /// Returns the view for the change model, and the model.
    pub(super) fn view_and_model(&mut self) -> (StateView<'_>, &mut ChangeModel) {
        let State { layout, geometry, values, present, history, model, .. } = self;
        (StateView { layout, values, present, history, geometry }, model)
    }

    /// Returns the view for the change model.
    pub(super) fn view(&self) -> StateView<'_> {
        let State { layout, geometry, values, present, history, .. } = self;
        StateView { layout, values, present, history, geometry }
    }

    /// Returns `hash` after the bytes that `next` has instead.
    pub(super) fn hash_after(&self, hash: StateHash, next: &NextValues) -> StateHash {
        next.moved_blocks().flat_map(|block| self.block_range(block)).fold(hash, |hash, at| {
            let (old, new) = (self.values[at], next.values[at]);
            if old == new {
                return hash;
            }
            hash.replace(RecordKind::Value, at as u32, &value_words(old), &value_words(new))
        })
    }

    /// Takes the bytes that `next` has after these changes. The caller sets the hash.
    pub(super) fn commit(&mut self, changes: &Changes, next: &NextValues) {
        self.history.advance();
        for (index, level) in changes.iter() {
            self.history.record(index, level);
        }
        for range in next.moved_blocks().map(|block| block * BLOCK_POINTS..(block + 1) * BLOCK_POINTS) {
            self.values[range.clone()].copy_from_slice(&next.values[range]);
        }
    }
}

/// Returns the hash word of a byte; 0 stands for a missing one.
pub(super) fn value_words(value: u8) -> [u32; 1] {
    [u32::from(value) + 1]
}

/// Returns the hash words of a set's points.
pub(super) fn geometry_words(digest: GeometryDigest) -> [u32; 3] {
    [digest.0 as u32, (digest.0 >> 32) as u32, 1]
}
