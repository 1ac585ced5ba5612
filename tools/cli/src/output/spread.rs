//! The spread of measurements that were repeated.

use serde::Serialize;

/// The median of some values, and the range that they cover.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct MedianRange {
    pub(crate) median: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
}

impl MedianRange {
    /// Returns the spread of `values`, in any order; zeros when there is none.
    pub(crate) fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |index: usize| sorted.get(index).copied().unwrap_or(0.0);
        let last = sorted.len().saturating_sub(1);
        Self { median: f64::midpoint(at(last / 2), at(last.div_ceil(2))), least: at(0), most: at(last) }
    }

    /// Returns the spread in words, with two decimals.
    pub(crate) fn text(self) -> String {
        let Self { median, least, most } = self;
        format!("{median:.2} ({least:.2} to {most:.2})")
    }

    /// As [`text`](Self::text), with the sign of each number.
    pub(crate) fn signed_text(self) -> String {
        let Self { median, least, most } = self;
        format!("{median:+.2} ({least:+.2} to {most:+.2})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_number_is_between_the_two_in_the_middle() {
        let of = MedianRange::of;
        assert_eq!(of(&[4.0, 1.0, 3.0]), MedianRange { median: 3.0, least: 1.0, most: 4.0 });
        assert_eq!(of(&[4.0, 1.0, 3.0, 2.0]).median, 2.5);
        assert_eq!(of(&[]), MedianRange { median: 0.0, least: 0.0, most: 0.0 });
    }
}
