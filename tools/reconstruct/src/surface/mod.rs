//! The points of profile `surface`: on the mesh at rest, where nothing moves.
//!
//! In rest space, limbs that touch each other stay as far apart as in the modelled mesh, whatever an instance does. So
//! each set needs one index of its points ([`SurfaceIndex`]), which is kept between frames ([`SetIndices`]).

mod chart_tree;
mod index;
mod point_cache;

use std::sync::Arc;

use glam::Vec3;
use psao_codec::surface::{BLOCK_POINTS, Geometry, NO_VALUE, State};

use self::index::IndexPoint;
pub use self::index::SurfaceIndex;
pub(crate) use self::point_cache::{AoSource, PointCache, Sheet};
use self::point_cache::{accessibility, each_near};
use crate::kernel::{Accumulate, FEWEST_POINTS, Fit, FitQuery, Pointwise, Support};

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

/// Returns the AO source of a state: the bytes that have arrived, but for points without a value.
pub(crate) fn arrived_ao(state: &State) -> impl AoSource {
    |instance, point| {
        let here = state.is_present(instance, point / BLOCK_POINTS);
        state.values(instance).get(point).copied().filter(|&ao| here && ao != NO_VALUE)
    }
}

impl SurfaceIndex {
    /// Fits the points of a chart around one place.
    pub(crate) fn fit_one(&self, ao: &impl AoSource, sheet: Sheet, position: Vec3, normal: Vec3) -> Support {
        let query = FitQuery::new(position, normal, self.kernel_radius());
        let mut fit = Pointwise::<Fit>::new(&query);
        let Some(octant) = self.octant(position) else { return Support::NONE };
        each_near(ao, self, sheet, octant, |point, ao| fit.add(point.position, point.normal, ao));
        self.support(ao, sheet, &query, &fit.finish())
    }

    /// Does what [`fit_one`](Self::fit_one) does, with a cache of points.
    #[inline]
    pub(crate) fn fit_near(
        &self,
        ao: &impl AoSource,
        near: &mut PointCache,
        sheet: Sheet,
        position: Vec3,
        normal: Vec3,
    ) -> Support {
        let query = FitQuery::new(position, normal, self.kernel_radius());
        let Some(octant) = self.octant(position) else { return Support::NONE };
        let mut fit = Fit::new();
        for group in near.of(ao, self, sheet, octant) {
            fit.add(group, &query);
        }
        self.support(ao, sheet, &query, &fit)
    }

    /// Returns the value of a fit; where it has too few points, that of the nearest points of the chart.
    #[inline]
    fn support(&self, ao: &impl AoSource, sheet: Sheet, query: &FitQuery, fit: &Fit) -> Support {
        if fit.count() >= FEWEST_POINTS {
            fit.support(query.radius)
        } else {
            self.fit_nearest(ao, sheet, query)
        }
    }

    /// Fits the nearest points of a chart, however far they are.
    fn fit_nearest(&self, ao: &impl AoSource, sheet: Sheet, query: &FitQuery) -> Support {
        let arrived = |point: &IndexPoint| ao(sheet.instance, point.point as usize);
        let nearest = self.nearest(sheet.chart, query.position, |point| arrived(point).is_some());
        let (points, farthest) = nearest.points();
        // The farthest point counts, too: its weight is a twenty-fifth of that of a point at the place.
        let query = query.within((1.25 * farthest).max(query.radius));
        let mut fit = Pointwise::<Fit>::new(&query);
        for point in points.map(|at| self.point(at)) {
            if let Some(ao) = arrived(point) {
                fit.add(point.position, point.normal, accessibility(ao));
            }
        }
        fit.finish().support(query.radius)
    }
}
