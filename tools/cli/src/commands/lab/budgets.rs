//! `psao lab budgets`: what byte budgets cost in AO, on the same traced AO.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::surface::{BLOCK_POINTS, Budget, Encoder, EncoderSettings, Geometry, GeometrySource, Layout};
use psao_proto::message;
use psao_server::clock::NoClock;
use psao_server::scene::Scene;
use psao_server::server::Server;
use serde::Serialize;

use crate::args::{Coder, Format, FormatArg, PointArgs, ProfileArg};
use crate::budget::{AgeArg, BudgetTotals};
use crate::cache::{Folder, as_cache};
use crate::context::{progress, say, say_json};
use crate::error::{Failure, Outcome};
use crate::output::csv::Csv;
use crate::output::number;
use crate::output::table::Figures;
use crate::producer::{Timetable, refused, settings, show_progress};
use crate::quantity::Share;

/// Measure the AO error that byte budgets cause
///
/// AO is traced once. It is then encoded without a budget, and with each share of the mean frame size that this took, not
/// counting the first frame. The error is the difference, in steps of 1/255, between the AO that clients hold and the
/// newest that the server knows. It covers the points that the stream without a budget sends again, in every frame;
/// "weighed" is its mean weighted by screen area. All AO of the clip stays in memory: a byte for each point and frame. The
/// figures are the same on any machine.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  psao lab budgets --scene robot-lab --points 128 --shares 50%,25%")]
pub(crate) struct Args {
    /// Name of a built-in scene (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE")]
    scene: String,
    /// Frames to compare, including the first
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
    /// Budgets as shares of the mean frame size without a budget, in whole percent
    #[arg(long, value_name = "SHARE,..", value_delimiter = ',', default_value = "100%,50%,25%,10%",
        value_parser = percent)]
    shares: Vec<u32>,
    #[command(flatten)]
    age: AgeArg,
    #[command(flatten)]
    points: PointArgs,
    /// Compression of blocks: range, zstd, zstd:LEVEL, lz4 or none
    #[arg(long, value_name = "CODER", default_value = "range")]
    compress: Coder,
    #[command(flatten)]
    format: FormatArg,
}

/// Parses one of `--shares` into whole percent, 1 to 1000.
fn percent(text: &str) -> Result<u32, String> {
    let Share(parts) = Share::at_most(text, 10_000_000)?;
    if parts > 0 && parts.is_multiple_of(10_000) {
        Ok(parts / 10_000)
    } else {
        Err(format!("\"{text}\" is not a whole number of percent from 1% to 1000%"))
    }
}

/// The stream as it was traced.
struct Traced {
    layout: Arc<Layout>,
    geometry: Vec<Arc<Geometry>>,
    threshold: u8,
    frames: Vec<Offers>,
    /// By point id: whether the stream without a budget sends it again.
    moving: Vec<bool>,
}

/// What is offered in a frame.
struct Offers {
    time: StreamTime,
    /// By point id.
    ao: Vec<u8>,
    /// By point id: whether clients need the point. Others are out of view, or of a level that no picture needs.
    needed: Vec<bool>,
    /// By block.
    weights: Vec<u16>,
}

/// The figures of a budget.
#[derive(Serialize)]
struct Row {
    /// Percent of the demand; 0 without a budget.
    share: u32,
    bytes_a_frame: f64,
    mbit_s: f64,
    mean: f64,
    weighed: f64,
    p99: u8,
    max: u8,
    budget: BudgetTotals,
}

/// Differences between server and clients.
#[derive(Default)]
struct Errors {
    histogram: Vec<u64>,
    /// Sums of weight and of weight times difference.
    weights: f64,
    weighed: f64,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let coder = ProfileArg::Surface.coder(Some(args.compress))?;
    let scene = Arc::new(Scene::load(&args.scene).map_err(Failure::input)?);
    // A budget that nothing exceeds: with one, the server weighs the points.
    let budget = Some(Budget::new(u32::MAX).with_longest_age(args.age.longest_age));
    let settings = settings(&args.points, &scene, args.frames).with_coder(coder).with_budget(budget);
    let cache = Folder::of(&args.points.cache);
    let server = Server::with_cache(Arc::clone(&scene), settings, as_cache(&cache), show_progress());
    let mut server = server.map_err(refused)?;
    let traced = trace(args, &scene, &mut server)?;
    let free = write(args, &traced, None, coder)?;
    let demand = free.bytes_a_frame;
    let mut rows = vec![free];
    for share in &args.shares {
        let bytes = (demand * f64::from(*share) / 100.0).round() as u32;
        let budget = Budget::new(bytes).with_longest_age(args.age.longest_age);
        rows.push(Row { share: *share, ..write(args, &traced, Some(budget), coder)? });
    }
    match args.format.get() {
        Format::Table => table(args, &server, &traced, &rows),
        Format::Csv => csv(&rows),
        Format::Json => say_json(&rows),
    }
}

