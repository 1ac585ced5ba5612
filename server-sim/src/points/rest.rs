//! Points at rest: the geometry of streams of profile `surface`. A server and a client that is not sent the geometry
//! compute it identically.

use std::sync::Arc;

use psao_codec::surface::{
    Geometry, GeometryError, MAX_CHARTS, RestPoint, RoundedGeometry, SetLayout, State,
};
use psao_proto::SceneInfo;
use rayon::prelude::*;
use thiserror::Error;

use super::{PointError, PointSet, PointSettings, ScenePoints, SurfacePoint, generate};
use crate::scene::{PosedMesh, Scene};

/// Precision to which the points of a `surface` stream are rounded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometryPrecision {
    /// Lattice steps per Poisson-disk radius of the points.
    pub steps: f32,
    /// Bits of one axis of a normal's octahedral code, 2 to 8.
    pub normal_bits: u8,
}

impl GeometryPrecision {
    /// Returns the precision that corresponds to the 32, 24 or 16 bits of the paper's packed points, or `None` for
    /// other sizes.
    #[must_use]
    pub const fn of_bits(bits: u8) -> Option<Self> {
        match bits {
            32 => Some(Self { steps: 8.0, normal_bits: 6 }),
            24 => Some(Self { steps: 4.0, normal_bits: 5 }),
            16 => Some(Self { steps: 2.0, normal_bits: 4 }),
            _ => None,
        }
    }
}

/// Returns the positions and normals of a set's points on its mesh at rest, in the order of the set. `set` is also
/// the index of the mesh. The list is empty if there is no such mesh or set.
#[must_use]
pub fn rest_points(scene: &Scene, points: &ScenePoints, set: usize) -> Vec<RestPoint> {
    let (Some(rest), Some(set)) = (scene.rests().get(set), points.sets().get(set)) else { return Vec::new() };
    let (posed, charts) = (PosedMesh::at_rest(scene, rest), rest.charts());
    let place = |point: &SurfacePoint| {
        let placed = point.place_on(&posed);
        let chart = if point.back { charts.back(point.triangle) } else { charts.front(point.triangle) };
        RestPoint { position: placed.position.to_array(), normal: placed.normal.to_array(), chart }
    };
    set.points().iter().map(place).collect()
}

/// Returns the geometry of every set, rounded to `precision`, with kernels of `kernel` Poisson-disk radii. Reorders
/// the points of the scene like their geometry, so that a point has the same index in both.
#[must_use]
pub fn order_at_rest(
    scene: &Scene,
    points: &mut ScenePoints,
    precision: GeometryPrecision,
    kernel: f32,
) -> Vec<Arc<Geometry>> {
    let made: Vec<RoundedGeometry> = (0..points.sets().len())
        .into_par_iter()
        .map(|set| {
            let at_rest = rest_points(scene, points, set);
            let lattice = lattice(&points.sets()[set], &at_rest, precision, kernel);
            Geometry::round(SetLayout { charts: charts(scene, set), ..lattice }, &at_rest)
        })
        .collect();
    let mut geometry = Vec::with_capacity(made.len());
    for (set, made) in made.into_iter().enumerate() {
        points.reorder(set, &made.order, *made.geometry.layout());
        geometry.push(Arc::new(made.geometry));
    }
    geometry
}

/// Returns the number of charts of a mesh, at most as many as a set may have.
fn charts(scene: &Scene, set: usize) -> u32 {
    let rest = &scene.rests()[set];
    let mesh = &scene.meshes()[rest.mesh().index()];
    rest.charts().count(scene.material(mesh).double_sided()).min(MAX_CHARTS)
}

/// Reason why a client could not compute the points of a stream itself.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SharedGeometryError {
    /// The settings of the stream give no points.
    #[error("the stream's points cannot be computed: {0}")]
    Points(#[from] PointError),
    /// The number of meshes in the scene differs from the number of sets in the stream.
    #[error(
        "the scene has {meshes} meshes, but the stream has {sets} point sets: it belongs to another scene"
    )]
    Sets {
        /// Number of meshes in the scene.
        meshes: usize,
        /// Number of sets in the stream.
        sets: usize,
    },
    /// The stream lacks the settings of its points.
    #[error("the stream lacks the settings of its points, so they cannot be computed from the scene")]
    NoTrace,
    /// The computed points differ from those of the stream.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

