//! `psao lab stress`: the cases that are known to be hard, with their bounds and what was measured.

use psao_eval::stress::{self, Verdict, cases};
use serde::Serialize;

use crate::args::{Format, FormatArg};
use crate::context::{progress, say, say_json};
use crate::error::{Exit, Failure, Outcome};
use crate::output::csv::Csv;
use crate::output::table::Figures;

/// Run cases that are hard for the method, and check their bounds
///
/// "known limit" marks a bound that the paper's own structure breaks, by no more than is documented. The exit code is 6 if
/// a case fails.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao lab stress
  psao lab stress --only plane")]
pub(crate) struct Args {
    /// Run only the cases whose name contains this
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    #[command(flatten)]
    format: FormatArg,
}

#[derive(Serialize)]
struct Line {
    name: &'static str,
    what: &'static str,
    bound_text: &'static str,
    bound: f64,
    worst: f64,
    unit: &'static str,
    verdict: String,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let chosen: Vec<_> = cases()
        .into_iter()
        .filter(|case| args.only.as_deref().is_none_or(|part| case.name().contains(part)))
        .collect();
    if chosen.is_empty() {
        let names: Vec<_> = cases().iter().map(stress::Case::name).collect();
        return Err(Failure::usage(format_args!(
            "no case has a name that contains \"{}\"; the cases are {}",
            args.only.as_deref().unwrap_or_default(),
            names.join(", ")
        )));
    }
    let bar = progress("stress", chosen.len() as u64);
    let mut outcomes = Vec::new();
    for case in chosen {
        outcomes.push(case.run().map_err(|error| Failure::new(Exit::System, error))?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    match args.format.get() {
        Format::Table => table(&outcomes)?,
        Format::Json => {
            let lines: Vec<Line> = outcomes.iter().map(line).collect();
            say_json(&lines)?;
        }
        Format::Csv => csv(&outcomes)?,
    }
    let failed: Vec<&str> = outcomes
        .iter()
        .filter(|outcome| outcome.verdict == Verdict::Fails)
        .map(|outcome| outcome.name)
        .collect();
    if failed.is_empty() {
        Ok(())
    } else {
        Err(Failure::new(Exit::Check, format_args!("failed: {}", failed.join(", "))))
    }
}

fn line(outcome: &stress::Outcome) -> Line {
    Line {
        name: outcome.name,
        what: outcome.what,
        bound_text: outcome.bound_text,
        bound: outcome.bound,
        worst: outcome.worst,
        unit: outcome.unit,
        verdict: outcome.verdict.to_string(),
    }
}

/// Formats a value with four significant figures or decimals.
fn figure(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        format!("{value:.4}")
    } else {
        format!("{value:.3e}")
    }
}

fn table(outcomes: &[stress::Outcome]) -> Outcome {
    let mut table = Figures::new(["case", "bound", "measured worst", "unit", "verdict"]).words(&[3, 4]);
    for outcome in outcomes {
        table.row([
            outcome.name.to_owned(),
            figure(outcome.bound),
            figure(outcome.worst),
            outcome.unit.to_owned(),
            outcome.verdict.to_string(),
        ]);
    }
    say(table)?;
    for outcome in outcomes {
        say(format_args!("{}: {} Bound: {}", outcome.name, outcome.what, outcome.bound_text))?;
    }
    Ok(())
}

fn csv(outcomes: &[stress::Outcome]) -> Outcome {
    let mut csv = Csv::new(["case", "bound", "worst", "unit", "verdict"])?;
    for outcome in outcomes {
        csv.row([
            outcome.name.to_owned(),
            outcome.bound.to_string(),
            outcome.worst.to_string(),
            outcome.unit.to_owned(),
            outcome.verdict.to_string(),
        ])?;
    }
    csv.finish()
}
