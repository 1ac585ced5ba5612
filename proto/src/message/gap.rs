//! GAP: frames of a stream that a recording lacks.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message};
use crate::{FrameIndex, FrameType};

wire_enum! {
    /// Why a recording lacks frames. Unknown values are kept and mean another reason.
    #[derive(Encode, Decode)]
    pub struct GapReason(u8), unknown "reason" {
        /// They arrived faster than they could be written.
        SLOW = 1 => "the disk was too slow",
        /// A write failed, for example because the disk was full or the file was deleted.
        FAILED = 2 => "the disk failed",
        /// They were damaged in the recording from which this one was made.
        DAMAGE = 3 => "damaged where this was copied from",
    }
}

/// Marks a place of a recording where frames of the stream are missing. It occurs only in files. Group and sequence of
/// its frame are 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Number of the first frame that is missing.
    pub first_lost: FrameIndex,
    /// Number of the last missing frame. It is below the first if the stream restarted in between.
    pub last_lost: FrameIndex,
    /// Number of missing keyframes and updates, as far as known.
    pub frames: u32,
    /// Number of missing bytes, as far as known: on the wire, or in the file from which this one was made.
    pub bytes: u64,
    /// Why.
    pub reason: GapReason,
}

fields!(Gap { first_lost as FrameIndex, last_lost as FrameIndex, frames, bytes, reason });

impl std::fmt::Display for Gap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { first_lost, last_lost, frames, bytes, reason } = self;
        match frames {
            0 => write!(f, "{bytes} bytes around frame {first_lost} are missing: {reason}"),
            1 => write!(f, "frame {first_lost} is missing ({bytes} bytes): {reason}"),
            _ => write!(
                f,
                "{frames} frames from {first_lost} to {last_lost} are missing ({bytes} bytes): {reason}"
            ),
        }
    }
}

impl Payload for Gap {
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }
}

impl Message for Gap {
    const KIND: FrameType = FrameType::GAP;
    const NAME: &'static str = "GAP";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let gap = Gap {
            first_lost: FrameIndex(5),
            last_lost: FrameIndex(258),
            frames: 254,
            bytes: 65_536,
            reason: GapReason::FAILED,
        };
        golden(&gap, "05000000 02010000 fe000000 0000010000000000 02");
        assert_eq!(GapReason(9).to_string(), "reason 9");
        let text = gap.to_string();
        assert_eq!(text, "254 frames from 5 to 258 are missing (65536 bytes): the disk failed");
    }
}
