//! A line for every frame that a client applied, as it happens.

use psao_codec::envelope::FrameInfo;
use psao_proto::message::Budget;
use serde::Serialize;

use super::latency::Summary;
use super::number;
use crate::args::Format;
use crate::budget::BudgetTotals;
use crate::context::{say, say_json_line};
use crate::error::Outcome;

/// Prints frames as they come and keeps the totals.
pub(crate) struct FrameLog {
    format: Format,
    quiet: bool,
    pub(crate) frames: u64,
    pub(crate) wire_bytes: u64,
    changed: u64,
    last: Option<(u32, u64)>,
    budgets: BudgetTotals,
}

#[derive(Serialize)]
struct Line {
    frame: u32,
    time_s: f64,
    kind: &'static str,
    wire_bytes: u64,
    changed_points: u32,
    state_hash: String,
}

impl FrameLog {
    /// Starts a log in a format; `quiet` prints the totals only.
    pub(crate) fn new(format: Format, quiet: bool) -> Outcome<Self> {
        if !quiet {
            match format {
                Format::Table => say("  frame    time s  kind   wire bytes   changed  state hash")?,
                Format::Csv => say("frame,time_s,kind,wire_bytes,changed_points,state_hash")?,
                Format::Json => {}
            }
        }
        Ok(Self {
            format,
            quiet,
            frames: 0,
            wire_bytes: 0,
            changed: 0,
            last: None,
            budgets: BudgetTotals::default(),
        })
    }

    /// Prints and counts a frame that was applied.
    pub(crate) fn frame(&mut self, info: &FrameInfo, wire_bytes: u64) -> Outcome {
        self.frames += 1;
        self.wire_bytes += wire_bytes;
        self.changed += u64::from(info.changed_points);
        self.last = Some((info.frame.0, info.hash.0));
        if self.quiet {
            return Ok(());
        }
        let line = Line {
            frame: info.frame.0,
            time_s: info.time.0 as f64 / 1e6,
            kind: if info.kind == psao_codec::envelope::FrameKind::Key { "key" } else { "delta" },
            wire_bytes,
            changed_points: info.changed_points,
            state_hash: format!("{:016x}", info.hash.0),
        };
        let Line { frame, time_s, kind, changed_points, state_hash, .. } = &line;
        match self.format {
            Format::Table => say(format_args!(
                "{frame:>7} {time_s:>9.3}  {kind:<5} {wire_bytes:>11} {changed_points:>9}  {state_hash}"
            )),
            Format::Csv => {
                say(format_args!("{frame},{time_s:.6},{kind},{wire_bytes},{changed_points},{state_hash}"))
            }
            Format::Json => say_json_line(&line),
        }
    }

    /// Prints how old the frames were; as a line of JSON where frames are.
    pub(crate) fn latency(&self, summary: &Summary) -> Outcome {
        match self.format {
            Format::Table => say(summary),
            Format::Json => say_json_line(summary),
            Format::Csv => {
                eprintln!("{summary}");
                Ok(())
            }
        }
    }

    /// Counts what the server did with its byte budget.
    pub(crate) fn budget(&mut self, budget: &Budget) {
        self.budgets.add(budget);
    }

    /// Prints the totals, to standard error where standard output is for programs.
    pub(crate) fn finish(&self, note: &str) -> Outcome {
        let last = self.last.map_or_else(
            || "none".to_owned(),
            |(frame, hash)| format!("frame {frame}, state hash {hash:016x}"),
        );
        let budgets = self.budgets.text().map_or_else(String::new, |text| format!("\n{text}"));
        let text = format!(
            "{} applied, {} on the wire, {} sent; last: {last}{note}{budgets}",
            number::counted(self.frames, "frame"),
            number::bytes(self.wire_bytes),
            number::counted(self.changed, "point"),
        );
        if self.format == Format::Table {
            say(text)
        } else {
            eprintln!("{text}");
            Ok(())
        }
    }
}
