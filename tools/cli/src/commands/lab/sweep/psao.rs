//! Table 1 and figure 5 of the PSAO paper, and what it published.

use std::cmp::Ordering;

use psao_eval::sweep::Record;

use crate::output::table::Figures;

/// A stream or method: LPIPS, PSNR in dB, FLIP and Mbit/s in each of [`SCENES`].
type Row = (&'static str, [(f64, f64, f64, Option<f64>); 3]);

/// The scenes of the paper.
const SCENES: [&str; 3] = ["Robot Lab", "Space", "Sponza"];

/// Table 1 of the paper: 1920 x 1080, 60 Hz, AO over shaded pictures.
const TABLE_1: [Row; 7] = [
    (
        "SAS-32",
        [
            (0.0087, 31.86, 0.0380, Some(44.05)),
            (0.0090, 25.70, 0.0814, Some(17.0)),
            (0.0053, 32.21, 0.0444, Some(26.68)),
        ],
    ),
    (
        "SAS-8",
        [
            (0.0057, 33.61, 0.0341, Some(50.62)),
            (0.0082, 25.98, 0.0778, Some(26.29)),
            (0.0037, 33.51, 0.0410, Some(43.73)),
        ],
    ),
    (
        "PSAO-512",
        [
            (0.0047, 34.07, 0.0313, Some(25.69)),
            (0.0068, 26.80, 0.0666, Some(4.66)),
            (0.0060, 31.42, 0.0500, Some(7.21)),
        ],
    ),
    (
        "PSAO-1024",
        [
            (0.0034, 35.20, 0.0296, Some(53.81)),
            (0.0056, 27.72, 0.0614, Some(9.30)),
            (0.0046, 32.55, 0.0468, Some(14.03)),
        ],
    ),
    (
        "PSAO-1536",
        [
            (0.0030, 35.61, 0.0289, Some(83.86)),
            (0.0050, 28.16, 0.0591, Some(13.81)),
            (0.0042, 32.79, 0.0456, Some(20.77)),
        ],
    ),
    (
        "PSAO-2048",
        [
            (0.0031, 35.47, 0.0291, Some(113.31)),
            (0.0048, 28.40, 0.0578, Some(18.22)),
            (0.0035, 33.61, 0.0444, Some(27.53)),
        ],
    ),
    ("SSAO", [(0.0081, 31.42, 0.0497, None), (0.0072, 26.96, 0.0876, None), (0.0141, 26.90, 0.0956, None)]),
];

/// Returns the table of a scene. Streams are in order of profile, rate and density.
pub(super) fn figures(mut records: Vec<&Record>) -> Figures {
    let place = |record: &Record| {
        let setting = record.setting.as_ref();
        setting.map(|setting| (setting.profile.clone(), setting.fps, setting.points_per_m2))
    };
    records.sort_by(|a, b| match (place(a), place(b)) {
        (Some(a), Some(b)) => a.partial_cmp(&b).unwrap_or(Ordering::Equal),
        (a, b) => a.is_none().cmp(&b.is_none()),
    });
    let mut table = Figures::new([
        "renderer",
        "Hz",
        "LPIPS",
        "PSNR, dB",
        "FLIP",
        "SSIM",
        "e_A",
        "Mbit/s as the paper counts",
        "Mbit/s, everything",
    ]);
    for record in records {
        let error = &record.error;
        table.row([
            record.setting.as_ref().map_or_else(
                || record.title(),
                |setting| format!("PSAO-{} ({})", setting.points_per_m2, setting.profile),
            ),
            some(record.setting.as_ref().map(|setting| setting.fps.to_string())),
            some(error.lpips.map(|lpips| format!("{lpips:.4}"))),
            some(error.psnr_db.map(|db| format!("{db:.2}"))),
            format!("{:.4}", error.flip),
            some(error.ssim.map(|ssim| format!("{ssim:.4}"))),
            format!("{:.4}", error.mae),
            some(record.stream.map(|stream| format!("{:.3}", stream.paper_mbit_s))),
            some(record.stream.map(|stream| format!("{:.3}", stream.wire_mbit_s))),
        ]);
    }
    table
}

/// Returns table 1 as it was published.
pub(super) fn published() -> String {
    let heads =
        SCENES.map(|scene| [format!("{scene}: LPIPS"), "PSNR, dB".into(), "FLIP".into(), "Mbit/s".into()]);
    let heads: Vec<String> =
        ["published".to_owned()].into_iter().chain(heads.into_iter().flatten()).collect();
    let mut table = Figures::of(&heads);
    for (name, scenes) in TABLE_1 {
        let cells = scenes.map(|(lpips, psnr, flip, mbit_s)| {
            let mbit_s = some(mbit_s.map(|mbit_s| format!("{mbit_s:.2}")));
            [format!("{lpips:.4}"), format!("{psnr:.2}"), format!("{flip:.4}"), mbit_s]
        });
        table.row([name.to_owned()].into_iter().chain(cells.into_iter().flatten()));
    }
    format!(
        "{table}\nThe paper's figures are of other scenes, at 1920x1080, of AO over shaded pictures; ours are of AO alone."
    )
}

/// Formats a figure, or a dash where there is none.
fn some(value: Option<String>) -> String {
    value.unwrap_or_else(|| "\u{2013}".to_owned())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_stream_stands_in_the_papers_columns() {
        let spread = json!({"median": 1.0, "low": 1.0, "high": 1.0, "samples": 1});
        let error = json!({"mae": 0.02, "rmse": 0.05, "psnr_db": 26.02, "bias": 0.0, "p99": 0.2, "max": 0.9,
            "within_5": 0.9, "ssim": null, "flip": 0.06, "lpips": 0.0047});
        let record = json!({
            "key": "k", "scene": "s", "kind": "stream", "name": "paper", "label": "512/m\u{b2}", "error": error,
            "setting": {"profile": "paper", "points_per_m2": 512.0, "bits": 32, "rays": 192, "threshold": 8,
                "fps": 15.0, "coder": "zstd:15"},
            "pictures": [], "picture_ms": spread, "stages": [],
            "stream": {"frames": 15, "points": 9, "scene_table_bytes": 1, "first_state_bytes": 2, "later_bytes": 3,
                "changed_points": 4, "paper_mbit_s": 25.69, "wire_mbit_s": 26.0, "first_frame_ms": 1.0,
                "server_ms": spread},
            "memory": {"picture_bytes": 1, "state_bytes": 2, "largest_frame_bytes": 3, "working_bytes": null},
        });
        let record: Record = serde_json::from_value(record).unwrap();
        let text = figures(vec![&record]).to_string();
        for cell in ["PSAO-512 (paper)", "15", "0.0047", "26.02", "0.0600", "25.690"] {
            assert!(text.contains(cell), "{cell}: {text}");
        }
        let mut sparse = record.clone();
        sparse.setting.as_mut().unwrap().points_per_m2 = 64.0;
        let text = figures(vec![&record, &sparse]).to_string();
        assert!(text.find("PSAO-64").unwrap() < text.find("PSAO-512").unwrap(), "by density: {text}");
    }

    #[test]
    fn what_was_published_stands_by_scene() {
        let text = published();
        let line = text.lines().find(|line| line.contains("PSAO-2048")).unwrap();
        let cells: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(cells[1..5], ["0.0031", "35.47", "0.0291", "113.31"], "{text}");
        assert_eq!(cells[9..13], ["0.0035", "33.61", "0.0444", "27.53"], "{text}");
    }
}
