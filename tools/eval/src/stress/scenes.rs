//! Scenes that strain rays and points: open, closed, tiny, huge, or made of slivers.

use std::sync::Arc;

use glam::Vec3;
use psao_reconstruct::{AoImage, GBuffer, Size, Surface};
use psao_server::ao::{AoSettings, Occlusion};
use psao_server::points::{PointSettings, ScenePoints, generate};
use psao_server::scene::{InstanceId, Scene};
use psao_server::world::SceneBvh;

use super::{Case, StressError};
use crate::adapter::SceneView;
use crate::reference::reference;
use crate::shapes;

/// Points per square metre of a scene one metre across, and rays of a point.
const POINTS_PER_M2: f32 = 64.0;
const RAYS: u32 = 256;
/// Half the side of the closed box in metres.
const HALF_SIDE: f32 = 0.5;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "open-plane",
            what: "Largest difference from 1 of the AO of points on an open plane, of either kind.",
            bound_text: "exact: no ray of a plane meets the plane",
            bound: 0.0,
            documented: None,
            unit: "AO",
            measure: || Ok(open_plane(Occlusion::Obscurance)?.max(open_plane(Occlusion::Binary)?)),
        },
        Case {
            name: "closed-box-binary",
            what: "Largest binary AO of points on the inner walls of a closed box smaller than the radius.",
            bound_text: "exact: every ray meets a wall",
            bound: 0.0,
            documented: None,
            unit: "AO",
            measure: closed_box_binary,
        },
        Case {
            name: "closed-box-obscurance",
            what: "Largest difference of the obscurance of points on the inner walls of a closed box, by 256 rays, from the integral over the walls.",
            bound_text: "0.01: the error of 256 stratified rays",
            bound: 0.01,
            documented: None,
            unit: "AO",
            measure: closed_box_obscurance,
        },
        Case {
            name: "scale-1e-3",
            what: "Largest change of a point's AO when a scene one metre across and the radius shrink to a millimetre.",
            bound_text: "two rays of 256 that graze an edge may fall to its other side: 0.0078",
            bound: 2.0 / f64::from(RAYS),
            documented: None,
            unit: "AO",
            measure: || scaled(1e-3),
        },
        Case {
            name: "scale-1e4",
            what: "Largest change of a point's AO when a scene one metre across and the radius grow to ten kilometres.",
            bound_text: "two rays of 256 that graze an edge may fall to its other side: 0.0078",
            bound: 2.0 / f64::from(RAYS),
            documented: None,
            unit: "AO",
            measure: || scaled(1e4),
        },
        Case {
            name: "slivers",
            what: "Points on slivers as thin as a ten-millionth of their length, and triangles without area beside them, that are missing, misplaced or without an AO in [0, 1].",
            bound_text: "no such point: as many points as the area requires, all finite and on the surface",
            bound: 0.0,
            documented: None,
            unit: "points",
            measure: slivers,
        },
    ]
}

/// A scene's points as the fragments of a picture one pixel high, and their reference AO.
struct PointPicture {
    view: GBuffer,
    image: AoImage,
}

/// Traces every point of a still scene with the rays of `settings`.
fn trace(
    scene: &Arc<Scene>,
    points: &ScenePoints,
    settings: &AoSettings,
) -> Result<PointPicture, StressError> {
    let world = SceneBvh::new(scene, &scene.pose(0.0));
    let mut fragments = Vec::new();
    for (instance, of) in (0_u32..).zip(scene.instances()) {
        let Some(posed) = world.posed(InstanceId(instance)) else { continue };
        let at = world.placement(InstanceId(instance));
        for point in points.sets()[of.rest().index()].points() {
            let placed = point.place_on(&posed);
            let (position, normal) = (at.point(placed.position), at.direction(placed.normal));
            fragments.push(Some(Surface { t: 0.0, position, normal, instance, rest: None }));
        }
    }
    let width = u32::try_from(fragments.len()).unwrap_or(u32::MAX);
    let size = Size::new(width, 1).map_err(StressError::new)?;
    let view = GBuffer::from_fragments(size, fragments).map_err(StressError::new)?;
    let image = reference(&SceneView::new(&world), &view, settings).map_err(StressError::new)?;
    Ok(PointPicture { view, image })
}

