//! The points of profile `surface`: on the mesh at rest, where nothing moves.
//!
//! In rest space, limbs that touch each other stay as far apart as in the modelled mesh, whatever an instance does. So
//! each set needs one index of its points ([`SurfaceIndex`]), which is kept between frames ([`SetIndices`]).

mod index;
mod point_cache;

use std::sync::Arc;

use glam::Vec3;
use psao_codec::surface::{BLOCK_POINTS, Geometry, State};

pub use self::index::SurfaceIndex;
use self::point_cache::each_near;
pub(crate) use self::point_cache::{AoSource, PointCache};
use crate::kernel::{Blend, PointwiseBlend, Query};

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

/// Returns the AO source of a state.
pub(crate) fn arrived_ao(state: &State) -> impl AoSource {
    |instance, point| {
        let here = state.is_present(instance, point / BLOCK_POINTS);
        state.values(instance).get(point).copied().filter(|_| here)
    }
}

impl SurfaceIndex {
    /// Returns a query in rest space.
    #[inline]
    pub(crate) fn query(&self, position: Vec3, normal: Vec3) -> Query {
        Query { position, normal, radius: self.kernel_radius() }
    }

    /// Blends the points of an instance around one place.
    pub(crate) fn blend_one(&self, ao: &impl AoSource, instance: u32, query: &Query) -> Blend {
        let mut blend = PointwiseBlend::new(query);
        if let Some(octant) = self.octant(query.position) {
            each_near(ao, self, instance, octant, |point, ao| blend.add(point.position, point.normal, ao));
        }
        blend.finish()
    }

    /// Does what [`blend_one`](Self::blend_one) does, with a cache of points.
    #[inline]
    pub(crate) fn blend_near(
        &self,
        ao: &impl AoSource,
        near: &mut PointCache,
        instance: u32,
        query: &Query,
    ) -> Blend {
        let mut blend = Blend::new();
        if let Some(octant) = self.octant(query.position) {
            for group in near.of(ao, self, instance, octant) {
                blend.add(group, query);
            }
        }
        blend
    }
}
