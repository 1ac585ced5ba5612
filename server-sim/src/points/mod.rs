//! Points on surfaces: an even distribution over every mesh, generated once (paper, section 3.1).

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

use psao_codec::setters;
use psao_codec::surface::SetLayout;
use thiserror::Error;

pub use cache::{PointCache, PointCacheError, PointKey};
pub use eliminate::{eliminate, poisson_radius};
pub use generate::{generate, generate_cached};
pub use ids::{PointId, PointInSet, RayKey};
pub use place::PlacedPoint;
pub use rest::{GeometryPrecision, SharedGeometryError, make_shared_geometry, order_at_rest, rest_points};

/// Largest number of points of a scene, all instances together.
pub const MAX_POINTS: u64 = 64 << 20;

/// A point on a mesh as barycentric weights of a triangle, so that it moves with the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Number of the triangle in the mesh.
    pub triangle: u32,
    /// Weights of the triangle's second and third corner. The three weights sum to 1.
    pub bary: [f32; 2],
    /// Whether the point is on the back of a double-sided triangle, with a reversed normal.
    pub back: bool,
}

/// The points of one mesh at rest, shared by its instances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointSet {
    points: Vec<SurfacePoint>,
    numbers: Vec<u32>,
    radius: f32,
    area: f64,
    at_rest: Option<SetLayout>,
}

impl PointSet {
    /// Returns the points, those of the front first. Points that are close in the list are mostly close on the mesh.
    #[must_use]
    pub fn points(&self) -> &[SurfacePoint] {
        &self.points
    }

    /// Returns the rank of every point in the order of creation. The rank stays with the point when the set is
    /// reordered, and so do the rays that it selects.
    #[must_use]
    pub fn numbers(&self) -> &[u32] {
        &self.numbers
    }

    /// Returns the largest possible Poisson-disk radius `r_max` of the points in metres; it is positive. It is half
    /// the distance between neighbours in the densest packing of equally many points on the same area.
    #[must_use]
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Returns the layout of the set in a stream of profile `surface`; `None` unless the points are in its order, see
    /// [`order_at_rest`].
    #[must_use]
    pub fn at_rest(&self) -> Option<&SetLayout> {
        self.at_rest.as_ref()
    }

    /// Returns the area in square metres that the points stand for. It counts both sides of a double-sided mesh and
    /// no masked-out parts.
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

    /// Returns the first point id of every instance, followed by the number of all points.
    #[must_use]
    pub fn offsets(&self) -> &[u32] {
        &self.offsets
    }

    /// Brings the points of a set into the order of a stream: `order` has, for each new place, the old place of its point.
    pub(crate) fn reorder(&mut self, set: usize, order: &[u32], layout: SetLayout) {
        let set = &mut self.sets[set];
        set.at_rest = Some(layout);
        set.points = order.iter().map(|&from| set.points[from as usize]).collect();
        set.numbers = order.iter().map(|&from| set.numbers[from as usize]).collect();
    }

    /// Returns the bytes of memory held.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        // Count lengths: the capacity depends on whether the points come from a cache.
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

    /// Returns the number of points of all instances together.
    #[must_use]
    pub fn total(&self) -> u32 {
        self.offsets.last().copied().unwrap_or(0)
    }
}

/// Density and number of points.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PointSettings {
    /// Points per square metre of surface, above 0 and finite.
    pub per_m2: f32,
    /// Fewest points of an instance, at least 1, whatever its size; a mask may leave fewer. A double-sided instance has
    /// half of them on each side.
    pub minimum: u32,
    /// Seed of the random candidates.
    pub seed: u64,
}

impl Default for PointSettings {
    /// The authors' values: 1,024 points per square metre and at least 1,024 per instance.
    fn default() -> Self {
        Self { per_m2: 1024.0, minimum: 1024, seed: 1 }
    }
}

impl PointSettings {
    setters! {
        const fn:
        with_per_m2: per_m2 as f32,
        with_minimum: minimum as u32,
        with_seed: seed as u64,
    }
}

/// Settings that give no points or too many.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PointError {
    /// The density is not a positive finite number.
    #[error("{per_m2} points per square metre: choose a finite number above 0")]
    Density {
        /// Density in the settings.
        per_m2: f32,
    },
    /// The minimum is 0 points per instance.
    #[error("a minimum of 0 points an instance: choose 1 or more")]
    Minimum,
    /// The scene would have more points than [`MAX_POINTS`].
    #[error("the scene would have {points:.0} points, at most {MAX_POINTS} are possible: lower the density")]
    TooMany {
        /// Number of points that the settings ask for.
        points: f64,
    },
}
