//! The table of profiles, in which the envelope finds what each of them allows.

use crate::envelope::{FrameRules, Profile, SectionTag};
use crate::{paper, surface};

/// The rules of every profile.
const PROFILES: [&dyn FrameRules; 2] = [&paper::Rules, &surface::Rules];

/// Why the content of a section was refused, by the profile that has the section.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ContentError {
    /// A section of profile `paper`.
    #[error(transparent)]
    Paper(#[from] paper::RecordError),
    /// A section of profile `surface`.
    #[error(transparent)]
    Surface(#[from] surface::SectionError),
}

/// Returns the rules of a profile; `None` if it is unknown.
pub(crate) fn rules_of(profile: Profile) -> Option<&'static dyn FrameRules> {
    PROFILES.into_iter().find(|rules| rules.profile() == profile)
}

/// Returns the rules of the profile that has sections of this tag; `None` if the tag is unknown.
pub(crate) fn rules_of_section(tag: SectionTag) -> Option<&'static dyn FrameRules> {
    PROFILES.into_iter().find(|rules| rules.sections().contains(&tag))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_section_is_of_one_profile() {
        for tag in SectionTag::ALL {
            let owners = PROFILES.iter().filter(|rules| rules.sections().contains(&tag)).count();
            assert_eq!(owners, 1, "{tag}");
        }
        assert!(rules_of_section(SectionTag(0)).is_none() && rules_of(Profile(3)).is_none());
    }
}