/// Traces the clip and keeps what every frame offers.
fn trace(args: &Args, scene: &Arc<Scene>, server: &mut Server) -> Outcome<Traced> {
    let bar = progress("tracing", u64::from(args.frames));
    let timetable = Timetable::new(scene, &args.points);
    let mut frames = Vec::new();
    for number in 0..args.frames {
        let (time, views) = timetable.frame(number, &[]);
        server.step(FrameIndex(number), time, &views, &NoClock).map_err(refused)?;
        let Some(encoder) = server.surface() else { continue };
        let layout = encoder.state().layout();
        let instances = 0..layout.members().len() as u32;
        let ao = instances.clone().flat_map(|instance| encoder.latest(instance)).copied().collect();
        let weights = |instance| {
            let blocks = 0..layout.blocks_of(instance).len();
            blocks.map(move |block| encoder.weight(instance, block).unwrap_or(1))
        };
        // The threshold of a point out of view is 255.
        let is_needed = |point| encoder.threshold(point).is_some_and(|threshold| threshold < u8::MAX);
        let needed = (0..layout.points()).map(is_needed).collect();
        frames.push(Offers { time, ao, needed, weights: instances.flat_map(weights).collect() });
        bar.inc(1);
    }
    bar.finish_and_clear();
    let encoder = server.surface().ok_or_else(|| Failure::usage("budgets are for profile surface"))?;
    let (state, threshold) = (encoder.state(), encoder.settings().threshold);
    let sets = 0..state.layout().sets().len() as u32;
    Ok(Traced {
        layout: Arc::clone(state.layout()),
        geometry: sets.filter_map(|set| state.geometry(set).cloned()).collect(),
        threshold,
        moving: vec![false; state.layout().points() as usize],
        frames,
    }
    .with_moving())
}

impl Traced {
    /// Marks the points that differ from the first frame by the threshold at least once.
    fn with_moving(mut self) -> Self {
        if let Some((first, later)) = self.frames.split_first() {
            for offers in later {
                for ((moving, ao), was) in self.moving.iter_mut().zip(&offers.ao).zip(&first.ao) {
                    *moving |= ao.abs_diff(*was) >= self.threshold;
                }
            }
        }
        self
    }

    /// Returns an encoder of the stream.
    fn encoder(&self, budget: Option<Budget>) -> Outcome<Encoder> {
        let settings = EncoderSettings::new(self.threshold, GeometrySource::Sent).with_budget(budget);
        Encoder::new(Arc::clone(&self.layout), self.geometry.clone(), settings).map_err(Failure::input)
    }
}

impl Offers {
    /// Offers the AO values to the encoder; returns how many points differ.
    fn offer(&self, layout: &Layout, encoder: &mut Encoder) -> u32 {
        let mut weights = self.weights.iter();
        for instance in 0..layout.members().len() as u32 {
            for (block, weight) in (0..layout.blocks_of(instance).len()).zip(&mut weights) {
                encoder.set_weight(instance, block, *weight);
            }
        }
        let differs = |(point, (ao, needed)): (u32, (&u8, &bool))| {
            if *needed {
                return u32::from(encoder.set_ao(point, *ao).unwrap_or(false));
            }
            encoder.release(point);
            0
        };
        (0..).zip(self.ao.iter().zip(&self.needed)).map(differs).sum()
    }
}

/// Writes the stream with a budget.
fn write(args: &Args, traced: &Traced, budget: Option<Budget>, coder: BlockCoder) -> Outcome<Row> {
    let mut encoder = traced.encoder(budget)?;
    let mut errors = Errors { histogram: vec![0; 256], ..Errors::default() };
    let (mut bytes, mut totals) = (0_u64, BudgetTotals::default());
    for (offers, number) in traced.frames.iter().zip(0..) {
        let changed_points = offers.offer(&traced.layout, &mut encoder);
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        let meta = FrameMeta { kind, frame: FrameIndex(number), time: offers.time, changed_points };
        let frame = encoder.finish(meta, coder).map_err(Failure::input)?;
        if number == 0 {
            continue;
        }
        bytes += frame.body.len() as u64;
        if let Some((budget, postponed)) = budget.zip(encoder.postponed().copied()) {
            totals.add(&message::Budget::of_frame(FrameIndex(number), budget, postponed));
        }
        errors.add(traced, offers, &encoder);
    }
    let later = f64::from(args.frames - 1);
    Ok(Row {
        share: 0,
        bytes_a_frame: bytes as f64 / later,
        mbit_s: number::megabits(bytes, later / f64::from(args.points.fps)),
        mean: errors.mean(),
        weighed: errors.weighed / errors.weights.max(1.0),
        p99: errors.quantile(99),
        max: errors.quantile(100),
        budget: totals,
    })
}

