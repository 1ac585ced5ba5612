//! The table of far-field obscurance: errors and times of each stage, beside the times that its paper gives.

use psao_eval::sweep::{Record, ReferenceRays};

use crate::output::table::Figures;

/// Milliseconds of the far field alone at 1280 x 720 on a Radeon HD 7970 (Timonen 2013, tables 1 to 4).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Published {
    scan: Option<f64>,
    sum: Option<f64>,
    obscurance: Option<f64>,
    /// Box average, gather and blur.
    separation: Option<f64>,
    all: Option<f64>,
}

impl Published {
    const fn all(ms: f64) -> Self {
        Self { scan: None, sum: None, obscurance: None, separation: None, all: Some(ms) }
    }

    /// By the settings; the paper does not treat slabs midway.
    fn of(record: &Record) -> Self {
        let has = |part: &str| record.label.contains(part);
        if has("midway") {
            return Self::default();
        }
        let found = TIMES.iter().find(|(settings, _)| has(settings));
        found.map_or(Self::default(), |(_, times)| *times)
    }
}

/// By what only their labels contain.
const TIMES: [(&str, Published); 6] = [
    ("K = 8x2, B0 = 20,", Published::all(6.06)),
    (
        "K = 8x2, B0 = 10,",
        Published {
            scan: Some(0.537),
            sum: Some(0.945),
            obscurance: Some(5.77),
            separation: None,
            all: Some(7.26),
        },
    ),
    ("K = 8x2, B0 = 5,", Published::all(8.89)),
    ("K = 16x2, B0 = 10,", Published::all(13.3)),
    (
        "K = 18x2, B0 = 10,",
        Published {
            scan: Some(1.07),
            sum: Some(1.09),
            obscurance: Some(1.60),
            separation: Some(0.265 + 0.591),
            all: Some(4.62),
        },
    ),
    ("K = 16, steps x 1.5,", Published::all(19.2)),
];

/// The table of a scene. The error of a method is against rays through the same depth buffer; its near field is not in
/// the sum of the far field, as in the paper, but for methods that have no stages of their own for it. The radius and
/// falloff, which all have from the reference, are not said again.
pub(super) fn figures(records: Vec<&Record>, truth: &ReferenceRays) -> Figures {
    let common = match truth {
        ReferenceRays::Scene(_) => String::new(),
        ReferenceRays::Screen(rays) => format!(", R = {} m, {}", rays.radius, rays.falloff.label()),
    };
    let mut table = Figures::new([
        "method",
        "e_A",
        "e_<5%",
        "bias",
        "ms: near",
        "scan",
        "sum",
        "obscurance",
        "separation",
        "far",
        "paper, ms: scan",
        "sum",
        "obscurance",
        "separation",
        "far",
    ]);
    let cell = |value: Option<f64>, decimals: usize| {
        value.map_or_else(|| "\u{2013}".to_owned(), |value| format!("{value:.decimals$}"))
    };
    for record in records {
        let error = &record.error;
        let ours = times(record);
        let paper = Published::of(record);
        let ms =
            [ours.near, ours.far.scan, ours.far.sum, ours.far.obscurance, ours.far.separation, ours.far.all];
        let published = [paper.scan, paper.sum, paper.obscurance, paper.separation, paper.all];
        let errors = [
            record.label.replacen(&common, "", 1),
            format!("{:.2} %", error.mae * 100.0),
            format!("{:.1} %", error.within_5 * 100.0),
            format!("{:+.2} %", error.bias * 100.0),
        ];
        let ms = ms.into_iter().map(|value| cell(value, 1));
        table.row(errors.into_iter().chain(ms).chain(published.into_iter().map(|value| cell(value, 2))));
    }
    table
}

/// What stages took here.
struct Times {
    near: Option<f64>,
    far: Published,
}

fn times(record: &Record) -> Times {
    let sum = |names: &[&str]| {
        let stages = record.stages.iter().filter(|stage| names.contains(&stage.name.as_str()));
        stages.map(|stage| stage.ms.median).reduce(|a, b| a + b)
    };
    let near = sum(&["near field"]);
    Times {
        near,
        far: Published {
            scan: sum(&["scan"]),
            sum: sum(&["prefix sum"]),
            obscurance: sum(&["obscurance"]),
            // Without separation, gathering only adds near and far field.
            separation: sum(&["box average"]).and_then(|_| sum(&["box average", "gather", "blur"])),
            all: Some(record.picture_ms.median - near.unwrap_or(0.0)),
        },
    }
}

#[cfg(test)]
mod tests {
    use psao_eval::screen::{Falloff, ScreenRays};
    use psao_eval::sweep::{
        ErrorFigures as Errors, MemoryFigures, RecordKind, Spread, StageTime, far_field_methods,
    };

    use super::*;

    fn record(label: &str, stages: &[(&str, f64)]) -> Record {
        let spread = |median| Spread { median, low: median, high: median, samples: 1 };
        Record {
            key: String::new(),
            scene: "s".to_owned(),
            kind: RecordKind::Screen,
            name: "far-field".to_owned(),
            label: label.to_owned(),
            setting: None,
            error: Errors { mae: 0.0123, within_5: 0.97, bias: -0.004, ..Errors::default() },
            pictures: Vec::new(),
            picture_ms: spread(stages.iter().map(|(_, ms)| ms).sum()),
            stages: stages
                .iter()
                .map(|&(name, ms)| StageTime {
                    side: "client".to_owned(),
                    name: name.to_owned(),
                    ms: spread(ms),
                })
                .collect(),
            stream: None,
            memory: MemoryFigures::default(),
        }
    }

    #[test]
    fn all_that_the_paper_gives_stands_beside_one_method() {
        let methods = far_field_methods(&ScreenRays::far(3.0, Falloff::Linear)).unwrap();
        let found: Vec<Published> =
            methods.iter().map(|method| Published::of(&record(&method.label(), &[]))).collect();
        for (settings, times) in TIMES {
            assert_eq!(found.iter().filter(|found| **found == times).count(), 1, "{settings}");
        }
        assert_eq!(found.iter().filter(|found| **found != Published::default()).count(), TIMES.len());
    }

    #[test]
    fn the_far_field_is_all_but_the_near_one() {
        let stages = [
            ("scan", 1.0),
            ("box average", 2.0),
            ("near field", 30.0),
            ("obscurance", 4.0),
            ("gather", 0.5),
            ("blur", 0.25),
        ];
        let times_of = |stages| times(&record("", stages));
        let found = times_of(&stages);
        let far = Published {
            scan: Some(1.0),
            sum: None,
            obscurance: Some(4.0),
            separation: Some(2.75),
            all: Some(7.75),
        };
        assert_eq!((found.near, found.far), (Some(30.0), far));
        let alone = times_of(&[("obscurance", 4.0), ("gather", 0.5)]);
        assert_eq!(
            (alone.far.separation, alone.far.all),
            (None, Some(4.5)),
            "gathering alone is no separation"
        );
        let truth = ReferenceRays::Screen(ScreenRays::far(3.0, Falloff::Linear));
        let label = "K = 8x2, B0 = 5, R = 3 m, linear falloff, more";
        let text = figures(vec![&record(label, &stages)], &truth).to_string();
        assert!(text.contains("B0 = 5, more "), "what all have in common is not repeated: {text}");
        for cell in ["1.23 %", "97.0 %", "-0.40 %", "30.0", "7.8", "8.89"] {
            assert!(text.contains(cell), "{cell}: {text}");
        }
    }
}
