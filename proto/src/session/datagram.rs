//! Datagrams, which carry pieces of frame bodies and acknowledgements. They may be lost, duplicated or reordered.
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0 | 2 | magic `0xA051` (bytes `51 A0`) |
//! | 2 | 1 | type: 1 piece of a body, 2 acknowledgement |
//! | 3 | 1 | flags, 0 |
//! | 4 | 4 | frame |
//! | 8 | 2 | number of the piece, from 0 |
//! | 10 | 2 | pieces of the body |
//! | 12 | 4 | bytes of the body |
//! | 16 | 4 | CRC32C of the bytes 0..16 and what follows |
//! | 20 | | piece: all but the last are as long as bytes / pieces, rounded up. Acknowledgement: an ACK message |
//!
//! All integers are little endian. Other datagrams are dropped and counted. They are not errors, because anyone on the
//! network can send them.

use std::collections::VecDeque;

use crate::message::{Ack, Message};
use crate::{FrameIndex, Limits};

/// Bytes of a datagram's header.
pub(super) const DATAGRAM_HEADER: usize = 20;
/// Smallest allowed limit of a datagram, in bytes.
pub const MIN_DATAGRAM_BYTES: u16 = 64;
/// First two bytes of every datagram, as a little endian `u16`.
const MAGIC: u16 = 0xA051;

const PIECE: u8 = 1;
const ACK: u8 = 2;

/// Header of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Head {
    kind: u8,
    frame: FrameIndex,
    piece: u16,
    pieces: u16,
    total: u32,
}

impl Head {
    fn write(self, content: &[u8]) -> Vec<u8> {
        let mut out = Vec::with_capacity(DATAGRAM_HEADER + content.len());
        out.extend_from_slice(&MAGIC.to_le_bytes());
        out.extend_from_slice(&[self.kind, 0]);
        out.extend_from_slice(&self.frame.0.to_le_bytes());
        out.extend_from_slice(&self.piece.to_le_bytes());
        out.extend_from_slice(&self.pieces.to_le_bytes());
        out.extend_from_slice(&self.total.to_le_bytes());
        let crc = crc32c::crc32c_append(crc32c::crc32c(&out), content);
        out.extend_from_slice(&crc.to_le_bytes());
        out.extend_from_slice(content);
        out
    }

    /// Returns the header and content of a datagram whose checksum is right.
    fn read(bytes: &[u8]) -> Option<(Self, &[u8])> {
        let (head, content) = bytes.split_first_chunk::<DATAGRAM_HEADER>()?;
        let &[m0, m1, kind, flags, f0, f1, f2, f3, p0, p1, n0, n1, t0, t1, t2, t3, c0, c1, c2, c3] = head;
        let crc = crc32c::crc32c_append(crc32c::crc32c(&head[..16]), content);
        let right = [m0, m1] == MAGIC.to_le_bytes() && flags == 0 && [c0, c1, c2, c3] == crc.to_le_bytes();
        let head = Self {
            kind,
            frame: FrameIndex(u32::from_le_bytes([f0, f1, f2, f3])),
            piece: u16::from_le_bytes([p0, p1]),
            pieces: u16::from_le_bytes([n0, n1]),
            total: u32::from_le_bytes([t0, t1, t2, t3]),
        };
        right.then_some((head, content))
    }
}

/// Cuts a body into datagrams of at most `bytes`. Returns `None` if that takes more than 65,535 of them.
pub(super) fn split(frame: FrameIndex, body: &[u8], bytes: u16) -> Option<VecDeque<Vec<u8>>> {
    let room = usize::from(bytes.max(MIN_DATAGRAM_BYTES)) - DATAGRAM_HEADER;
    let pieces = u16::try_from(body.len().div_ceil(room).max(1)).ok()?;
    let total = u32::try_from(body.len()).ok()?;
    let size = body.len().div_ceil(pieces.into()).max(1);
    let write =
        |(piece, content): (u16, &[u8])| Head { kind: PIECE, frame, piece, pieces, total }.write(content);
    let contents = (0..usize::from(pieces)).map(|piece| body.get(piece * size..).unwrap_or_default());
    Some((0..pieces).zip(contents.map(|rest| rest.get(..size).unwrap_or(rest))).map(write).collect())
}

