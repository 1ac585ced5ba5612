//! What the envelope asks of a profile.

use super::{FrameKind, Packing, Profile, SectionTag};
use crate::block::CoderId;

/// What frames of one profile may hold. Each profile has its rules in its folder; `crate::profiles` lists them.
pub(crate) trait FrameRules: Sync {
    /// The profile.
    fn profile(&self) -> Profile;

    /// Whether its points may be packed so.
    fn has_packing(&self, packing: Packing) -> bool;

    /// The sections that its frames may have.
    fn sections(&self) -> &'static [SectionTag];

    /// Whether a block of such a section may be coded so.
    fn may_use(&self, section: SectionTag, coder: CoderId) -> bool;

    /// Whether a frame of this kind may have such a section.
    fn may_be_in(&self, _section: SectionTag, _kind: FrameKind) -> bool {
        true
    }

    /// Whether the tags of two neighbouring sections are in order.
    fn is_ordered(&self, previous: SectionTag, next: SectionTag) -> bool {
        previous < next
    }

    /// Whether two sections, in order, may be neighbours in a frame of this kind.
    fn may_follow(&self, _previous: SectionTag, _next: SectionTag, _kind: FrameKind) -> bool {
        true
    }

    /// Whether a frame of this kind may end with such a section.
    fn may_be_last(&self, _section: SectionTag, _kind: FrameKind) -> bool {
        true
    }

    /// Bytes of one record of a section, for points packed so; `None` where they have no fixed size.
    fn record_bytes(&self, _section: SectionTag, _packing: Packing) -> Option<u32> {
        None
    }
}
