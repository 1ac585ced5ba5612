//! What a step did, for people and reports.

use psao_codec::paper::Occupancy;
use psao_codec::surface::Postponed;

use super::RayBacklog;
use crate::clock::Clock;

/// Microseconds that the stages of a step took (paper, section 3.3 and 3.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageMicros {
    /// Animation.
    pub pose: u64,
    /// Acceleration structures.
    pub bvh: u64,
    /// Points moved, visibility, what must be traced.
    pub place: u64,
    /// Rays.
    pub trace: u64,
    /// What must be sent.
    pub decide: u64,
    /// Cells, buckets, compression.
    pub encode: u64,
}

/// What a step did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameStats {
    /// Points in view.
    pub visible: u32,
    /// Points whose AO was traced.
    pub traced: u32,
    /// Rays traced: those that came into the bounds of a body that they had to be tested against.
    pub rays: u64,
    /// What was left for later frames because the ray budget was used up; `None` without a budget.
    pub waiting: Option<RayBacklog>,
    /// Whether it is the first frame, in which every point is traced.
    pub first: bool,
    /// Points sent.
    pub changed: u32,
    /// What was left for later frames because the byte budget was used up; `None` without a budget.
    pub postponed: Option<Postponed>,
    /// How full the client's tables are, and what did not fit; nothing in profile `surface`, which has none.
    pub occupancy: Option<Occupancy>,
    /// Times.
    pub micros: StageMicros,
}

/// What a step traced.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TraceTotals {
    pub(super) visible: u32,
    pub(super) traced: u32,
    pub(super) rays: u64,
    /// Nothing without a budget of rays.
    pub(super) waiting: Option<RayBacklog>,
}

impl FrameStats {
    /// Of a frame that is traced.
    pub(super) fn traced(traces: TraceTotals, micros: StageMicros) -> Self {
        let TraceTotals { visible, traced, rays, waiting } = traces;
        Self { visible, traced, rays, waiting, micros, ..Self::default() }
    }
}

/// Reads a clock between stages.
pub(super) struct Lap<'a> {
    clock: &'a dyn Clock,
    last: u64,
}

impl<'a> Lap<'a> {
    pub(super) fn new(clock: &'a dyn Clock) -> Self {
        Self { clock, last: clock.micros() }
    }

    /// Microseconds since the last call.
    pub(super) fn micros(&mut self) -> u64 {
        let now = self.clock.micros();
        let lap = now.saturating_sub(self.last);
        self.last = now;
        lap
    }
}

/// How far something that takes a while has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is going on.
    pub work: Work,
    /// Units done; never more than `total`.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}

/// What takes a while.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Spreading points over the meshes; counted in points.
    Points,
    /// Tracing every point for the first frame; counted in points.
    FirstFrame,
}
