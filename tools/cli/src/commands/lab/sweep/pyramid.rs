//! The table of pyramid HBAO: errors and times as the radius grows.

use std::fmt::Write as _;

use psao_eval::report::power_law_exponent;
use psao_eval::sweep::RecordAtRadius;

use crate::output::table::Figures;

/// Radii in metres unless they are given: five octaves.
pub(super) const RADII_M: [f32; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

/// What the paper says of the time as the radius R grows (Astapov et al. 2021, section 4).
const SAID: [(&str, &str); 3] = [
    ("hbao", "quadratic, R^2"),
    ("pyramid-hbao", "close to linear in the levels, of which there are about log R"),
    ("scalable", "as pyramid HBAO"),
];

/// The only time that its text gives.
const PUBLISHED: &str =
    "Published (RTX 2080 Mobile, 1280x720): HBAO, D = 8, S = 10: 0.58 ms, without the blur's 0.25 ms.";

/// Returns the table of a scene: its radii one after the other.
pub(super) fn figures(entries: &[RecordAtRadius<'_>]) -> Figures {
    let mut table = Figures::new([
        "method",
        "radius, m",
        "reach, px",
        "D",
        "S",
        "L",
        "samples a pixel",
        "MAE",
        "SSIM",
        "ms without blur",
    ]);
    let some = |value: Option<String>| value.unwrap_or_else(|| "\u{2013}".to_owned());
    for entry in entries {
        let (error, sampling) = (&entry.record.error, entry.sampling);
        let count = |value: Option<u32>| some(value.map(|value| value.to_string()));
        table.row([
            entry.record.name.clone(),
            entry.radius_m.to_string(),
            some(entry.reach_px.map(|pixels| format!("{pixels:.0}"))),
            count(sampling.and_then(|sampling| sampling.directions)),
            count(sampling.and_then(|sampling| sampling.along)),
            count(sampling.map(|sampling| sampling.levels)),
            count(sampling.map(|sampling| sampling.per_pixel)),
            format!("{:.4}", error.mae),
            some(error.ssim.map(|ssim| format!("{ssim:.4}"))),
            format!("{:.2}", entry.ms_without_blur()),
        ]);
    }
    table
}

/// Returns how time and samples grow with the radius, by method, beside the paper's figures.
pub(super) fn growth(entries: &[RecordAtRadius<'_>]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for entry in entries {
        if !names.contains(&entry.record.name.as_str()) {
            names.push(&entry.record.name);
        }
    }
    let mut text = String::new();
    for name in names {
        let of_name = || entries.iter().filter(|entry| entry.record.name == name);
        let ms: Vec<_> =
            of_name().map(|entry| (f64::from(entry.radius_m), entry.ms_without_blur())).collect();
        let Some(p) = power_law_exponent(&ms) else { continue };
        let samples: Option<Vec<_>> = of_name()
            .map(|entry| Some((f64::from(entry.radius_m), f64::from(entry.sampling?.per_pixel))))
            .collect();
        let samples = samples.and_then(|samples| power_law_exponent(&samples));
        let samples = samples.map_or_else(String::new, |p| format!(", samples ~ R^{p:.2}"));
        let said = SAID.iter().find(|(said, _)| *said == name);
        let said = said.map_or_else(String::new, |(_, said)| format!("; the paper: {said}"));
        let _ = writeln!(text, "{name}: ms ~ R^{p:.2}{samples}{said}");
    }
    text + PUBLISHED
}

#[cfg(test)]
mod tests {
    use psao_eval::screen::Sampling;
    use psao_eval::sweep::{ErrorFigures as Errors, MemoryFigures, Record, RecordKind, Spread, StageTime};

    use super::*;

    fn record(name: &str, sample_ms: f64) -> Record {
        let spread = |median| Spread { median, low: median, high: median, samples: 1 };
        let stages = [("pyramid", 0.5), ("sample", sample_ms), ("blur", 30.0)];
        let stage = |(name, ms): (&str, f64)| StageTime {
            side: "client".to_owned(),
            name: name.to_owned(),
            ms: spread(ms),
        };
        Record {
            key: String::new(),
            scene: "s".to_owned(),
            kind: RecordKind::Screen,
            name: name.to_owned(),
            label: String::new(),
            setting: None,
            error: Errors { mae: 0.0123, ssim: Some(0.9876), ..Errors::default() },
            pictures: Vec::new(),
            picture_ms: spread(sample_ms + 30.5),
            stages: stages.map(stage).to_vec(),
            stream: None,
            memory: MemoryFigures::default(),
        }
    }

    fn entry(record: &Record, radius_m: f32, side: u32) -> RecordAtRadius<'_> {
        let sampling =
            Sampling { directions: Some(side), along: Some(side), levels: 0, per_pixel: side * side };
        RecordAtRadius { record, radius_m, reach_px: Some(radius_m * 80.0), sampling: Some(sampling) }
    }

    #[test]
    fn times_are_without_the_blur_and_grow_by_their_exponent() {
        // With the half millisecond of the pyramid 2, 8 and 32 ms.
        let records = [record("hbao", 1.5), record("hbao", 7.5), record("hbao", 31.5)];
        let entries = [entry(&records[0], 0.25, 8), entry(&records[1], 0.5, 16), entry(&records[2], 1.0, 32)];
        let text = figures(&entries).to_string();
        for cell in ["0.25", "80", "1024", "0.0123", "0.9876", "2.00", "32.00"] {
            assert!(text.contains(cell), "{cell}: {text}");
        }
        let text = growth(&entries);
        assert!(text.contains("hbao: ms ~ R^2.00, samples ~ R^2.00; the paper: quadratic"), "{text}");
        assert!(text.contains("0.58 ms"), "{text}");
    }

    #[test]
    fn one_radius_does_not_grow() {
        let record = record("scalable", 1.0);
        let alone = RecordAtRadius { sampling: None, reach_px: None, ..entry(&record, 1.0, 8) };
        assert_eq!(growth(&[alone]), PUBLISHED);
        assert!(figures(&[alone]).to_string().contains('\u{2013}'), "unknown values are shown as a dash");
    }
}
