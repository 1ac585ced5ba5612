//! What a decoder is willing to hold: checked before every allocation whose size comes from input.

/// Upper bounds that both sides agree on in the handshake.
///
/// A [`crate::paper::Layout`] is refused when it is larger than the first three; a frame body is refused
/// when it, or one of its blocks, is larger than the last two. Nothing is allocated before the check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Most instances of a layout (default 65,536).
    pub max_instances: u32,
    /// Most buckets of a layout, all instances together (default 2^22; 64 B each).
    pub max_buckets: u32,
    /// Most cells of a layout (default 2^22, which is also all that a 22-bit cell index can name; 28 B each).
    pub max_cells: u32,
    /// Most points of a `surface` layout, all instances together (default 64 Mi; 2 B each and 14 B for every point of
    /// a set).
    pub max_points: u32,
    /// Most bytes of one section after decompression (default 272 MiB: a keyframe that writes every one of
    /// 2^22 buckets, 68 B each, is the largest section that the limits above allow).
    pub max_block_bytes: u32,
    /// Most bytes of one whole frame body as it came off the wire (default 512 MiB).
    pub max_frame_bytes: u32,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            max_instances: 65_536,
            max_buckets: 1 << 22,
            max_cells: 1 << 22,
            max_points: 64 << 20,
            max_block_bytes: 272 << 20,
            max_frame_bytes: 512 << 20,
        }
    }
}
