//! The questions that the envelope asks a profile.

use super::{FrameKind, Packing, Profile, SectionTag};
use crate::block::CoderId;

/// What frames of one profile may hold. Each profile has its rules in its folder; `crate::profiles` lists them.
pub(crate) trait FrameRules: Sync {
    /// Returns the profile.
    fn profile(&self) -> Profile;

    /// Returns whether its points may have this packing.
    fn has_packing(&self, packing: Packing) -> bool;

    /// Returns the sections that its frames may have.
    fn sections(&self) -> &'static [SectionTag];

    /// Returns whether this coder may code a block of this section.
    fn may_use(&self, section: SectionTag, coder: CoderId) -> bool;

    /// Returns whether a frame of this kind may have this section.
    fn may_be_in(&self, _section: SectionTag, _kind: FrameKind) -> bool {
        true
    }

    /// Returns whether the tags of two neighbouring sections are in order.
    fn is_ordered(&self, previous: SectionTag, next: SectionTag) -> bool {
        previous < next
    }

    /// Returns whether `next` may directly follow `previous` in a frame of this kind. The two are in order.
    fn may_follow(&self, _previous: SectionTag, _next: SectionTag, _kind: FrameKind) -> bool {
        true
    }

    /// Returns whether a frame of this kind may end with this section.
    fn may_be_last(&self, _section: SectionTag, _kind: FrameKind) -> bool {
        true
    }

    /// Returns the length of one record of a section in bytes; `None` if records have no fixed length.
    fn record_bytes(&self, _section: SectionTag, _packing: Packing) -> Option<u32> {
        None
    }
}
