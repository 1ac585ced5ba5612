//! REPORT: server statistics of a frame.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, require};
use crate::{FrameIndex, FrameType, Micros};

/// Largest number of stages in a report.
pub const MAX_STAGES: usize = 32;

wire_enum! {
    /// A stage of the server's frame loop. Unknown values are kept.
    #[derive(Encode, Decode)]
    pub struct StageId(u8), unknown "stage" {
        /// Animation: poses of the instances.
        POSE = 1 => "pose",
        /// Update of the acceleration structures.
        BVH = 2 => "bvh",
        /// Positions and normals of the points, and which are visible.
        PLACE = 3 => "place",
        /// AO rays.
        TRACE = 4 => "trace",
        /// Selection of the points to send.
        DECIDE = 5 => "decide",
        /// Cells, buckets and block coding.
        ENCODE = 6 => "encode",
    }
}

/// Wall time of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct StageTime {
    /// The stage.
    pub stage: StageId,
    /// Microseconds of wall time; saturates at about 71 minutes.
    pub micros: u32,
}

impl StageTime {
    /// Creates the entry of a stage that took `time`.
    #[must_use]
    pub fn new(stage: StageId, time: Micros) -> Self {
        Self { stage, micros: u32::try_from(time.0).unwrap_or(u32::MAX) }
    }
}

/// Server statistics of a frame. They are for display only; the protocol does not depend on them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// The frame.
    pub frame: FrameIndex,
    /// Rays traced.
    pub rays: u64,
    /// Points in some client's view.
    pub visible: u32,
    /// Points whose AO was traced.
    pub traced: u32,
    /// Points sent.
    pub changed: u32,
    /// Cells in use after the frame.
    pub cells: u32,
    /// Points that have a slot in a cell after the frame.
    pub stored: u32,
    /// Points left out because their bucket has no free entry.
    pub bucket_full: u32,
    /// Points left out because their cell has no free slot.
    pub cell_full: u32,
    /// Points left out because no cell is free.
    pub no_cell: u32,
    /// Points outside their instance's grid, stored in its nearest cell.
    pub outside_grid: u32,
    /// Points whose cell has the id of another cell.
    pub id_collisions: u32,
    /// Wall time by stage, at most [`MAX_STAGES`].
    pub stages: Vec<StageTime>,
}

fields!(Report {
    frame as FrameIndex,
    rays,
    visible,
    traced,
    changed,
    cells,
    stored,
    bucket_full,
    cell_full,
    no_cell,
    outside_grid,
    id_collisions,
    stages,
});

impl Payload for Report {
    fn check(&self) -> Result<(), FieldError> {
        require(self.stages.len() <= MAX_STAGES, "stages", "has more than 32 entries")
    }
}

impl Message for Report {
    const KIND: FrameType = FrameType::REPORT;
    const NAME: &'static str = "REPORT";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let report = Report {
            frame: FrameIndex(1),
            rays: 2,
            visible: 3,
            traced: 4,
            changed: 5,
            cells: 6,
            stored: 7,
            bucket_full: 8,
            cell_full: 9,
            no_cell: 10,
            outside_grid: 11,
            id_collisions: 12,
            stages: vec![
                StageTime { stage: StageId::TRACE, micros: 13 },
                StageTime::new(StageId(99), Micros(u64::MAX)),
            ],
        };
        golden(
            &report,
            "01000000 0200000000000000 03000000 04000000 05000000 06000000 07000000 08000000 09000000 0a000000 \
             0b000000 0c000000 0200000000000000 04 0d000000 63 ffffffff",
        );
        let stages = vec![StageTime::new(StageId::POSE, Micros(1)); MAX_STAGES + 1];
        assert!(Report { stages, ..report }.to_payload().is_err());
    }
}
