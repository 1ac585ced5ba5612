//! The decoder of profile `surface`: it applies a frame body completely or not at all.
//!
//! It decodes everything beside the state and checks it, including the hash of the resulting state. Only then does it
//! change the state.

use std::sync::Arc;

use super::encoder::hash_with_arrivals;
use super::model::change::ChangeModel;
use super::model::context;
use super::model::history::History;
use super::model::patch::PatchModel;
use super::prediction::{NextValues, Predictor};
use super::section::changes::{ChangeError, Changes};
use super::section::geometry::{self, GeometrySectionError};
use super::section::patch::Patch;
use super::section::values::{ClientValues, ValueError, Values};
use super::section::writer::FrameModels;
use super::state::value_words;
use super::{SectionError, State};
use crate::block::{CoderId, Decompressor};
use crate::envelope::{
    FrameBody, FrameError, FrameInfo, FrameKind, HASH_OFFSET, Profile, SectionBlock, SectionInfo, SectionTag,
    check_follows,
};
use crate::hash::RecordKind;
use crate::range::{LengthMismatch, RangeDecoder};
use crate::{Limits, StateHash};

/// Applies frame bodies. It keeps its buffers between frames.
#[derive(Debug, Default)]
pub struct Decoder {
    decompressor: Decompressor,
    plain: Vec<u8>,
    changes: Changes,
    next: NextValues,
    model: Option<ChangeModel>,
    patch: Patch,
    values: Vec<u8>,
    present: Vec<bool>,
}

impl Decoder {
    /// Creates a decoder that has allocated nothing yet.
    #[must_use]
    pub fn new() -> Decoder {
        Decoder::default()
    }

    /// Parses a frame body and applies it: [`FrameBody::parse`], then [`Decoder::apply`].
    ///
    /// # Errors
    /// Those of [`Decoder::apply`].
    pub fn decode(
        &mut self,
        state: &mut State,
        bytes: &[u8],
        limits: &Limits,
    ) -> Result<FrameInfo, FrameError> {
        let body = FrameBody::parse(bytes, limits)?;
        self.apply(state, &body, limits)?;
        Ok(body.into_info())
    }

    /// Applies a frame body to `state`. It checks everything first, including the hash of the resulting state, and
    /// then writes.
    ///
    /// A frame with only changes allocates nothing once the buffers have grown. They hold the largest section seen, at
    /// most `limits.max_block_bytes`.
    ///
    /// # Errors
    /// [`FrameError`] tells what is wrong and where; `state` is then unchanged.
    pub fn apply(
        &mut self,
        state: &mut State,
        body: &FrameBody<'_>,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        let info = body.info();
        check_follows(info, Profile::SURFACE, state.frame)?;
        let computed = match info.kind {
            FrameKind::Key => {
                let mut next = self.keyframe(state, body.blocks(), limits)?;
                next.hash = next.full_hash();
                let computed = check_hash(next.hash, info)?;
                *state = next;
                computed
            }
            FrameKind::Delta if info.section(SectionTag::PATCH).is_some() => {
                self.patch(state, info, body.blocks(), limits)?
            }
            FrameKind::Delta => self.delta(state, info, body.blocks(), limits)?,
        };
        state.hash = computed;
        state.frame = Some(info.frame);
        Ok(())
    }

