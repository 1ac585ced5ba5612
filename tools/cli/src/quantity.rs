//! Quantities as people type them: `5%`, `40ms`, `2mbit`, `3s@10s`.

use std::str::FromStr;

use psao_proto::Micros;

/// A number and what stands behind it.
fn split(text: &str) -> Option<(f64, &str)> {
    let end = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at_checked(end)?;
    number.parse().ok().map(|number| (number, unit.trim()))
}

/// A share, in parts of a million: `5%`, `0.1%`, or the same without the sign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Share(pub(crate) u32);

impl FromStr for Share {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match split(text.trim()) {
            Some((percent, "" | "%")) if percent <= 100.0 => Ok(Self((percent * 10_000.0).round() as u32)),
            _ => Err(format!("\"{text}\" is not a share such as 5% or 0.1%, at most 100%")),
        }
    }
}

impl std::fmt::Display for Share {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} %", f64::from(self.0) / 10_000.0)
    }
}

/// A length of time: `250us`, `40ms`, `3s`, `2min`; `0` needs no unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Span(pub(crate) Micros);

impl FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Some((number, unit)) = split(text.trim()) else {
            return Err(format!("\"{text}\" is not a time such as 40ms or 3s"));
        };
        let scale = match unit {
            "us" => 1.0,
            "ms" => 1e3,
            "s" => 1e6,
            "min" => 60e6,
            "" if number == 0.0 => 1.0,
            "" => return Err(format!("\"{text}\" has no unit: say {text}ms or {text}s")),
            _ => return Err(format!("\"{unit}\" in \"{text}\" is none of us, ms, s and min")),
        };
        let micros = (number * scale).round();
        if micros > 3600e6 {
            return Err(format!("\"{text}\" is longer than an hour"));
        }
        Ok(Self(Micros(micros as u64)))
    }
}

/// Bytes a second, typed as bits: `500kbit`, `2mbit`; `none` for no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Rate(pub(crate) Option<u64>);

impl FromStr for Rate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text.trim() == "none" {
            return Ok(Self(None));
        }
        let scale = |unit: &str| match unit.to_ascii_lowercase().as_str() {
            "bit" => Some(1.0),
            "kbit" => Some(1e3),
            "mbit" => Some(1e6),
            "gbit" => Some(1e9),
            _ => None,
        };
        let bits = split(text.trim()).and_then(|(number, unit)| Some(number * scale(unit)?));
        match bits {
            Some(bits) if (8.0..=1e12).contains(&bits) => Ok(Self(Some((bits / 8.0).round() as u64))),
            _ => Err(format!("\"{text}\" is not a rate such as 500kbit, 2mbit, 1gbit or none")),
        }
    }
}

impl std::fmt::Display for Rate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            None => f.write_str("none"),
            Some(rate) => write!(f, "{} Mbit/s", rate as f64 * 8.0 / 1e6),
        }
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
                "\"{text}\" does not say how long and when: 3s@10s is 3 s long from 10 s on"
            ));
        };
        let (Span(lasting), Span(from)) = (lasting.parse()?, from.parse()?);
        if lasting == Micros(0) {
            return Err(format!("\"{text}\" lasts no time at all"));
        }
        Ok(Self { from, to: from.plus(lasting) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_parse_exactly() {
        assert_eq!(
            ["0", "5", "5%", "0.1%", "100 %"].map(str::parse),
            [0, 50_000, 50_000, 1_000, 1_000_000].map(|p| Ok(Share(p)))
        );
        assert_eq!(
            ["0", "40ms", "1.5s", "7us", "2min"].map(str::parse),
            [0, 40_000, 1_500_000, 7, 120_000_000].map(|m| Ok(Span(Micros(m))))
        );
        assert_eq!(
            ["none", "2mbit", "500kbit", "8 bit"].map(str::parse),
            [None, Some(250_000), Some(62_500), Some(1)].map(|r| Ok(Rate(r)))
        );
        let during = During { from: Micros(10_000_000), to: Micros(13_000_000) };
        assert_eq!("3s@10s".parse(), Ok(during));
    }

    #[test]
    fn nonsense_is_refused_with_words() {
        for (text, says) in
            [("101%", "100%"), ("-1", "share"), ("five", "share"), ("5ppm", "share"), ("", "share")]
        {
            assert!(text.parse::<Share>().unwrap_err().contains(says), "{text}");
        }
        for (text, says) in
            [("40", "40ms or 40s"), ("4h", "\"h\""), ("1e9s", "\"e9s\""), ("61min", "hour"), ("x", "a time")]
        {
            let error = text.parse::<Span>().unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
        for text in ["0", "2", "2mb", "0mbit", "-2mbit", "1bit"] {
            assert!(text.parse::<Rate>().is_err(), "{text}");
        }
        for text in ["3s", "@3s", "3s@", "0@3s", "3@10s"] {
            assert!(text.parse::<During>().is_err(), "{text}");
        }
    }
}
