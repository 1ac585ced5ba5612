//! The points of a set at rest, rounded and in the order of the wire.

use super::levels::{self, LevelPoint};
use super::model::curve;
use super::parents::ParentTable;
use super::{Levels, SetLayout};
use crate::hash::fold_words;
use crate::memory;
use crate::quant::oct;

/// A point of a mesh at rest, before rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestPoint {
    /// Position, metres, rest space.
    pub position: [f32; 3],
    /// Direction of the normal at rest, towards the side of the point; its length does not matter.
    pub normal: [f32; 3],
    /// Number of the [chart](super::Charts) of its surface; 0 where a set has one chart.
    pub chart: u32,
}

/// Digest of a geometry. Equal digests mean the same points in the same order. It detects mistakes, not forgery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct GeometryDigest(pub u64);

/// A point of a set on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct CodedPoint {
    pub(crate) coord: [u32; 3],
    pub(crate) normal: u16,
    pub(crate) chart: u32,
}

/// What orders the points of a level: the place on the curve, the normal and the chart.
pub(crate) type OrderKey = (u64, u16, u32);

impl CodedPoint {
    /// Returns what orders the points of a level.
    pub(crate) fn order_key(&self) -> OrderKey {
        (curve::place(self.coord), self.normal, self.chart)
    }
}

/// Why a geometry was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// There is no such set.
    #[error("the layout has no set {set}")]
    NoSet {
        /// The set.
        set: u32,
    },
    /// The points differ from those that the stream was made with.
    #[error(
        "set {set}: its points differ from the stream's; is this the scene that the stream was made from?"
    )]
    Other {
        /// The set.
        set: u32,
    },
}

/// The rounded points of a set, ordered by [level](Levels), then by their place on a space-filling curve, then by the code
/// of their normal, then by their chart.
///
/// Positions are rounded to the nearest node of the set's lattice, normals to the best of the four octahedral codes
/// around them.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    pub(crate) layout: SetLayout,
    pub(crate) coords: Vec<[u32; 3]>,
    pub(crate) normals: Vec<u16>,
    pub(crate) charts: Vec<u32>,
    pub(super) parents: ParentTable,
}

/// A [`Geometry`], the origin of its points, and what rounding lost.
#[derive(Debug, Clone, PartialEq)]
pub struct RoundedGeometry {
    /// The rounded points.
    pub geometry: Geometry,
    /// For each rounded point: the index of the given point.
    pub order: Vec<u32>,
    /// Number of points outside the lattice, which were moved onto its surface. NaN counts as outside.
    pub outside: u32,
}

impl Geometry {
    /// Returns the bytes in use, including the geometry itself.
    pub(super) fn heap_bytes(&self) -> usize {
        size_of::<Self>()
            + memory::list(&self.coords)
            + memory::list(&self.normals)
            + memory::list(&self.charts)
            + self.parents.heap_bytes()
    }

    /// Rounds points to the lattice of `layout` and orders them. The [`layout`](Geometry::layout) of the result has
    /// their number, levels and digest, whatever `layout` has. A chart beyond the layout's counts as its last one.
    #[must_use]
    pub fn round(layout: SetLayout, points: &[RestPoint]) -> RoundedGeometry {
        let mut outside = 0;
        let mut keyed: Vec<(OrderKey, u32, [u32; 3])> = Vec::with_capacity(points.len());
        for (point, index) in points.iter().zip(0..) {
            let (coord, inside) = layout.nearest(point.position);
            outside += u32::from(!inside);
            let normal = oct::encode_bits(layout.normal_bits.into(), point.normal);
            let chart = point.chart.min(layout.charts.saturating_sub(1));
            let point = CodedPoint { coord, normal, chart };
            keyed.push((point.order_key(), index, coord));
        }
        keyed.sort_unstable();
        let placed: Vec<LevelPoint> =
            keyed.iter().map(|(key, _, coord)| LevelPoint { coord: *coord, chart: key.2 }).collect();
        let (count, level) = levels::assign(&layout, &placed);
        let mut order: Vec<u32> = (0..keyed.len() as u32).collect();
        order.sort_by_key(|&at| level[at as usize]);
        let before = |end: u8| order.partition_point(|&at| level[at as usize] < end) as u32;
        let ends: Vec<u32> = (1..count).map(before).collect();
        let keyed: Vec<_> = order.iter().map(|&at| keyed[at as usize]).collect();
        let levels = Levels::from_ends(&ends).unwrap_or_default();
        let layout = SetLayout { points: keyed.len() as u32, levels, ..layout };
        let mut geometry = Geometry::ordered(
            layout,
            keyed.iter().map(|(.., coord)| *coord).collect(),
            keyed.iter().map(|(key, ..)| key.1).collect(),
            keyed.iter().map(|(key, ..)| key.2).collect(),
        );
        geometry.layout.digest = geometry.digest();
        RoundedGeometry { geometry, order: keyed.iter().map(|(_, index, _)| *index).collect(), outside }
    }

