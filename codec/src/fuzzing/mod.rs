//! Fuzz bodies. Each takes arbitrary bytes. It must neither panic nor find a difference between a fast path and its
//! reference ([`crate::reference`]). The targets of `fuzz/` and the property tests of this crate call them.

mod paper;
mod surface;

pub use paper::{decode, round_trip};
pub use surface::{surface_decode, surface_round_trip};

use crate::Limits;
use crate::envelope::{CRC_OFFSET, FrameIndex, FrameKind, FrameMeta, HASH_OFFSET, StreamTime, body_crc};

/// Place of the state hash in a frame body.
const HASH_BYTES: std::ops::Range<usize> = HASH_OFFSET..HASH_OFFSET + 8;
/// Small limits, so that a frame with false sizes is refused for them.
const LIMITS: Limits = Limits {
    max_instances: 8,
    max_buckets: 64,
    max_cells: 64,
    max_points: 1024,
    max_block_bytes: 1 << 17,
    max_frame_bytes: 1 << 17,
};

fn meta(kind: FrameKind, frame: u32) -> FrameMeta {
    let time = StreamTime(u64::from(frame) * 16_667);
    FrameMeta { kind, frame: FrameIndex(frame), time, changed_points: frame }
}

/// Changes `body` from the offset in the first two bytes of `changes` on.
fn damage(body: &mut [u8], changes: &[u8]) {
    let [low, high, changes @ ..] = changes else { return };
    let start = usize::from(u16::from_le_bytes([*low, *high])) % body.len().max(1);
    for (byte, change) in body[start..].iter_mut().zip(changes) {
        *byte ^= change;
    }
}

fn make_checksum_right(body: &mut [u8]) {
    if body.len() >= CRC_OFFSET + 4 {
        let crc = body_crc(body);
        body[CRC_OFFSET..CRC_OFFSET + 4].copy_from_slice(&crc.to_le_bytes());
    }
}
