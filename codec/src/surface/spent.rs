//! What the bits of a range-coded frame of changes are spent on.

use std::ops::AddAssign;

use super::State;
use super::change_model::ChangeModel;
use super::changes::Changes;
use crate::Limits;
use crate::block::CoderId;
use crate::frame::{FrameError, SectionTag, inspect};
use crate::range::{Bits, RangeDecoder, Subject};

/// Bits of the decisions of a CHANGES section, by what they decide; together the length of its block, but for rounding.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Spent {
    /// Which blocks have a change.
    pub blocks: f64,
    /// Which points of those blocks change.
    pub points: f64,
    /// Whether they become darker or lighter.
    pub ways: f64,
    /// By how much.
    pub sizes: f64,
}

impl AddAssign for Spent {
    fn add_assign(&mut self, more: Spent) {
        self.blocks += more.blocks;
        self.points += more.points;
        self.ways += more.ways;
        self.sizes += more.sizes;
    }
}

/// A reader that adds up what each decision cost: the logarithm of the probability that it was given.
struct Meter<'a> {
    decoder: RangeDecoder<'a>,
    subject: Subject,
    spent: Spent,
}

impl Bits for Meter<'_> {
    fn bit(&mut self, one: u32, wanted: bool) -> bool {
        let bit = self.decoder.bit(one, wanted);
        let share = f64::from(if bit { one } else { 65_536 - one }) / 65_536.0;
        let place = match self.subject {
            Subject::Blocks => &mut self.spent.blocks,
            Subject::Points => &mut self.spent.points,
            Subject::Ways => &mut self.spent.ways,
            Subject::Sizes => &mut self.spent.sizes,
        };
        *place -= share.log2();
        bit
    }

    fn about(&mut self, subject: Subject) {
        self.subject = subject;
    }
}

/// What the bits of a frame's changes are spent on, `state` being that before the frame; `None` where it has none that
/// are range-coded. For figures: it is slower than applying the frame, checks less, and is no part of what both sides
/// must agree on.
///
/// # Errors
/// [`FrameError`] where the header of the body is not sound.
pub fn spent(state: &State, body: &[u8], limits: &Limits) -> Result<Option<Spent>, FrameError> {
    let info = inspect(body, limits)?;
    let mut offset = info.header_bytes as usize;
    for section in &info.sections {
        let end = offset + section.wire_bytes as usize;
        if section.tag == SectionTag::CHANGES && section.coder == CoderId::RANGE {
            let decoder = RangeDecoder::new(&body[offset..end]);
            let mut meter = Meter { decoder, subject: Subject::Blocks, spent: Spent::default() };
            let mut model: ChangeModel = state.model.clone();
            let (wanted, mut found) = (Changes::default(), Changes::default());
            let most = section.records as usize;
            let stop = |meter: &Meter<'_>| meter.decoder.is_exhausted();
            model.code(&mut meter, state.known(), &wanted, &mut found, most, stop);
            return Ok(Some(meter.spent));
        }
        offset = end;
    }
    Ok(None)
}
