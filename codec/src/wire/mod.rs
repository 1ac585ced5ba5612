//! Primitives of the wire: little-endian words, varints, ids, and a reader that tracks its offset. Messages are not
//! here.

mod error;
mod ids;
mod reader;
mod varint;

pub(crate) use error::{WireError, WireErrorKind};
pub(crate) use ids::wire_enum;
pub(crate) use reader::Reader;
pub use varint::VarintError;
pub(crate) use varint::{ReadVarintError, read_varint, varint_bytes, write_varint};

/// Splits little-endian bytes into words. `bytes` holds at least `4 * N` bytes; the rest is ignored.
#[inline]
pub(crate) fn words<const N: usize>(bytes: &[u8]) -> [u32; N] {
    bytemuck::pod_read_unaligned::<[u32; N]>(&bytes[..4 * N]).map(u32::from_le)
}

/// Splits little-endian bytes into words of `width` bytes, 2 to 4, and widens them. `bytes` holds at least `width * N`
/// bytes; the rest is ignored.
#[inline]
pub(crate) fn narrow_words<const N: usize>(bytes: &[u8], width: usize) -> [u32; N] {
    if width == 4 {
        return words(bytes);
    }
    let mut out = [0; N];
    for (word, bytes) in out.iter_mut().zip(bytes.chunks_exact(width)) {
        let high = bytes.get(2).copied().unwrap_or(0);
        *word = u32::from_le_bytes([bytes[0], bytes[1], high, 0]);
    }
    out
}

/// Appends the low `width` bytes, 2 to 4, of words in little-endian order.
#[inline]
pub(crate) fn push_narrow_words<const N: usize>(out: &mut Vec<u8>, words: &[u32; N], width: usize) {
    if width == 4 {
        return push_words(out, words);
    }
    for word in words {
        out.extend_from_slice(&word.to_le_bytes()[..width]);
    }
}

/// Appends words in little-endian order.
#[inline]
pub(crate) fn push_words<const N: usize>(out: &mut Vec<u8>, words: &[u32; N]) {
    out.extend_from_slice(bytemuck::bytes_of(&words.map(u32::to_le)));
}
