//! Logistic mixing: a decision has several inputs, each weighted by how well it predicted so far. The PAQ family of
//! compressors introduced it (M. Mahoney, "Adaptive weighing of context models for lossless data compression", 2005).
//!
//! Probabilities are mixed in the logistic domain: `x = ln(p / (1 - p))`, here in 256ths, -2,047 to 2,047.

use std::sync::LazyLock;

use super::{BinaryCoder, BitModel};
use crate::memory;

/// The logistic function and its inverse as integer tables.
pub(crate) struct Logistic {
    /// By probability in 4,096ths.
    stretch: [i16; 4096],
    /// By logistic value plus 2,048: the results of [`squash`].
    squash: [u16; 4096],
}

/// 65,536 / (1 + exp(-x)) for x = -8, -7.5 .. 8, rounded. The first and last values are equally far from the ends.
const SQUASH_KNOTS: [i32; 33] = [
    22, 36, 60, 98, 162, 267, 439, 720, 1179, 1921, 3108, 4971, 7812, 11_955, 17_625, 24_743, 32_768, 40_793,
    47_911, 53_581, 57_724, 60_565, 62_428, 63_615, 64_357, 64_816, 65_097, 65_269, 65_374, 65_438, 65_476,
    65_500, 65_514,
];

/// Returns the probability in 65,536ths of a logistic value in 256ths, interpolated between the knots of [`SQUASH_KNOTS`].
fn squash(x: i32) -> i32 {
    let x = x.clamp(-2047, 2047) + 2048;
    let (knot, part) = ((x >> 7) as usize, x & 127);
    (SQUASH_KNOTS[knot] * (128 - part) + SQUASH_KNOTS[knot + 1] * part + 64) >> 7
}

/// Returns the tables, which are computed once.
pub(crate) fn logistic() -> &'static Logistic {
    static LOGISTIC: LazyLock<Logistic> = LazyLock::new(|| {
        // For every probability: the smallest logistic value whose `squash` is at least the middle of its step.
        let mut x = -2047;
        let stretch = std::array::from_fn(|step| {
            let source = 16 * step as i32 + 8;
            while x < 2047 && squash(x) < source {
                x += 1;
            }
            x as i16
        });
        let squash = std::array::from_fn(|x| squash(x as i32 - 2048) as u16);
        Logistic { stretch, squash }
    });
    &LOGISTIC
}

/// Largest absolute value of a weight.
pub(crate) const MAX_WEIGHT: i32 = 1 << 20;

/// Weights of `N` inputs in 65,536ths, one set for each situation.
#[derive(Debug, PartialEq)]
pub(crate) struct Mixer<const N: usize> {
    pub(crate) weights: Vec<[i32; N]>,
}

impl<const N: usize> Clone for Mixer<N> {
    fn clone(&self) -> Mixer<N> {
        Mixer { weights: self.weights.clone() }
    }

    fn clone_from(&mut self, other: &Mixer<N>) {
        self.weights.clone_from(&other.weights);
    }
}

