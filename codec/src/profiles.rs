//! The profiles that there are: the one table in which the envelope finds what each of them allows.

use crate::envelope::{FrameRules, Profile, SectionTag};
use crate::{paper, surface};

/// The rules of every profile.
const PROFILES: [&dyn FrameRules; 2] = [&paper::Rules, &surface::Rules];

/// The rules of a profile; `None` for one that is unknown.
pub(crate) fn rules_of(profile: Profile) -> Option<&'static dyn FrameRules> {
    PROFILES.into_iter().find(|rules| rules.profile() == profile)
}

/// The rules of the profile that has sections of this tag; `None` for a tag that is unknown.
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
