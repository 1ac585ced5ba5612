//! Cases that strain the stream on purpose, each with its bound and its worst measured value.
//!
//! A case is a small, deterministic computation that ends in one number. [`Case::run`] measures that number and judges
//! it: the bound holds, a documented limit of the paper's own structures shows, or the case fails. The whole table
//! takes a few seconds.

mod drift;
mod hash;
mod normals;
mod overflow;
mod positions;
mod scenes;

/// Result of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Short name, unique in the table, for example `eq1-plane-256`.
    pub name: &'static str,
    /// What the case strains and measures, in one sentence.
    pub what: &'static str,
    /// The bound and its origin, in words.
    pub bound_text: &'static str,
    /// Largest value within the bound, in `unit`.
    pub bound: f64,
    /// Worst measured value, in `unit`.
    pub worst: f64,
    /// Unit of `bound` and `worst`, for example `%` or `degrees`.
    pub unit: &'static str,
    /// The judgement.
    pub verdict: Verdict,
}

/// The judgement on a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// The bound holds.
    Holds,
    /// The bound does not hold, but the value is within the documented limit of the structure under test, which is the
    /// paper's own.
    KnownLimit,
    /// The bound does not hold.
    Fails,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Holds => "holds",
            Self::KnownLimit => "known limit",
            Self::Fails => "FAILS",
        })
    }
}

/// A case: its measurement and its bound.
#[derive(Clone, Debug)]
pub struct Case {
    name: &'static str,
    what: &'static str,
    bound_text: &'static str,
    bound: f64,
    /// Documented limit of the paper's structure, if it is beyond the bound.
    documented: Option<f64>,
    unit: &'static str,
    measure: fn() -> Result<f64, StressError>,
}

/// A case that could not be set up, because one of its parts refused its input.
#[derive(Debug, thiserror::Error)]
#[error("a stress case could not be set up: {0}")]
pub struct StressError(#[from] Box<dyn std::error::Error + Send + Sync>);

impl StressError {
    fn new(cause: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self(Box::new(cause))
    }
}

impl Case {
    /// Returns the short name, which is unique in the table.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Measures and judges the case. The result is the same on every machine.
    ///
    /// # Errors
    ///
    /// [`StressError`] when the case could not be set up. That is a fault of the case and not a verdict.
    pub fn run(&self) -> Result<Outcome, StressError> {
        let worst = (self.measure)()?;
        Ok(Outcome {
            name: self.name,
            what: self.what,
            bound_text: self.bound_text,
            bound: self.bound,
            worst,
            unit: self.unit,
            verdict: self.judge(worst),
        })
    }

    fn judge(&self, worst: f64) -> Verdict {
        // NaN is within no bound.
        if worst <= self.bound {
            Verdict::Holds
        } else if self.documented.is_some_and(|limit| worst <= limit) {
            Verdict::KnownLimit
        } else {
            Verdict::Fails
        }
    }
}

/// Returns all cases, in the order of the stream: cells, points, changes, scenes.
///
/// ```
/// use psao_eval::stress::{Verdict, cases};
///
/// let normals = cases().into_iter().find(|case| case.name() == "normals-best-of-four").unwrap();
/// let outcome = normals.run()?;
/// assert_eq!(outcome.verdict, Verdict::Holds);
/// assert!(outcome.worst > 5.0 && outcome.worst <= outcome.bound, "{outcome:?}");
/// # Ok::<(), psao_eval::stress::StressError>(())
/// ```
pub fn cases() -> Vec<Case> {
    [hash::cases(), overflow::cases(), normals::cases(), positions::cases(), drift::cases(), scenes::cases()]
        .concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_case_fails_and_each_says_what_it_is() {
        let mut names = std::collections::BTreeSet::new();
        for case in cases() {
            let outcome = case.run().unwrap();
            eprintln!(
                "{:28} {:>12.6} of {:>10.6} {:14} {}",
                outcome.name, outcome.worst, outcome.bound, outcome.unit, outcome.verdict
            );
            assert_ne!(outcome.verdict, Verdict::Fails, "{outcome:?}");
            assert!(names.insert(outcome.name), "{} twice", outcome.name);
            assert!(
                outcome.what.ends_with('.') && !outcome.bound_text.is_empty() && !outcome.unit.is_empty()
            );
        }
    }

    #[test]
    fn judgement_knows_bound_documented_limit_and_failure() {
        let case = Case {
            name: "n",
            what: "w.",
            bound_text: "b",
            bound: 1.0,
            documented: Some(2.0),
            unit: "%",
            measure: || Ok(f64::NAN),
        };
        assert_eq!(case.judge(1.0), Verdict::Holds);
        assert_eq!(case.judge(1.1), Verdict::KnownLimit);
        assert_eq!(case.judge(2.1), Verdict::Fails);
        assert_eq!(case.run().unwrap().verdict, Verdict::Fails, "NaN is never good");
        let strict = Case { documented: None, ..case };
        assert_eq!(strict.judge(1.1), Verdict::Fails);
    }
}
