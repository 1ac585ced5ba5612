//! Quantities as people type them: time `20ms`, rate `500kbit/s`, size `4kB`, share `5%`.
//!
//! One grammar for every option: a number, perhaps a space, and a unit. A number alone is refused, because one option
//! would mean seconds and the next milliseconds; only `0` needs no unit.

use std::str::FromStr;

use psao_proto::{Micros, StreamTime};

/// Units of time, in microseconds.
const TIME: [(&str, f64); 5] = [("us", 1.0), ("ms", 1e3), ("s", 1e6), ("min", 60e6), ("h", 3600e6)];
/// Units of rate, in bits a second; `/s` may follow, and case does not count.
const RATE: [(&str, f64); 4] = [("bit", 1.0), ("kbit", 1e3), ("mbit", 1e6), ("gbit", 1e9)];
/// Units of size, in bytes; case does not count.
const SIZE: [(&str, f64); 7] = [
    ("b", 1.0),
    ("kb", 1e3),
    ("mb", 1e6),
    ("gb", 1e9),
    ("kib", 1024.0),
    ("mib", 1_048_576.0),
    ("gib", 1_073_741_824.0),
];
/// Longest time that an option takes, in microseconds: a thousand hours.
const LONGEST: f64 = 3600e9;

/// Splits a quantity into its number, at least 0 and finite, and its unit.
fn split(text: &str) -> Option<(f64, &str)> {
    let text = text.trim();
    let digits = |text: &str| text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let mut end = digits(text);
    // An exponent: `1e3s`.
    if let Some(exponent) = text[end..].strip_prefix(['e', 'E']) {
        let signed = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
        let length = signed.find(|c: char| !c.is_ascii_digit()).unwrap_or(signed.len());
        if length > 0 {
            end = text.len() - signed.len() + length;
        }
    }
    let (number, unit) = text.split_at_checked(end)?;
    number.parse().ok().filter(|number: &f64| number.is_finite()).map(|number| (number, unit.trim()))
}

/// Returns the factor of a unit.
fn factor(units: &[(&str, f64)], unit: &str) -> Option<f64> {
    units.iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor)
}

/// A length of time: `250us`, `20ms`, `2.5s`, `2min`, `1h`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct TimeSpan(pub(crate) Micros);

impl FromStr for TimeSpan {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Some((number, unit)) = split(text) else {
            return Err(format!("\"{text}\" is not a time such as 20ms or 2.5s"));
        };
        let micros = match factor(&TIME, unit) {
            Some(factor) => (number * factor).round(),
            None if unit.is_empty() && number == 0.0 => 0.0,
            None if unit.is_empty() => {
                return Err(format!("\"{text}\" has no unit: write {number}ms or {number}s"));
            }
            None => {
                return Err(format!("\"{unit}\" in \"{text}\" is no unit of time: use us, ms, s, min or h"));
            }
        };
        if micros > LONGEST {
            return Err(format!("\"{text}\" is longer than 1000 hours"));
        }
        Ok(Self(Micros(micros as u64)))
    }
}

impl std::fmt::Display for TimeSpan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let micros = self.0.0;
        match micros {
            0 => f.write_str("0"),
            _ if micros.is_multiple_of(1_000_000) => write!(f, "{}s", micros / 1_000_000),
            _ if micros.is_multiple_of(1_000) => write!(f, "{}ms", micros / 1_000),
            _ => write!(f, "{micros}us"),
        }
    }
}

impl TimeSpan {
    /// Returns the time as a time of a stream.
    pub(crate) const fn stream_time(self) -> StreamTime {
        StreamTime(self.0.0)
    }

    /// Parses a time of at most one hour, as the virtual network takes them.
    pub(crate) fn within_an_hour(text: &str) -> Result<Self, String> {
        let time: Self = text.parse()?;
        if time.0 > Micros::from_secs(3600) {
            Err(format!("\"{text}\" is longer than an hour"))
        } else {
            Ok(time)
        }
    }
}

/// A rate in bits a second: `500kbit/s`, `500kbit`, `2Mbit/s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rate {
    /// Bits a second, 8 to 1e12.
    pub(crate) bits: f64,
}

impl FromStr for Rate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let bits = split(text).and_then(|(number, unit)| {
            let unit = unit.to_ascii_lowercase();
            Some(number * factor(&RATE, unit.strip_suffix("/s").unwrap_or(&unit))?)
        });
        match bits {
            Some(bits) if (8.0..=1e12).contains(&bits) => Ok(Self { bits }),
            _ => Err(format!(
                "\"{text}\" is not a rate from 8bit/s to 1000Gbit/s, such as 500kbit/s or 2Mbit/s"
            )),
        }
    }
}

/// A rate, or `none` for no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RateLimit(pub(crate) Option<Rate>);

