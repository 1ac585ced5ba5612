//! Numbers as people read them.

use indicatif::HumanCount;

/// Formats a count: `1,234,567`.
pub(crate) fn count(value: u64) -> String {
    HumanCount(value).to_string()
}

/// Formats a number of things: `1 round`, `1,234 rounds`.
pub(crate) fn counted(value: u64, what: &str) -> String {
    format!("{} {what}{}", count(value), if value == 1 { "" } else { "s" })
}

/// Formats a number of bytes with a decimal unit: `712 B`, `7.1 kB`, `3.40 MB`.
pub(crate) fn bytes(value: u64) -> String {
    let value = value as f64;
    match value {
        v if v < 1e3 => format!("{v:.0} B"),
        v if v < 1e6 => format!("{:.1} kB", v / 1e3),
        v if v < 1e9 => format!("{:.2} MB", v / 1e6),
        v => format!("{:.2} GB", v / 1e9),
    }
}

/// Returns the Mbit/s of `bytes` sent in `seconds`; zero when no time passed.
pub(crate) fn megabits(bytes: u64, seconds: f64) -> f64 {
    if seconds > 0.0 { bytes as f64 * 8.0 / seconds / 1e6 } else { 0.0 }
}

/// Formats microseconds as milliseconds with two decimals.
pub(crate) fn millis(micros: f64) -> String {
    format!("{:.2}", micros / 1e3)
}

/// Formats a PSNR in decibels, or `equal` for equal pictures.
pub(crate) fn decibels(psnr: Option<f64>) -> String {
    psnr.map_or_else(|| "equal".to_owned(), |psnr| format!("{psnr:.2} dB"))
}

/// Formats a figure, or a dash: small pictures do not have it.
pub(crate) fn where_known(figure: Option<f64>) -> String {
    figure.map_or_else(|| "\u{2013}".to_owned(), |figure| format!("{figure:.4}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_grouped_by_three() {
        for (value, text) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_234_567, "1,234,567")] {
            assert_eq!(count(value), text);
        }
    }

    #[test]
    fn one_is_not_many() {
        assert_eq!(
            [0, 1, 2000].map(|rounds| counted(rounds, "round")),
            ["0 rounds", "1 round", "2,000 rounds"]
        );
    }

    #[test]
    fn bytes_change_unit_at_powers_of_a_thousand() {
        assert_eq!([bytes(999), bytes(1000), bytes(2_500_000)], ["999 B", "1.0 kB", "2.50 MB"]);
    }

    #[test]
    fn no_time_means_no_rate() {
        assert_eq!(megabits(10, 0.0), 0.0);
        assert_eq!(megabits(125_000, 1.0), 1.0);
    }
}
