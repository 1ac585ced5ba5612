//! Points on surfaces: an even spread over every mesh, made once (paper, section 3.1).

mod cache;
mod candidates;
mod eliminate;
mod generate;
mod ids;
mod place;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod reference;
mod rest;

use thiserror::Error;

pub use cache::{PointCache, PointCacheError, PointKey};
pub use eliminate::{eliminate, poisson_radius};
pub use generate::{generate, generate_cached};
pub use ids::{PointId, PointInSet, RayKey};
pub use place::PlacedPoint;
pub use rest::{GeometryPrecision, SharedGeometryError, make_shared_geometry, order_at_rest, rest_points};

/// Most points of a scene, all instances together.
pub const MAX_POINTS: u64 = 64 << 20;

/// A point on a mesh, as weights of a triangle's corners: it moves with the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Number of the triangle in the mesh.
    pub triangle: u32,
    /// Weights of the triangle's second and third corner; the first one has the rest to 1.
    pub bary: [f32; 2],
    /// On the back of a double-sided triangle: its normal is turned round.
    pub back: bool,
}

/// The points of one mesh at rest, shared by its instances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointSet {
    points: Vec<SurfacePoint>,
    numbers: Vec<u32>,
    radius: f32,
    area: f64,
}

impl PointSet {
    /// Returns the points, those of the front first; close in the list means close on the mesh, mostly.
    #[must_use]
    pub fn points(&self) -> &[SurfacePoint] {
        &self.points
    }

    /// Returns the number of every point in the order in which they were made. It stays with the point when the set
    /// is put into another order, and so do the rays that it chooses.
    #[must_use]
    pub fn numbers(&self) -> &[u32] {
        &self.numbers
    }

    /// Returns the largest possible Poisson-disk radius `r_max` of the points in metres: half the distance between
    /// neighbours in the densest packing of as many points on the same area. Positive.
    #[must_use]
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Returns the area that the points stand for in square metres: both sides where both have points, without
    /// masked-out parts.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area
    }
}

/// The points of a scene.
#[derive(Clone, Debug)]
pub struct ScenePoints {
    sets: Vec<PointSet>,
    offsets: Vec<u32>,
}

impl ScenePoints {
    /// Returns the point sets, in the order of the scene's meshes at rest.
    #[must_use]
    pub fn sets(&self) -> &[PointSet] {
        &self.sets
    }

    /// Returns the first point id of every instance in order, then the number of all points.
    #[must_use]
    pub fn offsets(&self) -> &[u32] {
        &self.offsets
    }

    /// Puts the points of a set into another order: `order` names, for each place, the point that goes there.
    pub(crate) fn reorder(&mut self, set: usize, order: &[u32]) {
        let set = &mut self.sets[set];
        set.points = order.iter().map(|&from| set.points[from as usize]).collect();
        set.numbers = order.iter().map(|&from| set.numbers[from as usize]).collect();
    }

    /// Returns the bytes of memory held.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        // Counted by length: how much room there is depends on whether the points come from a cache.
        let set = |set: &PointSet| size_of_val(set) + size_of_val(set.points()) + size_of_val(set.numbers());
        self.sets.iter().map(set).sum::<usize>() + size_of_val(self.offsets())
    }

    /// Returns the id of a point of an instance.
    pub(crate) fn id(&self, instance: usize, point: PointInSet) -> PointId {
        PointId(self.offsets[instance] + point.0)
    }

    /// Returns the ray key of a point of an instance, whose set is `set`.
    #[inline(always)]
    pub(crate) fn ray_key(&self, instance: usize, set: &PointSet, point: PointInSet) -> RayKey {
        RayKey(self.offsets[instance] + set.numbers[point.index()])
    }

    /// Returns the points of all instances together.
    #[must_use]
    pub fn total(&self) -> u32 {
        self.offsets.last().copied().unwrap_or(0)
    }
}

/// How many points there are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSettings {
    /// Points per square metre of surface, above 0 and finite.
    pub per_m2: f32,
    /// Fewest points of an instance, at least 1, however small it is; a double-sided one has half of them on each side.
    pub minimum: u32,
    /// Seed of the random candidates.
    pub seed: u64,
}

impl Default for PointSettings {
    /// 1,024 points per square metre and at least 1,024 an instance: the authors' own.
    fn default() -> Self {
        Self { per_m2: 1024.0, minimum: 1024, seed: 1 }
    }
}

/// Settings that make no points, or too many.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PointError {
    /// A density that is not a number of points.
    #[error("{per_m2} points per square metre: choose a finite number above 0")]
    Density {
        /// As given.
        per_m2: f32,
    },
    /// Instances without points.
    #[error("a minimum of 0 points an instance: choose 1 or more")]
    Minimum,
    /// More points than [`MAX_POINTS`].
    #[error("the scene would have {points:.0} points, at most {MAX_POINTS} are possible: lower the density")]
    TooMany {
        /// Points asked for.
        points: f64,
    },
}
