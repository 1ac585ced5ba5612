//! Where every byte of a recording went, for `inspect` and `demo`.
//!
//! Each byte of the file is counted once: in a part of a frame, or in a part of the overhead. What the readers skip
//! (damage) is overhead too, so the sums hold for any file.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use psao_codec::envelope::{FrameInfo, FrameKind, SectionTag};
use psao_proto::message::{Budget, Gap, Message, Report, Scene, SceneHeader};
use psao_proto::recording::{Damage, FILE_HEADER_BYTES, FOOTER_BYTES, RECORD_HEAD_BYTES, Reader, Record};
use psao_proto::{FrameType, HEADER_BYTES, Limits, Profile};

use crate::budget::BudgetTotals;
use crate::error::{Failure, Outcome};
use crate::output::number;

/// Parts of a frame on the wire, in the order in which tables and plots show them.
pub(crate) const PARTS: [&str; 13] = [
    "cells", "buckets", "poses", "geometry", "values", "changes", "context", "patch", "header", "envelope",
    "report", "budget", "other",
];
/// The parts that are blocks of a frame body.
pub(crate) const BLOCKS: Range<usize> = 0..HEADER;
const CELLS: usize = 0;
const BUCKETS: usize = 1;
const POSES: usize = 2;
const GEOMETRY: usize = 3;
const VALUES: usize = 4;
const CHANGES: usize = 5;
const CONTEXT: usize = 6;
const PATCH: usize = 7;
const HEADER: usize = 8;
const ENVELOPE: usize = 9;
const REPORT: usize = 10;
const BUDGET: usize = 11;
const OTHER: usize = 12;
/// The parts that the paper counts, and what does their work in profile `surface`: blocks that hold points.
const POINTS: [usize; 7] = [CELLS, BUCKETS, GEOMETRY, VALUES, CHANGES, CONTEXT, PATCH];

/// Parts of a recording that belong to no frame.
pub(crate) const OVERHEAD: [&str; 8] =
    ["file_header", "arrival_times", "scene", "index", "close", "other_frames", "damaged", "parity"];
const FILE_HEADER: usize = 0;
const ARRIVAL_TIMES: usize = 1;
const SCENE: usize = 2;
const INDEX: usize = 3;
const CLOSE: usize = 4;
const OTHER_FRAMES: usize = 5;
const DAMAGED: usize = 6;
const PARITY: usize = 7;

/// One keyframe or update, and what belongs to it.
#[derive(Clone, Debug)]
pub(crate) struct FrameLine {
    pub(crate) frame: u32,
    pub(crate) time_s: f64,
    pub(crate) key: bool,
    pub(crate) group: u32,
    pub(crate) sequence: u32,
    pub(crate) changed_points: u32,
    pub(crate) hash: u64,
    /// Bytes by part, in the order of [`PARTS`].
    pub(crate) parts: [u64; PARTS.len()],
    pub(crate) report: Option<Report>,
    pub(crate) budget: Option<Budget>,
}

impl FrameLine {
    /// Returns the bytes of the frame on the wire, all parts together.
    pub(crate) fn wire_bytes(&self) -> u64 {
        self.parts.iter().sum()
    }

    /// Returns the bytes that the paper counts, see [`paper_bytes`].
    pub(crate) fn paper_bytes(&self) -> u64 {
        paper_bytes(&self.parts)
    }
}

/// What is in a recording.
#[derive(Clone, Debug)]
pub(crate) struct Analysis {
    pub(crate) file_bytes: u64,
    pub(crate) stream: Option<SceneHeader>,
    pub(crate) frames: Vec<FrameLine>,
    /// Bytes by part, in the order of [`OVERHEAD`].
    pub(crate) overhead: [u64; OVERHEAD.len()],
    pub(crate) damages: Vec<Damage>,
    /// What the recorder says that it left out.
    pub(crate) gaps: Vec<Gap>,
    /// Keyframes and updates whose body could not be read although the record was whole.
    pub(crate) unreadable: Vec<String>,
}

/// Totals over the frames after the first state, and over everything.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Totals {
    /// Wire bytes of the first frame.
    pub(crate) first_state: u64,
    /// Frames after it.
    pub(crate) later_frames: u64,
    /// Seconds of stream time that those frames cover.
    pub(crate) seconds: f64,
    pub(crate) changed_points: u64,
    /// Wire bytes by part of the frames after the first.
    pub(crate) parts: [u64; PARTS.len()],
    /// Mbit/s after the first state of what the paper counts, see [`paper_bytes`].
    pub(crate) paper_mbit_s: f64,
    /// Mbit/s of every wire byte after the first state.
    pub(crate) wire_mbit_s: f64,
    /// Mbit/s of the whole file, first state and overhead included.
    pub(crate) file_mbit_s: f64,
    /// Wire bits for each point that was sent after the first state; zero when none was.
    pub(crate) bits_per_changed_point: f64,
}

