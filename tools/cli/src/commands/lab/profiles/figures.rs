//! The figures of a comparison, as tables and as JSON.

use psao_codec::surface::BitBreakdown;
use psao_proto::message::SceneHeader;
use psao_server::server::{AoErrorStats, PerProfile};
use serde::Serialize;

use super::Args;
use super::measure::{Line, Seen, Side};
use crate::analysis::{PARTS, paper_bytes};
use crate::context::say;
use crate::error::Outcome;
use crate::output::number;
use crate::output::table::Figures;

/// Everything that was measured; `docs/compare-json.md` describes the fields.
#[derive(Serialize)]
pub(super) struct Document {
    schema: &'static str,
    scene: String,
    digest: String,
    frames: u32,
    fps: f32,
    instances: u32,
    point_sets: u32,
    points: u32,
    points_per_m2: f32,
    min_points: u32,
    bits: u8,
    geometry: String,
    rays: u32,
    radius_m: f32,
    threshold: u8,
    seed: u64,
    all_visible: bool,
    paper: Figured,
    surface: Figured,
    paper_over_surface: Ratios,
}

/// The figures of one profile.
#[derive(Serialize)]
struct Figured {
    coder: String,
    scene_table_bytes: u64,
    first_state_bytes: u64,
    first_state_bits_per_point: f64,
    first_state_parts: Parts,
    /// Null unless frame 0 is among the pictures.
    first_picture_bytes: Option<u64>,
    later_frames: u64,
    later_seconds: f64,
    later_parts: Parts,
    join_keyframe_bytes: u64,
    changed_points: u64,
    bits_per_changed_point: f64,
    idle_frames: u64,
    paper_mbit_s: f64,
    wire_mbit_s: f64,
    session_mbit_s: f64,
    first_encode_ms: f64,
    first_decode_ms: f64,
    encode_ms: MeanDeviation,
    decode_ms: MeanDeviation,
    changes_spent: Option<SpentOut>,
    error: Error,
    pictures: Vec<PictureOut>,
}

/// How many times as much the paper's profile takes.
#[derive(Serialize)]
struct Ratios {
    paper_mbit_s: Option<f64>,
    wire_mbit_s: Option<f64>,
    session_mbit_s: Option<f64>,
    first_state_bytes: Option<f64>,
    first_picture_bytes: Option<f64>,
    join_keyframe_bytes: Option<f64>,
    changed_points: Option<f64>,
}

#[derive(Serialize)]
struct MeanDeviation {
    mean: f64,
    deviation: f64,
    max: f64,
}

/// Bytes of range-coded changes by what they say.
#[derive(Serialize)]
struct SpentOut {
    which_blocks: f64,
    which_points: f64,
    darker_or_lighter: f64,
    how_much: f64,
}

#[derive(Serialize)]
struct Error {
    points: u64,
    lost: u64,
    mean: f64,
    rms: f64,
    max: f64,
}

#[derive(Serialize)]
struct PictureOut {
    frame: u32,
    /// Null where the picture equals its reference.
    psnr_db: Option<f64>,
    mean_error: f64,
    p99: f64,
    unsupported: f64,
}

/// Wire bytes by part.
struct Parts([u64; PARTS.len()]);

impl Serialize for Parts {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(PARTS.iter().zip(&self.0).filter(|(_, bytes)| **bytes > 0))
    }
}