    /// Creates a geometry from points in any order within each level, as many as the layout has.
    pub(super) fn sorted(layout: SetLayout, points: &[CodedPoint]) -> Geometry {
        let mut keyed: Vec<(OrderKey, [u32; 3])> =
            points.iter().map(|point| (point.order_key(), point.coord)).collect();
        let mut rest = keyed.as_mut_slice();
        for points in layout.level_points() {
            let (level, after) = rest.split_at_mut(points.len().min(rest.len()));
            level.sort_unstable();
            rest = after;
        }
        Geometry::ordered(
            layout,
            keyed.iter().map(|(_, coord)| *coord).collect(),
            keyed.iter().map(|(key, _)| key.1).collect(),
            keyed.iter().map(|(key, _)| key.2).collect(),
        )
    }

    /// Creates a geometry from the parts of its points, in order.
    pub(crate) fn ordered(
        layout: SetLayout,
        coords: Vec<[u32; 3]>,
        normals: Vec<u16>,
        charts: Vec<u32>,
    ) -> Geometry {
        let parents = ParentTable::new(&layout, coords.len());
        Geometry { layout, coords, normals, charts, parents }
    }

    /// Returns the layout of the set.
    #[must_use]
    pub fn layout(&self) -> &SetLayout {
        &self.layout
    }

