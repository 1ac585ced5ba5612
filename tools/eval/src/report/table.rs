//! Tables of records, as text.

use crate::sweep::Record;

/// A column: its head, its text for a record, and whether only wide tables have it.
struct Column {
    head: &'static str,
    of: fn(&Record) -> Option<String>,
    page: bool,
}

const fn column(head: &'static str, of: fn(&Record) -> Option<String>) -> Column {
    Column { head, of, page: false }
}

const fn page(head: &'static str, of: fn(&Record) -> Option<String>) -> Column {
    Column { head, of, page: true }
}

const COLUMNS: [Column; 22] = [
    column("e_A", |r| Some(format!("{:.4}", r.error.mae))),
    page("RMSE", |r| Some(format!("{:.4}", r.error.rmse))),
    column("PSNR, dB", |r| r.error.psnr_db.map(|db| format!("{db:.2}"))),
    column("SSIM", |r| r.error.ssim.map(|ssim| format!("{ssim:.4}"))),
    column("FLIP", |r| Some(format!("{:.4}", r.error.flip))),
    column("LPIPS", |r| r.error.lpips.map(|lpips| format!("{lpips:.4}"))),
    column("e_<5%", |r| Some(format!("{:.1} %", r.error.within_5 * 100.0))),
    page("bias", |r| Some(format!("{:+.4}", r.error.bias))),
    page("P99", |r| Some(format!("{:.3}", r.error.p99))),
    page("largest", |r| Some(format!("{:.3}", r.error.max))),
    column("Mbit/s", |r| r.stream.map(|s| format!("{:.3}", s.wire_mbit_s))),
    page("Mbit/s as the paper counts", |r| r.stream.map(|s| format!("{:.3}", s.paper_mbit_s))),
    column("first state, kB", |r| r.stream.map(|s| format!("{:.1}", s.first_state_bytes as f64 / 1e3))),
    column("server, ms", |r| r.stream.map(|s| ms(s.server_ms.median))),
    page("encode, ms", |r| stage(r, "encode")),
    page("apply, ms", |r| stage(r, "apply")),
    page("reconstruct, ms", |r| stage(r, "reconstruct")),
    column("picture, ms", |r| Some(ms(r.picture_ms.median))),
    page("quartiles, ms", |r| Some(format!("{}\u{2013}{}", ms(r.picture_ms.low), ms(r.picture_ms.high)))),
    page("state, kB", |r| r.memory.state_bytes.map(|bytes| format!("{:.0}", bytes as f64 / 1e3))),
    page("server, MB", |r| r.memory.server_bytes.map(|bytes| format!("{:.1}", bytes as f64 / 1e6))),
    page("buffers, MB", |r| {
        let bytes = r.memory.picture_bytes + r.memory.working_bytes.unwrap_or(0);
        Some(format!("{:.1}", bytes as f64 / 1e6))
    }),
];

/// Returns the heads and the rows of a table, one row a record: number from 1, name, settings, figures.
///
/// Empty columns are left out. A `wide` table has all other columns, as on a page.
#[must_use]
pub fn table(records: &[&Record], wide: bool) -> (Vec<String>, Vec<Vec<String>>) {
    let used = COLUMNS.iter().filter(|column| wide || !column.page);
    let used = used.filter(|column| records.iter().any(|record| (column.of)(record).is_some()));
    let used: Vec<&Column> = used.collect();
    let heads = ["#", "what", "setting"].into_iter().chain(used.iter().map(|column| column.head));
    let row = |(number, record): (usize, &&Record)| {
        let first = [number.to_string(), record.name.clone(), record.label.clone()];
        let rest = used.iter().map(|column| (column.of)(record).unwrap_or_else(|| "\u{2013}".to_owned()));
        first.into_iter().chain(rest).collect()
    };
    (heads.map(str::to_owned).collect(), (1..).zip(records).map(row).collect())
}

/// Formats milliseconds with three significant figures.
pub(super) fn ms(value: f64) -> String {
    let decimals = match value {
        v if v < 10.0 => 2,
        v if v < 100.0 => 1,
        _ => 0,
    };
    format!("{value:.decimals$}")
}

fn stage(record: &Record, name: &str) -> Option<String> {
    record.stages.iter().find(|stage| stage.name == name).map(|stage| ms(stage.ms.median))
}

#[cfg(test)]
mod tests {
    use super::super::samples::record;
    use super::*;

    #[test]
    fn columns_that_say_nothing_are_left_out() {
        let records = [record("surface", 0.02, 5.0, Some(1.0)), record("ssao", 0.08, 123.4, None)];
        let (heads, rows) = table(&records.iter().collect::<Vec<_>>(), false);
        let at = |head: &str| heads.iter().position(|found| found == head);
        assert_eq!(at("LPIPS"), None);
        assert!(rows.iter().all(|row| row.len() == heads.len()));
        let mbit_s = at("Mbit/s").unwrap();
        assert_eq!((rows[0][mbit_s].as_str(), rows[1][mbit_s].as_str()), ("1.000", "\u{2013}"));
        assert_eq!(rows[1][at("picture, ms").unwrap()], "123");
        let (alone, _) = table(&[&records[1]], true);
        assert!(!alone.iter().any(|head| head.starts_with("Mbit/s")) && alone.contains(&"P99".to_owned()));
    }
}
