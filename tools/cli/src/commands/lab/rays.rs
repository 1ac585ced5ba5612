//! `psao lab rays`: rays a second of the server's tracer and of its plain twin, and whether they hit the same.

use std::path::PathBuf;
use std::sync::Arc;

use psao_server::ao::{
    AoSettings, Instructions, Occlusion, Ray, RayWorkload, ReferenceTracer, Scratch, Tracer,
};
use psao_server::points::{PointSettings, generate_cached};
use psao_server::scene::Scene;
use serde::Serialize;

use crate::args::{CacheArgs, OcclusionArg, ReportFormatArg};
use crate::cache::{Folder, as_cache};
use crate::context::{Stopwatch, say, say_json};
use crate::error::{Exit, Failure, Outcome};
use crate::output::number;
use crate::output::spread::MedianRange;
use crate::output::table::Figures;
use crate::output::target;

/// Differing rays that are shown.
const SHOWN: usize = 8;

/// Measure rays per second on one thread, beside a plain tracer
///
/// Takes all AO rays of a sample of points in the scene's first frame, and traces them with the server's tracer and as
/// single rays through a plain tree, in turns. Compares the results hit by hit. Masked triangles count as solid. A ray that
/// grazes an edge may hit in one and miss in the other, because they round differently. docs/bench-json.md describes the
/// JSON.
///
/// --dump writes the same rays and triangles for other tracers, little-endian and in metres: three u32 (numbers of vertices,
/// triangles, rays), vertices of three f32, triangles of three u32, rays of seven f32 (origin, unit direction, length).
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  psao lab rays --scene colonnade")]
pub(crate) struct Args {
    /// Name of a built-in scene (see `psao scenes`), or a file: .toml, .gltf or .glb
    #[arg(long, value_name = "NAME|FILE")]
    scene: String,
    /// Points per square metre of surface, from which the sample is taken
    #[arg(long = "points", alias = "per-m2", default_value_t = 64.0, value_name = "N_PER_M2")]
    per_m2: f32,
    /// Most points to trace, evenly spread over all
    #[arg(long, default_value_t = 3000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sample: u32,
    /// Rays per point
    #[arg(long, default_value_t = 192, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    rays: u32,
    /// Length of the rays in metres [default: the scene's own]
    #[arg(long, value_name = "METRES")]
    radius: Option<f32>,
    /// What a ray that hits something adds to the AO value; binary looks for any hit, obscurance for the nearest
    #[arg(long, value_enum, default_value_t = OcclusionArg::Obscurance)]
    occlusion: OcclusionArg,
    /// Seed of the points, their rays and the sample
    #[arg(long, default_value_t = 1, value_name = "S")]
    seed: u64,
    /// Number of measurements of each tracer
    #[arg(long, default_value_t = 9, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    /// Instruction set to trace with, such as sse2 or avx2 [default: the best of this machine]
    #[arg(long, value_name = "NAME")]
    instructions: Option<String>,
    /// Write triangles and rays to this file; - for standard output
    #[arg(long, value_name = "FILE")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    format: ReportFormatArg,
    #[command(flatten)]
    cache: CacheArgs,
}

#[derive(Serialize)]
struct Report {
    schema: &'static str,
    scene: String,
    points: usize,
    rays: usize,
    triangles: usize,
    radius_m: f32,
    occlusion: &'static str,
    seed: u64,
    rounds: u32,
    instructions: String,
    bundles: Tally,
    twin: Tally,
    /// Rays a second of the bundles over those of the twin in the same round.
    ratio: MedianRange,
    /// Rays that hit for one and not for the other.
    differing: usize,
    /// Largest difference of the distances where both hit, in metres.
    farthest_apart_m: f32,
    differences: Vec<Difference>,
}

/// What one way of tracing found, and how fast.
#[derive(Serialize)]
struct Tally {
    hits: usize,
    rays_a_second: MedianRange,
}

