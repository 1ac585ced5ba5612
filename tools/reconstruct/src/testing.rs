//! Small states for tests, made as a server and a client make them: encoder, frame body, `apply`.

use std::sync::Arc;

use glam::{DMat2, DVec2, DVec3, Vec3};
use proptest::prelude::*;
use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::PointFormat;
use psao_codec::paper::{self, Grid, InstanceLayout, Layout, PointSample};
use psao_codec::paper::{Pose, State, apply};
use psao_codec::surface::{
    self, Geometry, GeometryDigest, Levels, Member, RestPoint, RoundedGeometry, SetLayout,
};

/// An instance for [`state`].
pub(crate) struct TestInstance {
    pub(crate) grid: Grid,
    pub(crate) kernel_radius: f32,
    pub(crate) pose: Pose,
    pub(crate) points: Vec<PointSample>,
}

/// Returns a client's state after one keyframe with these instances.
pub(crate) fn state(instances: &[TestInstance]) -> State {
    state_of(PointFormat::Bits32, instances)
}

/// Returns such a state with points of this format.
pub(crate) fn state_of(format: PointFormat, instances: &[TestInstance]) -> State {
    let mut first_bucket = 0;
    let layouts = instances.iter().map(|instance| {
        let bucket_count = 64;
        first_bucket += bucket_count;
        InstanceLayout {
            grid: instance.grid,
            first_bucket: first_bucket - bucket_count,
            bucket_count,
            kernel_radius: instance.kernel_radius,
        }
    });
    let layout = Arc::new(Layout::new(format, layouts.collect(), 4_096, &Limits::default()).unwrap());
    let counts: Vec<u32> = instances.iter().map(|i| u32::try_from(i.points.len()).unwrap()).collect();
    let mut encoder = paper::Encoder::new(layout.clone(), &counts).unwrap();
    let mut id = 0;
    for (number, instance) in (0_u32..).zip(instances) {
        encoder.set_pose(number, instance.pose).unwrap();
        for point in &instance.points {
            encoder.put(id, point).unwrap();
            id += 1;
        }
    }
    let meta =
        FrameMeta { kind: FrameKind::Key, frame: FrameIndex(0), time: StreamTime(0), changed_points: id };
    let frame = encoder.finish(meta, BlockCoder::default()).unwrap();
    let mut state = State::new(layout);
    apply(&mut state, &frame.body, &Limits::default()).unwrap();
    state
}

/// Points of a set: position, normal.
pub(crate) type Points = Vec<(Vec3, Vec3)>;

/// Returns a state of instances of sets of points, in a lattice from (-1, -1, -1) to (1, 1, 1). `ao` gives the AO byte
/// of an instance's point, by its number in `sets`.
pub(crate) fn surface_state(
    kernel_radius: f32,
    sets: &[Points],
    members: &[u32],
    ao: impl Fn(u32, usize) -> u8,
) -> surface::State {
    let layouts: Vec<SetLayout> = sets
        .iter()
        .map(|points| SetLayout {
            origin: [-1.0; 3],
            step: 1.0 / 1024.0,
            extent: [2048; 3],
            normal_bits: 4,
            charts: 4,
            levels: Levels::default(),
            points: u32::try_from(points.len()).unwrap(),
            kernel_radius,
            digest: GeometryDigest::default(),
        })
        .collect();
    let rounded: Vec<RoundedGeometry> =
        layouts.iter().zip(sets).map(|(layout, points)| round(*layout, points)).collect();
    let orders: Vec<Vec<u32>> = rounded.iter().map(|rounded| rounded.order.clone()).collect();
    let geometry: Vec<Arc<Geometry>> =
        rounded.into_iter().map(|rounded| Arc::new(rounded.geometry)).collect();
    let instances = members.iter().map(|&set| Member { set }).collect();
    let layouts = geometry.iter().map(|geometry| *geometry.layout()).collect();
    let layout = Arc::new(surface::Layout::new(layouts, instances, &Limits::default()).unwrap());
    let values = (0..).zip(members).flat_map(|(instance, &set)| {
        let ao = &ao;
        orders[set as usize].iter().map(move |&point| ao(instance, point as usize))
    });
    surface::State::from_parts(layout.clone(), geometry, &values.collect::<Vec<_>>())
}

