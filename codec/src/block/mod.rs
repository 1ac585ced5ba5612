//! Compressed blocks. The size of each after decompression is known and checked beforehand.
//!
//! | wire id | coder |
//! |---|---|
//! | 0 | stored: the bytes as they are |
//! | 1 | LZ4 block format, no frame, no dictionary |
//! | 2 | one Zstandard frame with its content size, no dictionary, no content checksum |
//! | 3 | the adaptive range coder, which codes whole sections of profile `surface` with their models, no bytes |

mod error;
#[cfg(feature = "lz4")]
mod lz4;
#[cfg(not(feature = "lz4"))]
#[path = "no_lz4.rs"]
mod lz4;
#[cfg(not(feature = "zstd"))]
#[path = "no_zstd.rs"]
mod zstd;
#[cfg(feature = "zstd")]
mod zstd;

pub use error::{BlockError, CoderId};

use crate::memory;

/// How an encoder compresses blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockCoder {
    /// Stores the bytes as they are.
    Stored,
    /// LZ4 block format (paper, section 3.4).
    Lz4,
    /// Zstandard, strategy `lazy` at every level (paper, section 4: level 15, strategy 4).
    Zstd {
        /// Compression level, 1 to 22.
        level: i32,
    },
    /// The adaptive range coder, for sections of profile `surface`.
    Range,
}

impl Default for BlockCoder {
    /// Returns the paper's coder: Zstandard, level 15, strategy 4.
    fn default() -> BlockCoder {
        BlockCoder::Zstd { level: 15 }
    }
}

impl BlockCoder {
    /// Returns a coder that writes blocks of this wire id. For Zstandard and for unknown ids this is
    /// [`BlockCoder::default`].
    ///
    /// ```
    /// use psao_codec::block::{BlockCoder, CoderId};
    ///
    /// for id in [CoderId::STORED, CoderId::LZ4, CoderId::ZSTD, CoderId::RANGE] {
    ///     assert_eq!(BlockCoder::of(id).id(), id);
    /// }
    /// ```
    #[must_use]
    pub const fn of(id: CoderId) -> BlockCoder {
        match id {
            CoderId::STORED => BlockCoder::Stored,
            CoderId::LZ4 => BlockCoder::Lz4,
            CoderId::RANGE => BlockCoder::Range,
            _ => BlockCoder::Zstd { level: 15 },
        }
    }

    /// Returns the wire id of the blocks that this coder writes.
    #[must_use]
    pub const fn id(self) -> CoderId {
        match self {
            BlockCoder::Stored => CoderId::STORED,
            BlockCoder::Lz4 => CoderId::LZ4,
            BlockCoder::Zstd { .. } => CoderId::ZSTD,
            BlockCoder::Range => CoderId::RANGE,
        }
    }
}

/// Compresses blocks independently of each other. It keeps the memory of the coders between calls.
///
/// The same input and coder always give the same bytes.
#[derive(Default)]
pub struct Compressor {
    zstd: zstd::Encoder,
    lz4: lz4::Encoder,
    packed: Vec<u8>,
}

impl std::fmt::Debug for Compressor {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Compressor").finish_non_exhaustive()
    }
}

impl Compressor {
    /// Creates a compressor that has allocated nothing yet.
    #[must_use]
    pub fn new() -> Compressor {
        Compressor::default()
    }

    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        self.zstd.heap_bytes() + self.lz4.heap_bytes() + memory::list(&self.packed)
    }

    /// Compresses `raw` and appends it to `out`. Returns the coder used: `coder`, or [`CoderId::STORED`] where
    /// compression saves nothing.
    ///
    /// # Errors
    /// [`BlockError::Level`] for a level outside 1 to 22. [`BlockError::NoModel`] for [`BlockCoder::Range`].
    /// [`BlockError::Coder`] if the coder fails because it could not allocate memory. [`BlockError::Feature`] for a
    /// coder that the crate was built without. `out` is unchanged after an error.
    pub fn compress(
        &mut self,
        raw: &[u8],
        coder: BlockCoder,
        out: &mut Vec<u8>,
    ) -> Result<CoderId, BlockError> {
        let packed = match coder {
            BlockCoder::Stored => raw,
            BlockCoder::Lz4 => self.lz4.compress(raw, &mut self.packed)?,
            BlockCoder::Zstd { level } => self.zstd.compress(raw, level, &mut self.packed)?,
            BlockCoder::Range => return Err(BlockError::NoModel),
        };
        if packed.len() < raw.len() {
            out.extend_from_slice(packed);
            Ok(coder.id())
        } else {
            out.extend_from_slice(raw);
            Ok(CoderId::STORED)
        }
    }
}

