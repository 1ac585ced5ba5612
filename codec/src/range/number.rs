//! Whole numbers as decisions: how many bits, then the bits.

use super::{Bits, Slot};

/// Codes numbers, small ones best: the count of significant bits in unary (each step its own slot), then the bits
/// below the highest one, of which the first has a slot and the others are as likely as not.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Number {
    /// By count of bits so far.
    more: [Slot; 32],
    /// By count of bits: the one below the highest.
    second: [Slot; 32],
}

impl Number {
    pub(crate) fn new() -> Number {
        Number { more: [Slot::new(1 << 15); 32], second: [Slot::new(1 << 15); 32] }
    }

    /// All slots, in order.
    pub(crate) fn slots(&self) -> impl Iterator<Item = &Slot> {
        self.more.iter().chain(&self.second)
    }

    /// All slots, in order.
    pub(crate) fn slots_mut(&mut self) -> impl Iterator<Item = &mut Slot> {
        self.more.iter_mut().chain(&mut self.second)
    }

    /// Codes `wanted`, which is below 2^31. A reader never returns more.
    pub(crate) fn code<B: Bits>(&mut self, bits: &mut B, wanted: u32) -> u32 {
        let significant = 32 - wanted.leading_zeros();
        let mut count = 0_u32;
        while count < 31 {
            let slot = &mut self.more[count as usize];
            let more = bits.bit(slot.one(), count < significant);
            slot.learn(more);
            if !more {
                break;
            }
            count += 1;
        }
        if count < 2 {
            return count;
        }
        let slot = &mut self.second[count as usize];
        let second = bits.bit(slot.one(), wanted >> (count - 2) & 1 == 1);
        slot.learn(second);
        let low = bits.plain(count - 2, wanted & ((1 << (count - 2)) - 1));
        (2 | u32::from(second)) << (count - 2) | low
    }

    /// Codes a number with a sign: 0, -1, 1, -2 .. as 0, 1, 2, 3 ...
    pub(crate) fn code_signed<B: Bits>(&mut self, bits: &mut B, wanted: i32) -> i32 {
        let folded = ((wanted << 1) ^ (wanted >> 31)) as u32;
        let folded = self.code(bits, folded);
        (folded >> 1) as i32 ^ -((folded & 1) as i32)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::range::{RangeDecoder, RangeEncoder};

    proptest! {
        #[test]
        fn numbers_survive(
            numbers in prop::collection::vec((0_u32..31).prop_flat_map(|bits| 0_u32..(1 << bits)), 0..100),
            signed in prop::collection::vec(-40_000_i32..40_000, 0..100),
        ) {
            let mut out = Vec::new();
            let mut encoder = RangeEncoder::new(&mut out);
            let mut model = Number::new();
            numbers.iter().for_each(|n| { model.code(&mut encoder, *n); });
            signed.iter().for_each(|n| { model.code_signed(&mut encoder, *n); });
            encoder.finish();
            let mut decoder = RangeDecoder::new(&out);
            let mut model = Number::new();
            for n in numbers {
                prop_assert_eq!(model.code(&mut decoder, 0), n);
            }
            for n in signed {
                prop_assert_eq!(model.code_signed(&mut decoder, 0), n);
            }
            prop_assert_eq!(decoder.finish(), Ok(()));
        }

        #[test]
        fn noise_reads_as_numbers_in_range(noise in prop::collection::vec(any::<u8>(), 0..64)) {
            let mut decoder = RangeDecoder::new(&noise);
            let mut model = Number::new();
            for _ in 0..40 {
                prop_assert!(model.code(&mut decoder, 0) < 1 << 31);
            }
        }
    }
}