impl Document {
    pub(super) fn new(args: &Args, info: &SceneHeader, sides: &PerProfile<Side>) -> Self {
        let coder = |coder: &crate::args::Coder| coder.0.id().to_string();
        let paper = Figured::new(coder(&args.paper_compress), info, &sides.paper);
        let surface = Figured::new(coder(&args.surface_compress), info, &sides.surface);
        Self {
            schema: "psao-compare-profiles/1",
            scene: info.name.to_string(),
            digest: info.digest.iter().map(|byte| format!("{byte:02x}")).collect(),
            frames: args.frames,
            fps: info.fps,
            instances: info.instance_count,
            point_sets: info.set_count,
            points: info.point_count,
            points_per_m2: info.points_per_m2,
            min_points: info.min_points,
            bits: info.point_bits,
            geometry: info.geometry.to_string(),
            rays: info.rays,
            radius_m: info.radius_m,
            threshold: info.threshold,
            seed: info.seed,
            all_visible: args.points.all_visible,
            paper_over_surface: Ratios::new(&paper, &surface),
            paper,
            surface,
        }
    }

    /// Prints the tables.
    pub(super) fn print(&self) -> Outcome {
        say(format_args!(
            "{}: {} points of {} sets in {} instances, {} bit, {} rays of {} m, threshold {}/255, {} frames at {} Hz",
            self.scene,
            number::count(u64::from(self.points)),
            number::count(u64::from(self.point_sets)),
            number::count(u64::from(self.instances)),
            self.bits,
            self.rays,
            self.radius_m,
            self.threshold,
            self.frames,
            self.fps,
        ))?;
        say(self.part_table())?;
        say(self.figure_table())?;
        if let Some(spent) = &self.surface.changes_spent {
            say(spent.text())?;
        }
        if !self.paper.pictures.is_empty() {
            say(self.picture_table())?;
        }
        Ok(())
    }

    fn part_table(&self) -> Figures {
        let mut table = Figures::new([
            "part",
            "paper, first state",
            "paper, bytes a frame",
            "surface, first state",
            "surface, bytes a frame",
        ]);
        let sides = [&self.paper, &self.surface];
        let row = |name: &str, bytes: [(u64, u64); 2]| {
            let cells = bytes.into_iter().zip(sides).flat_map(|((first, later), side)| {
                let mean = later as f64 / side.later_frames.max(1) as f64;
                [number::bytes(first), format!("{mean:.1}")]
            });
            std::iter::once(name.to_owned()).chain(cells).collect::<Vec<_>>()
        };
        for (part, name) in PARTS.iter().enumerate() {
            let bytes = sides.map(|side| (side.first_state_parts.0[part], side.later_parts.0[part]));
            if bytes.iter().any(|(first, later)| first + later > 0) {
                table.row(row(name, bytes));
            }
        }
        table.row(row("all", sides.map(|side| (side.first_state_bytes, side.later_parts.0.iter().sum()))));
        table
    }

    fn figure_table(&self) -> Figures {
        let mut table =
            Figures::new(["after the first state unless said", "paper", "surface", "paper / surface"]);
        let mut row = |name: &str, of: &dyn Fn(&Figured) -> String, ratio: Option<f64>| {
            let ratio = ratio.map_or_else(String::new, |ratio| format!("{ratio:.2}"));
            table.row([name.to_owned(), of(&self.paper), of(&self.surface), ratio]);
        };
        let ratios = &self.paper_over_surface;
        row("Mbit/s as the paper counts", &|side| format!("{:.3}", side.paper_mbit_s), ratios.paper_mbit_s);
        row("Mbit/s, everything", &|side| format!("{:.3}", side.wire_mbit_s), ratios.wire_mbit_s);
        row(
            "Mbit/s from the scene table and first state on",
            &|side| format!("{:.3}", side.session_mbit_s),
            ratios.session_mbit_s,
        );
        row(
            "first state, bits a point",
            &|side| format!("{:.2}", side.first_state_bits_per_point),
            ratios.first_state_bytes,
        );
        if self.surface.first_picture_bytes.is_some() {
            let bytes = |side: &Figured| number::bytes(side.first_picture_bytes.unwrap_or(0));
            row("first state until the first picture is whole", &bytes, ratios.first_picture_bytes);
        }
        row(
            "keyframe to join after the last frame",
            &|side| number::bytes(side.join_keyframe_bytes),
            ratios.join_keyframe_bytes,
        );
        let per_frame = |side: &Figured| side.changed_points as f64 / side.later_frames.max(1) as f64;
        row("points sent a frame", &|side| format!("{:.1}", per_frame(side)), ratios.changed_points);
        row("bits a point sent, everything", &|side| format!("{:.2}", side.bits_per_changed_point), None);
        row("frames that send no point", &|side| number::count(side.idle_frames), None);
        row("encode, ms", &|side| side.encode_ms.text(), None);
        row("decode, ms", &|side| side.decode_ms.text(), None);
        row("encode of the first state, ms", &|side| format!("{:.2}", side.first_encode_ms), None);
        row("decode of the first state, ms", &|side| format!("{:.2}", side.first_decode_ms), None);
        row("error in 255ths: mean", &|side| format!("{:.3}", side.error.mean), None);
        row("error in 255ths: root of mean square", &|side| format!("{:.3}", side.error.rms), None);
        row("error in 255ths: largest", &|side| format!("{:.3}", side.error.max), None);
        row("points in view that the client lacks", &|side| side.error.lost_share(), None);
        table
    }

