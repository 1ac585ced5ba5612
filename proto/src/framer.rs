//! The framing of sockets and files: a 20-byte header and a payload under one CRC32C.
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0 | 2 | magic `0xA050` (bytes `50 A0`) |
//! | 2 | 1 | type, see [`FrameType`] |
//! | 3 | 1 | flags, 0; a frame with any other value is refused |
//! | 4 | 4 | length of the payload in bytes |
//! | 8 | 4 | group |
//! | 12 | 4 | sequence |
//! | 16 | 4 | CRC32C of the bytes 0..16 and the payload |
//! | 20 | length | payload |
//!
//! All integers are little endian. `docs/spec/protocol.md` specifies the framing.

use crate::{Group, Limits, Sequence};

/// Bytes of a frame's header.
pub const HEADER_BYTES: usize = 20;
/// First two bytes of every frame, as a little endian `u16`.
pub const FRAME_MAGIC: u16 = 0xA050;

wire_enum! {
    /// Type of a frame. A newtype, not an enum: a value that this version does not know survives reading and writing.
    pub struct FrameType(u8), unknown "type" {
        /// Client to server: [`Hello`](crate::message::Hello), the first frame of a connection.
        HELLO = 1 => "HELLO",
        /// Server to client: [`Accept`](crate::message::Accept), the answer to a hello.
        ACCEPT = 2 => "ACCEPT",
        /// Server to client: [`Reject`](crate::message::Reject), the other answer to a hello.
        REJECT = 3 => "REJECT",
        /// Server to client: [`Scene`](crate::message::Scene).
        SCENE = 4 => "SCENE",
        /// Client to server: [`View`](crate::message::View).
        VIEW = 5 => "VIEW",
        /// Both ways: [`Edit`](crate::message::Edit); a server sends it for an edit that later frames include.
        EDIT = 6 => "EDIT",
        /// Server to client: a frame body of `psao-codec` that replaces the whole state.
        KEYFRAME = 7 => "KEYFRAME",
        /// Server to client: a frame body of `psao-codec` that changes the state.
        UPDATE = 8 => "UPDATE",
        /// Client to server: [`Request`](crate::message::Request).
        REQUEST = 9 => "REQUEST",
        /// Server to client: [`Report`](crate::message::Report).
        REPORT = 10 => "REPORT",
        /// Both ways: [`Close`](crate::message::Close), the last frame.
        CLOSE = 11 => "CLOSE",
        /// Client to server: [`Ack`](crate::message::Ack).
        ACK = 12 => "ACK",
        /// Client to server: [`Auth`](crate::message::Auth), before the hello.
        AUTH = 13 => "AUTH",
        /// Both ways: [`Ping`](crate::message::Ping).
        PING = 14 => "PING",
        /// Both ways: [`Pong`](crate::message::Pong).
        PONG = 15 => "PONG",
        /// Server to client: [`Stamp`](crate::message::Stamp).
        STAMP = 16 => "STAMP",
        /// Server to client: [`Budget`](crate::message::Budget).
        BUDGET = 17 => "BUDGET",
        /// In files only: the index of a recording.
        INDEX = 0x40 => "INDEX",
        /// In files only: [`Gap`](crate::message::Gap), frames that were not recorded.
        GAP = 0x41 => "GAP",
        /// In files only: parity of the bytes before it, by which a reader repairs damage.
        PARITY = 0x42 => "PARITY",
    }
}

impl FrameType {
    /// Returns whether frames of this type carry the state: KEYFRAME and UPDATE.
    #[must_use]
    pub const fn carries_state(self) -> bool {
        matches!(self, Self::KEYFRAME | Self::UPDATE)
    }
}

/// The header of a frame without magic, flags and checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameHeader {
    /// Type of the frame.
    pub kind: FrameType,
    /// Group that the frame belongs to.
    pub group: Group,
    /// Sequence number in that group.
    pub sequence: Sequence,
    /// Bytes of the payload.
    pub length: u32,
}

impl FrameHeader {
    /// Returns the bytes of the whole frame, header and payload.
    #[must_use]
    pub const fn wire_bytes(&self) -> u64 {
        HEADER_BYTES as u64 + self.length as u64
    }
}

