//! The recording's figures as JSON; `docs/inspect-json.md` describes the fields.

use psao_proto::message::Budget;
use serde::Serialize;

use crate::analysis::{Analysis, FrameLine, OVERHEAD, PARTS};
use crate::budget::BudgetTotals;
use crate::context::say_json;
use crate::error::Outcome;

/// Names with their byte counts, in a fixed order.
struct Parts<'a>(&'a [&'a str], &'a [u64]);

impl Serialize for Parts<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().zip(self.1))
    }
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    file_bytes: u64,
    overhead_bytes: u64,
    overhead: Parts<'a>,
    stream: Option<Stream>,
    totals: TotalsOut<'a>,
    frames: Vec<FrameOut<'a>>,
    damage: Vec<DamageOut>,
    gaps: Vec<GapOut>,
    unreadable: &'a [String],
}

#[derive(Serialize)]
struct Stream {
    name: String,
    source: String,
    digest: String,
    profile: String,
    point_bits: u8,
    coder: String,
    geometry: String,
    fps: f32,
    radius_m: f32,
    rays: u32,
    occlusion: String,
    threshold: u8,
    seed: u64,
    points_per_m2: f32,
    min_points: u32,
    quality: f32,
    point_sets: u32,
    instances: u32,
    points: u32,
}

#[derive(Serialize)]
struct TotalsOut<'a> {
    frames: usize,
    keyframes: usize,
    first_state_bytes: u64,
    later_frames: u64,
    later_seconds: f64,
    later_parts: Parts<'a>,
    changed_points: u64,
    bits_per_changed_point: f64,
    paper_mbit_s: f64,
    wire_mbit_s: f64,
    file_mbit_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    budget: Option<BudgetTotals>,
}

#[derive(Serialize)]
struct FrameOut<'a> {
    frame: u32,
    time_s: f64,
    kind: &'static str,
    group: u32,
    sequence: u32,
    wire_bytes: u64,
    parts: Parts<'a>,
    changed_points: u32,
    state_hash: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    report: Option<ReportOut>,
    #[serde(skip_serializing_if = "Option::is_none")]
    budget: Option<BudgetOut>,
}

#[derive(Serialize)]
struct BudgetOut {
    bytes: u32,
    used: u32,
    postponed: u32,
    oldest: u32,
    forced: u32,
}

#[derive(Serialize)]
struct ReportOut {
    rays: u64,
    visible: u32,
    traced: u32,
    cells: u32,
    stored: u32,
    bucket_full: u32,
    cell_full: u32,
    no_cell: u32,
    outside_grid: u32,
    id_collisions: u32,
    stage_us: std::collections::BTreeMap<String, u32>,
}

#[derive(Serialize)]
struct DamageOut {
    offset: u64,
    lost_bytes: u64,
    what: String,
}

#[derive(Serialize)]
struct GapOut {
    first_lost: u32,
    last_lost: u32,
    frames: u32,
    bytes: u64,
    reason: String,
}

/// Prints everything that was counted.
pub(super) fn print(analysis: &Analysis) -> Outcome {
    let totals = analysis.totals();
    let document = Document {
        schema: "psao-inspect/1",
        file_bytes: analysis.file_bytes,
        overhead_bytes: analysis.overhead_bytes(),
        overhead: Parts(&OVERHEAD, &analysis.overhead),
        stream: analysis.stream.as_ref().map(|info| Stream {
            name: info.name.to_string(),
            source: info.source.to_string(),
            digest: info.digest.iter().map(|byte| format!("{byte:02x}")).collect(),
            profile: info.profile.to_string(),
            point_bits: info.point_bits,
            coder: info.coder.to_string(),
            geometry: info.geometry.to_string(),
            fps: info.fps,
            radius_m: info.radius_m,
            rays: info.rays,
            occlusion: info.occlusion.to_string(),
            threshold: info.threshold,
            seed: info.seed,
            points_per_m2: info.points_per_m2,
            min_points: info.min_points,
            quality: info.quality,
            point_sets: info.set_count,
            instances: info.instance_count,
            points: info.point_count,
        }),
        totals: TotalsOut {
            frames: analysis.frames.len(),
            keyframes: analysis.frames.iter().filter(|line| line.key).count(),
            first_state_bytes: totals.first_state,
            later_frames: totals.later_frames,
            later_seconds: totals.seconds,
            later_parts: Parts(&PARTS, &totals.parts),
            changed_points: totals.changed_points,
            bits_per_changed_point: totals.bits_per_changed_point,
            paper_mbit_s: totals.paper_mbit_s,
            wire_mbit_s: totals.wire_mbit_s,
            file_mbit_s: totals.file_mbit_s,
            budget: analysis.budgets(),
        },
        frames: analysis.frames.iter().map(frame_out).collect(),
        damage: analysis
            .damages
            .iter()
            .map(|damage| DamageOut {
                offset: damage.offset,
                lost_bytes: damage.lost_bytes,
                what: damage.kind.to_string(),
            })
            .collect(),
        gaps: analysis
            .gaps
            .iter()
            .map(|gap| GapOut {
                first_lost: gap.first_lost.0,
                last_lost: gap.last_lost.0,
                frames: gap.frames,
                bytes: gap.bytes,
                reason: gap.reason.to_string(),
            })
            .collect(),
        unreadable: &analysis.unreadable,
    };
    say_json(&document)
}

fn frame_out(line: &FrameLine) -> FrameOut<'_> {
    FrameOut {
        frame: line.frame,
        time_s: line.time_s,
        kind: if line.key { "key" } else { "delta" },
        group: line.group,
        sequence: line.sequence,
        wire_bytes: line.wire_bytes(),
        parts: Parts(&PARTS, &line.parts),
        changed_points: line.changed_points,
        state_hash: format!("{:016x}", line.hash),
        report: line.report.as_ref().map(|report| ReportOut {
            rays: report.rays,
            visible: report.visible,
            traced: report.traced,
            cells: report.cells,
            stored: report.stored,
            bucket_full: report.bucket_full,
            cell_full: report.cell_full,
            no_cell: report.no_cell,
            outside_grid: report.outside_grid,
            id_collisions: report.id_collisions,
            stage_us: report.stages.iter().map(|time| (time.stage.to_string(), time.micros)).collect(),
        }),
        budget: line.budget.map(|Budget { budget, used, postponed, oldest, forced, .. }| BudgetOut {
            bytes: budget,
            used,
            postponed,
            oldest,
            forced,
        }),
    }
}