/// Decompresses blocks. It keeps the memory of the coders between calls.
#[derive(Default)]
pub struct Decompressor {
    zstd: zstd::Decoder,
}

impl std::fmt::Debug for Decompressor {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Decompressor").finish_non_exhaustive()
    }
}

impl Decompressor {
    /// Creates a decompressor that has allocated nothing yet.
    #[must_use]
    pub fn new() -> Decompressor {
        Decompressor::default()
    }

    /// Decompresses `stored` into `out`, which is then exactly `raw_bytes` long.
    ///
    /// `raw_bytes` is checked against `limit` before `out` grows, and no coder writes past it.
    ///
    /// # Errors
    /// [`BlockError::UnknownCoder`], [`BlockError::TooLarge`], [`BlockError::Feature`] and [`BlockError::Corrupt`].
    /// [`BlockError::Length`] if the block holds more or fewer bytes than `raw_bytes`. The content of `out` is
    /// unspecified after an error.
    pub fn decompress(
        &mut self,
        stored: &[u8],
        coder: CoderId,
        raw_bytes: u32,
        limit: u32,
        out: &mut Vec<u8>,
    ) -> Result<(), BlockError> {
        if raw_bytes > limit {
            return Err(BlockError::TooLarge { raw_bytes, limit });
        }
        let wanted = raw_bytes as usize;
        let decode: &mut dyn FnMut(&mut [u8]) -> Result<(), BlockError> = match coder {
            CoderId::STORED => &mut |out| {
                if stored.len() != out.len() {
                    let (found, expected) = (stored.len() as u64, out.len() as u64);
                    return Err(BlockError::Length { coder: CoderId::STORED, expected, found });
                }
                out.copy_from_slice(stored);
                Ok(())
            },
            CoderId::LZ4 => &mut |out| lz4::decompress(stored, out),
            CoderId::ZSTD => {
                zstd::check_frame(stored, wanted)?;
                &mut |out| self.zstd.decompress(stored, out)
            }
            found => return Err(BlockError::UnknownCoder { found }),
        };
        out.resize(wanted, 0);
        decode(out)
    }
}

/// Compresses one block. [`Compressor::compress`] is cheaper for many.
///
/// # Errors
/// Those of [`Compressor::compress`].
pub fn compress(raw: &[u8], coder: BlockCoder) -> Result<(CoderId, Vec<u8>), BlockError> {
    let mut out = Vec::new();
    let id = Compressor::new().compress(raw, coder, &mut out)?;
    Ok((id, out))
}

