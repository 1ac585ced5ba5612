//! Writes sections: plain layouts by a block coder, or decisions by the range coder and its models.

use super::changes::Changes;
use super::geometry::{self, Sets};
use super::patch::Patch;
use super::values::{ClientValues, Values};
use crate::block::{BlockCoder, BlockError, CoderId, Compressor};
use crate::envelope::{EncodeError, SectionInfo, SectionTag};
use crate::memory;
use crate::range::{NumberModel, RangeEncoder};
use crate::surface::model::change::{ChangeModel, StateView};
use crate::surface::model::context;
use crate::surface::model::geometry::GeometryModel;
use crate::surface::model::history::History;
use crate::surface::model::patch::PatchModel;
use crate::surface::model::value::ValueModel;
use crate::surface::prediction::NextValues;
use crate::surface::{Layout, State};

/// The blocks of one frame and their section table.
#[derive(Debug, Default)]
pub(crate) struct SectionWriter {
    pub(crate) sections: Vec<SectionInfo>,
    pub(crate) blocks: Vec<u8>,
    compressor: Compressor,
    plain: Vec<u8>,
    coded: Changes,
    next: NextValues,
}

/// The models that live as long as a frame.
pub(crate) struct FrameModels {
    pub(crate) geometry: GeometryModel,
    pub(crate) sets: NumberModel,
    pub(crate) values: ValueModel,
}

impl FrameModels {
    pub(crate) fn new() -> FrameModels {
        FrameModels { geometry: GeometryModel::new(), sets: NumberModel::new(), values: ValueModel::new() }
    }
}