/// Gives `state` the points of a stream that does not carry them. Generates them from the scene as the server did,
/// with the density, minimum and seed in `info`.
///
/// # Errors
/// Returns [`SharedGeometryError`] if the scene or the settings differ from those of the stream. Sets before the one
/// that the error names then already have their points.
pub fn make_shared_geometry(
    scene: &Scene,
    info: &SceneInfo,
    state: &mut State,
) -> Result<(), SharedGeometryError> {
    let layout = Arc::clone(state.layout());
    let (meshes, sets) = (scene.rests().len(), layout.sets().len());
    if meshes != sets {
        return Err(SharedGeometryError::Sets { meshes, sets });
    }
    let trace = info.trace.ok_or(SharedGeometryError::NoTrace)?;
    let settings = PointSettings { per_m2: trace.points_per_m2, minimum: trace.min_points, seed: trace.seed };
    let points = generate(scene, &settings, &|_, _| {})?;
    let geometry: Vec<Geometry> = layout
        .sets()
        .par_iter()
        .enumerate()
        .map(|(set, layout)| Geometry::round(*layout, &rest_points(scene, &points, set)).geometry)
        .collect();
    for (set, geometry) in (0..).zip(geometry) {
        state.share_geometry(set, Arc::new(geometry))?;
    }
    Ok(())
}

/// Returns the lattice of a set in the given precision. On a mesh that is very large for its number of points the
/// lattice is coarser: as fine as possible.
fn lattice(set: &PointSet, points: &[RestPoint], precision: GeometryPrecision, kernel: f32) -> SetLayout {
    let step = set.radius() / precision.steps;
    SetLayout::covering(points, step, precision.normal_bits, kernel * set.radius())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::{PointSettings, generate};

    fn points(scene: &Scene) -> ScenePoints {
        generate(scene, &PointSettings { per_m2: 4.0, minimum: 40, seed: 2 }, &|_, _| {}).unwrap()
    }

    #[test]
    fn ordering_moves_points_and_their_numbers_together() {
        let scene = Scene::load("colonnade").unwrap();
        let before = points(&scene);
        let mut after = before.clone();
        let geometry = order_at_rest(&scene, &mut after, GeometryPrecision::of_bits(32).unwrap(), 2.5);
        assert_eq!(after.offsets(), before.offsets());
        for (set, geometry) in geometry.iter().enumerate() {
            let (old, new) = (&before.sets()[set], &after.sets()[set]);
            assert_eq!(geometry.len(), new.points().len());
            let mut seen = vec![false; old.points().len()];
            for (point, &number) in new.points().iter().zip(new.numbers()) {
                assert_eq!(*point, old.points()[number as usize]);
                assert!(!std::mem::replace(&mut seen[number as usize], true), "number {number} twice");
            }
        }
    }

    #[test]
    fn a_geometry_holds_its_points_within_the_lattices_error() {
        let scene = Scene::load("robot-lab").unwrap();
        for bits in [16, 24, 32] {
            let mut points = points(&scene);
            let geometry = order_at_rest(&scene, &mut points, GeometryPrecision::of_bits(bits).unwrap(), 2.5);
            for (set, geometry) in geometry.iter().enumerate() {
                let error = geometry.layout().max_position_error();
                for (index, point) in rest_points(&scene, &points, set).iter().enumerate() {
                    let found = geometry.position(index);
                    let off =
                        (0..3).map(|axis| (found[axis] - point.position[axis]).abs()).fold(0.0, f32::max);
                    assert!(off <= error, "{bits} bits, set {set}, point {index}: {off} over {error}");
                }
            }
        }
    }

    #[test]
    fn lattices_of_meshes_without_points_or_of_any_size_make_sense() {
        let precision = GeometryPrecision::of_bits(32).unwrap();
        let set = PointSet { radius: 1e-6, ..PointSet::default() };
        let at = |x| RestPoint { position: [x, 0.0, 0.0], normal: [0.0, 1.0, 0.0], chart: 0 };
        for points in [&[][..], &[at(5.0)], &[at(-1e6), at(1e6)]] {
            let found = SetLayout { charts: 1, ..lattice(&set, points, precision, 2.5) };
            let limits = psao_codec::Limits::default();
            let members = vec![psao_codec::surface::Member { set: 0 }];
            psao_codec::surface::Layout::new(vec![found], members, &limits).unwrap();
        }
        assert_eq!(GeometryPrecision::of_bits(31), None);
    }
}