/// Decompresses one block. [`Decompressor::decompress`] is cheaper for many.
///
/// # Errors
/// Those of [`Decompressor::decompress`].
pub fn decompress(stored: &[u8], coder: CoderId, raw_bytes: u32, limit: u32) -> Result<Vec<u8>, BlockError> {
    let mut out = Vec::new();
    Decompressor::new().decompress(stored, coder, raw_bytes, limit, &mut out)?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CODERS: [BlockCoder; 4] =
        [BlockCoder::Stored, BlockCoder::Lz4, BlockCoder::Zstd { level: 1 }, BlockCoder::Zstd { level: 15 }];

    fn sample() -> Vec<u8> {
        (0..4000_u32).flat_map(|at| (at * at % 97).to_le_bytes()).collect()
    }

    #[test]
    fn blocks_keep_to_the_announced_size() {
        let raw = sample();
        for coder in CODERS {
            let (id, stored) = compress(&raw, coder).unwrap();
            assert_eq!(id, coder.id());
            let size = raw.len() as u32;
            assert_eq!(decompress(&stored, id, size, size).unwrap(), raw);
            let limit = size - 1;
            let refused = decompress(&stored, id, size, limit);
            assert_eq!(refused, Err(BlockError::TooLarge { raw_bytes: size, limit }));
            for wrong in [size - 1, size + 1, 0] {
                assert!(decompress(&stored, id, wrong, u32::MAX).is_err(), "{id}: {wrong}");
            }
            for end in 0..stored.len() {
                assert!(decompress(&stored[..end], id, size, size).is_err(), "{id}: prefix of {end}");
            }
        }
    }

    #[test]
    fn a_size_that_lies_is_refused_before_anything_is_allocated() {
        let (id, stored) = compress(&sample(), BlockCoder::default()).unwrap();
        let mut out = Vec::new();
        let refused = Decompressor::new().decompress(&stored, id, u32::MAX, u32::MAX, &mut out);
        let expected = BlockError::Length { coder: id, expected: u64::from(u32::MAX), found: 16_000 };
        assert_eq!((refused, out.capacity()), (Err(expected), 0));
    }

    #[test]
    fn zstd_blocks_are_one_frame_with_nothing_around_it() {
        let raw = sample();
        let (id, stored) = compress(&raw, BlockCoder::default()).unwrap();
        let size = raw.len() as u32;
        // Descriptor: content size in 2 bytes, single segment, no checksum, no dictionary.
        assert_eq!(stored[4], 0x60);
        let skippable = [0x50, 0x2A, 0x4D, 0x18, 0, 0, 0, 0];
        let empty = compress(&[], BlockCoder::default()).unwrap().1;
        for around in [&skippable[..], &empty, &stored, &[0]] {
            assert!(around.is_empty() || decompress(&[&stored, around].concat(), id, size, size).is_err());
            assert!(around.is_empty() || decompress(&[around, &stored].concat(), id, size, size).is_err());
        }
    }

    #[test]
    fn ids_that_are_not_known_are_named() {
        for found in [CoderId::RANGE, CoderId(4), CoderId(255)] {
            assert_eq!(decompress(&[], found, 0, 0), Err(BlockError::UnknownCoder { found }));
        }
        for level in [0, -1, 23] {
            assert_eq!(compress(&[], BlockCoder::Zstd { level }), Err(BlockError::Level { level }));
        }
    }

    #[test]
    fn what_cannot_shrink_is_stored() {
        let noise: Vec<u8> = (0..64_u32).map(|at| (at.wrapping_mul(0x9E37_79B9) >> 24) as u8).collect();
        for coder in CODERS {
            assert_eq!(compress(&noise, coder), Ok((CoderId::STORED, noise.clone())));
        }
    }

    proptest! {
        #[test]
        fn a_used_compressor_writes_the_same_as_a_new_one(
            blocks in prop::collection::vec((0_usize..4, prop::collection::vec(0_u8..4, 0..300)), 1..8),
        ) {
            let (mut used, mut reader) = (Compressor::new(), Decompressor::new());
            let mut raw = Vec::new();
            for (coder, block) in blocks {
                let mut stored = Vec::new();
                let id = used.compress(&block, CODERS[coder], &mut stored).unwrap();
                prop_assert_eq!(&(id, stored.clone()), &compress(&block, CODERS[coder]).unwrap());
                let size = block.len() as u32;
                reader.decompress(&stored, id, size, size, &mut raw).unwrap();
                prop_assert_eq!(&raw, &block);
            }
        }

        #[test]
        fn noise_is_never_taken_for_more_than_it_is(
            noise in prop::collection::vec(any::<u8>(), 0..200), coder in 0_u8..4, size in 0_u32..500,
        ) {
            if let Ok(raw) = decompress(&noise, CoderId(coder), size, 500) {
                prop_assert_eq!(raw.len(), size as usize);
            }
        }
    }
}