/// A ray on which the two disagree; no distance where there is no hit.
#[derive(Serialize)]
struct Difference {
    ray: usize,
    bundles_m: Option<f32>,
    twin_m: Option<f32>,
}

pub(crate) fn run(args: &Args) -> Outcome {
    if args.dump.as_deref().is_some_and(target::is_standard) {
        target::refuse_terminal()?;
    }
    let scene = Arc::new(Scene::load(&args.scene).map_err(Failure::input)?);
    let settings = PointSettings::default().with_per_m2(args.per_m2).with_minimum(64).with_seed(args.seed);
    let kind = args.occlusion.into();
    let radius = args.radius.unwrap_or_else(|| scene.ao_radius_m());
    let ao =
        AoSettings::default().with_rays(args.rays).with_radius(radius).with_kind(kind).with_seed(args.seed);
    let instructions = instructions(args.instructions.as_deref())?;
    let tracer = Tracer::new(ao).map_err(Failure::usage)?.with_instructions(instructions);
    let cache = Folder::of(&args.cache);
    let points = generate_cached(&scene, &settings, as_cache(&cache), &|_, _| {}).map_err(Failure::points)?;
    let probe = RayWorkload::new(&scene, &points, tracer, args.sample, args.seed);
    let (rays, triangles) = (probe.rays(), probe.triangles());
    if rays.is_empty() {
        return Err(Failure::new(
            Exit::Input,
            "the scene shows nothing at its start: there are no rays to trace",
        ));
    }
    if let Some(path) = &args.dump {
        target::write(path, &dump(&triangles, &rays))?;
        if target::is_standard(path) {
            return Ok(());
        }
    }
    let report = measure(args, &probe, &rays, &ReferenceTracer::new(&triangles), kind);
    let report = Report {
        scene: args.scene.clone(),
        triangles: triangles.len(),
        radius_m: radius,
        instructions: instructions.name(),
        ..report
    };
    if args.format.is_json() { say_json(&report) } else { table(&report) }
}

/// Returns the instruction set of a name, or the best.
fn instructions(name: Option<&str>) -> Outcome<Instructions> {
    let Some(name) = name else { return Ok(Instructions::best()) };
    let all = Instructions::all();
    let found = all.iter().find(|one| one.name().eq_ignore_ascii_case(name));
    found.copied().ok_or_else(|| {
        let names: Vec<String> = all.iter().map(|one| one.name().to_lowercase()).collect();
        Failure::input(format_args!(
            "this machine does not have the instruction set {name:?}: there are {}",
            names.join(", ")
        ))
    })
}

/// Traces both ways in turns.
fn measure(
    args: &Args,
    probe: &RayWorkload,
    rays: &[Ray],
    twin: &ReferenceTracer,
    kind: Occlusion,
) -> Report {
    let mut scratch = Scratch::default();
    let bundles = probe.distances(&mut scratch);
    let single = |ray: &Ray| match kind {
        Occlusion::Obscurance => twin.closest(ray),
        Occlusion::Binary if twin.occluded(ray) => 0.0,
        Occlusion::Binary => f32::INFINITY,
    };
    let plain: Vec<f32> = rays.iter().map(single).collect();
    let rate = |start: &Stopwatch| rays.len() as f64 / start.seconds().max(1e-9);
    let (mut fast, mut slow) = (Vec::new(), Vec::new());
    for _ in 0..args.rounds {
        let start = Stopwatch::start();
        std::hint::black_box(probe.trace(&mut scratch));
        fast.push(rate(&start));
        let start = Stopwatch::start();
        std::hint::black_box(rays.iter().filter(|ray| single(ray).is_finite()).count());
        slow.push(rate(&start));
    }
    let ratios: Vec<f64> = fast.iter().zip(&slow).map(|(fast, slow)| fast / slow).collect();
    let both = || bundles.iter().zip(&plain).enumerate();
    let differ = || both().filter(|(_, (a, b))| a.is_finite() != b.is_finite());
    let met = |distance: &f32| distance.is_finite().then_some(*distance);
    let hits = |distances: &[f32]| distances.iter().filter(|distance| distance.is_finite()).count();
    let apart = both().filter(|(_, (a, b))| a.is_finite() && b.is_finite()).map(|(_, (a, b))| (a - b).abs());
    Report {
        schema: "psao-bench-rays/1",
        scene: String::new(),
        points: probe.points(),
        rays: rays.len(),
        triangles: 0,
        radius_m: 0.0,
        occlusion: if kind == Occlusion::Binary { "binary" } else { "obscurance" },
        seed: args.seed,
        rounds: args.rounds,
        instructions: String::new(),
        bundles: Tally { hits: hits(&bundles), rays_a_second: MedianRange::of(&fast) },
        twin: Tally { hits: hits(&plain), rays_a_second: MedianRange::of(&slow) },
        ratio: MedianRange::of(&ratios),
        differing: differ().count(),
        farthest_apart_m: apart.fold(0.0, f32::max),
        differences: differ()
            .take(SHOWN)
            .map(|(ray, (a, b))| Difference { ray, bundles_m: met(a), twin_m: met(b) })
            .collect(),
    }
}