fn scene(lists: &[Vec<[Vec3; 3]>], settings: &AoSettings) -> Result<Arc<Scene>, StressError> {
    Scene::from_triangles("stress", lists, settings.radius).map(Arc::new).map_err(StressError::new)
}

/// Makes a scene of triangles, its points and their AO.
fn traced(
    lists: &[Vec<[Vec3; 3]>],
    per_m2: f32,
    settings: &AoSettings,
) -> Result<(ScenePoints, PointPicture), StressError> {
    let scene = scene(lists, settings)?;
    let wanted = PointSettings::default().with_per_m2(per_m2).with_minimum(16).with_seed(1);
    let points = generate(&scene, &wanted, &|_, _| ()).map_err(StressError::new)?;
    let found = trace(&scene, &points, settings)?;
    Ok((points, found))
}

fn settings(radius: f32, kind: Occlusion) -> AoSettings {
    AoSettings::default().with_rays(RAYS).with_radius(radius).with_kind(kind).with_seed(1)
}

fn open_plane(kind: Occlusion) -> Result<f64, StressError> {
    let (_, found) = traced(&[shapes::floor(2.0)], POINTS_PER_M2, &settings(0.6, kind))?;
    Ok(found.image.values().iter().map(|&ao| f64::from(1.0 - ao)).fold(0.0, f64::max))
}

fn closed_box(kind: Occlusion) -> Result<PointPicture, StressError> {
    let walls = shapes::inside_out(&shapes::cube(Vec3::ZERO, HALF_SIDE));
    Ok(traced(&[walls], POINTS_PER_M2, &settings(2.0, kind))?.1)
}

fn closed_box_binary() -> Result<f64, StressError> {
    let found = closed_box(Occlusion::Binary)?;
    Ok(found.image.values().iter().map(|&ao| f64::from(ao)).fold(0.0, f64::max))
}

fn closed_box_obscurance() -> Result<f64, StressError> {
    let settings = settings(2.0, Occlusion::Obscurance);
    let found = closed_box(settings.kind)?;
    let mut worst = 0.0_f64;
    for (pixel, &ao) in found.image.values().iter().enumerate() {
        if let Some(fragment) = found.view.fragment(pixel) {
            let truth = box_integral(&fragment, &settings);
            worst = worst.max((f64::from(ao) - truth).abs());
        }
    }
    Ok(worst)
}

/// Returns the obscurance of a point in the closed box by the midpoint rule over the cosine-weighted hemisphere.
///
/// The distance to the box's walls is in closed form, so only the definition is shared with the tracer.
fn box_integral(fragment: &Surface, settings: &AoSettings) -> f64 {
    let steps = 64;
    let normal = fragment.normal.as_dvec3();
    let origin = fragment.position.as_dvec3() + normal * f64::from(settings.bias());
    let (side, other) = normal.any_orthonormal_pair();
    let mut sum = 0.0;
    for a in 0..steps {
        let across = (f64::from(a) + 0.5) / f64::from(steps);
        for b in 0..steps {
            let turn = (f64::from(b) + 0.5) / f64::from(steps) * std::f64::consts::TAU;
            let flat = side * libm::cos(turn) + other * libm::sin(turn);
            let direction = flat * across.sqrt() + normal * (1.0 - across).sqrt();
            let walls = (glam::DVec3::splat(f64::from(HALF_SIDE)).copysign(direction) - origin) / direction;
            sum += walls.min_element().min(f64::from(settings.radius)) / f64::from(settings.radius);
        }
    }
    sum / f64::from(steps * steps)
}