    /// Returns the number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.coords.len()
    }

    /// Returns whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.coords.is_empty()
    }

    /// Returns the position of a point, metres, rest space.
    #[inline]
    #[must_use]
    pub fn position(&self, point: usize) -> [f32; 3] {
        self.layout.position(self.coords[point])
    }

    /// Returns the lattice node of a point: its coordinates, 0 to the layout's extent.
    #[inline]
    #[must_use]
    pub fn node(&self, point: usize) -> [u32; 3] {
        self.coords[point]
    }

    /// Returns the octahedral code of a point's normal, twice the layout's `normal_bits` bits.
    #[inline]
    #[must_use]
    pub fn normal_code(&self, point: usize) -> u16 {
        self.normals[point]
    }

    /// Returns the number of the chart of a point, below the layout's `charts`.
    #[inline]
    #[must_use]
    pub fn chart(&self, point: usize) -> u32 {
        self.charts[point]
    }

    /// Returns the level of a point, 0 for the coarsest.
    #[inline]
    #[must_use]
    pub fn level(&self, point: usize) -> u8 {
        self.layout.levels.of_point(point as u32)
    }

    /// Returns the unit normal of a point, rest space.
    #[inline]
    #[must_use]
    pub fn normal(&self, point: usize) -> [f32; 3] {
        oct::decode_bits(self.layout.normal_bits.into(), self.normals[point])
    }

    /// Computes the digest.
    #[must_use]
    pub fn digest(&self) -> GeometryDigest {
        let SetLayout { normal_bits, step, charts, .. } = self.layout;
        let bits = [normal_bits.into(), step.to_bits(), self.len() as u32, charts];
        let start = fold_words(0, &bits);
        let start = fold_words(start, &self.layout.origin.map(f32::to_bits));
        let start = fold_words(start, self.layout.levels.ends());
        let points = self.coords.iter().zip(&self.normals).zip(&self.charts);
        GeometryDigest(points.fold(start, |digest, ((&[x, y, z], normal), chart)| {
            fold_words(digest, &[x, y, z, u32::from(*normal), *chart])
        }))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn layout() -> SetLayout {
        SetLayout {
            origin: [-1.0, 0.5, 10.0],
            step: 0.01,
            extent: [200, 100, 50],
            normal_bits: 6,
            points: 0,
            charts: 3,
            levels: Levels::default(),
            kernel_radius: 0.1,
            digest: GeometryDigest::default(),
        }
    }

    proptest! {
        #[test]
        fn positions_and_normals_are_off_by_no_more_than_is_stated(
            position in (-1.0_f32..=1.0, 0.5_f32..=1.5, 10.0_f32..=10.5).prop_map(<[f32; 3]>::from),
            normal in prop::array::uniform3(-1.0_f32..1.0),
        ) {
            let length = normal.iter().map(|axis| axis * axis).sum::<f32>().sqrt();
            prop_assume!(length > 1e-3);
            let rounded = Geometry::round(layout(), &[RestPoint { position, normal, chart: 2 }]);
            prop_assert_eq!(rounded.outside, 0);
            let found = rounded.geometry.position(0);
            for axis in 0..3 {
                prop_assert!((found[axis] - position[axis]).abs() <= layout().max_position_error());
            }
            let cosine: f32 = (0..3).map(|axis| rounded.geometry.normal(0)[axis] * normal[axis] / length).sum();
            let angle = cosine.clamp(-1.0, 1.0).acos().to_degrees();
            prop_assert!(angle <= oct::max_error_degrees(6) + 0.05, "{angle}");
        }

        #[test]
        fn the_order_is_that_of_the_curve_and_says_where_points_came_from(
            positions in prop::collection::vec(prop::array::uniform3(0.0_f32..0.5), 0..60),
        ) {
            let layout = SetLayout { origin: [0.0; 3], ..layout() };
            let points: Vec<RestPoint> =
                (0..).zip(&positions).map(|(n, &position)| RestPoint { position, normal: [0.0, 0.0, 1.0], chart: n % 3 }).collect();
            let RoundedGeometry { geometry, order, outside } = Geometry::round(layout, &points);
            prop_assert_eq!(outside, 0);
            for (at, index) in order.iter().enumerate() {
                prop_assert_eq!(geometry.coords[at], layout.nearest(positions[*index as usize]).0);
                prop_assert_eq!(geometry.chart(at), index % 3);
            }
            prop_assert!(geometry.coords.windows(2).all(|pair| curve::place(pair[0]) <= curve::place(pair[1])));
            let mut numbers = order.clone();
            numbers.sort_unstable();
            prop_assert!(numbers.into_iter().eq(0..points.len() as u32));
            let part = |at: usize| CodedPoint { coord: geometry.coords[at], normal: geometry.normals[at], chart: geometry.charts[at] };
            let parts: Vec<_> = (0..geometry.len()).rev().map(part).collect();
            prop_assert_eq!(Geometry::sorted(*geometry.layout(), &parts), geometry);
        }
    }

    #[test]
    fn points_outside_are_moved_onto_the_lattice_and_counted() {
        let at = |position| RestPoint { position, normal: [0.0, 1.0, 0.0], chart: 9 };
        let points =
            [at([-2.0, 0.6, 10.1]), at([f32::NAN, 0.6, 10.1]), at([0.0, 9.0, 10.1]), at([0.0, 0.6, 10.1])];
        let rounded = Geometry::round(layout(), &points);
        assert_eq!(rounded.outside, 3);
        assert_eq!(rounded.geometry.charts, [2; 4], "a chart beyond the last one");
        assert!(
            rounded
                .geometry
                .coords
                .iter()
                .all(|coord| (0..3).all(|axis| coord[axis] <= layout().extent[axis]))
        );
    }

    #[test]
    fn digests_tell_geometries_apart() {
        let at = |x: f32, normal| RestPoint { position: [x, 0.6, 10.1], normal, chart: 0 };
        let up = [0.0, 1.0, 0.0];
        let digest = |layout, points: &[RestPoint]| Geometry::round(layout, points).geometry.digest();
        let base = digest(layout(), &[at(0.1, up), at(0.2, up)]);
        assert_eq!(base, digest(layout(), &[at(0.2, up), at(0.1, up)]), "the order given does not matter");
        for other in [
            digest(layout(), &[at(0.1, up)]),
            digest(layout(), &[at(0.1, up), at(0.21, up)]),
            digest(layout(), &[at(0.1, up), at(0.2, [1.0, 0.0, 0.0])]),
            digest(SetLayout { step: 0.02, ..layout() }, &[at(0.1, up), at(0.2, up)]),
            digest(SetLayout { charts: 2, ..layout() }, &[at(0.1, up), at(0.2, up)]),
            digest(layout(), &[at(0.1, up), RestPoint { chart: 1, ..at(0.2, up) }]),
        ] {
            assert_ne!(base, other);
        }
    }
}