/// Why bytes are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WireFrameError {
    /// The first two bytes are not the magic.
    #[error(
        "expected the frame magic 0xA050, found {found:#06x}: the peer does not speak this protocol, or bytes were lost"
    )]
    Magic {
        /// The two bytes, little endian.
        found: u16,
    },
    /// A flag that this version does not know is set; it could change the payload's meaning.
    #[error("unknown frame flags {found:#04x}: a newer version wrote this; update this program")]
    Flags {
        /// The flags byte.
        found: u8,
    },
    /// The payload is over the limit.
    #[error("a {kind} frame of {length} bytes is over the limit of {limit} bytes")]
    TooLong {
        /// Type of the frame.
        kind: FrameType,
        /// Length in the header.
        length: u32,
        /// The limit, from [`Limits::payload_limit`].
        limit: u32,
    },
    /// The checksum does not match.
    #[error(
        "checksum of a {kind} frame is {found:#010x}, expected {expected:#010x}: the bytes were damaged on the way"
    )]
    Checksum {
        /// Type of the frame. It may itself be damaged.
        kind: FrameType,
        /// Checksum over the bytes.
        found: u32,
        /// Checksum in the header.
        expected: u32,
    },
}

/// A [`WireFrameError`] with its place in the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("at byte {offset} of the stream: {error}")]
pub struct FramerError {
    /// Bytes from the start of the stream to the start of the bad frame.
    pub offset: u64,
    /// The error.
    pub error: WireFrameError,
}

/// One whole frame, borrowed from its buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WireFrame<'a> {
    /// Header of the frame.
    pub header: FrameHeader,
    /// Bytes from the start of the stream to the start of the frame.
    pub offset: u64,
    /// Bytes of the frame on the wire, including the header.
    pub bytes: &'a [u8],
}

impl<'a> WireFrame<'a> {
    /// Returns the payload.
    #[must_use]
    pub fn payload(&self) -> &'a [u8] {
        self.bytes.get(HEADER_BYTES..).unwrap_or_default()
    }
}

/// Appends one frame to `out`.
///
/// # Errors
/// [`WireFrameError::TooLong`] when the payload does not fit the 32-bit length; `out` is then unchanged. The limits of
/// the other end are not checked.
pub fn write_frame(
    out: &mut Vec<u8>,
    kind: FrameType,
    group: Group,
    sequence: Sequence,
    payload: &[u8],
) -> Result<(), WireFrameError> {
    let head = frame_head(kind, group, sequence, payload)?;
    out.reserve(HEADER_BYTES + payload.len());
    out.extend_from_slice(&head);
    out.extend_from_slice(payload);
    Ok(())
}

/// Returns the header that goes before a payload.
pub(crate) fn frame_head(
    kind: FrameType,
    group: Group,
    sequence: Sequence,
    payload: &[u8],
) -> Result<[u8; HEADER_BYTES], WireFrameError> {
    let length = u32::try_from(payload.len()).map_err(|_| WireFrameError::TooLong {
        kind,
        length: u32::MAX,
        limit: u32::MAX,
    })?;
    let mut head = [0u8; HEADER_BYTES];
    head[0..2].copy_from_slice(&FRAME_MAGIC.to_le_bytes());
    head[2] = kind.0;
    head[4..8].copy_from_slice(&length.to_le_bytes());
    head[8..12].copy_from_slice(&group.0.to_le_bytes());
    head[12..16].copy_from_slice(&sequence.0.to_le_bytes());
    let crc = crc32c::crc32c_append(crc32c::crc32c(&head[..16]), payload);
    head[16..20].copy_from_slice(&crc.to_le_bytes());
    Ok(head)
}

/// Result of [`split_frame`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Split<'a> {
    /// A whole frame and its length in `bytes`.
    Whole(FrameHeader, &'a [u8]),
    /// The start of a frame, and the number of bytes needed in all.
    Partial(usize),
}

/// Splits the first frame off `bytes`. Errors are found as early as possible: a wrong magic after two bytes, a payload
/// over the limit after the header. So no caller waits for or stores the rest of an invalid frame.
pub(crate) fn split_frame<'a>(bytes: &'a [u8], limits: &Limits) -> Result<Split<'a>, WireFrameError> {
    if let Some(magic) = bytes.first_chunk() {
        let found = u16::from_le_bytes(*magic);
        if found != FRAME_MAGIC {
            return Err(WireFrameError::Magic { found });
        }
    }
    let Some(&[_, _, kind, flags, l0, l1, l2, l3, g0, g1, g2, g3, s0, s1, s2, s3, c0, c1, c2, c3]) =
        bytes.first_chunk::<HEADER_BYTES>()
    else {
        return Ok(Split::Partial(HEADER_BYTES));
    };
    let header = FrameHeader {
        kind: FrameType(kind),
        group: Group(u32::from_le_bytes([g0, g1, g2, g3])),
        sequence: Sequence(u32::from_le_bytes([s0, s1, s2, s3])),
        length: u32::from_le_bytes([l0, l1, l2, l3]),
    };
    if flags != 0 {
        return Err(WireFrameError::Flags { found: flags });
    }
    let limit = limits.payload_limit(header.kind);
    if header.length > limit {
        return Err(WireFrameError::TooLong { kind: header.kind, length: header.length, limit });
    }
    let whole = HEADER_BYTES.saturating_add(header.length as usize);
    let Some(frame) = bytes.get(..whole) else {
        return Ok(Split::Partial(whole));
    };
    let (head, payload) = frame.split_at(HEADER_BYTES);
    let found = crc32c::crc32c_append(crc32c::crc32c(&head[..16]), payload);
    let expected = u32::from_le_bytes([c0, c1, c2, c3]);
    if found != expected {
        return Err(WireFrameError::Checksum { kind: header.kind, found, expected });
    }
    Ok(Split::Whole(header, frame))
}

