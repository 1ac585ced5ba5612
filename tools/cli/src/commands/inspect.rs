//! `psao inspect`: where the bytes of a recording went.

use std::io::Write as _;
use std::path::PathBuf;

use psao_proto::message::Budget;
use serde::Serialize;

use crate::analysis::{Analysis, BLOCKS, FrameLine, OVERHEAD, PARTS, Totals, load};
use crate::args::{Format, RecordingArg};
use crate::budget::BudgetTotals;
use crate::context::say;
use crate::error::{Exit, Failure, Outcome};
use crate::output::number;
use crate::output::plot::{Bar, Plot};
use crate::output::stages::stage_table;
use crate::output::table::Figures;

/// Bytes per frame and part of a recording
///
/// Every byte of the file is counted once, in a part of a frame or in the overhead. A damaged recording is read as far
/// as it is whole; the exit code is then 4.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    recording: RecordingArg,
    /// A line for every frame as well
    #[arg(long)]
    per_frame: bool,
    /// How to print: table, json (docs/inspect-json.md) or csv (a line per frame)
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
    /// Draw bytes per frame, stacked by part, into this SVG file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let path = &args.recording.file;
    let analysis = Analysis::of(path, &load(path)?)?;
    match args.format {
        Format::Table => table(&analysis, args.per_frame)?,
        Format::Json => say(json(&analysis)?)?,
        Format::Csv => csv(&analysis)?,
    }
    if let Some(target) = &args.plot {
        let title = format!("Bytes per frame: {}", path.file_name().unwrap_or_default().to_string_lossy());
        std::fs::write(target, plot(&analysis, title).svg())
            .map_err(|error| Failure::writing(target, &error))?;
    }
    loss(&analysis)
}

/// The bandwidth plot of a recording.
pub(crate) fn plot(analysis: &Analysis, title: String) -> Plot {
    let used: Vec<usize> = used(analysis).collect();
    Plot {
        title,
        parts: used.iter().map(|&part| PARTS[part].to_owned()).collect(),
        bars: analysis
            .frames
            .iter()
            .map(|line| Bar {
                frame: line.frame,
                key: line.key,
                bytes: used.iter().map(|&part| line.parts[part]).collect(),
            })
            .collect(),
        fps: analysis.fps(),
    }
}

/// Exit code 4 when something was left out.
pub(crate) fn loss(analysis: &Analysis) -> Outcome {
    if analysis.is_whole() {
        return Ok(());
    }
    let places: Vec<String> =
        analysis.damages.iter().map(ToString::to_string).chain(analysis.unreadable.iter().cloned()).collect();
    Err(Failure::new(
        Exit::DataLoss,
        format_args!("{} damaged place(s) left out: {}", places.len(), places.join("; ")),
    ))
}

fn table(analysis: &Analysis, per_frame: bool) -> Outcome {
    if let Some(info) = &analysis.stream {
        say(format_args!(
            "{}: profile {}, {} points in {} instances, {} bit, {}, {}, {} rays of {} m, threshold {}/255, seed {}",
            info.name,
            info.profile,
            number::count(u64::from(info.point_count)),
            number::count(u64::from(info.instance_count)),
            info.point_bits,
            info.coder,
            info.occlusion,
            info.rays,
            info.radius_m,
            info.threshold,
            info.seed,
        ))?;
    }
    let totals = analysis.totals();
    let mut parts = Figures::new(PART_HEADS);
    for row in part_rows(analysis, &totals) {
        parts.row(row);
    }
    say(parts)?;
    say(summary_lines(analysis, &totals))?;
    let reports = analysis.frames.iter().enumerate();
    let reports = reports.filter_map(|(number, line)| Some((number == 0, line.report.as_ref()?)));
    if let Some(stages) = stage_table(reports) {
        say("Server time by stage (wall clock; the first frame traces every point):")?;
        say(stages)?;
    }
    if per_frame {
        say(frames_table(analysis))?;
    }
    Ok(())
}

/// Heads of [`part_rows`].
pub(crate) const PART_HEADS: [&str; 5] = ["part", "first state", "bytes a frame", "Mbit/s", "share"];

/// Bytes by part: the first state, then the frames after it; last, all parts together.
pub(crate) fn part_rows(analysis: &Analysis, totals: &Totals) -> Vec<[String; PART_HEADS.len()]> {
    let all: u64 = totals.parts.iter().sum();
    let frames = totals.later_frames.max(1) as f64;
    let row = |name: &str, first: u64, bytes: u64| {
        [
            name.to_owned(),
            number::bytes(first),
            format!("{:.1}", bytes as f64 / frames),
            format!("{:.3}", number::megabits(bytes, totals.seconds)),
            format!("{:.1} %", bytes as f64 * 100.0 / all.max(1) as f64),
        ]
    };
    let first = |part: usize| analysis.frames.first().map_or(0, |line| line.parts[part]);
    let mut rows: Vec<_> = (0..PARTS.len())
        .filter(|&part| first(part) + totals.parts[part] > 0)
        .map(|part| row(PARTS[part], first(part), totals.parts[part]))
        .collect();
    rows.push(row("all", totals.first_state, all));
    rows
}

