//! Reports of a sweep's results: a page that opens offline, a table for spreadsheets, advice in words.

mod advice;
mod csv;
mod front;
mod growth;
mod page;
mod plot;
mod table;

pub use self::advice::{BudgetStep, Cost, best_by_budget};
pub use self::csv::csv;
pub use self::front::pareto_front;
pub use self::growth::power_law_exponent;
pub use self::page::{Page, SceneSection, Thumbnail};
pub use self::table::table;

/// Colours that colour-blind readers can tell apart (Okabe and Ito's palette).
pub const COLOURS: [&str; 8] =
    ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#555555"];

/// Returns text with the special characters of SVG and HTML escaped.
#[must_use]
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod samples {
    //! Sample records for tests.

    use crate::sweep::{
        ErrorFigures, MemoryFigures, Record, RecordKind, SettingSummary, Spread, StreamFigures,
    };

    /// Makes a record with these figures. With Mbit/s it is the record of a stream.
    pub(super) fn record(name: &str, mae: f64, ms: f64, mbit_s: Option<f64>) -> Record {
        let setting = mbit_s.map(|_| SettingSummary {
            profile: name.to_owned(),
            points_per_m2: 512.0,
            quality: 4.0,
            bits: 32,
            rays: 192,
            threshold: 8,
            fps: 60.0,
            coder: "range".to_owned(),
            camera_lag_ms: 0,
        });
        let spread = Spread { median: ms, low: ms, high: ms, samples: 3 };
        Record {
            key: format!("{name} {mae}"),
            scene: "a <scene>".to_owned(),
            kind: if mbit_s.is_some() { RecordKind::Stream } else { RecordKind::Screen },
            name: name.to_owned(),
            label: setting.as_ref().map_or_else(|| format!("{name}, 8 steps"), ToString::to_string),
            setting,
            error: ErrorFigures { mae, flip: mae * 2.0, psnr_db: Some(30.0), ..ErrorFigures::default() },
            pictures: Vec::new(),
            picture_ms: spread,
            stages: Vec::new(),
            stream: mbit_s.map(|mbit_s| StreamFigures {
                frames: 60,
                points: 1_000,
                scene_table_bytes: 100,
                first_state_bytes: 5_000,
                later_bytes: 10_000,
                changed_points: 500,
                paper_mbit_s: mbit_s * 0.9,
                wire_mbit_s: mbit_s,
                first_frame_ms: 100.0,
                server_ms: spread,
            }),
            memory: MemoryFigures::default(),
        }
    }
}
