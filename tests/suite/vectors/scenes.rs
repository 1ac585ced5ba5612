//! The layouts of the vectors, and AO that moves over them. Nothing here may ever change: the vectors would.

use std::sync::Arc;

use psao_codec::Limits;
use psao_codec::paper::{self, Grid, InstanceLayout, PointFormat};
use psao_codec::surface::{Geometry, GeometryDigest, Layout, Levels, Member, RestPoint, SetLayout};

/// A layout with what belongs to it.
pub(super) enum Stream {
    Paper { name: &'static str, layout: Arc<paper::Layout> },
    Surface { name: &'static str, layout: Arc<Layout>, geometry: Vec<Arc<Geometry>>, shared: bool },
}

impl Stream {
    pub(super) fn name(&self) -> &'static str {
        match self {
            Stream::Paper { name, .. } | Stream::Surface { name, .. } => name,
        }
    }
}

pub(super) fn all() -> Vec<Stream> {
    let mut all: Vec<Stream> = FORMATS.iter().map(|(name, format)| paper(name, *format)).collect();
    all.extend([tiny(), hall(), pair(), crowd()]);
    all
}

pub(super) const FORMATS: [(&str, PointFormat); 3] =
    [("paper-32", PointFormat::Bits32), ("paper-24", PointFormat::Bits24), ("paper-16", PointFormat::Bits16)];

/// Two instances of 4 x 3 x 5 cells of 25 cm.
pub(super) fn paper(name: &'static str, format: PointFormat) -> Stream {
    let grid = |origin| Grid::new(origin, 0.25, [4, 3, 5]).unwrap();
    let instance = |origin, first_bucket| InstanceLayout {
        grid: grid(origin),
        first_bucket,
        bucket_count: 4,
        kernel_radius: 0.125,
    };
    let instances = vec![instance([0.0; 3], 0), instance([-0.5, 0.0, 2.0], 4)];
    let layout = paper::Layout::new(format, instances, 24, &Limits::default()).unwrap();
    Stream::Paper { name, layout: Arc::new(layout) }
}

fn set(step: f32, extent: [u32; 3], normal_bits: u8) -> SetLayout {
    let digest = GeometryDigest::default();
    SetLayout {
        origin: [-1.0, -0.5, 0.25],
        step,
        extent,
        normal_bits,
        points: 0,
        charts: 1,
        levels: Levels::default(),
        kernel_radius: 0.125,
        digest,
    }
}

fn surface(name: &'static str, geometry: Vec<Arc<Geometry>>, members: &[u32], shared: bool) -> Stream {
    let sets = geometry.iter().map(|geometry| *geometry.layout()).collect();
    let members = members.iter().map(|set| Member { set: *set }).collect();
    let layout = Layout::new(sets, members, &Limits::default()).unwrap();
    Stream::Surface { name, layout: Arc::new(layout), geometry, shared }
}

/// Points at nodes of a lattice with these normals. Charts are those of the normals' signs, as far as the layout has them.
fn at_nodes(layout: SetLayout, points: &[([u32; 3], [f32; 3])]) -> Arc<Geometry> {
    let chart = |normal: &[f32; 3]| {
        (0..3).map(|axis| u32::from(normal[axis] > 0.0) << axis).sum::<u32>() % layout.charts
    };
    let points: Vec<RestPoint> = points
        .iter()
        .map(|(node, normal)| RestPoint {
            position: layout.position(*node),
            normal: *normal,
            chart: chart(normal),
        })
        .collect();
    let rounded = Geometry::round(layout, &points);
    assert_eq!(rounded.outside, 0);
    Arc::new(rounded.geometry)
}

/// The three points of the specification's example.
pub(super) fn tiny() -> Stream {
    let up = [0.0, 1.0, 0.0];
    let layout = SetLayout { origin: [0.0; 3], kernel_radius: 0.5, ..set(0.25, [3, 0, 3], 4) };
    let geometry = at_nodes(layout, &[([0, 0, 0], up), ([1, 0, 2], up), ([3, 0, 2], up)]);
    surface("tiny", vec![geometry], &[0], false)
}

/// Numbers that look random: the same on every machine.
pub(super) fn noise(number: u32) -> u32 {
    let mixed = (number ^ number >> 15).wrapping_mul(0x2C1B_3C6D);
    let mixed = (mixed ^ mixed >> 12).wrapping_mul(0x297A_2D39);
    mixed ^ mixed >> 15
}

/// A sloping floor, a ball of whole numbers, a few points with the coarsest normals of which three share a node, and
/// a set without points; 1 floor, 9 balls, 3 of the few, one of nothing: 18 blocks. A ball fills its block, so that what is
/// beside its ends is of other instances.
pub(super) fn hall() -> Stream {
    let members = [1, 0, 1, 3, 1, 2, 1, 1, 2, 1, 1, 1, 2, 1];
    surface("hall", hall_sets(), &members, false)
}

/// Two of its balls and the few points between them; both sides have their geometry.
pub(super) fn pair() -> Stream {
    surface("pair", hall_sets()[1..3].to_vec(), &[0, 1, 0], true)
}

fn hall_sets() -> Vec<Arc<Geometry>> {
    let floor = (0..330).map(|n| {
        let (x, z) = (noise(n) % 600, noise(n + 1000) % 900);
        ([x, 40 + x / 7 + noise(n + 2000) % 2, z], [-1.0, 7.0, 0.0])
    });
    let ball = (0..64).map(|n| {
        let axis = |salt: u32| (noise(3 * n + salt) % 61) as i32 - 30;
        let direction = [axis(10_000), axis(20_000), axis(30_000)];
        let largest = direction.iter().map(|axis| axis.abs()).max().unwrap_or(0).max(1);
        // On a cube rather than a ball, so that there is no root to round.
        let node = direction.map(|axis| (32 + axis * 30 / largest) as u32);
        (node, direction.map(|axis| axis as f32))
    });
    let few = [
        ([5, 5, 5], [1.0, 0.0, 0.0]),
        ([5, 5, 5], [0.0, 0.0, -1.0]),
        ([5, 5, 5], [0.0, 0.0, -1.0]),
        ([0, 0, 0], [0.0, -1.0, 0.0]),
        ([6, 5, 5], [0.0, 0.0, 1.0]),
        ([511, 1000, 7], [-1.0, 0.0, 0.0]),
    ];
    let floor = at_nodes(set(1.0 / 256.0, [640, 180, 1023], 6), &floor.collect::<Vec<_>>());
    let ball = at_nodes(SetLayout { charts: 7, ..set(1.0 / 64.0, [64; 3], 8) }, &ball.collect::<Vec<_>>());
    let few = at_nodes(SetLayout { charts: 1 << 24, ..set(1.0 / 128.0, [511, 1023, 7], 2) }, &few);
    let none = at_nodes(set(0.5, [0; 3], 3), &[]);
    vec![floor, ball, few, none]
}

/// More instances than one opinion can tell apart: 270 of one or two points, and some of 70.
pub(super) fn crowd() -> Stream {
    let layout = set(1.0 / 16.0, [15; 3], 3);
    let up = [0.0, 0.0, 1.0];
    let sets = [1, 2, 70].map(|count| {
        let nodes = (0..count).map(|n| ([noise(n) % 16, noise(n + 50) % 16, noise(n + 90) % 3], up));
        at_nodes(layout, &nodes.collect::<Vec<_>>())
    });
    let members: Vec<u32> = (0..270).map(|n| if n % 90 == 40 { 2 } else { n % 2 }).collect();
    surface("crowd", sets.to_vec(), &members, false)
}

/// AO of a point at a time: a shadow that passes over, points that blink at their own pace, and a little noise.
pub(super) fn ao(point: u32, frame: u32) -> u8 {
    let open = match noise(point) % 16 {
        0 => 255,
        1 => 40 + 7 * (noise(point.wrapping_add(frame.wrapping_mul(0x9E37))) % 4),
        2 if frame.is_multiple_of(2 + point % 5) => 0,
        3 if (frame / 3).is_multiple_of(2) => 90,
        _ => 250 - noise(point + 77) % 12,
    };
    let shadow = 150_u32.saturating_sub(6 * (point % 210).abs_diff(9 * frame % 210));
    open.saturating_sub(shadow) as u8
}