fn round(layout: SetLayout, points: &Points) -> RoundedGeometry {
    let rest = points.iter().map(|(position, normal)| RestPoint {
        position: position.to_array(),
        normal: normal.to_array(),
        chart: chart_of(*normal),
    });
    Geometry::round(layout, &rest.collect::<Vec<_>>())
}

/// Returns the chart that test points and places of a normal have.
pub(crate) fn chart_of(normal: Vec3) -> u32 {
    u32::from(normal.x > 0.0) + 2 * u32::from(normal.y > 0.0)
}

/// The value at a place, computed in f64.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference {
    pub(crate) ao: f64,
    /// Points with a weight above 0.
    pub(crate) blended: u64,
    /// Whether a criterion is so near its threshold that rounding may decide it.
    pub(crate) near_threshold: bool,
}

/// How near its threshold a criterion of Eq. 3 may be decided by rounding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Margins {
    /// Margin of the squared cosine.
    pub(crate) straight: f64,
    /// Least distance between place and point, in metres, at which the direction between them is exact enough.
    pub(crate) away: f64,
}

/// Computes Eq. 2 to 4 as the paper writes them, in f64, for a place and its normal. `points` are positions, normals
/// and accessibilities.
pub(crate) fn reference(
    points: impl IntoIterator<Item = (DVec3, DVec3, f64)>,
    (x, n_x): (DVec3, DVec3),
    r: f64,
    margins: Margins,
) -> Reference {
    let mut found = Reference { ao: 1.0, blended: 0, near_threshold: false };
    let (mut sum, mut weighted) = (0.0, 0.0);
    for (p, n_p, ao) in points {
        let away = (p - x).length();
        let mut alpha = ((r - away) / r).max(0.0);
        let straight = if p == x { 0.0 } else { n_p.dot((p - x) / away).powi(2) };
        if alpha > 0.0 {
            found.near_threshold |= alpha < 1e-5 || (n_p.dot(n_x) - 0.1).abs() < 1e-5;
            found.near_threshold |=
                (straight - 0.7).abs() < margins.straight || (p != x && away < margins.away);
        } else {
            found.near_threshold |= away < r * 1.00001;
        }
        if n_p.dot(n_x) <= 0.1 || straight >= 0.7 {
            alpha = 0.0;
        }
        sum += alpha;
        weighted += alpha * ao;
        found.blended += u64::from(alpha > 0.0);
    }
    if sum > 0.0 {
        found.ao = weighted / sum;
    }
    found
}

/// Computes the fit of profile `surface` as the specification of the client writes it, in f64. `points` are positions,
/// normals and accessibilities of the place's chart.
pub(crate) fn fit_reference(
    points: impl IntoIterator<Item = (DVec3, DVec3, f64)>,
    (place, normal): (DVec3, DVec3),
    r: f64,
) -> Reference {
    let mut points: Vec<_> = points.into_iter().map(|(p, n, ao)| ((p - place).length(), p, n, ao)).collect();
    let counts = |point: &&(f64, DVec3, DVec3, f64)| point.0 < r && point.2.dot(normal) > 0.5;
    let near_criterion = |point: &(f64, DVec3, DVec3, f64)| {
        (point.0 / r - 1.0).abs() < 1e-4 || point.0 < 1.0001 * r && (point.2.dot(normal) - 0.5).abs() < 1e-4
    };
    let near_threshold = points.iter().any(near_criterion);
    let counted: Vec<_> = points.iter().filter(counts).copied().collect();
    if counted.len() >= 3 {
        let mut nearest = counted.clone();
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        if let Some(&(too_far, ..)) = nearest.get(10) {
            nearest.retain(|point| point.0 < too_far);
            if nearest.len() >= 3 {
                let ao = affine_value(&nearest, place, normal, too_far);
                // Of two points that are nearly as far, either may be the one too many.
                let near_threshold =
                    near_threshold || too_far - nearest[nearest.len() - 1].0 < 1e-4 * too_far;
                return Reference { ao, blended: nearest.len() as u64, near_threshold };
            }
        }
        let ao = affine_value(&counted, place, normal, r);
        return Reference { ao, blended: counted.len() as u64, near_threshold };
    }
    let nearest = nearest_reference(points.drain(..).map(|(_, p, _, ao)| (p, ao)), (place, normal), r);
    Reference { near_threshold: near_threshold || nearest.near_threshold, ..nearest }
}

