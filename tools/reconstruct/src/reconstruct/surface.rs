//! Ambient occlusion of every fragment from points of the mesh at rest (paper, section 3.5, Eq. 2 to 4, in rest space).

use glam::Vec3;
use psao_codec::surface::State;

use super::result::{ReconstructError, Reconstruction};
use super::walk::{check_instances, walk};
use crate::kernel::Blend;
use crate::surface::{AoSource, PointCache, SurfaceIndex, arrived_ao};
use crate::{AoSampler, GBuffer};

/// Reconstructs views of a stream of profile `surface` with an [`AoSampler`] that it keeps between frames.
#[derive(Clone, Debug, Default)]
pub struct SurfaceReconstructor {
    sampler: AoSampler,
}

/// Reconstructs a single view as [`SurfaceReconstructor::reconstruct`] does, and keeps nothing.
///
/// # Errors
///
/// Those of [`SurfaceReconstructor::reconstruct`].
pub fn surface(state: &State, view: &GBuffer) -> Result<Reconstruction, ReconstructError> {
    SurfaceReconstructor::new().reconstruct(state, view)
}

impl SurfaceReconstructor {
    /// Makes a reconstructor without indices.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the sampler. It is prepared for the sets of instances in the views so far.
    #[must_use]
    pub fn sampler(&self) -> &AoSampler {
        &self.sampler
    }

    /// Reconstructs the ambient occlusion of every fragment of `view` from the points of `state`.
    ///
    /// All points of the fragment's instance within the kernel radius of its place at rest count. Their weights are
    /// those of Eq. 2 and 3 ([`weight`](crate::kernel::weight())), with the fragment's normal at rest. The fragment's
    /// value is their weighted mean (Eq. 4), or 1 if no weight is above 0. Background is 1.
    ///
    /// Points that have not arrived yet do not count, so that a client can show a first state while it arrives.
    /// [`Statistics::unsupported`](super::Statistics::unsupported) counts the fragments that have no points.
    ///
    /// The first view that shows a set makes its [`SurfaceIndex`](crate::SurfaceIndex), as does the first view after
    /// its geometry changed. The feature `rayon` spreads rows over all cores. The result depends neither on their
    /// number nor on earlier frames.
    ///
    /// # Errors
    ///
    /// [`ReconstructError::Instance`] when a fragment shows an instance beyond the stream's layout,
    /// [`ReconstructError::NoRest`] when a fragment lacks its place at rest.
    pub fn reconstruct(&mut self, state: &State, view: &GBuffer) -> Result<Reconstruction, ReconstructError> {
        self.blend(state, view, &arrived_ao(state))
    }

    /// Reconstructs a view with the AO of `ao` instead of the state's.
    pub(super) fn blend(
        &mut self,
        state: &State,
        view: &GBuffer,
        ao: &impl AoSource,
    ) -> Result<Reconstruction, ReconstructError> {
        let instances = state.layout().members().len();
        check_instances(view, instances)?;
        let (positions, normals) = rest_planes(view)?;
        let mut shown = vec![false; state.layout().sets().len()];
        for &instance in view.instance() {
            if let Some(member) = state.layout().members().get(instance as usize) {
                shown[member.set as usize] = true;
            }
        }
        self.sampler.indices.prepare(state, |set| shown[set]);
        let indices: Vec<Option<&SurfaceIndex>> =
            (0..instances as u32).map(|instance| self.sampler.indices.of(state, instance)).collect();
        Ok(walk(view, PointCache::new, |near, pixel, instance| {
            let Some(index) = indices[instance as usize] else { return Blend::new() };
            index.blend_near(ao, near, instance, &index.query(positions[pixel], normals[pixel]))
        }))
    }
}

/// Returns the positions and normals at rest after checking that every fragment has them.
fn rest_planes(view: &GBuffer) -> Result<(&[Vec3], &[Vec3]), ReconstructError> {
    let instances = view.instance().iter();
    let mut shown = instances.enumerate().filter(|(_, instance)| **instance != GBuffer::NO_INSTANCE);
    match shown.find(|(pixel, _)| view.at_rest(*pixel).is_none()) {
        Some((pixel, _)) => Err(ReconstructError::NoRest { pixel }),
        None => Ok((view.rest_position().unwrap_or_default(), view.rest_normal().unwrap_or_default())),
    }
}