/// Returns rates in millions, with two decimals.
fn millions(rates: MedianRange) -> [String; 3] {
    [rates.median, rates.least, rates.most].map(|rate| format!("{:.2}", rate / 1e6))
}

fn table(report: &Report) -> Outcome {
    let rays = number::count(report.rays as u64);
    say(format_args!(
        "{}: {rays} rays of {} m from {} points against {} triangles, {}, {}, one thread, {}",
        report.scene,
        report.radius_m,
        number::count(report.points as u64),
        number::count(report.triangles as u64),
        report.occlusion,
        number::counted(report.rounds.into(), "round"),
        report.instructions.to_lowercase(),
    ))?;
    let mut figures = Figures::new(["", "Mrays/s, median", "least", "most", "hits"]);
    for (name, tally) in [("server's tracer", &report.bundles), ("single rays, plain tree", &report.twin)] {
        let rates = millions(tally.rays_a_second);
        let hits = number::count(tally.hits as u64);
        figures.row([name.to_owned()].into_iter().chain(rates).chain([hits]));
    }
    say(figures)?;
    say(format_args!("The server's tracer over the plain tree: {}", report.ratio.text()))?;
    if report.differing == 0 {
        return say(format_args!("the same hits, at most {:.1e} m apart", report.farthest_apart_m));
    }
    say(format_args!(
        "{} rays hit for one and not for the other; distances where both hit are at most {:.1e} m apart",
        report.differing, report.farthest_apart_m
    ))?;
    for Difference { ray, bundles_m, twin_m } in &report.differences {
        let distance = |met: &Option<f32>| met.map_or_else(|| "no hit".to_owned(), |t| format!("{t} m"));
        say(format_args!(
            "  ray {ray}: server's tracer {}, plain tree {}",
            distance(bundles_m),
            distance(twin_m)
        ))?;
    }
    Ok(())
}

/// Returns triangles and rays as bytes, in the layout that the help describes.
fn dump(triangles: &[[impl Into<[f32; 3]> + Copy; 3]], rays: &[Ray]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let vertices = triangles.len() as u32 * 3;
    for count in [vertices, triangles.len() as u32, rays.len() as u32] {
        bytes.extend(count.to_le_bytes());
    }
    for &corner in triangles.iter().flatten() {
        bytes.extend(corner.into().into_iter().flat_map(f32::to_le_bytes));
    }
    bytes.extend((0..vertices).flat_map(u32::to_le_bytes));
    for Ray { origin, direction, length } in rays {
        let numbers = origin.to_array().into_iter().chain(direction.to_array()).chain([*length]);
        bytes.extend(numbers.flat_map(f32::to_le_bytes));
    }
    bytes
}
