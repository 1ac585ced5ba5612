//! Fuzz bodies: each takes arbitrary bytes, and must neither panic nor find a fast path and its slow twin
//! ([`crate::reference`]) apart. The targets of `fuzz/` call them, and so do this crate's property tests.

mod paper;
mod surface;

pub use paper::{decode, round_trip};
pub use surface::{surface_decode, surface_round_trip};

use crate::Limits;
use crate::envelope::{CRC_OFFSET, FrameIndex, FrameKind, FrameMeta, HASH_OFFSET, StreamTime, body_crc};

/// Where the state hash is in a frame body.
const HASH_BYTES: std::ops::Range<usize> = HASH_OFFSET..HASH_OFFSET + 8;
/// Small limits, so that a frame that lies about its sizes is refused for it.
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
