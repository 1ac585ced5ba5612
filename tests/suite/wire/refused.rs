//! Bytes that are not a wire frame, or only the start of one.

use psao_proto::FrameType;

use super::Case;
use super::accepted::{Frames, wire};

pub(super) fn frames() -> Vec<Case> {
    let mut frames = Frames { all: vec![] };
    let good = wire(FrameType::PING, (0, 0), &[7, 6, 5, 4, 3, 2, 1, 0]);

    // Refused after two bytes.
    frames.bytes("refused-magic", b"51"[..].to_vec());
    frames.bytes("refused-magic-datagram", vec![0x51, 0xa0]);
    frames.bytes("refused-magic-swapped", with(&good, 0, &[0xa0, 0x50]));
    // Refused after the header, although the checksum is right.
    for flag in [1, 0x80] {
        let mut bytes = with(&good, 3, &[flag]);
        bytes.truncate(20);
        frames.bytes(&format!("refused-flags-{flag}"), bytes);
    }
    let longest = [
        ("hello", FrameType::HELLO, 65_536_u32),
        ("unknown", FrameType(200), 65_536),
        ("keyframe", FrameType::KEYFRAME, 512 << 20),
        ("update", FrameType::UPDATE, 512 << 20),
        ("index", FrameType::INDEX, 512 << 20),
    ];
    for (name, kind, most) in longest {
        let head = |length: u32| {
            let mut bytes = wire(kind, (0, 0), &[]);
            bytes[4..8].copy_from_slice(&length.to_le_bytes());
            bytes
        };
        frames.bytes(&format!("unfinished-{name}"), head(most));
        frames.bytes(&format!("refused-length-{name}"), head(most + 1));
    }
    frames.bytes("refused-length-largest", {
        let mut bytes = wire(FrameType::UPDATE, (0, 0), &[]);
        bytes[4..8].fill(0xff);
        bytes
    });

    let damaged = |at: usize| {
        let mut bytes = good.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    for (name, at) in [("type", 2), ("group", 8), ("sequence", 15), ("itself", 16), ("payload", 27)] {
        frames.bytes(&format!("refused-checksum-{name}"), damaged(at));
    }
    // The checksum covers header and payload, not one of them.
    frames.bytes("refused-checksum-of-payload", with_crc(&good, crc32c::crc32c(&good[20..])));
    frames.bytes("refused-checksum-of-header", with_crc(&good, crc32c::crc32c(&good[..16])));

    for (name, end) in [("magic", 1), ("header", 19), ("payload", 20), ("last-byte", good.len() - 1)] {
        frames.bytes(&format!("unfinished-{name}"), good[..end].to_vec());
    }
    frames.all
}

/// Returns a copy of `frame` with `bytes` written at `at` of its header, and the right checksum.
fn with(frame: &[u8], at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut frame = frame.to_vec();
    frame[at..at + bytes.len()].copy_from_slice(bytes);
    let crc = crc32c::crc32c_append(crc32c::crc32c(&frame[..16]), &frame[20..]);
    with_crc(&frame, crc)
}

fn with_crc(frame: &[u8], crc: u32) -> Vec<u8> {
    let mut frame = frame.to_vec();
    frame[16..20].copy_from_slice(&crc.to_le_bytes());
    frame
}