    fn picture_table(&self) -> Figures {
        let mut table = Figures::new([
            "picture",
            "PSNR, paper",
            "PSNR, surface",
            "mean error, paper",
            "mean error, surface",
            "no point near, paper",
            "no point near, surface",
        ]);
        let psnr = |seen: &PictureOut| number::decibels(seen.psnr_db);
        for (paper, surface) in self.paper.pictures.iter().zip(&self.surface.pictures) {
            table.row([
                format!("frame {}", paper.frame),
                psnr(paper),
                psnr(surface),
                format!("{:.5}", paper.mean_error),
                format!("{:.5}", surface.mean_error),
                format!("{:.3} %", paper.unsupported * 100.0),
                format!("{:.3} %", surface.unsupported * 100.0),
            ]);
        }
        table
    }
}

impl Figured {
    fn new(coder: String, info: &SceneHeader, side: &Side) -> Self {
        let (first, later) = side.frames.split_at(side.frames.len().min(1));
        let sum = |lines: &[Line]| {
            let parts = |part| lines.iter().map(|line: &Line| line.parts[part]).sum();
            std::array::from_fn::<u64, { PARTS.len() }, _>(parts)
        };
        let (first_parts, later_parts) = (sum(first), sum(later));
        let (first_bytes, later_bytes) = (first_parts.iter().sum::<u64>(), later_parts.iter().sum::<u64>());
        let (fps, frames) = (f64::from(info.fps), later.len() as u64);
        let seconds = frames as f64 / fps;
        let changed_points = later.iter().map(|line| u64::from(line.changed)).sum::<u64>();
        let time = |of: fn(&Line) -> f64| first.first().map_or(0.0, of);
        Self {
            coder,
            scene_table_bytes: side.scene_bytes,
            first_state_bytes: first_bytes,
            first_state_bits_per_point: first_bytes as f64 * 8.0 / f64::from(info.point_count.max(1)),
            first_state_parts: Parts(first_parts),
            first_picture_bytes: side.first_picture_bytes,
            later_frames: frames,
            later_seconds: seconds,
            join_keyframe_bytes: side.join_bytes,
            changed_points,
            bits_per_changed_point: later_bytes as f64 * 8.0 / changed_points.max(1) as f64,
            idle_frames: later.iter().filter(|line| line.changed == 0).count() as u64,
            paper_mbit_s: number::megabits(paper_bytes(&later_parts), seconds),
            wire_mbit_s: number::megabits(later_bytes, seconds),
            session_mbit_s: number::megabits(
                side.scene_bytes + first_bytes + later_bytes,
                side.frames.len() as f64 / fps,
            ),
            later_parts: Parts(later_parts),
            first_encode_ms: time(|line| line.encode_ms),
            first_decode_ms: time(|line| line.decode_ms),
            encode_ms: MeanDeviation::of(later.iter().map(|line| line.encode_ms)),
            decode_ms: MeanDeviation::of(later.iter().map(|line| line.decode_ms)),
            changes_spent: SpentOut::of(&side.spent),
            error: Error::of(&side.error),
            pictures: side.pictures.iter().map(PictureOut::of).collect(),
        }
    }
}