impl SectionWriter {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        let SectionWriter { sections, blocks, compressor, plain, coded, next } = self;
        memory::list(sections)
            + memory::list(blocks)
            + compressor.heap_bytes()
            + memory::list(plain)
            + coded.heap_bytes()
            + next.heap_bytes()
    }

    /// Clears everything for the next frame.
    pub(crate) fn clear(&mut self) {
        self.sections.clear();
        self.blocks.clear();
    }

    /// Returns the number of points in the sections of values and changes.
    pub(crate) fn points(&self) -> u32 {
        let of_points = |tag| matches!(tag, SectionTag::VALUES | SectionTag::CHANGES);
        let sections = self.sections.iter().filter(|section| of_points(section.tag));
        sections.map(|section| section.records).sum()
    }

    /// Adds a section whose block starts at `start` to the table.
    fn section(&mut self, tag: SectionTag, coder: CoderId, records: usize, raw_bytes: usize, start: usize) {
        let wire_bytes = (self.blocks.len() - start) as u32;
        let (records, raw_bytes) = (records as u32, raw_bytes as u32);
        self.sections.push(SectionInfo { tag, coder, records, raw_bytes, wire_bytes });
    }

    /// Compresses the content of `plain`.
    fn block(&mut self, tag: SectionTag, coder: BlockCoder, records: usize) -> Result<(), EncodeError> {
        let start = self.blocks.len();
        let id = self
            .compressor
            .compress(&self.plain, coder, &mut self.blocks)
            .map_err(|source: BlockError| EncodeError::Block { section: tag, source })?;
        self.section(tag, id, records, self.plain.len(), start);
        Ok(())
    }

    pub(crate) fn geometry(
        &mut self,
        layout: &Layout,
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
            let mut encoder = RangeEncoder::new(&mut self.blocks);
            let records = points as u32;
            let coded = geometry::code(
                &mut models.geometry,
                &mut models.sets,
                &mut encoder,
                layout,
                sets,
                records,
                |_| false,
            );
            encoder.finish();
            debug_assert!(coded.is_ok(), "{coded:?}");
            self.section(SectionTag::GEOMETRY, CoderId::RANGE, points, geometry::plain_bytes(sets), start);
            return Ok(());
        }
        self.plain.clear();
        geometry::write_plain(sets, &mut self.plain);
        self.block(SectionTag::GEOMETRY, coder, points)
    }

    /// Writes values. `bytes` and `present` are what clients have at that point; both are updated.
    pub(crate) fn values(
        &mut self,
        layout: &Layout,
        clients: ClientValues<'_>,
        values: &Values,
        models: &mut FrameModels,
        coder: BlockCoder,
    ) -> Result<(), EncodeError> {
        let points = values.bytes.len();
        if coder == BlockCoder::Range {
            let start = self.blocks.len();
            let mut encoder = RangeEncoder::new(&mut self.blocks);
            let mut coded = Values::default();
            let pair = (values, &mut coded);
            let coded = models.values.code(&mut encoder, layout, clients, pair, points as u32, |_| false);
            encoder.finish();
            debug_assert!(coded.is_ok(), "{coded:?}");
            self.section(SectionTag::VALUES, CoderId::RANGE, points, values.plain_bytes(), start);
            return Ok(());
        }
        self.plain.clear();
        values.write_plain(layout, clients, &mut self.plain);
        self.block(SectionTag::VALUES, coder, points)
    }

    /// Writes changes of the state in `view`; `model` learns from them. The range coder stops if they take more than
    /// `most` bytes. Then it writes no section and returns the number of changes coded so far.
    pub(crate) fn changes(
        &mut self,
        view: StateView<'_>,
        model: &mut ChangeModel,
        changes: &Changes,
        coder: BlockCoder,
        most: usize,
    ) -> Result<Option<usize>, EncodeError> {
        let (points, blocks) = (changes.levels.len(), view.layout.blocks());
        if coder == BlockCoder::Range {
            let start = self.blocks.len();
            let most = start.saturating_add(most);
            let mut encoder = RangeEncoder::new(&mut self.blocks);
            let made = (&mut self.coded, &mut self.next);
            let fits = model.code(&mut encoder, view, changes, made, points, |encoder| encoder.len() > most);
            encoder.finish();
            debug_assert!(fits.is_ok(), "{fits:?}");
            if self.blocks.len() > most {
                self.blocks.truncate(start);
                return Ok(Some(self.coded.levels.len()));
            }
            debug_assert_eq!(&self.coded, changes);
            self.section(SectionTag::CHANGES, CoderId::RANGE, points, changes.plain_bytes(blocks), start);
            return Ok(None);
        }
        self.plain.clear();
        changes.write_plain(blocks, &mut self.plain);
        self.block(SectionTag::CHANGES, coder, points)?;
        Ok(None)
    }

    /// Writes a patch that leads to `state`.
    pub(crate) fn patch(
        &mut self,
        state: &State,
        patch: &Patch,
        coder: BlockCoder,
    ) -> Result<(), EncodeError> {
        let (points, blocks) = (patch.bytes.len(), state.layout.blocks());
        if coder == BlockCoder::Range {
            let start = self.blocks.len();
            let mut encoder = RangeEncoder::new(&mut self.blocks);
            let mut model = PatchModel::new();
            let mut coded = Patch { back: model.back(&mut encoder, patch.back), ..Patch::default() };
            let runs = (patch.arrivals.as_slice(), &mut coded);
            let fits = model.arrivals(&mut encoder, blocks, runs, points);
            debug_assert!(fits.is_ok(), "{fits:?}");
            let known = (&*state.layout, state.present.as_slice());
            let mut values = state.values.clone();
            let known_values = (state.geometry.as_slice(), values.as_mut_slice());
            model.code(&mut encoder, known, known_values, (patch, &mut coded), points, |_| false);
            encoder.finish();
            debug_assert_eq!(&coded, patch);
            self.section(SectionTag::PATCH, CoderId::RANGE, points, patch.plain_bytes(blocks), start);
            return Ok(());
        }
        self.plain.clear();
        patch.write_plain(blocks, &mut self.plain);
        self.block(SectionTag::PATCH, coder, points)
    }

    /// Writes the coder context, unless it is fresh. The range coder has no model for it.
    pub(crate) fn context(&mut self, state: &State, coder: BlockCoder) -> Result<(), EncodeError> {
        if state.history == History::new(state.layout.blocks()) && state.model == ChangeModel::new() {
            return Ok(());
        }
        self.plain.clear();
        context::write(&state.history, &state.model, &mut self.plain);
        let coder = if coder == BlockCoder::Range { BlockCoder::default() } else { coder };
        self.block(SectionTag::CONTEXT, coder, 1)
    }
}
