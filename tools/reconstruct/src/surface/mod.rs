//! The points of profile `surface`: on the mesh at rest, where nothing moves.
//!
//! In rest space, limbs that touch each other stay as far apart as in the modelled mesh, whatever an instance does. So
//! each set needs one index of its points ([`SurfaceIndex`]), which is kept between frames ([`SetIndices`]).

mod chart_tree;
mod grid;
mod index;
mod point_cache;

use std::sync::Arc;

use glam::Vec3;
use psao_codec::surface::{BLOCK_POINTS, Geometry, NO_VALUE, State};

use self::grid::IndexPoint;
use self::grid::Octant;
pub use self::index::SurfaceIndex;
pub(crate) use self::point_cache::{AoSource, PointCache, Sheet};
use self::point_cache::{accessibility, each_near};
use crate::kernel::{
    Accumulate, FEWEST_POINTS, Fit, FitQuery, MOST_POINTS, Mark, NearestSquares, Pointwise, Support,
};

/// The indices of a stream's sets. Each lives as long as its geometry.
#[derive(Clone, Debug, Default)]
pub(crate) struct SetIndices {
    by_set: Vec<Option<IndexedSet>>,
}

/// An index and its geometry.
#[derive(Clone, Debug)]
struct IndexedSet {
    geometry: Arc<Geometry>,
    index: SurfaceIndex,
}

impl SetIndices {
    /// Makes missing and outdated indices of the sets for which `wanted` is true, and drops those of removed geometry.
    pub(crate) fn prepare(&mut self, state: &State, wanted: impl Fn(usize) -> bool) {
        self.by_set.resize_with(state.layout().sets().len(), || None);
        for (set, kept) in self.by_set.iter_mut().enumerate() {
            let geometry = state.geometry(set as u32);
            let current = kept.as_ref().map(|kept| &kept.geometry);
            if current.zip(geometry).is_some_and(|(kept, now)| Arc::ptr_eq(kept, now)) {
                continue;
            }
            *kept = geometry.filter(|_| wanted(set)).map(|geometry| IndexedSet {
                geometry: Arc::clone(geometry),
                index: SurfaceIndex::new(geometry),
            });
        }
    }

    /// Returns the index of an instance's set; `None` unless its geometry is that of `state`.
    pub(crate) fn of(&self, state: &State, instance: u32) -> Option<&SurfaceIndex> {
        let set = state.layout().members().get(instance as usize)?.set;
        let kept = self.by_set.get(set as usize)?.as_ref()?;
        state.geometry(set).is_some_and(|now| Arc::ptr_eq(&kept.geometry, now)).then_some(&kept.index)
    }

    /// Returns the size of the indices on the heap in bytes.
    pub(crate) fn heap_bytes(&self) -> usize {
        self.by_set.iter().flatten().map(|kept| kept.index.heap_bytes()).sum()
    }

    /// Returns for each set the geometry of its index.
    #[cfg(all(test, feature = "view"))]
    pub(crate) fn geometries(&self) -> Vec<Option<*const Geometry>> {
        self.by_set.iter().map(|kept| kept.as_ref().map(|kept| Arc::as_ptr(&kept.geometry))).collect()
    }
}

/// Returns the AO source of a state: the bytes that have arrived.
pub(crate) fn arrived_ao(state: &State) -> impl AoSource {
    |instance, point| {
        let here = state.is_present(instance, point / BLOCK_POINTS);
        state.values(instance).get(point).copied().filter(|_| here)
    }
}

/// A place at rest, and how far apart points around it should be, metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RestPlace {
    pub(crate) position: Vec3,
    pub(crate) normal: Vec3,
    pub(crate) spacing: f32,
}

/// The points around places of a chart.
trait Neighbourhood {
    /// Returns the sums over the points up to a level that may be near an octant.
    fn sum<A: Accumulate<Query = FitQuery>>(&mut self, level: u8, octant: Octant, query: &FitQuery) -> A;
}

/// The points themselves.
struct Plain<'a, S: AoSource> {
    index: &'a SurfaceIndex,
    ao: &'a S,
    sheet: Sheet,
}

