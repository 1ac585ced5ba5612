//! The recording's frames as CSV.

use psao_proto::message::Budget;

use crate::analysis::{Analysis, PARTS};
use crate::error::Outcome;
use crate::output::csv::Csv;

/// Prints a row for each frame; columns without a value are empty.
pub(super) fn print(analysis: &Analysis) -> Outcome {
    let first = ["frame", "time_s", "kind", "group", "sequence", "wire_bytes"];
    let last =
        ["changed_points", "state_hash", "budget_bytes", "body_bytes", "postponed", "oldest", "forced"];
    let mut csv = Csv::new(first.into_iter().chain(PARTS).chain(last))?;
    for line in &analysis.frames {
        let mut row = vec![
            line.frame.to_string(),
            format!("{:.6}", line.time_s),
            if line.key { "key" } else { "delta" }.to_owned(),
            line.group.to_string(),
            line.sequence.to_string(),
            line.wire_bytes().to_string(),
        ];
        row.extend(line.parts.iter().map(u64::to_string));
        row.extend([line.changed_points.to_string(), format!("{:016x}", line.hash)]);
        let budget = line.budget.as_ref();
        row.extend(budget.map_or_else(
            Default::default,
            |Budget { budget, used, postponed, oldest, forced, .. }| {
                [budget, used, postponed, oldest, forced].map(u32::to_string)
            },
        ));
        csv.row(row)?;
    }
    csv.finish()
}