/// The sentences below the table.
pub(crate) fn summary_lines(analysis: &Analysis, totals: &Totals) -> String {
    let mut lines = vec![
        format!(
            "{} frames, {:.2} s at {} Hz; file {}, of which {} belong to no frame",
            analysis.frames.len(),
            analysis.frames.len() as f64 / analysis.fps(),
            analysis.fps(),
            number::bytes(analysis.file_bytes),
            number::bytes(analysis.overhead_bytes()),
        ),
        format!(
            "After the first state: {:.3} Mbit/s as the paper counts ({}), {:.3} Mbit/s with everything on the wire, \
             {:.3} Mbit/s for the whole file",
            totals.paper_mbit_s,
            if analysis.is_paper() { "cells and buckets" } else { "blocks that hold points" },
            totals.wire_mbit_s,
            totals.file_mbit_s
        ),
        format!(
            "{} points sent after the first state, {:.2} bits each with everything counted",
            number::count(totals.changed_points),
            totals.bits_per_changed_point
        ),
    ];
    lines.extend(analysis.budgets().and_then(|budgets| budgets.text()));
    if let Some(report) = analysis.last_report().filter(|_| analysis.is_paper()) {
        lines.push(format!(
            "Frame {}: {} points in {} cells; not stored: {} bucket full, {} cell full, {} no free cell; {} outside \
             their grid, {} in a cell whose id is shared",
            report.frame.0,
            number::count(u64::from(report.stored)),
            number::count(u64::from(report.cells)),
            number::count(u64::from(report.bucket_full)),
            number::count(u64::from(report.cell_full)),
            number::count(u64::from(report.no_cell)),
            number::count(u64::from(report.outside_grid)),
            number::count(u64::from(report.id_collisions)),
        ));
    }
    lines.extend(analysis.gaps.iter().map(|gap| format!("Gap: {gap}")));
    lines.join("\n")
}

fn frames_table(analysis: &Analysis) -> Figures {
    let blocks = used(analysis).filter(|part| BLOCKS.contains(part));
    let blocks: Vec<usize> = blocks.collect();
    let mut heads: Vec<&str> = vec!["frame", "time s", "kind", "wire bytes"];
    heads.extend(blocks.iter().map(|&part| PARTS[part]));
    heads.extend(["rest", "changed"]);
    let budgets = analysis.budgets().is_some();
    if budgets {
        heads.extend(["postponed", "oldest", "forced"]);
    }
    let heads: Vec<String> = heads.into_iter().map(str::to_owned).collect();
    let mut table = Figures::of(&heads);
    for line in &analysis.frames {
        let mut row = vec![
            line.frame.to_string(),
            format!("{:.3}", line.time_s),
            if line.key { "key" } else { "delta" }.to_owned(),
            number::count(line.wire_bytes()),
        ];
        row.extend(blocks.iter().map(|&part| number::count(line.parts[part])));
        let rest = line.wire_bytes() - blocks.iter().map(|&part| line.parts[part]).sum::<u64>();
        row.extend([number::count(rest), number::count(u64::from(line.changed_points))]);
        if budgets {
            let figures = line.budget.map(|budget| [budget.postponed, budget.oldest, budget.forced]);
            row.extend(
                figures.map_or_else(Default::default, |figures| {
                    figures.map(|figure| number::count(figure.into()))
                }),
            );
        }
        table.row(row);
    }
    table
}

/// Parts that some frame has.
fn used(analysis: &Analysis) -> impl Iterator<Item = usize> + '_ {
    (0..PARTS.len()).filter(|&part| analysis.frames.iter().any(|line| line.parts[part] > 0))
}

fn csv(analysis: &Analysis) -> Outcome {
    let mut out = std::io::stdout().lock();
    let mut lines = vec![format!(
        "frame,time_s,kind,group,sequence,wire_bytes,{},changed_points,state_hash,budget_bytes,body_bytes,postponed,oldest,forced",
        PARTS.join(",")
    )];
    for line in &analysis.frames {
        let parts: Vec<String> = line.parts.iter().map(u64::to_string).collect();
        let budget = line.budget.map_or_else(
            || ",".repeat(4),
            |Budget { budget, used, postponed, oldest, forced, .. }| {
                format!("{budget},{used},{postponed},{oldest},{forced}")
            },
        );
        lines.push(format!(
            "{},{:.6},{},{},{},{},{},{},{:016x},{budget}",
            line.frame,
            line.time_s,
            if line.key { "key" } else { "delta" },
            line.group,
            line.sequence,
            line.wire_bytes(),
            parts.join(","),
            line.changed_points,
            line.hash
        ));
    }
    writeln!(out, "{}", lines.join("\n")).map_err(|error| crate::context::broken_output(&error))
}

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

fn json(analysis: &Analysis) -> Outcome<String> {
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
    serde_json::to_string_pretty(&document)
        .map_err(|error| Failure::new(Exit::System, format_args!("cannot write JSON: {error}")))
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
