//! What frames of profile `surface` may hold.

use crate::block::CoderId;
use crate::envelope::{FrameIds, FrameKind, FrameRules, Packing, Profile, SectionTag};

/// Returns the ids of a frame of profile `surface`.
pub(crate) const fn frame_ids(kind: FrameKind) -> FrameIds {
    FrameIds { profile: Profile::SURFACE, packing: Packing::LATTICE, kind }
}

/// The rules of profile `surface`.
pub(crate) struct Rules;

impl FrameRules for Rules {
    fn profile(&self) -> Profile {
        Profile::SURFACE
    }

    fn has_packing(&self, packing: Packing) -> bool {
        packing == Packing::LATTICE
    }

    fn sections(&self) -> &'static [SectionTag] {
        &[
            SectionTag::GEOMETRY,
            SectionTag::VALUES,
            SectionTag::CHANGES,
            SectionTag::CONTEXT,
            SectionTag::PATCH,
        ]
    }

    fn may_use(&self, section: SectionTag, coder: CoderId) -> bool {
        match coder {
            CoderId::STORED | CoderId::LZ4 | CoderId::ZSTD => true,
            CoderId::RANGE => section != SectionTag::CONTEXT,
            _ => false,
        }
    }

    fn may_be_in(&self, section: SectionTag, kind: FrameKind) -> bool {
        // Changes and patches are only in deltas.
        kind == FrameKind::Delta || !matches!(section, SectionTag::CHANGES | SectionTag::PATCH)
    }

    fn is_ordered(&self, previous: SectionTag, next: SectionTag) -> bool {
        // Tags ascend, except that geometry and values may alternate.
        let parcel = |tag| matches!(tag, SectionTag::GEOMETRY | SectionTag::VALUES);
        previous < next || parcel(previous) && parcel(next)
    }

    fn may_follow(&self, previous: SectionTag, next: SectionTag, kind: FrameKind) -> bool {
        // A delta with a patch has nothing else, except a context before it.
        match next {
            SectionTag::CONTEXT => kind == FrameKind::Key,
            SectionTag::PATCH => previous == SectionTag::CONTEXT,
            _ => true,
        }
    }

    fn may_be_last(&self, section: SectionTag, kind: FrameKind) -> bool {
        // A delta has a context only before a patch.
        kind == FrameKind::Key || section != SectionTag::CONTEXT
    }
}
