//! Writes sections: plain layouts through a block coder, or through the range coder and its models.

use super::State;
use super::change_model::{ChangeModel, Known};
use super::changes::Changes;
use super::context;
use super::geometry_model::GeometryModel;
use super::geometry_section::{self, Sets};
use super::history::History;
use super::patch_model::PatchModel;
use super::patch_section::Patch;
use super::values::{ValueModel, Values};
use crate::block::{BlockCoder, BlockError, CoderId, Compressor};
use crate::frame::{EncodeError, SectionInfo, SectionTag};
use crate::memory;
use crate::range::{Number, RangeEncoder};

/// The blocks of one frame, and the section table that goes before them.
#[derive(Debug, Default)]
pub(super) struct SectionWriter {
    pub(super) sections: Vec<SectionInfo>,
    pub(super) blocks: Vec<u8>,
    compressor: Compressor,
    plain: Vec<u8>,
    found: Changes,
}

/// Models that live as long as a frame.
pub(super) struct FrameModels {
    pub(super) geometry: GeometryModel,
    pub(super) sets: Number,
    pub(super) values: ValueModel,
}

impl FrameModels {
    pub(super) fn new() -> FrameModels {
        FrameModels { geometry: GeometryModel::new(), sets: Number::new(), values: ValueModel::new() }
    }
}

impl SectionWriter {
    /// Bytes held.
    pub(super) fn held(&self) -> usize {
        let SectionWriter { sections, blocks, compressor, plain, found } = self;
        memory::list(sections) + memory::list(blocks) + compressor.held() + memory::list(plain) + found.held()
    }

    /// Ready for the next frame.
    pub(super) fn clear(&mut self) {
        self.sections.clear();
        self.blocks.clear();
    }

    /// Ends a section whose block starts at `start`.
    fn section(&mut self, tag: SectionTag, coder: CoderId, records: usize, raw_bytes: usize, start: usize) {
        let wire_bytes = (self.blocks.len() - start) as u32;
        let (records, raw_bytes) = (records as u32, raw_bytes as u32);
        self.sections.push(SectionInfo { tag, coder, records, raw_bytes, wire_bytes });
    }

    /// Compresses what is in `plain`.
    fn block(&mut self, tag: SectionTag, coder: BlockCoder, records: usize) -> Result<(), EncodeError> {
        let start = self.blocks.len();
        let id = self
            .compressor
            .compress(&self.plain, coder, &mut self.blocks)
            .map_err(|source: BlockError| EncodeError::Block { section: tag, source })?;
        self.section(tag, id, records, self.plain.len(), start);
        Ok(())
    }

    pub(super) fn geometry(
        &mut self,
        layout: &super::Layout,
        sets: &Sets,
        models: &mut FrameModels,
        coder: BlockCoder,
    ) -> Result<(), EncodeError> {
        let points = sets.iter().map(|(_, geometry)| geometry.len()).sum();
        if points == 0 {
            return Ok(());
        }
        if coder == BlockCoder::Range {
            let start = self.blocks.len();
            let mut bits = RangeEncoder::new(&mut self.blocks);
            let records = points as u32;
            let coded = geometry_section::code(
                &mut models.geometry,
                &mut models.sets,
                &mut bits,
                layout,
                sets,
                records,
                |_| false,
            );
            bits.finish();
            debug_assert!(coded.is_ok(), "{coded:?}");
            self.section(
                SectionTag::GEOMETRY,
                CoderId::RANGE,
                points,
                geometry_section::plain_bytes(sets),
                start,
            );
            return Ok(());
        }
        self.plain.clear();
        geometry_section::write_plain(sets, &mut self.plain);
        self.block(SectionTag::GEOMETRY, coder, points)
    }

