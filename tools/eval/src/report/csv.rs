//! One line of comma-separated values for each setting or method.

use ::csv::WriterBuilder;

use crate::sweep::{RecordAtRadius, RecordKind, SettingSummary, StreamFigures};

/// A column: its head, and the text of its cell.
type Column = (&'static str, fn(&RecordAtRadius<'_>) -> String);

const COLUMNS: [Column; 48] = [
    ("scene", |entry| entry.record.scene.clone()),
    ("kind", |entry| kind(entry.record.kind).to_owned()),
    ("name", |entry| entry.record.name.clone()),
    ("label", |entry| entry.record.label.clone()),
    ("points_per_m2", |entry| setting(entry, |setting| setting.points_per_m2)),
    ("quality", |entry| setting(entry, |setting| setting.quality)),
    ("bits", |entry| setting(entry, |setting| setting.bits)),
    ("rays", |entry| setting(entry, |setting| setting.rays)),
    ("threshold", |entry| setting(entry, |setting| setting.threshold)),
    ("fps", |entry| setting(entry, |setting| setting.fps)),
    ("coder", |entry| setting(entry, |setting| setting.coder.clone())),
    ("camera_lag_ms", |entry| setting(entry, |setting| setting.camera_lag_ms)),
    ("mae", |entry| entry.record.error.mae.to_string()),
    ("rmse", |entry| entry.record.error.rmse.to_string()),
    ("psnr_db", |entry| some(entry.record.error.psnr_db)),
    ("bias", |entry| entry.record.error.bias.to_string()),
    ("p99", |entry| entry.record.error.p99.to_string()),
    ("max", |entry| entry.record.error.max.to_string()),
    ("within_5", |entry| entry.record.error.within_5.to_string()),
    ("ssim", |entry| some(entry.record.error.ssim)),
    ("flip", |entry| entry.record.error.flip.to_string()),
    ("lpips", |entry| some(entry.record.error.lpips)),
    ("paper_mbit_s", |entry| stream(entry, |stream| stream.paper_mbit_s)),
    ("wire_mbit_s", |entry| stream(entry, |stream| stream.wire_mbit_s)),
    ("first_state_bytes", |entry| stream(entry, |stream| stream.first_state_bytes)),
    ("later_bytes", |entry| stream(entry, |stream| stream.later_bytes)),
    ("changed_points", |entry| stream(entry, |stream| stream.changed_points)),
    ("points", |entry| stream(entry, |stream| stream.points)),
    ("frames", |entry| stream(entry, |stream| stream.frames)),
    ("server_ms", |entry| stream(entry, |stream| stream.server_ms.median)),
    ("server_ms_low", |entry| stream(entry, |stream| stream.server_ms.low)),
    ("server_ms_high", |entry| stream(entry, |stream| stream.server_ms.high)),
    ("first_frame_ms", |entry| stream(entry, |stream| stream.first_frame_ms)),
    ("picture_ms", |entry| entry.record.picture_ms.median.to_string()),
    ("picture_ms_low", |entry| entry.record.picture_ms.low.to_string()),
    ("picture_ms_high", |entry| entry.record.picture_ms.high.to_string()),
    ("picture_bytes", |entry| entry.record.memory.picture_bytes.to_string()),
    ("state_bytes", |entry| some(entry.record.memory.state_bytes)),
    ("largest_frame_bytes", |entry| some(entry.record.memory.largest_frame_bytes)),
    ("working_bytes", |entry| some(entry.record.memory.working_bytes)),
    ("server_bytes", |entry| some(entry.record.memory.server_bytes)),
    ("key", |entry| entry.record.key.clone()),
    ("radius_m", |entry| entry.radius_m.to_string()),
    ("reach_px", |entry| some(entry.reach_px)),
    ("directions", |entry| some(entry.sampling.and_then(|sampling| sampling.directions))),
    ("samples_along", |entry| some(entry.sampling.and_then(|sampling| sampling.along))),
    ("levels", |entry| some(entry.sampling.map(|sampling| sampling.levels))),
    ("samples_per_pixel", |entry| some(entry.sampling.map(|sampling| sampling.per_pixel))),
];

/// Returns all records as comma-separated values (RFC 4180) after a line of column heads.
///
/// The cell of a missing figure is empty. So is that of the PSNR of equal pictures.
#[must_use]
pub fn csv<'a>(entries: impl IntoIterator<Item = RecordAtRadius<'a>>) -> String {
    let mut writer = WriterBuilder::new().from_writer(Vec::new());
    // Writing to memory cannot fail, and every line has a cell for each column.
    let _ = writer.write_record(COLUMNS.map(|(head, _)| head));
    for entry in entries {
        let _ = writer.write_record(COLUMNS.map(|(_, cell)| cell(&entry)));
    }
    let bytes = writer.into_inner().unwrap_or_default();
    String::from_utf8(bytes).unwrap_or_default()
}

const fn kind(kind: RecordKind) -> &'static str {
    match kind {
        RecordKind::Stream => "stream",
        RecordKind::Screen => "screen",
        RecordKind::Texture => "texture",
        RecordKind::Cloud => "cloud",
    }
}

fn setting<T: ToString>(entry: &RecordAtRadius<'_>, figure: fn(&SettingSummary) -> T) -> String {
    some(entry.record.setting.as_ref().map(figure))
}

fn stream<T: ToString>(entry: &RecordAtRadius<'_>, figure: fn(&StreamFigures) -> T) -> String {
    some(entry.record.stream.as_ref().map(figure))
}

fn some(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::super::samples::record;
    use super::*;
    use crate::screen::Sampling;

    #[test]
    fn every_line_has_the_cells_of_the_head() {
        let records = [record("surface", 0.02, 5.0, Some(1.0)), record("ssao", 0.08, 2.0, None)];
        let sampling = Some(Sampling { directions: None, along: None, levels: 3, per_pixel: 96 });
        let entry = |record| RecordAtRadius { record, radius_m: 0.5, reach_px: Some(40.5), sampling };
        let text = csv(records.iter().map(entry));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[2].contains("\"ssao, 8 steps\""), "{}", lines[2]);
        assert!(lines[2].ends_with(",0.5,40.5,,,3,96"), "{}", lines[2]);
        for (line, record) in lines[1..].iter().zip(&records) {
            // The label itself contains commas.
            let commas = line.matches(',').count() - record.label.matches(',').count();
            assert_eq!(commas, COLUMNS.len() - 1, "{line}");
        }
    }

    #[test]
    fn quotes_are_doubled() {
        let mut record = record("ssao", 0.08, 2.0, None);
        record.label = "a \"b\", c".to_owned();
        let text = csv([RecordAtRadius { record: &record, radius_m: 0.5, reach_px: None, sampling: None }]);
        assert!(text.contains(",\"a \"\"b\"\", c\","), "{text}");
    }
}
