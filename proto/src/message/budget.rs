//! BUDGET: use of the byte budget by a frame.

use psao_codec::surface;

use super::sealed::Payload;
use super::{FieldError, Message, require};
use crate::{FrameIndex, FrameType};

/// Use of the server's byte budget by a frame. It is for display only; the protocol does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Budget {
    /// Number of the frame.
    pub frame: FrameIndex,
    /// Target for the largest size of its body, in bytes.
    pub budget: u32,
    /// Size of its body in bytes.
    pub used: u32,
    /// Postponed points: they differ by the threshold but wait for later frames.
    pub postponed: u32,
    /// Number of frames that the oldest postponed point has waited.
    pub oldest: u32,
    /// Points that were sent despite the budget, because they had reached the longest age.
    pub forced: u32,
}

fields!(Budget { frame as FrameIndex, budget, used, postponed, oldest, forced });

impl Budget {
    /// Returns the message about a frame that an encoder wrote with a byte budget, and what the budget postponed in it.
    #[must_use]
    pub fn of_frame(frame: FrameIndex, budget: surface::Budget, postponed: surface::Postponed) -> Self {
        let surface::Postponed { points, oldest, forced, used } = postponed;
        Self { frame, budget: budget.bytes, used, postponed: points, oldest: oldest.into(), forced }
    }
}

impl Payload for Budget {
    fn check(&self) -> Result<(), FieldError> {
        require(self.postponed > 0 || self.oldest == 0, "oldest", "is the age of nothing")
    }
}

impl Message for Budget {
    const KIND: FrameType = FrameType::BUDGET;
    const NAME: &'static str = "BUDGET";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let budget =
            Budget { frame: FrameIndex(9), budget: 1200, used: 1199, postponed: 7, oldest: 3, forced: 0 };
        golden(&budget, "09000000 b0040000 af040000 07000000 03000000 00000000");
        assert!(Budget { postponed: 0, ..budget }.to_payload().is_err());
    }
}