/// Returns the datagram of an acknowledgement. It always fits.
pub(super) fn write_ack(ack: &Ack) -> Vec<u8> {
    let content = ack.to_payload().unwrap_or_default();
    Head { kind: ACK, frame: ack.frame, piece: 0, pieces: 1, total: content.len() as u32 }.write(&content)
}

/// Returns the acknowledgement in a datagram, if it holds one.
pub(super) fn read_ack(bytes: &[u8]) -> Option<Ack> {
    let (head, content) = Head::read(bytes)?;
    let ack = Ack::from_payload(content).ok()?;
    let expected = Head { kind: ACK, frame: ack.frame, piece: 0, pieces: 1, total: content.len() as u32 };
    (head == expected).then_some(ack)
}

/// Reassembles the body of the newest frame from its pieces. Older bodies are dropped.
#[derive(Clone, Debug, Default)]
pub(super) struct Reassembler {
    head: Option<Head>,
    bytes: Vec<u8>,
    here: Vec<bool>,
    missing: u16,
}

/// Result of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reassembly<'a> {
    /// The datagram is not a piece, or does not fit the body that it names.
    Bad,
    /// The piece belongs to an older frame, is a duplicate, or does not complete its body.
    Waiting,
    /// The body is complete.
    Whole(FrameIndex, &'a [u8]),
}

