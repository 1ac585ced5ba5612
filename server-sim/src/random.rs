//! The project's own random number generator: the same numbers on every machine and in every version.
//!
//! `SplitMix64` (Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number Generators") with its published
//! constants: a Weyl sequence through a 64-bit mixer.

const WEYL: u64 = 0x9E37_79B9_7F4A_7C15;

/// Mixes 64 bits: a bijection in which every input bit flips every output bit with probability near 1/2.
#[must_use]
pub(crate) fn mix(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ (value >> 31)
}

/// Returns a seed for one of many streams derived from one seed.
#[must_use]
pub(crate) fn substream(seed: u64, stream: u64) -> u64 {
    mix(seed.wrapping_add(WEYL) ^ mix(stream.wrapping_mul(WEYL).wrapping_add(1)))
}

/// Returns the upper 24 bits as an exact number in [0, 1).
#[must_use]
pub(crate) fn unit(bits: u64) -> f32 {
    (bits >> 40) as f32 * (1.0 / 16_777_216.0)
}

/// A stream of random numbers.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(WEYL);
        mix(self.0)
    }

    /// Returns a number uniform in [0, 1), with 24 bits.
    pub(crate) fn unit(&mut self) -> f32 {
        unit(self.bits())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_the_published_sequence() {
        // First outputs of SplitMix64 with seed 1234567, as printed with the reference implementation.
        let mut random = Random::new(1_234_567);
        assert_eq!(random.bits(), 6_457_827_717_110_365_317);
        assert_eq!(random.bits(), 3_203_168_211_198_807_973);
        assert_eq!(random.bits(), 9_817_491_932_198_370_423);
    }

    #[test]
    fn unit_numbers_stay_below_one() {
        assert_eq!(unit(0), 0.0);
        assert!(unit(u64::MAX) < 1.0);
        assert_ne!(substream(1, 2), substream(2, 1));
    }
}
