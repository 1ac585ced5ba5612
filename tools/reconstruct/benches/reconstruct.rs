//! Time of one 1080p reconstruction from cells and from points at rest, all cores and one: `cargo bench -p
//! psao-reconstruct`.
//!
//! Both have the same points. The view is a hall of three walls at 512 points per square metre, from the height of a
//! person's eyes. Before the runs, the picture is compared with the pattern of the points.

#![expect(clippy::expect_used, reason = "a bench that cannot be set up has nothing to time")]

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::{
    self, Grid, InstanceLayout, Layout, PointFormat, PointSample, State, apply, bucket_count,
};
use psao_codec::{Limits, surface};
use psao_proto::message::CameraPose;
use psao_reconstruct::reconstruct::SurfaceReconstructor;
use psao_reconstruct::{
    AtRest, GBuffer, Reconstruction, Size, Surface, SurfaceIndex, Surfaces, cast_view, reconstruct,
};

/// Side of the hall in metres; each wall is one instance.
const SIDE: f32 = 12.0;
/// Points per square metre.
const DENSITY: f32 = 512.0;

/// Normals of the walls, each through the corner at the origin.
const WALLS: [Vec3; 3] = [Vec3::X, Vec3::Y, Vec3::Z];

struct Hall;

impl Surfaces for Hall {
    fn first_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<Surface> {
        let hits = WALLS.iter().zip(0..).filter_map(|(&normal, instance)| {
            let t = -origin.dot(normal) / dir.dot(normal);
            let position = origin + dir * t;
            let inside = position.min_element() > -1e-3 && position.max_element() <= SIDE;
            let rest = Some(AtRest { position, normal, chart: 0 });
            (t > 0.0 && t <= tmax && inside).then_some(Surface { t, position, normal, instance, rest })
        });
        hits.min_by(|a, b| a.t.total_cmp(&b.t))
    }
}

/// Returns the AO of the points: slow waves, so that blending points of one wall keeps them.
fn pattern(at: Vec3) -> f32 {
    0.5 + 0.5 * libm::sinf(at.x) * libm::cosf(at.y + at.z)
}

/// Returns the points of each wall: a jittered lattice.
fn points() -> [Vec<PointSample>; 3] {
    let spacing = 1.0 / DENSITY.sqrt();
    let across = (SIDE / spacing) as u32;
    let mut random = 1_u32;
    let mut jitter = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 8) as f32 / 16_777_216.0
    };
    [0, 1, 2].map(|wall: usize| {
        let sample = |point: u32| {
            let u = ((point % across) as f32 + 0.2 + 0.6 * jitter()) * spacing;
            let v = ((point / across) as f32 + 0.2 + 0.6 * jitter()) * spacing;
            let local = [Vec3::new(0.0, u, v), Vec3::new(u, 0.0, v), Vec3::new(u, v, 0.0)][wall];
            let ao = (pattern(local) * 255.0 + 0.5) as u8;
            PointSample { local: local.to_array(), normal: WALLS[wall].to_array(), ao }
        };
        (0..across * across).map(sample).collect()
    })
}

/// Returns the Poisson-disk radius of a hexagonal packing of the density in metres.
fn poisson_radius() -> f32 {
    (1.0 / (2.0 * 3.0_f32.sqrt() * DENSITY)).sqrt()
}

/// Returns a state with the points in cells of four Poisson-disk radii (paper, section 3.2).
fn in_cells(points: &[Vec<PointSample>; 3]) -> State {
    let edge = 4.0 * poisson_radius();
    let cells = (SIDE / edge).ceil() as u32 + 2;
    let origin = Vec3::splat(-edge * 0.37);
    let buckets = bucket_count(SIDE * SIDE, edge, 64.0);
    let instances = (0..3).map(|instance: u32| {
        let mut dims = [cells; 3];
        dims[instance as usize] = 1;
        let grid = Grid::new(origin.to_array(), edge, dims).expect("the grid is small");
        InstanceLayout {
            grid,
            first_bucket: instance * buckets,
            bucket_count: buckets,
            kernel_radius: 2.0 * poisson_radius(),
        }
    });
    let layout = Layout::new(PointFormat::Bits32, instances.collect(), 1 << 20, &Limits::default())
        .expect("the layout is small");
    let layout = Arc::new(layout);
    let counts = points.each_ref().map(|wall| wall.len() as u32);
    let mut encoder = paper::Encoder::new(Arc::clone(&layout), &counts).expect("three walls");
    for (id, sample) in (0..).zip(points.iter().flatten()) {
        encoder.put(id, sample).expect("the point exists");
    }
    let meta = FrameMeta {
        kind: FrameKind::Key,
        frame: FrameIndex(0),
        time: StreamTime(0),
        changed_points: counts.iter().sum(),
    };
    let frame = encoder.finish(meta, BlockCoder::Stored).expect("the first frame");
    let mut state = State::new(layout);
    apply(&mut state, &frame.body, &Limits::default()).expect("a frame just encoded");
    state
}

