//! Ambient occlusion of every fragment from points of the mesh at rest.

use glam::Vec3;
use psao_codec::surface::{PICTURE_ROWS, State};
use psao_proto::message::CameraPose;

use super::result::{ReconstructError, Reconstruction};
use super::walk::{check_instances, walk};
use crate::kernel::Support;
use crate::surface::{AoSource, PointCache, RestPlace, Sheet, SurfaceIndex, arrived_ao};
use crate::{AoSampler, GBuffer};

/// Reconstructs views of a stream of profile `surface` with an [`AoSampler`] that it keeps between frames.
#[derive(Clone, Debug, Default)]
pub struct SurfaceReconstructor {
    sampler: AoSampler,
    detail: Option<Detail>,
}

/// What a camera asks of the points.
#[derive(Clone, Copy, Debug)]
struct Detail {
    eye: Vec3,
    /// How far apart points should be for each metre of distance from the eye, metres.
    spacing_per_m: f32,
}

impl Detail {
    /// Returns how far apart points should be at a place of the world, metres.
    #[inline]
    fn spacing(&self, place: Vec3) -> f32 {
        self.spacing_per_m * self.eye.distance(place)
    }
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

    /// Sets the camera of the views that follow, and the quality of the stream (`TraceInfo::quality`): the distance of
    /// neighbouring points in pixels on a picture of 1,080 rows. The server keeps no finer points up to date.
    ///
    /// Without a camera, or with a quality of 0, all points that have arrived are taken.
    pub fn set_camera(&mut self, camera: &CameraPose, quality: f32) {
        let spacing_per_m = quality * 2.0 * (0.5 * camera.fov_y_deg.to_radians()).tan() / PICTURE_ROWS;
        self.detail = Some(Detail { eye: camera.eye.into(), spacing_per_m });
    }

    /// Returns the sampler. It is prepared for the sets of instances in the views so far.
    #[must_use]
    pub fn sampler(&self) -> &AoSampler {
        &self.sampler
    }

    /// Reconstructs the ambient occlusion of every fragment of `view` from the points of `state`.
    ///
    /// The camera chooses a level for each fragment ([`set_camera`](Self::set_camera)). Points of the fragment's chart up to
    /// that level count if they are within the level's radius `r` of its place at rest, and the cosine between both normals
    /// is above [`FACING_THRESHOLD`](crate::kernel::FACING_THRESHOLD). Of more than ten, the ten nearest count. The weight of
    /// a point at distance `d` is `(1 - d / r)^2`. The value is that of the weighted affine fit at the place, kept within
    /// half the points' range around that range.
    ///
    /// The next coarser level is taken where no point of the chosen level has arrived, or fewer than three points count.
    /// After the coarsest level, the six nearest points of the chart are taken. A fragment whose chart has no points is 1,
    /// as is background.
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
        check_rest(view)?;
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
            let (Some(index), Some(rest)) = (indices[instance as usize], view.at_rest(pixel)) else {
                return Support::NONE;
            };
            let spacing = self.detail.map_or(0.0, |detail| detail.spacing(view.position()[pixel]));
            let place = RestPlace { position: rest.position, normal: rest.normal, spacing };
            index.fit_near(ao, near, Sheet { instance, chart: rest.chart }, &place)
        }))
    }
}

/// Checks that every fragment has its place at rest.
fn check_rest(view: &GBuffer) -> Result<(), ReconstructError> {
    let instances = view.instance().iter();
    let mut shown = instances.enumerate().filter(|(_, instance)| **instance != GBuffer::NO_INSTANCE);
    match shown.find(|(pixel, _)| view.at_rest(*pixel).is_none()) {
        Some((pixel, _)) => Err(ReconstructError::NoRest { pixel }),
        None => Ok(()),
    }
}
