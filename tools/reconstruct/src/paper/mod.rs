//! The points of profile `paper`: cells in the current local space of an instance.

mod neighbourhood;

use glam::Vec3;
use psao_codec::paper::State;

pub(crate) use self::neighbourhood::{InstanceCells, NeighbourhoodCache};
use crate::kernel::{Accumulate, Blend, Mark, Pointwise, Query, Support};

impl InstanceCells {
    /// Returns a query in the local space of the instance.
    #[inline]
    pub(crate) fn query(&self, position: Vec3, normal: Vec3) -> Query {
        Query { position, normal, radius: self.kernel_radius() }
    }

    /// Blends the points around one place.
    pub(crate) fn blend_one(&self, state: &State, query: &Query) -> Support {
        let mut blend = Pointwise::<Blend>::new(query);
        if let Some(base) = self.base(query.position) {
            self.each_point(state, base, |position, normal, ao| blend.add(position, normal, ao, Mark::NONE));
        }
        blend.finish().support()
    }

    /// Does what [`blend_one`](Self::blend_one) does, with a cache of neighbourhoods.
    #[inline]
    pub(crate) fn blend_near(&self, state: &State, near: &mut NeighbourhoodCache, query: &Query) -> Support {
        let mut blend = Blend::new();
        if let Some(base) = self.base(query.position) {
            for group in near.of(state, self, base) {
                blend.add(group, query);
            }
        }
        blend.support()
    }
}
