//! Wire ids and errors of block coders.

use crate::wire::wire_enum;

wire_enum! {
    /// The wire id of a block coder. Unknown values survive reading; decompressing one is an error.
    CoderId, unknown "unknown coder";
    /// Bytes as they are.
    STORED = 0 => "stored",
    /// LZ4 block format.
    LZ4 = 1 => "lz4",
    /// One Zstandard frame.
    ZSTD = 2 => "zstd",
    /// The adaptive range coder of profile `surface`.
    RANGE = 3 => "range",
}

/// Why a block could not be compressed or decompressed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BlockError {
    /// The wire id of the coder is reserved or unknown.
    #[error("block coder is {found}; this version reads stored (0), lz4 (1) and zstd (2)")]
    UnknownCoder {
        /// The id on the wire.
        found: CoderId,
    },
    /// The crate was built without the coder.
    #[error(
        "this program was built without the block coder {coder}: build psao-codec with its feature {coder}"
    )]
    Feature {
        /// The coder; the feature has the same name.
        coder: CoderId,
    },
    /// The range coder cannot code plain bytes.
    #[error("the range coder codes sections of profile surface only: choose zstd, lz4 or none")]
    NoModel,
    /// The block claims to be larger than agreed. Nothing was allocated.
    #[error("block of {raw_bytes} B is larger than the agreed {limit} B; raise Limits::max_block_bytes")]
    TooLarge {
        /// The claimed size after decompression.
        raw_bytes: u32,
        /// The agreed limit.
        limit: u32,
    },
    /// The block holds another number of bytes than the frame tells.
    #[error("{coder} block holds {found} B, the frame says {expected} B")]
    Length {
        /// The coder.
        coder: CoderId,
        /// Bytes by the section table.
        expected: u64,
        /// Bytes that the block holds or declares.
        found: u64,
    },
    /// The stored bytes are not a block of this coder.
    #[error("{coder} block is damaged: {reason}")]
    Corrupt {
        /// The coder.
        coder: CoderId,
        /// The error of the coder.
        reason: String,
    },
    /// The Zstandard level is outside 1 to 22.
    #[error("zstd level {level} is outside 1 to 22")]
    Level {
        /// The requested level.
        level: i32,
    },
    /// The coder failed while compressing; only lack of memory explains that.
    #[error("{coder} cannot compress: {reason}")]
    Coder {
        /// The coder.
        coder: CoderId,
        /// The error of the coder.
        reason: String,
    },
}