impl RateLimit {
    /// Returns the limit in whole bytes a second.
    pub(crate) fn bytes(self) -> Option<u64> {
        self.0.map(|rate| (rate.bits / 8.0).round() as u64)
    }
}

impl FromStr for RateLimit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text.trim() == "none" {
            return Ok(Self(None));
        }
        text.parse().map(|rate| Self(Some(rate))).map_err(|error| format!("{error}, or none"))
    }
}

/// A number of bytes: `1200B`, `4kB` (4000), `64MiB` (64 times 1024 times 1024).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Size(pub(crate) u64);

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Some((number, unit)) = split(text) else {
            return Err(format!("\"{text}\" is not a size such as 1200B, 4kB or 64MiB"));
        };
        let bytes = match factor(&SIZE, &unit.to_ascii_lowercase()) {
            Some(factor) => (number * factor).round(),
            None if unit.is_empty() && number == 0.0 => 0.0,
            None if unit.is_empty() => {
                return Err(format!("\"{text}\" has no unit: write {number}B, {number}kB or {number}MiB"));
            }
            None => {
                return Err(format!(
                    "\"{unit}\" in \"{text}\" is no unit of size: use B, kB, MB, GB, KiB, MiB or GiB"
                ));
            }
        };
        if bytes > 1e15 {
            return Err(format!("\"{text}\" is more than 1e15 bytes"));
        }
        Ok(Self(bytes as u64))
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let bytes = self.0;
        for (unit, factor) in [("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10)] {
            if bytes >= factor && bytes.is_multiple_of(factor) {
                return write!(f, "{}{unit}", bytes / factor);
            }
        }
        write!(f, "{bytes}B")
    }
}

impl Size {
    /// Parses a size from `low` to `high` bytes.
    pub(crate) fn between(text: &str, low: u64, high: u64) -> Result<Self, String> {
        let size: Self = text.parse()?;
        if (low..=high).contains(&size.0) {
            Ok(size)
        } else {
            Err(format!("\"{text}\" is not a size from {} to {}", Self(low), Self(high)))
        }
    }
}

/// A share in parts of a million: `5%` or `0.05`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Share(pub(crate) u32);

impl Share {
    /// Parses a share of at most `most` parts of a million.
    ///
    /// A number without a sign is a fraction up to 1.0. Above 1 it is in percent, as older versions wrote it; `1` alone
    /// could be either and is refused.
    pub(crate) fn at_most(text: &str, most: u32) -> Result<Self, String> {
        let wrong = || format!("\"{text}\" is not a share such as 5% or 0.05, at most {}", Self(most));
        let (number, unit) = split(text).ok_or_else(wrong)?;
        let percent = match unit {
            "%" => number,
            "" if text.trim() == "1" => return Err(format!("\"{text}\" could be 1% or 100%: write which")),
            "" if number <= 1.0 => number * 100.0,
            "" => number,
            _ => return Err(wrong()),
        };
        let parts = (percent * 10_000.0).round();
        if parts <= f64::from(most) { Ok(Self(parts as u32)) } else { Err(wrong()) }
    }
}

impl FromStr for Share {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::at_most(text, 1_000_000)
    }
}

impl std::fmt::Display for Share {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}%", f64::from(self.0) / 10_000.0)
    }
}

/// Something that lasts, and when it begins: `3s@10s`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct During {
    pub(crate) from: Micros,
    pub(crate) to: Micros,
}

