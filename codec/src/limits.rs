//! Limits of a decoder, checked before every allocation whose size comes from input.

/// Upper bounds that both ends agree on in the handshake.
///
/// A layout that exceeds its limits is refused. A frame body is refused if it, or one of its blocks after
/// decompression, exceeds the last two. Nothing is allocated before the check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// Largest number of instances of a layout (default 65,536).
    pub max_instances: u32,
    /// Largest number of buckets of a `paper` layout, over all instances (default 2^22; 64 B each).
    pub max_buckets: u32,
    /// Largest number of cells of a `paper` layout (default 2^22, which is all that a 22-bit cell index can name; 28 B
    /// each).
    pub max_cells: u32,
    /// Largest number of points of a `surface` layout, over all instances (default 64 Mi; 2 B each, and 14 B for every
    /// point of a set).
    pub max_points: u32,
    /// Largest section after decompression, bytes (default 272 MiB). The largest section that the limits above allow
    /// is a keyframe of all 2^22 buckets, 68 B each.
    pub max_block_bytes: u32,
    /// Largest frame body on the wire, bytes (default 512 MiB).
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

impl Limits {
    setters! {
        const fn:
        with_max_instances: max_instances as u32,
        with_max_buckets: max_buckets as u32,
        with_max_cells: max_cells as u32,
        with_max_points: max_points as u32,
        with_max_block_bytes: max_block_bytes as u32,
        with_max_frame_bytes: max_frame_bytes as u32,
    }
}
