//! The recording's figures as tables for people.

use super::used;
use crate::analysis::{Analysis, BLOCKS, PARTS, Totals};
use crate::context::say;
use crate::error::Outcome;
use crate::output::number;
use crate::output::stages::stage_table;
use crate::output::table::Figures;

/// Prints the stream, its bytes by part, its sums, and with `per_frame` a row for each frame.
pub(super) fn print(analysis: &Analysis, per_frame: bool) -> Outcome {
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
        say("Server time by stage (wall clock; the first frame traces all points that it sends):")?;
        say(stages)?;
    }
    if per_frame {
        say(frames_table(analysis))?;
    }
    Ok(())
}

/// Heads of [`part_rows`].
pub(crate) const PART_HEADS: [&str; 5] = ["part", "first state", "bytes a frame", "Mbit/s", "share"];

/// Returns the bytes by part: the first state, then the frames after it; the last row is all parts together.
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

/// Returns the sentences below the table.
pub(crate) fn summary_lines(analysis: &Analysis, totals: &Totals) -> String {
    let mut lines = vec![
        format!(
            "{}, {:.2} s at {} Hz; file {}, of which {} belong to no frame",
            number::counted(analysis.frames.len() as u64, "frame"),
            analysis.duration_s(),
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