impl FromStr for During {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Some((lasting, from)) = text.split_once('@') else {
            return Err(format!(
                "\"{text}\" does not say how long and when: 3s@10s lasts 3 s and begins at 10 s"
            ));
        };
        let (TimeSpan(lasting), TimeSpan(from)) =
            (TimeSpan::within_an_hour(lasting)?, TimeSpan::within_an_hour(from)?);
        if lasting == Micros(0) {
            return Err(format!("\"{text}\" lasts no time at all"));
        }
        Ok(Self { from, to: from.plus(lasting) })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn quantities_parse_exactly() {
        for (text, parts) in [
            ("0", 0),
            ("0.05", 50_000),
            ("5%", 50_000),
            ("0.1%", 1_000),
            ("100 %", 1_000_000),
            ("1.0", 1_000_000),
        ] {
            assert_eq!(text.parse(), Ok(Share(parts)), "{text}");
        }
        // As older versions wrote percent.
        assert_eq!(["5", "20", "2.5"].map(str::parse), [50_000, 200_000, 25_000].map(|p| Ok(Share(p))));
        for (text, micros) in [
            ("0", 0),
            ("40ms", 40_000),
            ("1.5s", 1_500_000),
            ("7us", 7),
            ("2min", 120_000_000),
            ("1h", 3_600_000_000),
            ("1e3 ms", 1_000_000),
            (" 20 ms ", 20_000),
        ] {
            assert_eq!(text.parse(), Ok(TimeSpan(Micros(micros))), "{text}");
        }
        for (text, bits) in [
            ("2mbit", 2e6),
            ("2Mbit/s", 2e6),
            ("500kbit", 500e3),
            ("500kbit/s", 500e3),
            ("0.48 Mbit/s", 480e3),
            ("8 bit", 8.0),
            ("1Gbit/s", 1e9),
        ] {
            assert_eq!(text.parse(), Ok(Rate { bits }), "{text}");
            assert_eq!(text.parse(), Ok(RateLimit(Some(Rate { bits }))), "{text}");
        }
        assert_eq!("none".parse(), Ok(RateLimit(None)));
        for (text, bytes) in [
            ("0", 0),
            ("1200B", 1200),
            ("1.5kB", 1500),
            ("4 kB", 4000),
            ("64MiB", 64 << 20),
            ("1GiB", 1 << 30),
            ("2MB", 2_000_000),
            ("1e3B", 1000),
        ] {
            assert_eq!(text.parse(), Ok(Size(bytes)), "{text}");
        }
        let during = During { from: Micros(10_000_000), to: Micros(13_000_000) };
        assert_eq!("3s@10s".parse(), Ok(during));
    }

    #[test]
    fn nonsense_is_refused_with_words() {
        for (text, says) in [
            ("101%", "100%"),
            ("-1", "share"),
            ("five", "share"),
            ("5ppm", "share"),
            ("", "share"),
            ("1", "1% or 100%"),
        ] {
            assert!(text.parse::<Share>().unwrap_err().contains(says), "{text}");
        }
        for (text, says) in [
            ("40", "40ms or 40s"),
            ("4d", "\"d\""),
            ("1e9s", "1000 hours"),
            ("1001h", "hours"),
            ("x", "a time"),
            ("-5ms", "a time"),
            ("nans", "a time"),
            ("infs", "a time"),
            ("1es", "\"es\""),
        ] {
            let error = text.parse::<TimeSpan>().unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
        assert!(TimeSpan::within_an_hour("61min").unwrap_err().contains("hour"));
        for text in ["0", "2", "2mb", "0mbit", "-2mbit", "1bit", "500kb/s", "1e99bit/s", "none"] {
            assert!(text.parse::<Rate>().is_err(), "{text}");
        }
        for (text, says) in [
            ("64", "64MiB"),
            ("4kbit", "\"kbit\""),
            ("-5B", "a size"),
            ("nanB", "a size"),
            ("1e99B", "1e15"),
            ("", "a size"),
        ] {
            let error = text.parse::<Size>().unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
        assert!(Size::between("1kB", 1 << 20, 1 << 30).unwrap_err().contains("1MiB to 1GiB"));
        for text in ["3s", "@3s", "3s@", "0@3s", "3@10s"] {
            assert!(text.parse::<During>().is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn what_is_printed_is_read_again(micros in 0..3_600_000_000_000_u64, bytes in 0..1_000_000_000_000_u64, parts in 0..=1_000_000_u32) {
            prop_assert_eq!(TimeSpan(Micros(micros)).to_string().parse(), Ok(TimeSpan(Micros(micros))));
            prop_assert_eq!(Size(bytes).to_string().parse(), Ok(Size(bytes)));
            prop_assert_eq!(Share(parts).to_string().parse(), Ok(Share(parts)));
        }

        #[test]
        fn units_scale_and_spaces_do_not_count(number in 1..10_000_u32, gap in " {0,3}") {
            let read = |unit: &str| format!("{gap}{number}{gap}{unit}{gap}").parse::<TimeSpan>().unwrap().0.0;
            for (large, small, factor) in [("ms", "us", 1000), ("s", "ms", 1000), ("min", "s", 60)] {
                prop_assert_eq!(read(large), read(small) * factor);
            }
            let bits = |unit: &str| format!("{number}{gap}{unit}").parse::<Rate>().unwrap().bits;
            prop_assert_eq!(bits("kbit"), bits("Kbit/s"));
            prop_assert_eq!(bits("Mbit/s"), bits("kbit") * 1e3);
            let bytes = |unit: &str| format!("{number}{gap}{unit}").parse::<Size>().unwrap().0;
            prop_assert_eq!(bytes("KiB"), bytes("b") * 1024);
        }

        #[test]
        fn any_text_is_read_or_refused_without_a_panic(text in "\\PC{0,12}") {
            let _ = (text.parse::<TimeSpan>(), text.parse::<RateLimit>(), text.parse::<Size>());
            let _ = (text.parse::<Share>(), text.parse::<During>());
        }
    }
}
