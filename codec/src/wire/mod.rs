//! Primitives of the wire: little-endian words, varints, a reader that knows where it is. No messages.

mod reader;
mod varint;

pub(crate) use reader::Reader;
pub use varint::VarintProblem;
pub(crate) use varint::{VarintFault, read_varint, write_varint};

/// Splits little-endian bytes into words. `bytes` holds at least `4 * N` bytes; further ones are ignored.
#[inline]
pub(crate) fn words<const N: usize>(bytes: &[u8]) -> [u32; N] {
    let mut out = [0; N];
    for (word, four) in out.iter_mut().zip(bytes.chunks_exact(4)) {
        *word = u32::from_le_bytes([four[0], four[1], four[2], four[3]]);
    }
    out
}

/// Appends words in little-endian order.
#[inline]
pub(crate) fn push_words(out: &mut Vec<u8>, words: &[u32]) {
    for word in words {
        out.extend_from_slice(&word.to_le_bytes());
    }
}