/// Computes the fit over the six nearest of some points: positions and accessibilities.
pub(crate) fn nearest_reference(
    points: impl IntoIterator<Item = (DVec3, f64)>,
    (place, normal): (DVec3, DVec3),
    r: f64,
) -> Reference {
    let mut points: Vec<_> =
        points.into_iter().map(|(p, ao)| ((p - place).length(), p, normal, ao)).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Of two points that are nearly as far, either may be the sixth.
    let near_threshold = points.len() > 6 && points[6].0 - points[5].0 < 1e-4 * points[6].0;
    points.truncate(6);
    match points.last() {
        None => Reference { ao: 1.0, blended: 0, near_threshold },
        Some(farthest) => {
            let r = r.max(1.25 * farthest.0);
            Reference {
                ao: affine_value(&points, place, normal, r),
                blended: points.len() as u64,
                near_threshold,
            }
        }
    }
}

/// Returns the value at a place of the affine function with the least weighted square error over points: distance,
/// position, normal and accessibility.
fn affine_value(points: &[(f64, DVec3, DVec3, f64)], place: DVec3, normal: DVec3, r: f64) -> f64 {
    let [t, b] = crate::kernel::tangent_frame(normal.as_vec3()).map(Vec3::as_dvec3);
    let weighted: Vec<(f64, DVec2, f64)> = points
        .iter()
        .map(|(d, p, _, ao)| ((1.0 - d / r).powi(2), DVec2::new((p - place).dot(t), (p - place).dot(b)), *ao))
        .collect();
    let sum: f64 = weighted.iter().map(|point| point.0).sum();
    let m = weighted.iter().map(|(w, o, _)| *o * (w / sum)).sum::<DVec2>();
    let mut c = DMat2::from_diagonal(DVec2::splat(0.02 * r * r));
    for (w, o, _) in &weighted {
        c += DMat2::from_cols((*o - m) * (o.x - m.x), (*o - m) * (o.y - m.y)) * (w / sum);
    }
    let g = c.inverse() * m;
    let value: f64 = weighted.iter().map(|(w, o, ao)| w / sum * ao * (1.0 - g.dot(*o - m))).sum();
    let low = weighted.iter().map(|point| point.2).fold(1.0, f64::min);
    let high = weighted.iter().map(|point| point.2).fold(0.0, f64::max);
    let half = (high - low) / 2.0;
    value.clamp(low - half, high + half).clamp(0.0, 1.0)
}

pub(crate) fn unit() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-1.0_f32..1.0)
        .prop_map(Vec3::from)
        .prop_filter("has a direction", |v| v.length() > 0.1)
        .prop_map(Vec3::normalize)
}

/// Returns points of a set. Half of them lie on planes of lattice nodes, where many cells are alike.
pub(crate) fn points(most: usize) -> impl Strategy<Value = Points> {
    let point = (prop::array::uniform3(-1.0_f32..1.0), unit(), 0..6_usize);
    let placed = point.prop_map(|(mut at, normal, plane)| {
        if plane < 3 {
            at[plane] = 0.25;
        }
        (at.into(), normal)
    });
    prop::collection::vec(placed, 0..most)
}