impl Ratios {
    fn new(paper: &Figured, surface: &Figured) -> Self {
        let of = |value: fn(&Figured) -> f64| {
            let (paper, surface) = (value(paper), value(surface));
            (surface > 0.0).then(|| paper / surface)
        };
        Self {
            paper_mbit_s: of(|side| side.paper_mbit_s),
            wire_mbit_s: of(|side| side.wire_mbit_s),
            session_mbit_s: of(|side| side.session_mbit_s),
            first_state_bytes: of(|side| side.first_state_bytes as f64),
            first_picture_bytes: of(|side| side.first_picture_bytes.unwrap_or(0) as f64),
            join_keyframe_bytes: of(|side| side.join_keyframe_bytes as f64),
            changed_points: of(|side| side.changed_points as f64),
        }
    }
}

impl SpentOut {
    fn of(spent: &BitBreakdown) -> Option<Self> {
        let BitBreakdown { blocks, points, signs, sizes } = *spent;
        (blocks + points + signs + sizes > 0.0).then_some(Self {
            which_blocks: blocks / 8.0,
            which_points: points / 8.0,
            darker_or_lighter: signs / 8.0,
            how_much: sizes / 8.0,
        })
    }

    /// Returns the shares as lines of bars.
    fn text(&self) -> String {
        let parts = [
            ("which blocks", self.which_blocks),
            ("which points", self.which_points),
            ("darker or lighter", self.darker_or_lighter),
            ("how much", self.how_much),
        ];
        let all: f64 = parts.iter().map(|(_, bytes)| bytes).sum();
        let line = |(name, bytes): &(&str, f64)| {
            let share = bytes / all;
            format!("  {name:<18}{:>5.1} %  {}", share * 100.0, "#".repeat((share * 50.0).round() as usize))
        };
        let lines: Vec<String> = parts.iter().map(line).collect();
        format!("What the changes of surface say, by their bits:\n{}", lines.join("\n"))
    }
}

impl MeanDeviation {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.collect();
        let count = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        Self { mean, deviation: variance.sqrt(), max: values.iter().copied().fold(0.0, f64::max) }
    }

    fn text(&self) -> String {
        format!("{:.2} ± {:.2}", self.mean, self.deviation)
    }
}

impl Error {
    fn of(error: &AoErrorStats) -> Self {
        let AoErrorStats { points, lost, max, .. } = *error;
        Self { points, lost, mean: error.mean(), rms: error.rms(), max }
    }

    fn lost_share(&self) -> String {
        format!("{:.3} %", self.lost as f64 * 100.0 / (self.points + self.lost).max(1) as f64)
    }
}

impl PictureOut {
    fn of(seen: &Seen) -> Self {
        let comparison = &seen.comparison;
        Self {
            frame: seen.frame,
            psnr_db: Some(comparison.psnr).filter(|psnr| psnr.is_finite()),
            mean_error: comparison.mae,
            p99: comparison.p99,
            unsupported: seen.unsupported,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_are_means_and_standard_deviations() {
        let MeanDeviation { mean, deviation, max } = MeanDeviation::of([1.0, 3.0, 5.0, 7.0].into_iter());
        assert_eq!((mean, max), (4.0, 7.0));
        assert!((deviation - 5.0_f64.sqrt()).abs() < 1e-12, "{deviation}");
        let MeanDeviation { mean, deviation, max } = MeanDeviation::of(std::iter::empty());
        assert_eq!((mean, deviation, max), (0.0, 0.0, 0.0));
    }
}