/// Splits a stream of bytes into frames. The bytes may arrive in any pieces.
///
/// ```
/// use psao_proto::{FrameType, Framer, Group, Limits, Sequence, write_frame};
///
/// let mut wire = Vec::new();
/// write_frame(&mut wire, FrameType::UPDATE, Group(1), Sequence(4), b"body")?;
/// let mut framer = Framer::new(Limits::default());
/// for byte in wire {
///     framer.push(&[byte]); // any chunking gives the same frames
/// }
/// let frame = framer.next_frame()?.expect("one whole frame is in");
/// assert_eq!((frame.header.kind, frame.payload()), (FrameType::UPDATE, &b"body"[..]));
/// assert!(framer.next_frame()?.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Framer {
    limits: Limits,
    /// Bytes received. Those before `start` belong to frames that were returned already.
    buffer: Vec<u8>,
    start: usize,
    /// Bytes of the stream before `buffer[start]`.
    offset: u64,
    /// The error that ended the stream. After it the place of the next frame is unknown.
    failed: Option<FramerError>,
}

impl Framer {
    /// Creates a framer at the start of a stream.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, buffer: Vec::new(), start: 0, offset: 0, failed: None }
    }

    /// Pushes bytes and passes every whole frame to `use_frame`, up to the first error.
    ///
    /// The framer is moved out of its owner meanwhile, because the owner uses frames that borrow from the framer.
    pub(crate) fn drain<O, E: From<FramerError>>(
        owner: &mut O,
        framer: fn(&mut O) -> &mut Self,
        bytes: &[u8],
        mut use_frame: impl FnMut(&mut O, &WireFrame<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        framer(owner).push(bytes);
        while Self::take_one(owner, framer, &mut use_frame)? {}
        Ok(())
    }

    /// Passes the next whole frame of `owner`'s framer to `use_frame`, which may use the owner. Returns whether there was
    /// one.
    pub(crate) fn take_one<O, E: From<FramerError>>(
        owner: &mut O,
        framer: fn(&mut O) -> &mut Self,
        use_frame: impl FnOnce(&mut O, &WireFrame<'_>) -> Result<(), E>,
    ) -> Result<bool, E> {
        let limits = framer(owner).limits;
        let mut lent = std::mem::replace(framer(owner), Self::new(limits));
        let result = match lent.next_frame() {
            Ok(None) => Ok(false),
            Err(error) => Err(error.into()),
            Ok(Some(frame)) => use_frame(owner, &frame).map(|()| true),
        };
        *framer(owner) = lent;
        result
    }

    /// Adds bytes. Call [`next_frame`](Self::next_frame) until it returns `None` before the next push. The framer then
    /// holds at most one unfinished frame, which is under the limit.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.failed.is_some() {
            self.buffer = Vec::new();
            self.start = 0;
            return;
        }
        if self.start > 0 {
            self.buffer.drain(..self.start);
            self.start = 0;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// Returns the next whole frame, or `None` until more bytes are pushed.
    ///
    /// # Errors
    /// [`FramerError`] when the bytes are not a frame. The stream has then ended, and later calls return the same
    /// error.
    pub fn next_frame(&mut self) -> Result<Option<WireFrame<'_>>, FramerError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        let bytes = self.buffer.get(self.start..).unwrap_or_default();
        match split_frame(bytes, &self.limits) {
            Ok(Split::Partial(_)) => Ok(None),
            Ok(Split::Whole(header, bytes)) => {
                let offset = self.offset;
                self.start += bytes.len();
                self.offset += bytes.len() as u64;
                Ok(Some(WireFrame { header, offset, bytes }))
            }
            Err(fault) => {
                let error = FramerError { offset: self.offset, error: fault };
                self.failed = Some(error);
                Err(error)
            }
        }
    }

    /// Returns the number of bytes received of an unfinished frame.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.buffer.len() - self.start.min(self.buffer.len())
    }

    /// Returns the bytes of all whole frames returned so far.
    #[must_use]
    pub const fn offset(&self) -> u64 {
        self.offset
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::message::testing::hex;

    fn frame(kind: FrameType, payload: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        write_frame(&mut out, kind, Group(2), Sequence(3), payload).unwrap();
        out
    }

    /// Returns all frames and the final error, if any, of a stream that is pushed in pieces of the given sizes.
    fn cut(stream: &[u8], sizes: impl IntoIterator<Item = usize>) -> (Vec<Vec<u8>>, Option<FramerError>) {
        let mut framer = Framer::new(Limits::default());
        let mut frames = Vec::new();
        let mut rest = stream;
        for size in sizes {
            let (piece, after) = rest.split_at(size.min(rest.len()));
            rest = after;
            framer.push(piece);
            loop {
                match framer.next_frame() {
                    Ok(Some(frame)) => frames.push(frame.bytes.to_vec()),
                    Ok(None) => break,
                    Err(error) => return (frames, Some(error)),
                }
            }
        }
        assert!(rest.is_empty(), "the sizes do not cover the stream");
        (frames, None)
    }

    #[test]
    fn golden_bytes() {
        let expected = "50a0 08 00 04000000 02000000 03000000 675ad7a4 626f6479".replace(' ', "");
        assert_eq!(hex(&frame(FrameType::UPDATE, b"body")), expected);
    }

    #[test]
    fn every_flipped_bit_of_a_frame_is_found() {
        let good = frame(FrameType::UPDATE, b"a frame body");
        for bit in 0..good.len() * 8 {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            // A longer length leaves the frame unfinished, so more bytes follow until it is whole.
            bad.resize(good.len() + 70_000, 0);
            let (frames, error) = cut(&bad, [bad.len()]);
            let untold = bad[4..8] != good[4..8] && error.is_none();
            assert!(frames.is_empty() && (error.is_some() || untold), "bit {bit}: {frames:?}");
        }
    }

    #[test]
    fn faults_are_found_before_the_bytes_they_announce() {
        let mut framer = Framer::new(Limits::default());
        framer.push(b"GE");
        let error = framer.next_frame().unwrap_err();
        assert_eq!(error, FramerError { offset: 0, error: WireFrameError::Magic { found: 0x4547 } });
        framer.push(&frame(FrameType::UPDATE, b""));
        assert_eq!(framer.next_frame(), Err(error), "a framer does not go on after a fault");

        let mut limits = Limits::default();
        limits.codec.max_frame_bytes = 100;
        for (kind, limit) in
            [(FrameType::KEYFRAME, 100u32), (FrameType::HELLO, 65_536), (FrameType(77), 65_536)]
        {
            let length = limit + 1;
            let mut head = frame(kind, &[]);
            head[4..8].copy_from_slice(&length.to_le_bytes());
            let mut framer = Framer::new(limits);
            framer.push(&head);
            let error = framer.next_frame().unwrap_err();
            assert_eq!(error.error, WireFrameError::TooLong { kind, length, limit });
        }
    }

    #[test]
    fn unknown_types_survive() {
        let bytes = frame(FrameType(200), b"later");
        let mut framer = Framer::new(Limits::default());
        framer.push(&bytes);
        let frame = framer.next_frame().unwrap().unwrap();
        assert_eq!((frame.header.kind, frame.bytes), (FrameType(200), &bytes[..]));
        assert_eq!(frame.header.kind.to_string(), "type 200");
    }

    proptest! {
        /// Any chunking gives the same frames and the same error.
        #[test]
        fn chunking_does_not_matter(
            payloads in prop::collection::vec((1u8..14, prop::collection::vec(any::<u8>(), 0..40)), 0..8),
            tail in prop::collection::vec(any::<u8>(), 0..30),
            sizes in prop::collection::vec(1usize..50, 0..20),
        ) {
            let mut stream: Vec<u8> = Vec::new();
            for (kind, payload) in &payloads {
                stream.extend(frame(FrameType(*kind), payload));
            }
            stream.extend(tail);
            let whole = cut(&stream, [stream.len()]);
            prop_assert!(whole.0.len() >= payloads.len());
            prop_assert_eq!(&cut(&stream, stream.iter().map(|_| 1)), &whole);
            prop_assert_eq!(&cut(&stream, sizes.into_iter().chain([stream.len()])), &whole);
        }

        #[test]
        fn round_trip(kind in any::<u8>(), group in any::<u32>(), sequence in any::<u32>(),
                      payload in prop::collection::vec(any::<u8>(), 0..200)) {
            let mut bytes = Vec::new();
            let (kind, group, sequence) = (FrameType(kind), Group(group), Sequence(sequence));
            write_frame(&mut bytes, kind, group, sequence, &payload).unwrap();
            let mut framer = Framer::new(Limits::default());
            framer.push(&bytes);
            let frame = framer.next_frame().unwrap().unwrap();
            let length = payload.len() as u32;
            prop_assert_eq!(frame.header, FrameHeader { kind, group, sequence, length });
            prop_assert_eq!(frame.payload(), &payload[..]);
            prop_assert_eq!((framer.pending(), framer.offset()), (0, bytes.len() as u64));
        }
    }
}