/// Returns a state with the same points on the walls at rest, one set for each wall.
fn at_rest(points: &[Vec<PointSample>; 3]) -> surface::State {
    let step = SIDE / 4096.0;
    let sets = points.each_ref().map(|wall| surface::SetLayout {
        origin: [0.0; 3],
        step,
        extent: [4096; 3],
        normal_bits: 4,
        charts: 1,
        levels: surface::Levels::default(),
        points: wall.len() as u32,
        kernel_radius: 2.8 * poisson_radius(),
        digest: surface::GeometryDigest::default(),
    });
    let members = [0, 1, 2].map(|set| surface::Member { set });
    let (mut geometry, mut values) = (Vec::new(), Vec::new());
    for (set, wall) in sets.into_iter().zip(points) {
        let rest = wall.iter().map(|sample| surface::RestPoint {
            position: sample.local,
            normal: sample.normal,
            chart: 0,
        });
        let rounded = surface::Geometry::round(set, &rest.collect::<Vec<_>>());
        geometry.push(Arc::new(rounded.geometry));
        values.extend(rounded.order.into_iter().map(|point| wall[point as usize].ao));
    }
    let sets = geometry.iter().map(|geometry| *geometry.layout()).collect();
    let layout = surface::Layout::new(sets, members.to_vec(), &Limits::default());
    surface::State::from_parts(Arc::new(layout.expect("the layout is small")), geometry, &values)
}

fn view(size: Size) -> GBuffer {
    let pose = CameraPose {
        eye: [9.0, 1.7, 8.0],
        target: [0.0, 1.5, 0.5],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 60.0,
        aspect: size.aspect(),
    };
    cast_view(&Hall, &pose, size).expect("the camera is sound")
}

/// Checks that the picture shows the pattern, except at the rims and where the tables lost points.
fn check(found: &Reconstruction, view: &GBuffer) {
    let mut near = 0;
    for (pixel, value) in found.image.values().iter().enumerate() {
        let want = view.fragment(pixel).map_or(1.0, |fragment| pattern(fragment.position));
        near += usize::from((value - want).abs() < 0.03);
    }
    let share = near as f64 / found.image.values().len() as f64;
    assert!(share > 0.99, "only {share} of the pixels show the pattern");
    println!(
        "{} fragments, {:.1} points blended each",
        found.statistics.fragments,
        found.statistics.mean_blended()
    );
}

fn reconstruct_1080p(c: &mut Criterion) {
    let points = points();
    let (cells, rest) = (in_cells(&points), at_rest(&points));
    let view = view(Size::new(1920, 1080).expect("a possible size"));
    check(&reconstruct::cells(&cells, &view).expect("the view is of this state"), &view);
    let mut kept = SurfaceReconstructor::new();
    check(&kept.reconstruct(&rest, &view).expect("the view is of this state"), &view);
    let mut group = c.benchmark_group("reconstruct 1080p");
    group.sample_size(20).throughput(Throughput::Elements(view.covered() as u64));
    for threads in [1, rayon::current_num_threads()] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        group.bench_function(format!("cells, {threads} threads"), |b| {
            b.iter(|| pool.install(|| reconstruct::cells(black_box(&cells), black_box(&view))));
        });
        group.bench_function(format!("surface, {threads} threads"), |b| {
            b.iter(|| pool.install(|| kept.reconstruct(black_box(&rest), black_box(&view))));
        });
    }
    group.finish();
    let geometry = rest.geometry(0).expect("it is there");
    let index = SurfaceIndex::new(geometry);
    println!("index: {:.1} bytes a point", index.heap_bytes() as f64 / geometry.len() as f64);
    c.bench_function("index of a wall", |b| b.iter(|| SurfaceIndex::new(black_box(geometry))));
}

criterion_group!(benches, reconstruct_1080p);
criterion_main!(benches);