/// Returns the bytes that the paper counts: the compressed cells and buckets, or the blocks that hold points in profile `surface`.
pub(crate) fn paper_bytes(parts: &[u64; PARTS.len()]) -> u64 {
    POINTS.iter().map(|&part| parts[part]).sum()
}

/// Returns the wire bytes of a frame by part, in the order of [`PARTS`].
pub(crate) fn parts_of(info: &FrameInfo) -> [u64; PARTS.len()] {
    let mut parts = [0; PARTS.len()];
    parts[ENVELOPE] = HEADER_BYTES as u64;
    parts[HEADER] = u64::from(info.header_bytes);
    for section in &info.sections {
        let part = match section.tag {
            SectionTag::CELLS => CELLS,
            SectionTag::BUCKETS => BUCKETS,
            SectionTag::POSES => POSES,
            SectionTag::GEOMETRY => GEOMETRY,
            SectionTag::VALUES => VALUES,
            SectionTag::CHANGES => CHANGES,
            SectionTag::CONTEXT => CONTEXT,
            SectionTag::PATCH => PATCH,
            _ => OTHER,
        };
        parts[part] += u64::from(section.wire_bytes);
    }
    parts
}

impl Analysis {
    /// Counts the bytes of a recording.
    pub(crate) fn of(path: &Path, bytes: &[u8]) -> Outcome<Self> {
        let reader = Reader::new(bytes)
            .map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))?;
        let mut analysis = Self {
            file_bytes: bytes.len() as u64,
            stream: None,
            frames: Vec::new(),
            overhead: [0; OVERHEAD.len()],
            damages: Vec::new(),
            gaps: Vec::new(),
            unreadable: Vec::new(),
        };
        let mut by_number = BTreeMap::new();
        for item in reader {
            match item {
                Ok(record) => analysis.record(&record, &mut by_number),
                Err(damage) => {
                    analysis.overhead[DAMAGED] += damage.lost_bytes;
                    analysis.damages.push(damage);
                }
            }
        }
        analysis.close_the_books();
        Ok(analysis)
    }

    fn record(&mut self, record: &Record<'_>, by_number: &mut BTreeMap<u32, usize>) {
        self.overhead[ARRIVAL_TIMES] += RECORD_HEAD_BYTES as u64;
        let wire = record.wire_bytes();
        let payload = record.frame.payload();
        match record.frame.header.kind {
            FrameType::KEYFRAME | FrameType::UPDATE => {
                match psao_codec::envelope::inspect(payload, &Limits::default().codec) {
                    Ok(info) => {
                        by_number.insert(info.frame.0, self.frames.len());
                        self.frames.push(line(record, &info));
                    }
                    Err(error) => {
                        self.overhead[OTHER_FRAMES] += wire;
                        self.unreadable.push(format!("record at offset {}: {error}", record.offset()));
                    }
                }
            }
            FrameType::REPORT => {
                let report = Report::from_payload(payload).ok();
                let index = report.as_ref().and_then(|report| by_number.get(&report.frame.0));
                match index.and_then(|&index| self.frames.get_mut(index)) {
                    Some(line) => {
                        line.parts[REPORT] += wire;
                        line.report = report;
                    }
                    None => self.overhead[OTHER_FRAMES] += wire,
                }
            }
            FrameType::BUDGET => {
                let budget = Budget::from_payload(payload).ok();
                let index = budget.as_ref().and_then(|budget| by_number.get(&budget.frame.0));
                match index.and_then(|&index| self.frames.get_mut(index)) {
                    Some(line) => {
                        line.parts[BUDGET] += wire;
                        line.budget = budget;
                    }
                    None => self.overhead[OTHER_FRAMES] += wire,
                }
            }
            FrameType::SCENE => {
                self.overhead[SCENE] += wire;
                if let Ok(Scene::Info(info)) = Scene::from_payload(payload) {
                    self.stream.get_or_insert(info);
                }
            }
            FrameType::INDEX => self.overhead[INDEX] += wire,
            FrameType::PARITY => self.overhead[PARITY] += wire,
            FrameType::CLOSE => self.overhead[CLOSE] += wire,
            FrameType::GAP => {
                self.overhead[OTHER_FRAMES] += wire;
                self.gaps.extend(Gap::from_payload(payload).ok());
            }
            _ => self.overhead[OTHER_FRAMES] += wire,
        }
    }

    /// Counts what the reader does not return: the file header and the footer.
    fn close_the_books(&mut self) {
        let counted =
            self.overhead.iter().sum::<u64>() + self.frames.iter().map(FrameLine::wire_bytes).sum::<u64>();
        let mut rest = self.file_bytes.saturating_sub(counted);
        let header = rest.min(FILE_HEADER_BYTES as u64);
        self.overhead[FILE_HEADER] += header;
        rest -= header;
        let footer = rest.min(FOOTER_BYTES as u64);
        self.overhead[INDEX] += footer;
        self.overhead[DAMAGED] += rest - footer;
    }

    /// Returns the bytes of the file that belong to no frame.
    pub(crate) fn overhead_bytes(&self) -> u64 {
        self.overhead.iter().sum()
    }

    /// Returns whether everything in the file could be read.
    pub(crate) fn is_whole(&self) -> bool {
        self.damages.is_empty() && self.unreadable.is_empty()
    }

    /// Returns whether the file says that the stream is of profile `paper`.
    pub(crate) fn is_paper(&self) -> bool {
        self.stream.as_ref().is_some_and(|info| info.profile == Profile::PAPER)
    }

    /// Returns the frames per second: the stream's own, or the rate of the frames' times.
    pub(crate) fn fps(&self) -> f64 {
        match (&self.stream, self.frames.first(), self.frames.last()) {
            (Some(info), ..) => f64::from(info.fps),
            (None, Some(first), Some(last)) if last.time_s > first.time_s => {
                (self.frames.len() - 1) as f64 / (last.time_s - first.time_s)
            }
            _ => 60.0,
        }
    }

    /// Returns the seconds of stream time from the first frame to the last. A step back, as between joined recordings,
    /// counts as one frame.
    fn seconds(&self) -> f64 {
        let step = |pair: &[FrameLine]| {
            let step = pair[1].time_s - pair[0].time_s;
            if step > 0.0 { step } else { 1.0 / self.fps() }
        };
        self.frames.windows(2).map(step).sum()
    }

    /// Returns the seconds that the frames are shown, the last for one frame.
    pub(crate) fn duration_s(&self) -> f64 {
        if self.frames.is_empty() { 0.0 } else { self.seconds() + 1.0 / self.fps() }
    }

    /// Returns the totals. The first frame is the first state, which the paper does not count.
    pub(crate) fn totals(&self) -> Totals {
        let Some((first, later)) = self.frames.split_first() else {
            return Totals::default();
        };
        let mut totals = Totals {
            first_state: first.wire_bytes(),
            later_frames: later.len() as u64,
            seconds: self.seconds(),
            changed_points: later.iter().map(|line| u64::from(line.changed_points)).sum(),
            ..Totals::default()
        };
        for line in later {
            for (total, bytes) in totals.parts.iter_mut().zip(line.parts) {
                *total += bytes;
            }
        }
        let wire: u64 = totals.parts.iter().sum();
        let paper = later.iter().map(FrameLine::paper_bytes).sum();
        totals.paper_mbit_s = number::megabits(paper, totals.seconds);
        totals.wire_mbit_s = number::megabits(wire, totals.seconds);
        totals.file_mbit_s = number::megabits(self.file_bytes, self.duration_s());
        if totals.changed_points > 0 {
            totals.bits_per_changed_point = wire as f64 * 8.0 / totals.changed_points as f64;
        }
        totals
    }

    /// Returns what the server did with its byte budget; `None` where no frame had one.
    pub(crate) fn budgets(&self) -> Option<BudgetTotals> {
        let mut totals = BudgetTotals::default();
        self.frames.iter().filter_map(|line| line.budget.as_ref()).for_each(|budget| totals.add(budget));
        (totals.frames > 0).then_some(totals)
    }

    /// Returns the newest report that says how the tables are filled.
    pub(crate) fn last_report(&self) -> Option<&Report> {
        self.frames.iter().rev().find_map(|line| line.report.as_ref())
    }
}

fn line(record: &Record<'_>, info: &FrameInfo) -> FrameLine {
    FrameLine {
        frame: info.frame.0,
        time_s: info.time.0 as f64 / 1e6,
        key: info.kind == FrameKind::Key,
        group: record.frame.header.group.0,
        sequence: record.frame.header.sequence.0,
        changed_points: info.changed_points,
        hash: info.hash.0,
        parts: parts_of(info),
        report: None,
        budget: None,
    }
}
