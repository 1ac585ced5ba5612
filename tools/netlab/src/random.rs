//! Random numbers from a seed, the same on any machine.

use rand_pcg::Pcg64Dxsm;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};

/// Denominator of `ppm` values (parts per million).
pub const MILLION: u32 = 1_000_000;

/// A stream of random numbers. Streams of the same seed but different names are independent, so that no client's draws
/// depend on another client.
#[derive(Clone, Debug)]
pub(crate) struct Random(Pcg64Dxsm);

impl Random {
    /// Creates the stream of a seed with this name.
    pub(crate) fn new(seed: u64, name: &[u32]) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&seed.to_le_bytes());
        for part in name {
            hasher.update(&part.to_le_bytes());
        }
        Self(Pcg64Dxsm::from_seed(*hasher.finalize().as_bytes()))
    }

    /// Returns a uniform number from 0 to `most`, both included.
    pub(crate) fn up_to(&mut self, most: u64) -> u64 {
        // The high half of a product (Lemire 2019). Its bias is below the range divided by 2^64.
        ((u128::from(self.0.next_u64()) * (u128::from(most) + 1)) >> 64) as u64
    }

    /// Returns `true` with a probability of `ppm` in a million.
    pub(crate) fn happens(&mut self, ppm: u32) -> bool {
        self.up_to(u64::from(MILLION) - 1) < u64::from(ppm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_the_same_for_ever() {
        let mut random = Random::new(1, &[2, 3]);
        let drawn: Vec<u64> = (0..6).map(|_| random.up_to(999)).collect();
        assert_eq!(drawn, [995, 923, 398, 473, 895, 643], "golden");
    }

    #[test]
    fn draws_are_even_and_streams_apart() {
        let mut random = Random::new(7, &[0]);
        let mut counts = [0_u32; 10];
        for _ in 0..100_000 {
            counts[random.up_to(9) as usize] += 1;
        }
        assert!(counts.iter().all(|count| (9_600..10_400).contains(count)), "{counts:?}");
        let struck = (0..100_000).filter(|_| random.happens(50_000)).count();
        assert!((4_700..5_300).contains(&struck), "{struck}");
        assert!(!(0..1000).any(|_| random.happens(0)) && (0..1000).all(|_| random.happens(MILLION)));
        let (mut a, mut b) = (Random::new(7, &[0, 1]), Random::new(7, &[1, 0]));
        let same = (0..1000).filter(|_| a.up_to(9) == b.up_to(9)).count();
        assert!((50..150).contains(&same), "{same}");
    }
}
