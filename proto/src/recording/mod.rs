//! Recordings: the wire frames of a stream, byte for byte, each with its arrival time.
//!
//! | part | bytes |
//! |---|---|
//! | file header | magic `89 50 53 41 4F 0D 0A 1A` (8), version `u16` = 1, flags `u16` = 0, CRC32C `u32` of the 12 bytes before |
//! | record, any number | arrival `u64` in microseconds, CRC32C `u32` of those 8 bytes, the frame byte for byte |
//! | parity, every 128 KiB | a record whose frame has the type PARITY, see [`repair`] |
//! | index, optional | a record whose frame has the type INDEX |
//! | footer, after an index | offset of the index record `u64`, magic `u32` `0x1D0A_A05E`, CRC32C `u32` of the 12 bytes before |
//!
//! A file only grows, and is a valid recording after every record. The file of a killed recorder can be read up to its
//! last whole record. `docs/spec/recording.md` specifies the format.
//!
//! | type | does |
//! |---|---|
//! | [`Writer`] | returns the bytes to append |
//! | [`Reader`] | iterates over records and damages without copying |
//! | [`repair`] | makes damaged stretches whole again |
//! | [`Summary`] | scans a whole file: index, groups, gaps, damages |
//! | [`Player`], [`OwnedPlayer`] | decode a recording into states |
//! | [`cut()`], [`Concatenation`], [`recover()`] | make new recordings of old ones |
//! | `file::Recorder` (feature `fs`) | writes a live stream to a disk |

mod cat;
mod cut;
mod edits;
#[cfg(feature = "fs")]
pub mod file;
mod index;
mod owned_player;
mod parity;
mod player;
mod reader;
mod recover;
mod rewrite;
#[cfg(test)]
mod rewrite_tests;
mod summary;
#[cfg(test)]
mod tests;
mod writer;

pub use cat::Concatenation;
pub use cut::{Bounds, RangeError, cut};
pub use edits::EditsInForce;
pub use index::{FrameEntry, INDEX_ENTRY_BYTES, IndexEntry, IndexKind};
pub use owned_player::OwnedPlayer;
pub use parity::{Repaired, repair};
pub use player::{PlayedFrame, Player, PlayerError, PlayerEvent, PlayerStats};
pub use reader::{Damage, DamageKind, Reader, ReaderError, Record};
pub use recover::recover;
pub use rewrite::{LossError, RewriteError, RewriteOutcome};
pub use summary::{StoredIndex, Summary, TypeCount, load_index};
pub use writer::{Writer, WriterError};

use crate::{Micros, WireFrameError};

/// First bytes of a recording.
pub const FILE_MAGIC: [u8; 8] = *b"\x89PSAO\r\n\x1a";
/// Version of the format.
pub const FILE_VERSION: u16 = 1;
/// Bytes of the file header.
pub const FILE_HEADER_BYTES: usize = 16;
/// Bytes of a record before its frame.
pub const RECORD_HEAD_BYTES: usize = 12;
/// Bytes of the footer.
pub const FOOTER_BYTES: usize = 16;
/// Magic in the footer.
pub const FOOTER_MAGIC: u32 = 0x1D0A_A05E;

/// Returns the file header of this version.
pub(crate) fn file_header() -> [u8; FILE_HEADER_BYTES] {
    let mut head = [0; FILE_HEADER_BYTES];
    head[..8].copy_from_slice(&FILE_MAGIC);
    head[8..10].copy_from_slice(&FILE_VERSION.to_le_bytes());
    let crc = crc32c::crc32c(&head[..12]);
    head[12..].copy_from_slice(&crc.to_le_bytes());
    head
}

/// Appends the head of a record: the arrival time and its checksum.
fn record_head(arrival: Micros, out: &mut Vec<u8>) {
    let time = arrival.0.to_le_bytes();
    out.extend_from_slice(&time);
    out.extend_from_slice(&crc32c::crc32c(&time).to_le_bytes());
}

/// Returns the footer of an index record at `offset`.
pub(crate) fn footer(offset: u64) -> [u8; FOOTER_BYTES] {
    let mut foot = [0; FOOTER_BYTES];
    foot[..8].copy_from_slice(&offset.to_le_bytes());
    foot[8..12].copy_from_slice(&FOOTER_MAGIC.to_le_bytes());
    let crc = crc32c::crc32c(&foot[..12]);
    foot[12..].copy_from_slice(&crc.to_le_bytes());
    foot
}

/// Returns whether the last 4 of 16 bytes are the CRC32C of the first 12.
fn has_valid_crc(bytes: &[u8; 16]) -> bool {
    let (body, crc) = bytes.split_at(12);
    crc == crc32c::crc32c(body).to_le_bytes()
}

/// Returns the offset in a footer; `None` when the bytes are not a footer.
pub(crate) fn parse_footer(bytes: &[u8; FOOTER_BYTES]) -> Option<u64> {
    let &[o0, o1, o2, o3, o4, o5, o6, o7, m0, m1, m2, m3, ..] = bytes;
    let valid = u32::from_le_bytes([m0, m1, m2, m3]) == FOOTER_MAGIC && has_valid_crc(bytes);
    valid.then(|| u64::from_le_bytes([o0, o1, o2, o3, o4, o5, o6, o7]))
}

/// Why no record can be read at a place.
pub(crate) enum RecordError {
    /// The bytes end before the record does.
    Ends,
    /// The arrival time does not match its checksum.
    Arrival,
    /// The wire frame is damaged.
    Frame(WireFrameError),
}
