//! Codes whole numbers as decisions: the number of significant bits, then the bits.

use super::{BinaryCoder, BitModel};

/// Codes numbers; small ones cost least. The number of significant bits is unary, with a bit model for each step. Of
/// the bits below the highest one, the first has a bit model and the others have probability 1/2.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NumberModel {
    /// By the number of bits so far: whether there are more.
    more: [BitModel; 32],
    /// By the number of bits: the one below the highest.
    second: [BitModel; 32],
}

impl NumberModel {
    pub(crate) fn new() -> NumberModel {
        NumberModel { more: [BitModel::new(1 << 15); 32], second: [BitModel::new(1 << 15); 32] }
    }

    /// Returns all bit models, in order.
    pub(crate) fn models(&self) -> impl Iterator<Item = &BitModel> {
        self.more.iter().chain(&self.second)
    }

    /// Returns all bit models, in order.
    pub(crate) fn models_mut(&mut self) -> impl Iterator<Item = &mut BitModel> {
        self.more.iter_mut().chain(&mut self.second)
    }

    /// Codes `source`, which is below 2^31. A decoder never returns more.
    pub(crate) fn code<B: BinaryCoder>(&mut self, coder: &mut B, source: u32) -> u32 {
        let significant = 32 - source.leading_zeros();
        let mut count = 0_u32;
        while count < 31 {
            let model = &mut self.more[count as usize];
            let more = coder.bit(model.one(), count < significant);
            model.learn(more);
            if !more {
                break;
            }
            count += 1;
        }
        if count < 2 {
            return count;
        }
        let model = &mut self.second[count as usize];
        let second = coder.bit(model.one(), source >> (count - 2) & 1 == 1);
        model.learn(second);
        let low = coder.plain(count - 2, source & ((1 << (count - 2)) - 1));
        (2 | u32::from(second)) << (count - 2) | low
    }

    /// Codes a signed number: 0, -1, 1, -2 .. as 0, 1, 2, 3 ..
    pub(crate) fn code_signed<B: BinaryCoder>(&mut self, coder: &mut B, source: i32) -> i32 {
        let folded = ((source << 1) ^ (source >> 31)) as u32;
        let folded = self.code(coder, folded);
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
            let mut model = NumberModel::new();
            numbers.iter().for_each(|n| { model.code(&mut encoder, *n); });
            signed.iter().for_each(|n| { model.code_signed(&mut encoder, *n); });
            encoder.finish();
            let mut decoder = RangeDecoder::new(&out);
            let mut model = NumberModel::new();
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
            let mut model = NumberModel::new();
            for _ in 0..40 {
                prop_assert!(model.code(&mut decoder, 0) < 1 << 31);
            }
        }
    }
}
