//! What a client holds of a `surface` stream.

use std::sync::Arc;

use super::model::change::{ChangeModel, StateView};
use super::model::history::History;
use super::section::changes::Changes;
use super::{BLOCK_POINTS, Geometry, GeometryDigest, GeometryError, Layout, PaddedIndex};
use crate::envelope::FrameIndex;
use crate::hash::RecordKind;
use crate::{StateHash, memory};

/// Geometry of the sets, AO of the points, what the coder remembers of both, and the hash over all that came.
///
/// Only [`super::Decoder`] and the encoder change it, so hash and content always agree.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    pub(crate) layout: Arc<Layout>,
    pub(crate) geometry: Vec<Option<Arc<Geometry>>>,
    /// Whether a set's geometry came with a frame: then it is part of the hash.
    pub(crate) received: Vec<bool>,
    /// By slot; 0 where nothing came.
    pub(crate) values: Vec<u8>,
    /// By block.
    pub(crate) present: Vec<bool>,
    pub(crate) history: History,
    pub(crate) model: ChangeModel,
    pub(crate) hash: StateHash,
    pub(crate) frame: Option<FrameIndex>,
}

impl State {
    /// The empty state: no geometry, no AO, hash 0.
    ///
    /// It allocates 5 B a point, rounded up to blocks, and 75 kB; [`Layout::new`] has checked the sizes.
    #[must_use]
    pub fn new(layout: Arc<Layout>) -> State {
        let blocks = layout.blocks();
        State {
            geometry: vec![None; layout.sets().len()],
            received: vec![false; layout.sets().len()],
            values: vec![0; blocks * BLOCK_POINTS],
            present: vec![false; blocks],
            history: History::new(blocks),
            model: ChangeModel::new(),
            hash: StateHash::default(),
            frame: None,
            layout,
        }
    }

    /// Bytes held, the layout and the points that came included.
    pub(super) fn heap_bytes(&self) -> usize {
        let State { layout, geometry, received, values, present, history, model, .. } = self;
        let points: usize = geometry.iter().flatten().map(|geometry| geometry.heap_bytes()).sum();
        let lists =
            memory::list(geometry) + memory::list(received) + memory::list(values) + memory::list(present);
        layout.heap_bytes() + points + lists + history.heap_bytes() + model.heap_bytes()
    }

    /// The layout of the stream.
    #[must_use]
    pub fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    /// The hash of everything that came; kept up by every frame.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        self.hash
    }

    /// Returns the last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        self.frame
    }

    /// The points of a set; `None` until they came.
    #[must_use]
    pub fn geometry(&self, set: u32) -> Option<&Arc<Geometry>> {
        self.geometry.get(set as usize)?.as_ref()
    }

    /// Gives a set its points, for streams that do not carry them ([`GeometrySource::Shared`](super::GeometrySource)).
    ///
    /// # Errors
    /// [`GeometryError`] where the set is not there or the points are not those of the layout.
    pub fn share_geometry(&mut self, set: u32, geometry: Arc<Geometry>) -> Result<(), GeometryError> {
        let wanted = self.layout.sets().get(set as usize).ok_or(GeometryError::NoSet { set })?;
        if geometry.layout() != wanted || geometry.digest() != wanted.digest {
            return Err(GeometryError::Other { set });
        }
        let at = set as usize;
        if !self.received[at] {
            self.geometry[at] = Some(geometry);
        }
        Ok(())
    }

    /// AO bytes of an instance's points in the order of its set's geometry, 255 being open. Where
    /// [`State::is_present`] says no, nothing has come yet and the bytes mean nothing.
    #[must_use]
    pub fn values(&self, instance: u32) -> &[u8] {
        if instance as usize >= self.layout.members().len() {
            return &[];
        }
        &self.values[self.layout.padded_range(instance as usize)]
    }

    /// Whether the AO of an instance's points `block * BLOCK_POINTS ..` came.
    #[inline]
    #[must_use]
    pub fn is_present(&self, instance: u32, block: usize) -> bool {
        self.present[self.layout.blocks_of(instance)].get(block).is_some_and(|here| *here)
    }

    /// Points whose AO came.
    #[must_use]
    pub fn present_points(&self) -> u64 {
        let here = self.present.iter().enumerate().filter(|(_, here)| **here);
        here.map(|(block, _)| self.layout.block_len(block) as u64).sum()
    }

    /// A state that holds this geometry and these values, all of them present: for tests of what looks at states.
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

    /// The hash computed from scratch: the slow twin of [`State::hash`].
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

    /// The slots of a block.
    pub(super) fn block_range(&self, block: usize) -> std::ops::Range<usize> {
        block * BLOCK_POINTS..block * BLOCK_POINTS + self.layout.block_len(block)
    }

    /// What the model of changes looks at, and the model.
    pub(super) fn view_and_model(&mut self) -> (StateView<'_>, &mut ChangeModel) {
        let State { layout, values, present, history, model, .. } = self;
        (StateView { layout, values, present, history }, model)
    }

    /// What the model of changes looks at.
    pub(super) fn view(&self) -> StateView<'_> {
        let State { layout, values, present, history, .. } = self;
        StateView { layout, values, present, history }
    }

    /// `hash` after changes of what is here now.
    pub(super) fn hash_after(&self, hash: StateHash, changes: &Changes) -> StateHash {
        changes.iter().fold(hash, |hash, (index, level)| {
            let old = value_words(self.values[index.0]);
            let new = value_words(self.changed_value(index, level, changes.quantum));
            hash.replace(RecordKind::Value, index.0 as u32, &old, &new)
        })
    }

    /// The byte that a change leaves: `level` quanta from the one here, within 0 to 255.
    #[inline]
    pub(super) fn changed_value(&self, index: PaddedIndex, level: i16, quantum: u8) -> u8 {
        (i32::from(self.values[index.0]) + i32::from(level) * i32::from(quantum)).clamp(0, 255) as u8
    }

    /// Makes changes that were checked; the hash is set apart.
    pub(super) fn commit(&mut self, changes: &Changes) {
        self.history.advance();
        for (index, level) in changes.iter() {
            self.values[index.0] = self.changed_value(index, level, changes.quantum);
            self.history.record(index, level);
        }
    }
}

/// What stands for a byte in the hash: 0 stands for none.
pub(super) fn value_words(value: u8) -> [u32; 1] {
    [u32::from(value) + 1]
}

/// What stands for a set's points in the hash.
pub(super) fn geometry_words(digest: GeometryDigest) -> [u32; 3] {
    [digest.0 as u32, (digest.0 >> 32) as u32, 1]
}
