//! Where the server's time went, from the reports in a stream.

use std::collections::BTreeMap;

use psao_proto::message::{Report, StageId};

use super::{number, table::Figures};

/// Milliseconds by stage, over the frames that were reported with times; nothing where none was. The first frame, which
/// traces all points that clients get, stands apart.
pub(crate) fn stage_table<'a>(reports: impl Iterator<Item = (bool, &'a Report)>) -> Option<Figures> {
    let mut first = BTreeMap::<StageId, u64>::new();
    let mut later = BTreeMap::<StageId, Vec<u64>>::new();
    let mut sums = Vec::new();
    for (is_first, report) in reports.filter(|(_, report)| !report.stages.is_empty()) {
        for time in &report.stages {
            if is_first {
                first.insert(time.stage, time.micros.into());
            } else {
                later.entry(time.stage).or_default().push(time.micros.into());
            }
        }
        if !is_first {
            sums.push(report.stages.iter().map(|time| u64::from(time.micros)).sum());
        }
    }
    if first.is_empty() && later.is_empty() {
        return None;
    }
    let mut figures = Figures::new(["stage", "first frame, ms", "median, ms", "95 of 100, ms", "most, ms"]);
    let mut row = |name: String, first: Option<u64>, mut micros: Vec<u64>| {
        micros.sort_unstable();
        let at = |share: f64| {
            let place = (share * micros.len().saturating_sub(1) as f64).round() as usize;
            micros.get(place).map_or_else(|| "-".to_owned(), |&micros| number::millis(micros as f64))
        };
        let first = first.map_or_else(|| "-".to_owned(), |micros| number::millis(micros as f64));
        figures.row([name, first, at(0.5), at(0.95), at(1.0)]);
    };
    let mut stages: Vec<StageId> = first.keys().chain(later.keys()).copied().collect();
    stages.sort_unstable();
    stages.dedup();
    for stage in stages {
        row(stage.to_string(), first.get(&stage).copied(), later.remove(&stage).unwrap_or_default());
    }
    let whole = (!first.is_empty()).then(|| first.values().sum());
    row("all".to_owned(), whole, sums);
    Some(figures)
}

#[cfg(test)]
mod tests {
    use psao_proto::message::StageTime;
    use psao_proto::{FrameIndex, Micros};

    use super::*;

    fn report(frame: u32, times: &[(StageId, u64)]) -> Report {
        let stages = times.iter().map(|&(stage, micros)| StageTime::new(stage, Micros(micros))).collect();
        Report { frame: FrameIndex(frame), stages, ..Report::default() }
    }

    #[test]
    fn the_first_frame_stands_apart_and_the_rest_is_sorted() {
        let reports = [
            report(0, &[(StageId::TRACE, 900_000), (StageId::ENCODE, 7_000)]),
            report(1, &[(StageId::TRACE, 3_000), (StageId::ENCODE, 1_000)]),
            report(2, &[(StageId::TRACE, 1_000), (StageId::ENCODE, 1_000)]),
            report(3, &[(StageId::TRACE, 2_000), (StageId::ENCODE, 5_000)]),
            report(4, &[]),
        ];
        let table = stage_table(reports.iter().map(|report| (report.frame.0 == 0, report))).unwrap();
        let text = table.to_string();
        let line = |name: &str| {
            let line = text.lines().find(|line| line.trim_start().starts_with(name)).unwrap();
            line.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
        };
        assert_eq!(line("trace"), ["trace", "900.00", "2.00", "3.00", "3.00"]);
        assert_eq!(line("all"), ["all", "907.00", "4.00", "7.00", "7.00"]);
        assert!(stage_table(std::iter::once((true, &reports[4]))).is_none());
    }
}
