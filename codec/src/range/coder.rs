//! A binary range coder without carries. The interval is a pair of 32-bit bounds; a byte leaves as soon as both agree
//! on it.

/// A coder of binary decisions: it writes or reads them.
pub(crate) trait BinaryCoder {
    /// Codes one decision. `one` is the probability of `true` in 65,536ths, 1 to 65,535. An encoder writes `source`
    /// and returns it; a decoder ignores it.
    fn bit(&mut self, one: u32, source: bool) -> bool;

    /// Sets the class of the decisions that follow. Only coders that count bits need it.
    #[inline]
    fn set_class(&mut self, _subject: SymbolClass) {}

    /// Codes the low `count` bits of `source`, high bit first, each with probability 1/2.
    fn plain(&mut self, count: u32, source: u32) -> u32 {
        (0..count).rev().fold(0, |value, at| value << 1 | u32::from(self.bit(1 << 15, source >> at & 1 == 1)))
    }
}

/// The class of a decision of a frame of changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SymbolClass {
    /// The quantum, and the blocks that have a change.
    Blocks,
    /// The points of a block that change.
    Points,
    /// The sign of a change.
    Signs,
    /// The size of a change.
    Sizes,
}

/// Writes decisions.
#[derive(Debug)]
pub(crate) struct RangeEncoder<'a> {
    low: u32,
    high: u32,
    out: &'a mut Vec<u8>,
}

impl<'a> RangeEncoder<'a> {
    /// Creates an encoder that appends to `out`.
    pub(crate) fn new(out: &'a mut Vec<u8>) -> RangeEncoder<'a> {
        RangeEncoder { low: 0, high: u32::MAX, out }
    }

    /// Returns the number of bytes in `out` so far.
    pub(crate) fn len(&self) -> usize {
        self.out.len()
    }

    /// Writes the shortest ending that lies in the interval when zeros follow it.
    pub(crate) fn finish(self) {
        for kept in 0..4 {
            // The smallest number at least `low` whose bytes after the first `kept` are zero.
            let unit = 1_u64 << (32 - 8 * kept);
            let value = u64::from(self.low).div_ceil(unit) * unit;
            if value <= u64::from(self.high) {
                self.out.extend_from_slice(&(value as u32).to_be_bytes()[..kept]);
                return;
            }
        }
        self.out.extend_from_slice(&self.low.to_be_bytes());
    }
}

/// Returns where an interval is cut in two. The lower part, which includes the cut, means `true`.
#[inline]
fn cut(low: u32, high: u32, one: u32) -> u32 {
    debug_assert!((1..1 << 16).contains(&one), "probability {one}");
    low + ((u64::from(high - low) * u64::from(one)) >> 16) as u32
}

impl BinaryCoder for RangeEncoder<'_> {
    #[inline]
    fn bit(&mut self, one: u32, source: bool) -> bool {
        let cut = cut(self.low, self.high, one);
        if source {
            self.high = cut;
        } else {
            self.low = cut + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.out.push((self.high >> 24) as u8);
            self.low <<= 8;
            self.high = self.high << 8 | 0xFF;
        }
        source
    }
}

/// Reads decisions. Reading never fails: missing bytes count as zeros. [`RangeDecoder::finish`] then tells whether an
/// encoder wrote the bytes.
#[derive(Debug)]
pub(crate) struct RangeDecoder<'a> {
    low: u32,
    high: u32,
    code: u32,
    bytes: &'a [u8],
    /// Bytes read, including those beyond the end.
    taken: usize,
}

/// A block that is longer or shorter than its decisions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LengthMismatch {
    /// The block ends too early.
    Short,
    /// Bytes remain.
    Long {
        /// Their number.
        extra: usize,
    },
}

impl<'a> RangeDecoder<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> RangeDecoder<'a> {
        let mut decoder = RangeDecoder { low: 0, high: u32::MAX, code: 0, bytes, taken: 0 };
        for _ in 0..4 {
            decoder.shift();
        }
        decoder
    }

    #[inline]
    fn shift(&mut self) {
        let byte = self.bytes.get(self.taken).copied().unwrap_or(0);
        self.taken += 1;
        self.code = self.code << 8 | u32::from(byte);
    }

    /// Checks that the block may end here. The ending of an encoder is at most four bytes shorter than what a decoder
    /// reads.
    pub(crate) fn finish(self) -> Result<(), LengthMismatch> {
        let length = self.bytes.len();
        if self.taken < length {
            return Err(LengthMismatch::Long { extra: length - self.taken });
        }
        if self.taken > length + 4 { Err(LengthMismatch::Short) } else { Ok(()) }
    }

    /// Returns whether more was read than an encoder ever leaves out. Then nothing sensible follows.
    #[inline]
    pub(crate) fn is_exhausted(&self) -> bool {
        self.taken > self.bytes.len() + 4
    }
}

impl BinaryCoder for RangeDecoder<'_> {
    #[inline]
    fn bit(&mut self, one: u32, _: bool) -> bool {
        let cut = cut(self.low, self.high, one);
        let bit = self.code <= cut;
        if bit {
            self.high = cut;
        } else {
            self.low = cut + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.low <<= 8;
            self.high = self.high << 8 | 0xFF;
            self.shift();
        }
        bit
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn write(decisions: &[(u32, bool)]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = RangeEncoder::new(&mut out);
        for (one, bit) in decisions {
            encoder.bit(*one, *bit);
        }
        encoder.finish();
        out
    }

    fn read(bytes: &[u8], decisions: &[(u32, bool)]) -> (Vec<bool>, Result<(), LengthMismatch>) {
        let mut decoder = RangeDecoder::new(bytes);
        let bits = decisions.iter().map(|(one, _)| decoder.bit(*one, false)).collect();
        (bits, decoder.finish())
    }

    #[test]
    fn nothing_takes_nothing() {
        assert_eq!(write(&[]), []);
        assert_eq!(RangeDecoder::new(&[]).finish(), Ok(()));
        assert_eq!(RangeDecoder::new(&[0; 5]).finish(), Err(LengthMismatch::Long { extra: 1 }));
    }

    #[test]
    fn likely_decisions_cost_what_they_should() {
        let likely = vec![(65_000, true); 10_000];
        let bits = 10_000.0 * -(65_000.0_f64 / 65_536.0).log2();
        let bytes = write(&likely).len() as f64;
        assert!((bytes - bits / 8.0).abs() < 3.0, "{bytes} B for {bits} bits");
    }

    #[test]
    fn golden_bytes() {
        let mut out = Vec::new();
        let mut encoder = RangeEncoder::new(&mut out);
        encoder.plain(12, 0xABC);
        encoder.bit(1, true);
        encoder.bit(65_535, false);
        encoder.plain(8, 0x5A);
        encoder.finish();
        assert_eq!(out, GOLDEN);
    }

    const GOLDEN: [u8; 7] = [84, 48, 0, 15, 255, 250, 80];

    proptest! {
        #[test]
        fn what_is_written_is_read(decisions in prop::collection::vec((1_u32..65_536, any::<bool>()), 0..400)) {
            let bytes = write(&decisions);
            let (bits, end) = read(&bytes, &decisions);
            prop_assert_eq!(bits, decisions.iter().map(|(_, bit)| *bit).collect::<Vec<_>>());
            prop_assert_eq!(end, Ok(()));
            let mut long = bytes;
            long.extend_from_slice(&[0; 5]);
            let refused = matches!(read(&long, &decisions).1, Err(LengthMismatch::Long { .. }));
            prop_assert!(refused);
        }
    }
}
