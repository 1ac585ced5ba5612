//! Tables and figures of papers: what they sweep, and what they show.

use std::cmp::Ordering;

use clap::ValueEnum;
use psao_eval::sweep::{Record, TEXTURE_SPACE, Truth};

use super::{AxisArgs, far_field};
use crate::args::Coder;
use crate::output::table::Figures;

/// `--table`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum TableArg {
    /// Table 1 of the PSAO paper: three densities at 60 Hz, texture space, and screen-space methods
    PsaoTable1,
    /// Figure 5 of the PSAO paper: three densities and texture space at 5, 15, 30 and 60 Hz
    PsaoFig5,
    /// Timonen 2013, figure 7 and tables 1 to 4: far-field obscurance against rays through the depth buffer
    FarField,
    /// Astapov et al. 2021: pyramid HBAO and what it is compared with
    PyramidHbao,
}

impl TableArg {
    /// What is swept unless it is given.
    pub(super) fn axes(self) -> AxisArgs {
        let fps = if self == Self::PsaoFig5 { vec![5.0, 15.0, 30.0, 60.0] } else { vec![60.0] };
        AxisArgs {
            bits: vec![32],
            threshold: vec![8],
            rays: vec![192],
            coder: vec![Coder::RANGE],
            fps,
            ..AxisArgs::usual()
        }
    }

    /// Whether streams are part of it.
    pub(super) fn has_streams(self) -> bool {
        matches!(self, Self::PsaoTable1 | Self::PsaoFig5)
    }

    /// Names of the methods that are compared unless they are given; `None` for all there are.
    pub(super) fn methods(self) -> Option<&'static [&'static str]> {
        match self {
            Self::PsaoTable1 => Some(&[TEXTURE_SPACE, "ssao", "ssao-plus", "hbao"]),
            Self::PsaoFig5 => Some(&[TEXTURE_SPACE]),
            Self::FarField => None,
            Self::PyramidHbao => Some(&["pyramid-hbao", "hbao", "ssao"]),
        }
    }

    /// The table of a scene, in the paper's columns. Streams stand by profile, rate and density.
    pub(super) fn figures(self, records: &[&Record], truth: &Truth) -> Figures {
        let place = |record: &Record| {
            let setting = record.setting.as_ref();
            setting.map(|setting| (setting.profile.clone(), setting.fps, setting.points_per_m2))
        };
        let mut records = records.to_vec();
        records.sort_by(|a, b| match (place(a), place(b)) {
            (Some(a), Some(b)) => a.partial_cmp(&b).unwrap_or(Ordering::Equal),
            (a, b) => a.is_none().cmp(&b.is_none()),
        });
        let mut table = match self {
            Self::FarField => return far_field::figures(&records, truth),
            Self::PsaoTable1 | Self::PsaoFig5 => {
                Figures::new(["renderer", "Hz", "LPIPS", "PSNR, dB", "FLIP", "Mbit/s as the paper counts"])
            }
            Self::PyramidHbao => Figures::new(["method", "e_A", "e_<5%", "PSNR, dB", "SSIM", "ms"]),
        };
        let some = |value: Option<String>| value.unwrap_or_else(|| "\u{2013}".to_owned());
        for record in records {
            let error = &record.error;
            let psnr = some(error.psnr_db.map(|db| format!("{db:.2}")));
            table.row(if self.has_streams() {
                [
                    record.setting.as_ref().map_or_else(
                        || record.title(),
                        |setting| format!("PSAO-{} ({})", setting.points_per_m2, setting.profile),
                    ),
                    some(record.setting.as_ref().map(|setting| setting.fps.to_string())),
                    some(error.lpips.map(|lpips| format!("{lpips:.4}"))),
                    psnr,
                    format!("{:.4}", error.flip),
                    some(record.stream.map(|stream| format!("{:.3}", stream.paper_mbit_s))),
                ]
            } else {
                [
                    record.title(),
                    format!("{:.4}", error.mae),
                    format!("{:.1} %", error.within_5 * 100.0),
                    psnr,
                    some(error.ssim.map(|ssim| format!("{ssim:.4}"))),
                    format!("{:.2}", record.picture_ms.median),
                ]
            });
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use psao_server_sim::ao::AoSettings;
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
        let truth = Truth::Scene(AoSettings::default());
        let table = |which: TableArg, records: &[&Record]| which.figures(records, &truth).to_string();
        let text = table(TableArg::PsaoFig5, &[&record]);
        for cell in ["PSAO-512 (paper)", "15", "0.0047", "26.02", "0.0600", "25.690"] {
            assert!(text.contains(cell), "{cell}: {text}");
        }
        let text = table(TableArg::PyramidHbao, &[&record]);
        assert!(text.contains("90.0 %") && text.contains("paper: 512/m\u{b2}"), "{text}");
        let mut sparse = record.clone();
        sparse.setting.as_mut().unwrap().points_per_m2 = 64.0;
        let text = table(TableArg::PsaoTable1, &[&record, &sparse]);
        assert!(text.find("PSAO-64").unwrap() < text.find("PSAO-512").unwrap(), "by density: {text}");
    }
}