    /// Writes values. `bytes` and `present` are what clients have by then, and are brought up to date.
    pub(super) fn values(
        &mut self,
        layout: &super::Layout,
        (bytes, present): (&mut [u8], &mut [bool]),
        values: &Values,
        models: &mut FrameModels,
        coder: BlockCoder,
    ) -> Result<(), EncodeError> {
        let points = values.bytes.len();
        if coder == BlockCoder::Range {
            let start = self.blocks.len();
            let mut bits = RangeEncoder::new(&mut self.blocks);
            let mut found = Values::default();
            let pair = (values, &mut found);
            let coded =
                models.values.code(&mut bits, layout, (bytes, present), pair, points as u32, |_| false);
            bits.finish();
            debug_assert!(coded.is_ok(), "{coded:?}");
            self.section(SectionTag::VALUES, CoderId::RANGE, points, values.plain_bytes(), start);
            return Ok(());
        }
        self.plain.clear();
        values.write_plain(&mut self.plain);
        values.scatter(layout, bytes);
        values.blocks().for_each(|block| present[block] = true);
        self.block(SectionTag::VALUES, coder, points)
    }

    /// Writes changes of what is `known`, from which `model` learns. The range coder stops where they take more than `most`
    /// bytes; then there is no section, and the answer is how many came before that.
    pub(super) fn changes(
        &mut self,
        known: Known<'_>,
        model: &mut ChangeModel,
        changes: &Changes,
        coder: BlockCoder,
        most: usize,
    ) -> Result<Option<usize>, EncodeError> {
        let (points, blocks) = (changes.levels.len(), known.layout.blocks());
        if coder == BlockCoder::Range {
            let start = self.blocks.len();
            let most = start.saturating_add(most);
            let mut bits = RangeEncoder::new(&mut self.blocks);
            model.code(&mut bits, known, changes, &mut self.found, points, |bits| bits.len() > most);
            bits.finish();
            if self.blocks.len() > most {
                self.blocks.truncate(start);
                return Ok(Some(self.found.levels.len()));
            }
            debug_assert_eq!(&self.found, changes);
            self.section(SectionTag::CHANGES, CoderId::RANGE, points, changes.plain_bytes(blocks), start);
            return Ok(None);
        }
        self.plain.clear();
        changes.write_plain(blocks, &mut self.plain);
        self.block(SectionTag::CHANGES, coder, points)?;
        Ok(None)
    }

    /// Writes a patch that leads to `state`.
    pub(super) fn patch(
        &mut self,
        state: &State,
        patch: &Patch,
        coder: BlockCoder,
    ) -> Result<(), EncodeError> {
        let (points, blocks) = (patch.bytes.len(), state.layout.blocks());
        if coder == BlockCoder::Range {
            let start = self.blocks.len();
            let mut bits = RangeEncoder::new(&mut self.blocks);
            let mut model = PatchModel::new();
            let mut found = Patch { back: model.back(&mut bits, patch.back), ..Patch::default() };
            let known = (&*state.layout, state.present.as_slice());
            let mut values = state.values.clone();
            model.code(&mut bits, known, &mut values, (patch, &mut found), points, |_| false);
            bits.finish();
            debug_assert_eq!(&found, patch);
            self.section(SectionTag::PATCH, CoderId::RANGE, points, patch.plain_bytes(blocks), start);
            return Ok(());
        }
        self.plain.clear();
        patch.write_plain(blocks, &mut self.plain);
        self.block(SectionTag::PATCH, coder, points)
    }

    /// Writes what was learned, if anything was. It is no data of points, so the range coder has no model for it.
    pub(super) fn context(&mut self, state: &State, coder: BlockCoder) -> Result<(), EncodeError> {
        if state.history == History::new(state.layout.blocks()) && state.model == ChangeModel::new() {
            return Ok(());
        }
        self.plain.clear();
        context::write(&state.history, &state.model, &mut self.plain);
        let coder = if coder == BlockCoder::Range { BlockCoder::default() } else { coder };
        self.block(SectionTag::CONTEXT, coder, 1)
    }
}
