//! The best setting for each budget: the Pareto front in the order of rising cost.

use super::pareto_front;
use crate::sweep::Record;

/// A kind of cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cost {
    /// Mbit/s with everything counted. Only streams have it.
    MbitPerSecond,
    /// Milliseconds a picture on the client.
    PictureMs,
}

impl Cost {
    /// Returns the cost of a record; `None` when it has no cost of this kind.
    #[must_use]
    pub fn of(self, record: &Record) -> Option<f64> {
        match self {
            Self::MbitPerSecond => record.stream.map(|stream| stream.wire_mbit_s),
            Self::PictureMs => Some(record.picture_ms.median),
        }
    }
}

/// A step of the front: from this budget to that of the next step, this record is the best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BudgetStep {
    /// Smallest budget.
    pub budget: f64,
    /// Index of the record.
    pub index: usize,
    /// Its mean absolute error.
    pub mae: f64,
}

/// Smallest relative improvement of the error that makes a step of its own.
const MIN_IMPROVEMENT: f64 = 0.01;

/// Returns the best records for growing budgets, by mean absolute error.
///
/// No record fits a budget below the first step. An improvement by less than 1 % of the error makes no step, because it
/// may be chance.
#[must_use]
pub fn best_by_budget(records: &[&Record], cost: Cost) -> Vec<BudgetStep> {
    let points: Vec<(f64, f64)> =
        records.iter().map(|record| (cost.of(record).unwrap_or(f64::NAN), record.error.mae)).collect();
    let step = |index: usize| BudgetStep { budget: points[index].0, index, mae: points[index].1 };
    let mut found: Vec<BudgetStep> = Vec::new();
    for step in pareto_front(&points).into_iter().map(step) {
        if found.last().is_none_or(|last| step.mae < last.mae * (1.0 - MIN_IMPROVEMENT)) {
            found.push(step);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::samples::record;
    use super::*;

    #[test]
    fn a_larger_budget_never_gets_a_larger_error() {
        let records = [
            record("surface", 0.02, 5.0, Some(1.0)),
            record("surface", 0.03, 4.0, Some(3.0)),
            record("paper", 0.01, 9.0, Some(8.0)),
            record("ssao", 0.08, 2.0, None),
        ];
        let records: Vec<&Record> = records.iter().collect();
        let chosen = |cost| best_by_budget(&records, cost).iter().map(|step| step.index).collect::<Vec<_>>();
        assert_eq!(chosen(Cost::MbitPerSecond), [0, 2], "a method sends nothing and is no choice of stream");
        assert_eq!(chosen(Cost::PictureMs), [3, 1, 0, 2]);
    }

    #[test]
    fn what_is_hardly_better_is_no_advice() {
        let records = [0.02, 0.0199, 0.01985, 0.0197].map(|mae| record("surface", mae, 1.0 / mae, Some(1.0)));
        let records: Vec<&Record> = records.iter().collect();
        let chosen: Vec<usize> =
            best_by_budget(&records, Cost::PictureMs).iter().map(|step| step.index).collect();
        assert_eq!(chosen, [0, 3]);
    }
}
