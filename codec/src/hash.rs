//! The state hash, which both ends compare after every frame.
//!
//! The hash of a state is the wrapping sum of one 64-bit term for each record (a pose, a bucket, a cell, a set, a
//! point). The order of a sum does not matter, so a change of one record costs one subtraction and one addition. A
//! record whose words are all zero has the term 0, so every empty state has the hash 0.
//!
//! The terms detect mistakes and damage. They do not protect against an adversary who computes collisions.

use std::fmt;

/// Hash of the whole state of a client (`docs/spec/codec.md`, "State hash").
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct StateHash(pub u64);

impl fmt::Display for StateHash {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{:016x}", self.0)
    }
}

impl StateHash {
    /// Returns the hash after record `index` of `kind` changed from `old` to `new`.
    #[inline]
    pub(crate) fn replace<const N: usize>(
        self,
        kind: RecordKind,
        index: u32,
        old: &[u32; N],
        new: &[u32; N],
    ) -> StateHash {
        StateHash(self.0.wrapping_sub(term(kind, index, old)).wrapping_add(term(kind, index, new)))
    }

    /// Returns the hash after a record that was all zero became `new`.
    #[inline]
    pub(crate) fn insert<const N: usize>(self, kind: RecordKind, index: u32, new: &[u32; N]) -> StateHash {
        StateHash(self.0.wrapping_add(term(kind, index, new)))
    }
}

/// Kind of the record that a term stands for. The numbers are those of the section tags.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecordKind {
    Pose = 1,
    Bucket = 2,
    Cell = 3,
    Geometry = 4,
    Value = 5,
}

/// Odd multiplier of every round: 2^64 divided by the golden ratio.
const ROUND_MULTIPLIER: u64 = 0x9E37_79B9_7F4A_7C15;
/// Multiplier of the closing round, the first one of `SplitMix64`.
const CLOSING_MULTIPLIER: u64 = 0xBF58_476D_1CE4_E5B9;

/// Returns the term of one record.
#[inline]
pub(crate) fn term<const N: usize>(kind: RecordKind, index: u32, words: &[u32; N]) -> u64 {
    if words.iter().all(|word| *word == 0) {
        return 0;
    }
    let mut hash = fold_words(round(((kind as u64) << 32) | u64::from(index)), words);
    hash = (hash ^ (hash >> 29)).wrapping_mul(CLOSING_MULTIPLIER);
    hash ^ (hash >> 32)
}

/// Folds words into a digest, two at a time.
#[inline]
pub(crate) fn fold_words(digest: u64, words: &[u32]) -> u64 {
    words.chunks(2).fold(digest, |digest, pair| {
        let high = pair.get(1).copied().unwrap_or(0);
        round(digest ^ ((u64::from(high) << 32) | u64::from(pair[0])))
    })
}

/// Mixes 64 bits by a bijection, so that no single changed word goes unnoticed.
#[inline]
fn round(value: u64) -> u64 {
    let product = value.wrapping_mul(ROUND_MULTIPLIER);
    product ^ (product >> 32)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn records_of_zeros_count_nothing() {
        assert_eq!(term(RecordKind::Cell, 5, &[0; 7]), 0);
        assert_eq!(StateHash(9).replace(RecordKind::Bucket, 1, &[0; 16], &[0; 16]), StateHash(9));
    }

    #[test]
    fn golden_terms() {
        // The worked example of the specification.
        assert_eq!(term(RecordKind::Cell, 0, &[1, 0, 0, 0, 0, 0, 0]), GOLDEN_TERM);
        let by_hand = {
            let mut hash = round(3 << 32);
            for pair in [1, 0, 0, 0] {
                hash = round(hash ^ pair);
            }
            hash = (hash ^ (hash >> 29)).wrapping_mul(CLOSING_MULTIPLIER);
            hash ^ (hash >> 32)
        };
        assert_eq!(by_hand, GOLDEN_TERM);
    }

    const GOLDEN_TERM: u64 = 0x8474128510d0df72;

    proptest! {
        #[test]
        fn order_leaves_no_trace_and_what_goes_away_takes_its_term_along(
            a in any::<[u32; 7]>(), b in any::<[u32; 7]>(), c in any::<[u32; 7]>(), at in 0_u32..1000,
        ) {
            let start = StateHash(12345);
            let one = start.insert(RecordKind::Cell, at, &a).insert(RecordKind::Cell, at + 1, &b);
            let two = start.insert(RecordKind::Cell, at + 1, &c).insert(RecordKind::Cell, at, &a);
            prop_assert_eq!(one, two.replace(RecordKind::Cell, at + 1, &c, &b));
            prop_assert_eq!(one.replace(RecordKind::Cell, at, &a, &[0; 7]), start.insert(RecordKind::Cell, at + 1, &b));
        }

        #[test]
        fn kind_place_and_every_bit_matter(words in any::<[u32; 7]>(), at in any::<u32>(), bit in 0_usize..224) {
            let mut changed = words;
            changed[bit / 32] ^= 1 << (bit % 32);
            let hash = term(RecordKind::Cell, at, &words);
            prop_assume!(hash != 0);
            prop_assert_ne!(hash, term(RecordKind::Cell, at, &changed));
            prop_assert_ne!(hash, term(RecordKind::Cell, at ^ 1, &words));
            prop_assert_ne!(hash, term(RecordKind::Pose, at, &words));
        }
    }
}