impl Reassembler {
    /// Takes a datagram. `after` is the newest frame that was applied; older ones are dropped.
    pub(super) fn take(
        &mut self,
        bytes: &[u8],
        after: Option<FrameIndex>,
        limits: &Limits,
    ) -> Reassembly<'_> {
        let Some((head, content)) = Head::read(bytes).filter(|(head, _)| head.kind == PIECE) else {
            return Reassembly::Bad;
        };
        let Head { frame, piece, pieces, total, .. } = head;
        let size = (total as usize).div_ceil(usize::from(pieces.max(1))).max(1);
        let start = usize::from(piece) * size;
        let fits = piece < pieces && content.len() == (total as usize).saturating_sub(start).min(size);
        let empty = total as usize <= size * usize::from(pieces).saturating_sub(1);
        if !fits || total > limits.max_datagram_body || (empty && pieces > 1) {
            return Reassembly::Bad;
        }
        let old = after.is_some_and(|after| frame <= after);
        if old || self.head.is_some_and(|held| frame < held.frame) {
            return Reassembly::Waiting;
        }
        match self.head {
            Some(held) if held.frame == frame => {
                if (held.pieces, held.total) != (pieces, total) {
                    return Reassembly::Bad;
                }
            }
            _ => self.begin(head),
        }
        if std::mem::replace(&mut self.here[usize::from(piece)], true) {
            return Reassembly::Waiting;
        }
        self.bytes[start..start + content.len()].copy_from_slice(content);
        self.missing -= 1;
        if self.missing > 0 { Reassembly::Waiting } else { Reassembly::Whole(frame, &self.bytes) }
    }

    fn begin(&mut self, head: Head) {
        self.head = Some(head);
        self.bytes.clear();
        self.bytes.resize(head.total as usize, 0);
        self.here.clear();
        self.here.resize(head.pieces.into(), false);
        self.missing = head.pieces;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::StateHash;

    const LIMITS: fn() -> Limits = Limits::default;

    fn pieces(frame: u32, body: &[u8], bytes: u16) -> Vec<Vec<u8>> {
        split(FrameIndex(frame), body, bytes).unwrap().into()
    }

    #[test]
    fn golden_bytes() {
        let expected = "51a0 01 00 07000000 0000 0100 03000000 046a1b8a 010203";
        let expected: String = expected.split_whitespace().collect();
        let hex = |bytes: &[u8]| bytes.iter().map(|b| format!("{b:02x}")).collect::<String>();
        assert_eq!(hex(&pieces(7, &[1, 2, 3], 1200)[0]), expected);
        let ack = Ack { frame: FrameIndex(2), hash: StateHash(0x0102_0304_0506_0708) };
        let expected = "51a0 02 00 02000000 0000 0100 0c000000 d9628097 02000000 0807060504030201";
        let expected: String = expected.split_whitespace().collect();
        assert_eq!(hex(&write_ack(&ack)), expected);
    }

    proptest! {
        #[test]
        fn a_body_comes_together_in_any_order_and_number(
            body in prop::collection::vec(any::<u8>(), 0..2000), bytes in 64_u16..300,
            order in prop::collection::vec(any::<prop::sample::Index>(), 1..200),
        ) {
            let sent = pieces(3, &body, bytes);
            prop_assert!(sent.iter().all(|piece| piece.len() <= bytes.into()));
            let mut reassembler = Reassembler::default();
            let mut whole = 0;
            let all = order.iter().map(|index| index.get(&sent)).chain(&sent);
            for piece in all {
                match reassembler.take(piece, None, &LIMITS()) {
                    Reassembly::Whole(frame, bytes) => {
                        prop_assert_eq!((frame.0, bytes), (3, &body[..]));
                        whole += 1;
                    }
                    other => prop_assert_eq!(other, Reassembly::Waiting),
                }
            }
            prop_assert_eq!(whole, 1);
        }

        #[test]
        fn no_datagram_does_harm(datagrams in prop::collection::vec(
            (prop::collection::vec(any::<u8>(), 0..40), 0_u32..4, any::<u16>(), any::<u16>(), any::<u32>()), 1..20)
        ) {
            let mut reassembler = Reassembler::default();
            for (content, frame, piece, count, total) in datagrams {
                let (pieces, total) = (count % 5, total % 200);
                let head = Head { kind: PIECE, frame: FrameIndex(frame), piece: piece % 5, pieces, total };
                let _ = reassembler.take(&head.write(&content), None, &LIMITS());
                let _ = reassembler.take(&content, None, &LIMITS());
            }
        }
    }

    #[test]
    fn the_newest_frame_wins_and_older_ones_never_come_back() {
        let (old, new) = (pieces(3, &[1; 100], 64), pieces(4, &[2; 100], 64));
        let mut reassembler = Reassembler::default();
        assert_eq!(reassembler.take(&old[0], None, &LIMITS()), Reassembly::Waiting);
        assert_eq!(reassembler.take(&new[1], None, &LIMITS()), Reassembly::Waiting);
        for piece in &old {
            assert_eq!(reassembler.take(piece, None, &LIMITS()), Reassembly::Waiting);
        }
        assert_eq!(reassembler.take(&new[0], None, &LIMITS()), Reassembly::Waiting);
        assert_eq!(reassembler.take(&new[2], None, &LIMITS()), Reassembly::Whole(FrameIndex(4), &[2; 100]));
        assert_eq!(Reassembler::default().take(&new[0], Some(FrameIndex(4)), &LIMITS()), Reassembly::Waiting);
    }

    #[test]
    fn every_changed_bit_and_every_claim_over_the_limit_is_dropped() {
        let sent = &pieces(3, &[9; 50], 64)[0];
        for bit in 0..sent.len() * 8 {
            let mut bad = sent.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Reassembler::default().take(&bad, None, &LIMITS()), Reassembly::Bad, "bit {bit}");
        }
        for end in 0..sent.len() {
            assert_eq!(Reassembler::default().take(&sent[..end], None, &LIMITS()), Reassembly::Bad);
        }
        let limits = Limits { max_datagram_body: 49, ..Limits::default() };
        assert_eq!(Reassembler::default().take(sent, None, &limits), Reassembly::Bad);
        let ack = Ack { frame: FrameIndex(2), hash: StateHash(5) };
        assert_eq!(read_ack(&write_ack(&ack)), Some(ack));
        assert_eq!((read_ack(sent), read_ack(b"")), (None, None));
        assert_eq!(Reassembler::default().take(&write_ack(&ack), None, &LIMITS()), Reassembly::Bad);
        assert_eq!(split(FrameIndex(0), &[0; 44 * 65_536], 64), None);
    }
}