/// Returns the largest AO difference between a scene of unit size and the same scene `scale` times as large.
fn scaled(scale: f32) -> Result<f64, StressError> {
    let lists = [shapes::floor(0.5), shapes::cube(Vec3::new(0.1, 0.15, 0.05), 0.15)];
    let (points, unit) = traced(&lists, POINTS_PER_M2, &settings(0.6, Occlusion::Obscurance))?;
    // The same places on the triangles: it is their AO that is compared, not how points are spread.
    let grown = lists.map(|triangles| -> Vec<[Vec3; 3]> {
        triangles.into_iter().map(|triangle| triangle.map(|corner| corner * scale)).collect()
    });
    let settings = settings(0.6 * scale, Occlusion::Obscurance);
    let other = trace(&scene(&grown, &settings)?, &points, &settings)?;
    let (unit, other) = (unit.image, other.image);
    let pairs = unit.values().iter().zip(other.values());
    Ok(pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max))
}

/// Returns the number of missing and wrong points on a floor with slivers and triangles without area.
fn slivers() -> Result<f64, StressError> {
    let mut thin = Vec::new();
    for index in 0_u16..200 {
        let at = Vec3::new(f32::from(index) * 0.005 - 0.5, 0.05, -0.5);
        let width = [1e-2, 1e-4, 1e-6, 1e-7][usize::from(index) % 4];
        thin.push([at, at + Vec3::Z, at + Vec3::Z + Vec3::X * width]);
        thin.push([at, at + Vec3::Z, at + Vec3::Z * 0.5]);
        thin.push([at; 3]);
    }
    let lists = [shapes::floor(0.5), thin];
    let settings = settings(0.6, Occlusion::Obscurance);
    let (points, found) = traced(&lists, 1024.0, &settings)?;
    let area = |&[a, b, c]: &[Vec3; 3]| (b - a).as_dvec3().cross((c - a).as_dvec3()).length() * 0.5;
    // Each sliver is a chart: it has its share of the points, or up to 8 where that is at most 16 times its share.
    let of_chart = |area: f64| (area * 1024.0).ceil().max((16.0 * area * 1024.0).ceil().min(8.0));
    let floor = of_chart(lists[0].iter().map(area).sum());
    let wanted = floor + lists[1].iter().map(|sliver| of_chart(area(sliver))).sum::<f64>();
    let missing = (wanted - f64::from(points.total())).abs();
    let wrong = |fragment: &Surface| {
        let height = if fragment.instance == 0 { 0.0 } else { 0.05 };
        let off = (fragment.position.y - height).abs() > 1e-6 || fragment.position.abs().max_element() > 0.52;
        off || !fragment.position.is_finite() || (fragment.normal.length() - 1.0).abs() > 1e-5
    };
    let bad =
        (0..found.view.size().pixels()).filter_map(|pixel| found.view.fragment(pixel)).filter(wrong).count();
    // AO values outside [0, 1] or NaN would have been an error above.
    Ok(missing + bad as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_integral_is_open_in_a_small_radius_and_the_same_on_every_wall() {
        let at = |position: Vec3, normal: Vec3, radius: f32| {
            let settings = settings(radius, Occlusion::Obscurance);
            box_integral(&Surface { t: 0.0, position, normal, instance: 0, rest: None }, &settings)
        };
        assert_eq!(at(Vec3::NEG_Y * HALF_SIDE, Vec3::Y, 0.1), 1.0);
        let middles = [Vec3::X, Vec3::NEG_Y, Vec3::Z].map(|normal| at(-normal * HALF_SIDE, normal, 2.0));
        assert!(middles.iter().all(|m| (m - middles[0]).abs() < 1e-3), "{middles:?}");
        let corner = at(Vec3::new(0.49, -HALF_SIDE, 0.49), Vec3::Y, 2.0);
        assert!(corner < middles[0] && corner > 0.1, "{corner} {middles:?}");
    }

    #[test]
    fn a_change_of_geometry_would_show() {
        let near = [shapes::floor(0.5), shapes::cube(Vec3::new(0.1, 0.15, 0.05), 0.15)];
        let (points, found) = traced(&near, POINTS_PER_M2, &settings(0.6, Occlusion::Obscurance)).unwrap();
        assert_eq!(points.total(), 64 + 6 * 8, "64 points a square metre, and 8 on each face of the cube");
        let [low, high] = [f32::min as fn(f32, f32) -> f32, f32::max]
            .map(|f| found.image.values().iter().copied().reduce(f).unwrap());
        assert!(low < 0.7 && high > 0.95, "{low} {high}");
    }
}
