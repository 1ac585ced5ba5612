//! The adaptive probability of one binary decision.

/// A probability of `true` in 2^22nds (high 22 bits) and its number of uses up to [`MAX_USES`] (low 10 bits).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BitModel(pub(crate) u32);

/// Number of uses after which a model learns no slower.
const MAX_USES: u32 = 255;

/// Step towards the outcome after `n` uses, in 65,536ths: 65536 / (n + 1.6), rounded down.
const LEARNING_STEPS: [u16; MAX_USES as usize + 1] = {
    let mut steps = [0; MAX_USES as usize + 1];
    let mut n = 0;
    while n < steps.len() {
        steps[n] = (655_360 / (10 * n + 16)) as u16;
        n += 1;
    }
    steps
};

impl BitModel {
    /// Creates an unused model; `one` is the probability of `true` in 65,536ths.
    pub(crate) const fn new(one: u32) -> BitModel {
        BitModel(one << 16)
    }

    /// Returns the model of a word; `None` if no model ever has that word.
    pub(crate) fn from_word(word: u32) -> Option<BitModel> {
        (word & 0x3FF <= MAX_USES).then_some(BitModel(word))
    }

    /// Returns the probability of `true` in 4,096ths, 0 to 4,095.
    #[inline]
    pub(crate) fn in_4096(self) -> usize {
        (self.0 >> 20) as usize
    }

    /// Returns the probability of `true` in 65,536ths, limited to 32 to 65,504.
    #[inline]
    pub(crate) fn one(self) -> u32 {
        (self.0 >> 16).clamp(32, 65_536 - 32)
    }

    /// Learns an outcome.
    #[inline]
    pub(crate) fn learn(&mut self, bit: bool) {
        let count = self.0 & 0x3FF;
        let value = (self.0 >> 10) as i32;
        let target = if bit { (1 << 22) - 1 } else { 0 };
        let step = i64::from(target - value) * i64::from(LEARNING_STEPS[count.min(MAX_USES) as usize]);
        let value = (value + (step >> 16) as i32) as u32;
        self.0 = value << 10 | (count + 1).min(MAX_USES);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_comes_to_the_share_that_it_sees() {
        for every in [2_u32, 5, 50] {
            let mut model = BitModel::new(1 << 15);
            for n in 0..20_000 {
                model.learn(n % every == 0);
            }
            let share = f64::from(model.one()) / 65_536.0;
            assert!((share - 1.0 / f64::from(every)).abs() < 0.02, "{share} of 1/{every}");
        }
    }

    #[test]
    fn certainty_stays_off_the_ends() {
        for bit in [false, true] {
            let mut model = BitModel::new(1 << 15);
            (0..10_000).for_each(|_| model.learn(bit));
            assert!((32..=65_504).contains(&model.one()));
            assert_eq!(model.in_4096(), if bit { 4095 } else { 0 });
        }
    }
}