impl Errors {
    /// Adds the moving points of a frame.
    fn add(&mut self, traced: &Traced, offers: &Offers, encoder: &Encoder) {
        let mut weights = offers.weights.iter();
        let (layout, mut point) = (&traced.layout, 0);
        for instance in 0..layout.members().len() as u32 {
            let blocks = encoder.state().values(instance).chunks(BLOCK_POINTS);
            for (block, weight) in blocks.zip(&mut weights) {
                for held in block {
                    if traced.moving[point] && offers.needed[point] {
                        let off = held.abs_diff(offers.ao[point]);
                        self.histogram[usize::from(off)] += 1;
                        self.weights += f64::from(*weight);
                        self.weighed += f64::from(*weight) * f64::from(off);
                    }
                    point += 1;
                }
            }
        }
    }

    fn mean(&self) -> f64 {
        let sum: u64 = (0..).zip(&self.histogram).map(|(off, count): (u64, _)| off * count).sum();
        sum as f64 / self.histogram.iter().sum::<u64>().max(1) as f64
    }

    /// Returns the smallest difference that `percent` of all differences do not exceed.
    fn quantile(&self, percent: u64) -> u8 {
        let wanted = (self.histogram.iter().sum::<u64>() * percent).div_ceil(100);
        let mut seen = 0;
        let found = self.histogram.iter().position(|count| {
            seen += count;
            seen >= wanted
        });
        found.unwrap_or(255) as u8
    }
}

fn table(args: &Args, server: &Server, traced: &Traced, rows: &[Row]) -> Outcome {
    let moving = traced.moving.iter().filter(|moving| **moving).count();
    say(format_args!(
        "{}: {} points, of which {} are sent again; threshold {}/255, {} frames at {} Hz, longest age {} frames",
        server.table().info().name,
        number::count(u64::from(traced.layout.points())),
        number::count(moving as u64),
        traced.threshold,
        args.frames,
        args.points.fps,
        args.age.longest_age,
    ))?;
    let mut table = Figures::new([
        "budget",
        "bytes a frame",
        "Mbit/s",
        "error, mean",
        "weighed",
        "P99",
        "largest",
        "postponed",
        "oldest",
        "forced",
        "frames over",
    ]);
    for row in rows {
        let BudgetTotals { frames, bytes, over, postponed, oldest, forced, .. } = row.budget;
        let share = |sum: u64| sum as f64 / frames.max(1) as f64;
        table.row([
            if row.share == 0 {
                "none".to_owned()
            } else {
                format!("{} %: {} B", row.share, number::count(bytes.into()))
            },
            format!("{:.1}", row.bytes_a_frame),
            format!("{:.3}", row.mbit_s),
            format!("{:.3}", row.mean),
            format!("{:.3}", row.weighed),
            row.p99.to_string(),
            row.max.to_string(),
            format!("{:.1}", share(postponed)),
            oldest.to_string(),
            number::count(forced),
            format!("{:.1} %", share(over) * 100.0),
        ]);
    }
    say(table)
}

fn csv(rows: &[Row]) -> Outcome {
    let heads =
        "share,budget_bytes,bytes_a_frame,mbit_s,mean,weighed,p99,max,frames,over,postponed,oldest,forced";
    let mut csv = Csv::new(heads.split(','))?;
    for Row { share, bytes_a_frame, mbit_s, mean, weighed, p99, max, budget } in rows {
        let BudgetTotals { frames, bytes, over, postponed, oldest, forced, .. } = budget;
        let [bytes_a_frame, mbit_s, mean, weighed] =
            [bytes_a_frame, mbit_s, mean, weighed].map(f64::to_string);
        let [share, bytes] = [share, bytes].map(u32::to_string);
        let [p99, max] = [p99, max].map(u8::to_string);
        let [frames, over, postponed, forced] = [frames, over, postponed, forced].map(u64::to_string);
        let oldest = oldest.to_string();
        csv.row([
            share,
            bytes,
            bytes_a_frame,
            mbit_s,
            mean,
            weighed,
            p99,
            max,
            frames,
            over,
            postponed,
            oldest,
            forced,
        ])?;
    }
    csv.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_and_means_are_those_of_the_differences() {
        let mut histogram = vec![0; 256];
        (histogram[0], histogram[2], histogram[40]) = (98, 1, 1);
        let errors = Errors { histogram, ..Errors::default() };
        assert_eq!([98, 99, 100].map(|percent| errors.quantile(percent)), [0, 2, 40]);
        assert!((errors.mean() - 0.42).abs() < 1e-12);
    }
}