    /// Returns the state of a keyframe. It keeps the geometry that the stream does not carry.
    pub(super) fn keyframe<'a>(
        &mut self,
        state: &State,
        blocks: impl Iterator<Item = SectionBlock<'a>>,
        limits: &Limits,
    ) -> Result<State, FrameError> {
        let mut next = state.empty();
        let mut models = None;
        for block in blocks {
            if block.section.tag == SectionTag::CONTEXT {
                (next.history, next.model) = self.read_context(state, &block, limits)?;
            } else {
                self.parcel(&mut next, &block, models.get_or_insert_with(FrameModels::new), limits)?;
            }
        }
        Ok(next)
    }

    /// Changes `state` by a delta and returns the hash after it.
    fn delta<'a>(
        &mut self,
        state: &mut State,
        info: &FrameInfo,
        mut blocks: impl Iterator<Item = SectionBlock<'a>> + Clone,
        limits: &Limits,
    ) -> Result<StateHash, FrameError> {
        let parcels = blocks.clone().filter(|block| block.section.tag != SectionTag::CHANGES);
        let mut next = None;
        let mut models = None;
        for block in parcels {
            let next = next.get_or_insert_with(|| state.without_context());
            self.parcel(next, &block, models.get_or_insert_with(FrameModels::new), limits)?;
        }
        let mut hash = next.as_ref().map_or(state.hash, |next| hash_with_arrivals(state, next));
        self.changes.clear();
        self.next.start(&[]);
        let mut learned = false;
        if let Some(block) = blocks.find(|block| block.section.tag == SectionTag::CHANGES) {
            learned = self.read_changes(state, &block, limits)?;
            hash = state.hash_after(hash, &self.next);
        }
        let computed = check_hash(hash, info)?;
        state.commit(&self.changes, &self.next);
        if let (true, Some(model)) = (learned, &mut self.model) {
            std::mem::swap(&mut state.model, model);
        }
        if let Some(next) = next {
            for block in (0..next.present.len()).filter(|block| !state.present[*block]) {
                let range = next.block_range(block);
                state.values[range.clone()].copy_from_slice(&next.values[range]);
            }
            state.present = next.present;
            state.geometry = next.geometry;
            state.received = next.received;
        }
        Ok(computed)
    }

    /// Changes `state` by a patch and returns the hash after it.
    fn patch<'a>(
        &mut self,
        state: &mut State,
        info: &FrameInfo,
        blocks: impl Iterator<Item = SectionBlock<'a>>,
        limits: &Limits,
    ) -> Result<StateHash, FrameError> {
        let mut learned = None;
        for block in blocks {
            if block.section.tag == SectionTag::CONTEXT {
                learned = Some(self.read_context(state, &block, limits)?);
            } else {
                self.read_patch(state, info, &block, limits)?;
            }
        }
        let hash = self.patch.iter().fold(state.hash, |hash, (index, byte)| {
            let (kind, at, new) = (RecordKind::Value, index.0 as u32, value_words(byte));
            if state.present[index.block()] {
                hash.replace(kind, at, &value_words(state.values[index.0]), &new)
            } else {
                hash.insert(kind, at, &new)
            }
        });
        let computed = check_hash(hash, info)?;
        for (index, byte) in self.patch.iter() {
            state.values[index.0] = byte;
        }
        self.patch.add_arrivals(&mut state.present);
        (state.history, state.model) =
            learned.unwrap_or_else(|| (History::new(state.present.len()), ChangeModel::new()));
        Ok(computed)
    }

    /// Reads a PATCH section into `self.patch` and checks that it fits the state.
    fn read_patch(
        &mut self,
        state: &State,
        info: &FrameInfo,
        block: &SectionBlock<'_>,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        let SectionInfo { records, coder, .. } = block.section;
        let (offset, blocks) = (block.offset, state.layout.blocks());
        let refuse = |error: ChangeError| refused(block, error);
        if coder != CoderId::RANGE {
            self.decompress(block, limits)?;
            self.patch.read_plain(&self.plain, blocks, records).map_err(refuse)?;
            check_base(self.patch.back, state, info, offset)?;
            self.present.clone_from(&state.present);
            self.patch.add_arrivals(&mut self.present);
            return self.patch.check(&state.layout, &self.present).map_err(refuse);
        }
        let mut decoder = RangeDecoder::new(block.bytes);
        let mut model = PatchModel::new();
        self.patch.back = model.back(&mut decoder, 0);
        check_base(self.patch.back, state, info, offset)?;
        self.values.clone_from(&state.values);
        let (most, none) = (records as usize, Patch::default());
        model.arrivals(&mut decoder, blocks, (&[], &mut self.patch), most).map_err(refuse)?;
        self.present.clone_from(&state.present);
        self.patch.add_arrivals(&mut self.present);
        let known = (&*state.layout, self.present.as_slice());
        let pair = (&none, &mut self.patch);
        let known_values = (state.geometry.as_slice(), self.values.as_mut_slice());
        model.code(&mut decoder, known, known_values, pair, most, RangeDecoder::is_exhausted);
        check_end(decoder, block)?;
        let found = self.patch.bytes.len();
        if found != most {
            return Err(refuse(ChangeError::Count { expected: records, found }));
        }
        self.patch.check(&state.layout, &self.present).map_err(refuse)?;
        check_plain(self.patch.plain_bytes(blocks), block)
    }

    /// Reads a CONTEXT section for a client of `state`.
    fn read_context(
        &mut self,
        state: &State,
        block: &SectionBlock<'_>,
        limits: &Limits,
    ) -> Result<(History, ChangeModel), FrameError> {
        check_single(block)?;
        self.decompress(block, limits)?;
        let mut learned = (History::new(state.present.len()), ChangeModel::new());
        context::read(&self.plain, &mut learned.0, &mut learned.1).map_err(|error| refused(block, error))?;
        Ok(learned)
    }

    /// Reads a GEOMETRY or VALUES section into `next`.
    fn parcel(
        &mut self,
        next: &mut State,
        block: &SectionBlock<'_>,
        models: &mut FrameModels,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        if block.section.tag == SectionTag::GEOMETRY {
            self.read_geometry(next, block, models, limits)
        } else {
            self.read_values(next, block, models, limits)
        }
    }

    fn read_geometry(
        &mut self,
        next: &mut State,
        block: &SectionBlock<'_>,
        models: &mut FrameModels,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        let layout = Arc::clone(&next.layout);
        let refuse = |error: GeometrySectionError| refused(block, error);
        let records = block.section.records;
        let sets = if block.section.coder == CoderId::RANGE {
            let mut decoder = RangeDecoder::new(block.bytes);
            let (model, numbers) = (&mut models.geometry, &mut models.sets);
            let none = geometry::Sets::new();
            let coded = geometry::code(
                model,
                numbers,
                &mut decoder,
                &layout,
                &none,
                records,
                RangeDecoder::is_exhausted,
            );
            let sets = coded.map_err(refuse)?;
            check_end(decoder, block)?;
            check_plain(geometry::plain_bytes(&sets), block)?;
            sets
        } else {
            self.decompress(block, limits)?;
            geometry::read_plain(&self.plain, &layout, records).map_err(refuse)?
        };
        for (set, geometry) in sets {
            let at = set as usize;
            if next.received.replace(at, true) {
                return Err(refuse(GeometrySectionError::Set { set }));
            }
            next.geometry[at] = Some(geometry);
        }
        Ok(())
    }

    fn read_values(
        &mut self,
        next: &mut State,
        block: &SectionBlock<'_>,
        models: &mut FrameModels,
        limits: &Limits,
    ) -> Result<(), FrameError> {
        let layout = Arc::clone(&next.layout);
        let refuse = |error: ValueError| refused(block, error);
        let SectionInfo { records, coder, .. } = block.section;
        let mut found = Values::default();
        let clients =
            ClientValues { geometry: &next.geometry, bytes: &mut next.values, present: &mut next.present };
        if coder == CoderId::RANGE {
            let mut decoder = RangeDecoder::new(block.bytes);
            let none = Values::default();
            let pair = (&none, &mut found);
            models
                .values
                .code(&mut decoder, &layout, clients, pair, records, RangeDecoder::is_exhausted)
                .map_err(refuse)?;
            check_end(decoder, block)?;
            return check_plain(found.plain_bytes(), block);
        }
        self.decompress(block, limits)?;
        found.read_plain(&self.plain, &layout, clients, records).map_err(refuse)
    }

    /// Reads a CHANGES section. Returns whether the model has learned from it; then `self.model` is the next model.
    fn read_changes(
        &mut self,
        state: &State,
        block: &SectionBlock<'_>,
        limits: &Limits,
    ) -> Result<bool, FrameError> {
        let SectionInfo { records, coder, .. } = block.section;
        let blocks = state.layout.blocks();
        let refuse = |error: ChangeError| refused(block, error);
        if coder != CoderId::RANGE {
            self.decompress(block, limits)?;
            self.changes.read_plain(&self.plain, blocks, records).map_err(refuse)?;
            check_changes(state, &self.changes).map_err(refuse)?;
            let State { layout, geometry, values, present, .. } = state;
            let mut predictor =
                Predictor::new(layout, geometry, values, &mut self.next, self.changes.quantum);
            predictor.apply(&self.changes, present);
            predictor.finish().map_err(refuse)?;
            return Ok(false);
        }
        let model = self.model.get_or_insert_with(ChangeModel::new);
        model.clone_from(&state.model);
        let mut decoder = RangeDecoder::new(block.bytes);
        let none = Changes::default();
        let made = (&mut self.changes, &mut self.next);
        let most = records as usize;
        let fits = model.code(&mut decoder, state.view(), &none, made, most, RangeDecoder::is_exhausted);
        let found = self.changes.levels.len();
        if found != records as usize {
            return Err(refuse(ChangeError::Count { expected: records, found }));
        }
        check_end(decoder, block)?;
        check_plain(self.changes.plain_bytes(blocks), block)?;
        check_changes(state, &self.changes).map_err(refuse)?;
        fits.map_err(refuse)?;
        Ok(true)
    }

    fn decompress(&mut self, block: &SectionBlock<'_>, limits: &Limits) -> Result<(), FrameError> {
        let SectionInfo { tag, coder, raw_bytes, .. } = block.section;
        self.decompressor
            .decompress(block.bytes, coder, raw_bytes, limits.max_block_bytes, &mut self.plain)
            .map_err(|source| FrameError::Block { offset: block.offset, section: tag, source })
    }
}

