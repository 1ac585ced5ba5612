//! Measures the bits of a range-coded frame of changes or of a patch.

use std::ops::AddAssign;

use super::State;
use super::model::patch::PatchModel;
use super::prediction::NextValues;
use super::section::changes::Changes;
use super::section::patch::Patch;
use crate::Limits;
use crate::block::CoderId;
use crate::envelope::{FrameError, SectionInfo, SectionTag, inspect};
use crate::range::{BinaryCoder, RangeDecoder, SymbolClass};

/// Bits of a CHANGES or PATCH section by class of decision. Except for rounding, their sum is the length of its block.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BitBreakdown {
    /// Which blocks have a change.
    pub blocks: f64,
    /// Which points of those blocks change.
    pub points: f64,
    /// Sign of each change. In a patch, the sign relative to the prediction from the neighbours.
    pub signs: f64,
    /// Size of each change.
    pub sizes: f64,
}

impl AddAssign for BitBreakdown {
    fn add_assign(&mut self, more: BitBreakdown) {
        self.blocks += more.blocks;
        self.points += more.points;
        self.signs += more.signs;
        self.sizes += more.sizes;
    }
}

/// A decoder that adds up the cost of each decision: the negative logarithm of its probability.
struct CostMeter<'a> {
    decoder: RangeDecoder<'a>,
    class: SymbolClass,
    spent: BitBreakdown,
}

impl BinaryCoder for CostMeter<'_> {
    fn bit(&mut self, one: u32, wanted: bool) -> bool {
        let bit = self.decoder.bit(one, wanted);
        let share = f64::from(if bit { one } else { 65_536 - one }) / 65_536.0;
        let place = match self.class {
            SymbolClass::Blocks => &mut self.spent.blocks,
            SymbolClass::Points => &mut self.spent.points,
            SymbolClass::Signs => &mut self.spent.signs,
            SymbolClass::Sizes => &mut self.spent.sizes,
        };
        *place -= share.log2();
        bit
    }

    fn set_class(&mut self, class: SymbolClass) {
        self.class = class;
    }
}

/// Returns the bits of a frame's changes or patch by class of decision. `state` is the state before the frame. Returns
/// `None` if the frame has no such range-coded section. It is meant for statistics: it is slower than applying the
/// frame and checks less.
///
/// # Errors
/// [`FrameError`] if the header of the body is invalid.
pub fn bit_breakdown(
    state: &State,
    body: &[u8],
    limits: &Limits,
) -> Result<Option<BitBreakdown>, FrameError> {
    let info = inspect(body, limits)?;
    let mut offset = info.header_bytes as usize;
    for section in &info.sections {
        let end = offset + section.wire_bytes as usize;
        let is_points = matches!(section.tag, SectionTag::CHANGES | SectionTag::PATCH);
        if is_points && section.coder == CoderId::RANGE {
            let decoder = RangeDecoder::new(&body[offset..end]);
            let mut meter = CostMeter { decoder, class: SymbolClass::Blocks, spent: BitBreakdown::default() };
            read(state, section, &mut meter);
            return Ok(Some(meter.spent));
        }
        offset = end;
    }
    Ok(None)
}

fn read(state: &State, section: &SectionInfo, meter: &mut CostMeter<'_>) {
    let most = section.records as usize;
    let stop = |meter: &CostMeter<'_>| meter.decoder.is_exhausted();
    if section.tag == SectionTag::CHANGES {
        let (wanted, mut found) = (Changes::default(), Changes::default());
        let made = (&mut found, &mut NextValues::default());
        // What does not fit the state does not matter here.
        let _ = state.model.clone().code(meter, state.view(), &wanted, made, most, stop);
    } else {
        let mut model = PatchModel::new();
        let (wanted, mut found) = (Patch::default(), Patch::default());
        model.back(meter, 0);
        if model.arrivals(meter, state.layout.blocks(), (&[], &mut found), most).is_err() {
            return;
        }
        let mut present = state.present.clone();
        found.add_arrivals(&mut present);
        let known = (&*state.layout, present.as_slice());
        let mut values = state.values.clone();
        let known_values = (state.geometry.as_slice(), values.as_mut_slice());
        model.code(meter, known, known_values, (&wanted, &mut found), most, stop);
    }
}
