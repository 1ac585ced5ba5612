//! What a step did, for people and reports.

use std::ops::AddAssign;

use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::paper::Occupancy;
use psao_codec::surface::Postponed;
use psao_proto::Micros;
use psao_proto::message::{Report, StageId, StageTime};

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
    /// Whether it is the first frame, in which all points that clients get are traced.
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

/// What was traced of a frame, before an encoder takes it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Traces {
    pub(super) index: FrameIndex,
    pub(super) time: StreamTime,
    /// Whether the frame is the stream's first.
    pub(super) first: bool,
    pub(super) totals: TraceTotals,
    pub(super) micros: StageMicros,
}

impl StageMicros {
    /// Names of the stages, in the order of [`by_stage`](Self::by_stage).
    pub const NAMES: [&'static str; 6] =
        ["pose", "acceleration structures", "place points", "trace rays", "decide", "encode"];

    /// Returns the stages in the order in which they run, with what each took.
    #[must_use]
    pub fn by_stage(&self) -> [(StageId, u64); 6] {
        let Self { pose, bvh, place, trace, decide, encode } = *self;
        [
            (StageId::POSE, pose),
            (StageId::BVH, bvh),
            (StageId::PLACE, place),
            (StageId::TRACE, trace),
            (StageId::DECIDE, decide),
            (StageId::ENCODE, encode),
        ]
    }

    /// Returns the time of all stages.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.by_stage().iter().map(|(_, micros)| micros).sum()
    }
}

impl FrameStats {
    /// Returns the figures of a frame that is traced and not encoded yet.
    pub(super) fn of(traces: &Traces) -> Self {
        let Traces { first, micros, .. } = *traces;
        let TraceTotals { visible, traced, rays, waiting } = traces.totals;
        Self { visible, traced, rays, waiting, first, micros, ..Self::default() }
    }

    /// Returns the REPORT of the frame; without `timings` it is the same in every run.
    #[must_use]
    pub fn report(&self, frame: FrameIndex, timings: bool) -> Report {
        let tables = self.occupancy.unwrap_or_default();
        let times = self.micros.by_stage().map(|(stage, micros)| StageTime::new(stage, Micros(micros)));
        Report {
            frame,
            rays: self.rays,
            visible: self.visible,
            traced: self.traced,
            changed: self.changed,
            cells: tables.cells,
            stored: tables.points_stored,
            bucket_full: tables.bucket_full,
            cell_full: tables.cell_full,
            no_cell: tables.no_cell,
            outside_grid: tables.outside_grid,
            id_collisions: tables.id_collisions,
            stages: if timings { times.into() } else { Vec::new() },
        }
    }
}

/// Sums over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct FrameTotals {
    /// Frames in the sums.
    pub frames: u64,
    /// Points in view.
    pub visible: u64,
    /// Points whose AO was traced.
    pub traced: u64,
    /// Rays traced.
    pub rays: u64,
    /// Points sent.
    pub changed: u64,
    /// Points that waited for rays, summed over the frames, and the longest wait of all.
    pub waiting: RayBacklog,
    /// Times.
    pub micros: StageMicros,
}

impl FrameTotals {
    /// Adds a frame.
    pub fn add(&mut self, frame: &FrameStats) {
        self.frames += 1;
        self.visible += u64::from(frame.visible);
        self.traced += u64::from(frame.traced);
        self.rays += frame.rays;
        self.changed += u64::from(frame.changed);
        if let Some(RayBacklog { points, oldest }) = frame.waiting {
            self.waiting.points = self.waiting.points.saturating_add(points);
            self.waiting.oldest = self.waiting.oldest.max(oldest);
        }
        self.micros += frame.micros;
    }
}

impl AddAssign for StageMicros {
    fn add_assign(&mut self, other: Self) {
        self.pose += other.pose;
        self.bvh += other.bvh;
        self.place += other.place;
        self.trace += other.trace;
        self.decide += other.decide;
        self.encode += other.encode;
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
    /// Tracing the points of the first frame; counted in points.
    FirstFrame,
}
