//! Ambient occlusion of every fragment from points of the mesh at rest (paper, section 3.5, Eq. 2 to 4, in rest space).
//!
//! In rest space nothing moves, whatever an instance does, and limbs that touch each other are as far apart as the mesh
//! was made. So where the points are is worked out once for each set ([`SurfaceIndex`]) and kept between frames.

mod index;
mod patches;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::Vec3;
use psao_codec::surface::{BLOCK_POINTS, Geometry, State};

pub use self::index::SurfaceIndex;
use self::patches::{Ao, Patches};
use super::blend::{Blend, Place};
use super::outcome::{ReconstructError, Reconstruction};
use super::walk::{check_instances, walk};
use crate::GBuffer;

/// Reconstructs frames of a stream of profile `surface`, and keeps between them what only geometry decides.
#[derive(Clone, Debug, Default)]
pub struct SurfaceReconstructor {
    /// By set.
    kept: Vec<Option<Kept>>,
}

/// An index, and the geometry that it was made of.
#[derive(Clone, Debug)]
struct Kept {
    geometry: Arc<Geometry>,
    index: SurfaceIndex,
}

/// [`SurfaceReconstructor::reconstruct`] for a single frame: nothing is kept.
///
/// # Errors
///
/// Those of [`SurfaceReconstructor::reconstruct`].
pub fn surface(state: &State, view: &GBuffer) -> Result<Reconstruction, ReconstructError> {
    SurfaceReconstructor::new().reconstruct(state, view)
}

impl SurfaceReconstructor {
    /// One that has seen nothing yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Reconstructs the ambient occlusion of every fragment of `view` from the points of `state`.
    ///
    /// For each fragment: the points of its instance within the kernel radius of its place at rest, all of them, are
    /// weighted by Eq. 2 and 3 ([`weight`](super::weight())) with its normal at rest; Eq. 4 is their weighted mean,
    /// or 1 if no weight is above 0. Background is 1. Points that have not come yet do not count, so that a first
    /// state can be looked at while it is coming; [`Statistics::unsupported`](super::Statistics::unsupported) says how
    /// much of the view has nothing yet.
    ///
    /// The first frame that shows a set makes its [`SurfaceIndex`]; so does one in which its geometry is another.
    /// Rows are spread over all cores; the result depends neither on how many there are nor on earlier frames.
    ///
    /// # Errors
    ///
    /// [`ReconstructError::Instance`] when a fragment shows an instance beyond the stream's layout,
    /// [`ReconstructError::NoRest`] when one does not say where it is at rest.
    pub fn reconstruct(&mut self, state: &State, view: &GBuffer) -> Result<Reconstruction, ReconstructError> {
        self.blend(state, view, &|instance, point| {
            let here = state.is_present(instance, point / BLOCK_POINTS);
            state.values(instance).get(point).copied().filter(|_| here)
        })
    }

    /// [`SurfaceReconstructor::reconstruct`] with AO from anywhere.
    fn blend(
        &mut self,
        state: &State,
        view: &GBuffer,
        ao: &impl Ao,
    ) -> Result<Reconstruction, ReconstructError> {
        let members = state.layout().members();
        check_instances(view, members.len())?;
        let (positions, normals) = rest_planes(view)?;
        self.index(state, view);
        let indices: Vec<Option<&SurfaceIndex>> =
            members.iter().map(|member| self.kept_index(member.set)).collect();
        Ok(walk(view, Patches::new, |patches, pixel, instance| {
            let mut blend = Blend::new();
            let Some(index) = indices[instance as usize] else { return blend };
            let place =
                Place { position: positions[pixel], normal: normals[pixel], radius: index.kernel_radius() };
            if let Some(patch) = index.patch(place.position) {
                for group in patches.of(ao, index, instance, patch) {
                    blend.add(group, &place);
                }
            }
            blend
        }))
    }

    /// The index of a set; `None` until a frame showed it with its geometry.
    fn kept_index(&self, set: u32) -> Option<&SurfaceIndex> {
        self.kept.get(set as usize)?.as_ref().map(|kept| &kept.index)
    }

    /// Makes the indices that are missing or out of date of the sets that `view` shows.
    fn index(&mut self, state: &State, view: &GBuffer) {
        let layout = state.layout();
        let mut shown = vec![false; layout.sets().len()];
        for &instance in view.instance() {
            if let Some(member) = layout.members().get(instance as usize) {
                shown[member.set as usize] = true;
            }
        }
        self.kept.resize_with(shown.len(), || None);
        for ((kept, shown), set) in self.kept.iter_mut().zip(shown).zip(0_u32..) {
            let geometry = state.geometry(set);
            let current = kept.as_ref().map(|kept| &kept.geometry);
            if current.zip(geometry).is_some_and(|(kept, now)| Arc::ptr_eq(kept, now)) {
                continue;
            }
            *kept = geometry
                .filter(|_| shown)
                .map(|geometry| Kept { geometry: Arc::clone(geometry), index: SurfaceIndex::new(geometry) });
        }
    }
}

/// Positions and normals at rest, checked to be there for every fragment.
fn rest_planes(view: &GBuffer) -> Result<(&[Vec3], &[Vec3]), ReconstructError> {
    let instances = view.instance().iter();
    let mut shown = instances.enumerate().filter(|(_, instance)| **instance != GBuffer::NO_INSTANCE);
    match shown.find(|(pixel, _)| view.at_rest(*pixel).is_none()) {
        Some((pixel, _)) => Err(ReconstructError::NoRest { pixel }),
        None => Ok((view.rest_position().unwrap_or_default(), view.rest_normal().unwrap_or_default())),
    }
}