impl<S: AoSource> Neighbourhood for Plain<'_, S> {
    fn sum<A: Accumulate<Query = FitQuery>>(&mut self, level: u8, octant: Octant, query: &FitQuery) -> A {
        let mut sums = Pointwise::<A>::new(query);
        each_near(self.ao, self.index.grid(level), self.sheet, octant, |point, ao, mark| {
            sums.add(point.position, point.normal, ao, mark);
        });
        sums.finish()
    }
}

/// The points in a cache.
struct Cached<'a, S: AoSource> {
    points: Plain<'a, S>,
    cache: &'a mut PointCache,
}

impl<S: AoSource> Neighbourhood for Cached<'_, S> {
    #[inline]
    fn sum<A: Accumulate<Query = FitQuery>>(&mut self, level: u8, octant: Octant, query: &FitQuery) -> A {
        let Plain { index, ao, sheet } = self.points;
        let mut sums = A::new();
        for group in self.cache.of(ao, index.grid(level), (level, sheet), octant) {
            sums.add(group, query);
        }
        sums
    }
}

impl SurfaceIndex {
    /// Fits the points of a chart around one place.
    pub(crate) fn fit_one(&self, ao: &impl AoSource, sheet: Sheet, place: &RestPlace) -> Support {
        self.fit(ao, sheet, place, &mut Plain { index: self, ao, sheet })
    }

    /// Does what [`fit_one`](Self::fit_one) does, with a cache of points.
    #[inline]
    pub(crate) fn fit_near(
        &self,
        ao: &impl AoSource,
        cache: &mut PointCache,
        sheet: Sheet,
        place: &RestPlace,
    ) -> Support {
        self.fit(ao, sheet, place, &mut Cached { points: Plain { index: self, ao, sheet }, cache })
    }

    /// Fits the points around a place at the level that it asks for. Where none of that level has arrived but some should, or
    /// fewer than three points count, the next coarser level is taken; after the coarsest, the nearest points of the chart.
    #[inline]
    fn fit(
        &self,
        ao: &impl AoSource,
        sheet: Sheet,
        place: &RestPlace,
        points: &mut impl Neighbourhood,
    ) -> Support {
        let wanted = self.level_within(place.spacing);
        for level in (0..=wanted).rev() {
            let grid = self.grid(level);
            let query = FitQuery::new(place.position, place.normal, grid.radius());
            let Some(octant) = grid.octant(place.position) else { return Support::NONE };
            let fit: Fit = points.sum(level, octant, &query);
            if fit.count() < FEWEST_POINTS || level > 0 && !fit.is_complete() {
                continue;
            }
            if fit.count() as usize > MOST_POINTS {
                let narrowed = points.sum::<NearestSquares>(level, octant, &query).narrowed(&query);
                let fit: Fit = points.sum(level, octant, &narrowed);
                // Of points that are all as far, none is nearer than the others.
                if fit.count() >= FEWEST_POINTS {
                    return fit.support(narrowed.radius);
                }
            }
            return fit.support(query.radius);
        }
        self.fit_nearest(ao, (sheet, wanted), place)
    }

    /// Fits the nearest points of a chart, however far they are.
    fn fit_nearest(&self, ao: &impl AoSource, (sheet, level): (Sheet, u8), place: &RestPlace) -> Support {
        let with_value =
            |point: &IndexPoint| ao(sheet.instance, point.point as usize).filter(|&ao| ao != NO_VALUE);
        let nearest = self.nearest((sheet.chart, level), place.position, |point| with_value(point).is_some());
        let (points, farthest) = nearest.points();
        // The farthest point counts, too: its weight is a twenty-fifth of that of a point at the place.
        let query = FitQuery::new(place.position, place.normal, self.grid(level).radius());
        let query = query.within((1.25 * farthest).max(query.radius));
        let mut fit = Pointwise::<Fit>::new(&query);
        for point in points.map(|at| self.point(at)) {
            if let Some(ao) = with_value(point) {
                fit.add(point.position, point.normal, accessibility(ao), Mark::NONE);
            }
        }
        fit.finish().support(query.radius)
    }
}