/// Returns the error of a section.
fn refused(block: &SectionBlock<'_>, error: impl Into<SectionError>) -> FrameError {
    let error: SectionError = error.into();
    FrameError::Content { section: block.section.tag, offset: block.offset, problem: error.into() }
}

/// Checks that a section with one record has the record count 1.
fn check_single(block: &SectionBlock<'_>) -> Result<(), FrameError> {
    let SectionInfo { tag, records, .. } = block.section;
    if records == 1 {
        return Ok(());
    }
    Err(FrameError::TooManyRecords { offset: block.offset, section: tag, records, places: 1 })
}

/// Checks that a patch that reaches back `back` frames fits the state.
fn check_base(back: u32, state: &State, info: &FrameInfo, offset: usize) -> Result<(), FrameError> {
    let last = state.frame.unwrap_or_default();
    match info.frame.0.checked_sub(back) {
        Some(base) if base <= last.0 => Ok(()),
        _ => Err(FrameError::PatchBase { offset, back, last }),
    }
}

fn check_hash(computed: StateHash, info: &FrameInfo) -> Result<StateHash, FrameError> {
    if computed == info.hash {
        Ok(computed)
    } else {
        Err(FrameError::Hash { offset: HASH_OFFSET, stored: info.hash, computed })
    }
}

/// Checks that changes have a quantum, are to points of present blocks, and are not 0.
fn check_changes(state: &State, changes: &Changes) -> Result<(), ChangeError> {
    if changes.quantum == 0 {
        return Err(ChangeError::Quantum);
    }
    changes.points.check(&state.layout, &state.present)?;
    match changes.iter().find(|(_, level)| *level == 0) {
        Some((index, _)) => Err(ChangeError::Level { padded_index: index.0 as u32, level: 0 }),
        None => Ok(()),
    }
}

fn check_end(decoder: RangeDecoder<'_>, block: &SectionBlock<'_>) -> Result<(), FrameError> {
    decoder.finish().map_err(|mismatch| {
        let extra = match mismatch {
            LengthMismatch::Short => None,
            LengthMismatch::Long { extra } => Some(extra),
        };
        FrameError::RangeLength { offset: block.offset, section: block.section.tag, extra }
    })
}

fn check_plain(found: usize, block: &SectionBlock<'_>) -> Result<(), FrameError> {
    let SectionInfo { tag, raw_bytes, .. } = block.section;
    if found == raw_bytes as usize {
        return Ok(());
    }
    Err(FrameError::PlainLength { offset: block.offset, section: tag, expected: raw_bytes, found })
}