impl<const N: usize> Mixer<N> {
    /// Creates equal weights for each of `situations` situations. They sum to slightly more than 1, because single
    /// inputs tend to be under-confident.
    pub(crate) fn new(situations: usize) -> Mixer<N> {
        Mixer { weights: vec![[Self::FIRST_WEIGHT; N]; situations] }
    }

    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.weights)
    }

    const FIRST_WEIGHT: i32 = match N {
        1 => 65_536,
        2 => 46_341,
        3 => 37_837,
        4 => 32_768,
        _ => 29_309,
    };

    /// Codes a decision that mixes the probabilities of `models`. The models and the weights learn from it.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn code<B: BinaryCoder>(
        &mut self,
        logistic: &Logistic,
        coder: &mut B,
        situation: usize,
        models: [&mut BitModel; N],
        source: bool,
    ) -> bool {
        let inputs = std::array::from_fn(|n| logistic.stretch(*models[n]));
        let bit = self.code_inputs(logistic, coder, situation, inputs, source);
        for model in models {
            model.learn(bit);
        }
        bit
    }

    /// Codes a decision from inputs in the logistic domain. The weights learn from it.
    #[inline]
    pub(crate) fn code_inputs<B: BinaryCoder>(
        &mut self,
        logistic: &Logistic,
        coder: &mut B,
        situation: usize,
        inputs: [i32; N],
        source: bool,
    ) -> bool {
        let weights = &mut self.weights[situation];
        let sum: i64 = (0..N).map(|n| i64::from(weights[n]) * i64::from(inputs[n])).sum();
        let place = ((sum >> 16).clamp(-2047, 2047) + 2048) as usize;
        let mixed = i32::from(logistic.squash[place & 4095]);
        let one = mixed.clamp(32, 65_536 - 32);
        let bit = coder.bit(one as u32, source);
        // Gradient of the coding cost, times 5/256: small enough to be steady, large enough to follow a scene.
        let miss = (i32::from(bit) << 16) - mixed;
        for (weight, input) in weights.iter_mut().zip(inputs) {
            // Below 2^11 times 5 * 2^16.
            let step = (input * (miss * 5) + 0x8000) >> 16;
            *weight = (*weight + step).clamp(-MAX_WEIGHT, MAX_WEIGHT);
        }
        bit
    }
}

impl Logistic {
    /// Returns the logistic value of a bit model.
    #[inline]
    pub(crate) fn stretch(&self, model: BitModel) -> i32 {
        i32::from(self.stretch[model.in_4096()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::range::{RangeDecoder, RangeEncoder};

    #[test]
    fn the_tables_are_the_logistic_function() {
        for (knot, value) in SQUASH_KNOTS.iter().enumerate() {
            let x = (knot as f64 - 16.0) / 2.0;
            let exact = 65_536.0 / (1.0 + (-x).exp());
            assert!((f64::from(*value) - exact).abs() <= 0.51, "{x}: {value} {exact}");
        }
        let table = &logistic().stretch;
        assert!(table.windows(2).all(|pair| pair[0] <= pair[1]));
        for (step, x) in table.iter().enumerate().skip(8).take(4080) {
            let p = (step as f64 + 0.5) / 4096.0;
            let exact = 256.0 * (p / (1.0 - p)).ln();
            assert!((f64::from(*x) - exact).abs() < 12.0, "{p}: {x} {exact}");
        }
    }

    #[test]
    fn mixing_beats_each_opinion_and_reads_back() {
        // Two clues, each usually right; together they almost decide.
        let history: Vec<[bool; 3]> = (0..8000_u32)
            .map(|n| {
                let noise =
                    |salt: u32, of: u32| n.wrapping_add(salt).wrapping_mul(0x9E37_79B9) >> 8 & 1023 < of;
                let truth = noise(1, 512);
                [truth, truth ^ noise(77, 150), truth ^ noise(991, 150)]
            })
            .collect();
        let mut out = Vec::new();
        let mut encoder = RangeEncoder::new(&mut out);
        let mut clues = Clues::new();
        for step in &history {
            clues.code(&mut encoder, step, step[0]);
        }
        encoder.finish();
        // One clue alone leaves H(150/1024) = 0.60 bits.
        assert!(out.len() * 8 < history.len() * 45 / 100, "{} bits", out.len() * 8);
        let mut decoder = RangeDecoder::new(&out);
        let mut clues = Clues::new();
        for step in &history {
            assert_eq!(clues.code(&mut decoder, step, false), step[0]);
        }
        assert_eq!(decoder.finish(), Ok(()));
    }

    /// A bit model for each answer of each clue.
    struct Clues {
        mixer: Mixer<2>,
        models: [[BitModel; 2]; 2],
    }

    impl Clues {
        fn new() -> Clues {
            Clues { mixer: Mixer::new(1), models: [[BitModel::new(1 << 15); 2]; 2] }
        }

        fn code<B: BinaryCoder>(&mut self, coder: &mut B, step: &[bool; 3], source: bool) -> bool {
            let [a, b] = &mut self.models;
            let models = [&mut a[usize::from(step[1])], &mut b[usize::from(step[2])]];
            self.mixer.code(logistic(), coder, 0, models, source)
        }
    }
}
