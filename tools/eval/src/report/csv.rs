//! A line for each setting or method.

use std::fmt::Write as _;

use crate::sweep::{Entry, Kind};

const HEADS: &str = "scene,kind,name,label,points_per_m2,bits,rays,threshold,fps,coder,mae,rmse,psnr_db,bias,p99,max,\
within_5,ssim,flip,lpips,paper_mbit_s,wire_mbit_s,first_state_bytes,later_bytes,changed_points,points,frames,server_ms,\
server_ms_low,server_ms_high,first_frame_ms,picture_ms,picture_ms_low,picture_ms_high,picture_bytes,state_bytes,\
largest_frame_bytes,working_bytes,server_bytes,key,radius_m,reach_px,directions,samples_along,levels,samples_per_pixel";

/// All records as comma-separated values with a head line. What a record does not have is empty; so is the PSNR of equal
/// pictures.
#[must_use]
pub fn csv<'a>(entries: impl IntoIterator<Item = Entry<'a>>) -> String {
    let mut out = format!("{HEADS}\n");
    for entry in entries {
        let cells = cells(&entry);
        let cells: Vec<String> = cells.into_iter().map(|cell| quoted(&cell)).collect();
        let _ = writeln!(out, "{}", cells.join(","));
    }
    out
}

fn cells(entry: &Entry<'_>) -> Vec<String> {
    fn some(value: Option<impl ToString>) -> String {
        value.map_or_else(String::new, |value| value.to_string())
    }
    let record = entry.record;
    let (setting, stream, error) = (record.setting.as_ref(), record.stream.as_ref(), &record.error);
    let kind = match record.kind {
        Kind::Stream => "stream",
        Kind::Screen => "screen",
        Kind::Texture => "texture",
    };
    let mut cells = vec![record.scene.clone(), kind.to_owned(), record.name.clone(), record.label.clone()];
    cells.extend([
        some(setting.map(|setting| setting.points_per_m2)),
        some(setting.map(|setting| setting.bits)),
        some(setting.map(|setting| setting.rays)),
        some(setting.map(|setting| setting.threshold)),
        some(setting.map(|setting| setting.fps)),
        some(setting.map(|setting| &setting.coder)),
    ]);
    cells.extend([error.mae, error.rmse].map(|figure| figure.to_string()));
    cells.push(some(error.psnr_db));
    cells.extend([error.bias, error.p99, error.max, error.within_5].map(|figure| figure.to_string()));
    cells.extend([some(error.ssim), error.flip.to_string(), some(error.lpips)]);
    cells.extend([
        some(stream.map(|stream| stream.paper_mbit_s)),
        some(stream.map(|stream| stream.wire_mbit_s)),
        some(stream.map(|stream| stream.first_state_bytes)),
        some(stream.map(|stream| stream.later_bytes)),
        some(stream.map(|stream| stream.changed_points)),
        some(stream.map(|stream| stream.points)),
        some(stream.map(|stream| stream.frames)),
        some(stream.map(|stream| stream.server_ms.median)),
        some(stream.map(|stream| stream.server_ms.low)),
        some(stream.map(|stream| stream.server_ms.high)),
        some(stream.map(|stream| stream.first_frame_ms)),
    ]);
    let spread = &record.picture_ms;
    cells.extend([spread.median, spread.low, spread.high].map(|ms| ms.to_string()));
    let memory = &record.memory;
    cells.extend([
        memory.picture_bytes.to_string(),
        some(memory.state_bytes),
        some(memory.largest_frame_bytes),
        some(memory.working_bytes),
        some(memory.server_bytes),
        record.key.clone(),
        entry.radius_m.to_string(),
        some(entry.reach_px),
    ]);
    let sampling = entry.sampling.as_ref();
    cells.extend([
        some(sampling.and_then(|sampling| sampling.directions)),
        some(sampling.and_then(|sampling| sampling.along)),
        some(sampling.map(|sampling| sampling.levels)),
        some(sampling.map(|sampling| sampling.per_pixel)),
    ]);
    cells
}

/// RFC 4180: in quotes where it must be.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
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
        let entry = |record| Entry { record, radius_m: 0.5, reach_px: Some(40.5), sampling };
        let text = csv(records.iter().map(entry));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[2].contains("\"ssao, 8 steps\""), "{}", lines[2]);
        assert!(lines[2].ends_with(",0.5,40.5,,,3,96"), "{}", lines[2]);
        for (line, record) in lines[1..].iter().zip(&records) {
            // The label holds commas of its own.
            let commas = line.matches(',').count() - record.label.matches(',').count();
            assert_eq!(commas, HEADS.matches(',').count(), "{line}");
        }
    }

    #[test]
    fn quotes_are_doubled() {
        assert_eq!(quoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
    }
}
