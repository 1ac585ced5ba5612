//! What frames of profile `paper` may hold.

use super::{POINTS_PER_CELL, PointFormat};
use crate::block::CoderId;
use crate::envelope::{FrameRules, Packing, Profile, SectionTag};

/// The rules of profile `paper`.
pub(crate) struct Rules;

impl FrameRules for Rules {
    fn profile(&self) -> Profile {
        Profile::PAPER
    }

    fn has_packing(&self, packing: Packing) -> bool {
        PointFormat::from_packing(packing).is_some()
    }

    fn sections(&self) -> &'static [SectionTag] {
        &[SectionTag::POSES, SectionTag::BUCKETS, SectionTag::CELLS]
    }

    fn may_use(&self, _section: SectionTag, coder: CoderId) -> bool {
        matches!(coder, CoderId::STORED | CoderId::LZ4 | CoderId::ZSTD)
    }

    fn record_bytes(&self, section: SectionTag, packing: Packing) -> Option<u32> {
        record_bytes(section, PointFormat::from_packing(packing)?)
    }
}

/// Returns the length of one record of a section in bytes; `None` for sections of other profiles.
pub(super) const fn record_bytes(section: SectionTag, format: PointFormat) -> Option<u32> {
    match section {
        SectionTag::POSES => Some(32),
        SectionTag::BUCKETS => Some(68),
        SectionTag::CELLS => Some(4 + (POINTS_PER_CELL * format.bytes()) as u32),
        _ => None,
    }
}
