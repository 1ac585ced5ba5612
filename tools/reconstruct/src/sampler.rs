//! Ambient occlusion at any place of a surface.

use glam::Vec3;
use psao_codec::StateRef;
use psao_codec::paper;
use psao_codec::surface;

use crate::paper::{InstanceCells, NeighbourhoodCache};
use crate::parallel;
use crate::surface::{PointCache, RestPlace, SetIndices, Sheet, arrived_ao};

/// Number of places in one chunk of [`AoSampler::ao_many`]. The places of a chunk share a cache of points.
const PLACES_PER_CHUNK: usize = 1024;

/// A place of a surface, in the space of the profile's points:
///
/// | profile | position and normal |
/// |---|---|
/// | `surface` | on the mesh at rest, before skinning, morphing and any transform: plain vertex attributes |
/// | `paper` | in the instance's local space in its current pose. For an instance that only moves rigidly, that is the mesh at rest, too; for one that deforms, the deformed vertex before the instance's rigid transform |
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Place {
    /// Metres.
    pub position: [f32; 3],
    /// Unit normal.
    pub normal: [f32; 3],
    /// Number of the [chart](psao_codec::surface::Charts) of the place's triangle and side; profile `paper` has none and
    /// ignores it.
    pub chart: u32,
    /// How far apart points around the place should be at most, metres: the size of some pixels there. With 0, all points that
    /// have arrived are taken; of those far from all cameras, the finest may be out of date. Profile `paper` ignores it.
    pub spacing: f32,
}

/// Blends points into the accessibility of places: vertices, texels of a light map, fragments of a renderer.
///
/// Profile `surface` fits an affine function to the points of the place's own chart (see [`Place`]). Profile `paper` takes the
/// weighted mean of the paper, section 3.5.
///
/// [`prepare`](Self::prepare) makes an index for each set of points of profile `surface`, once for each geometry.
/// [`ao`](Self::ao) and [`ao_many`](Self::ao_many) then take `&self`, so any number of threads may call them. The
/// results are bit-identical to those of `reconstruct::SurfaceReconstructor` and `reconstruct::cells`.
///
/// ```
/// # use std::sync::Arc;
/// # use psao_codec::Limits;
/// # use psao_codec::surface::{Geometry, GeometryDigest, Layout, Levels, Member, RestPoint, RoundedGeometry, SetLayout, State};
/// use psao_reconstruct::{AoSampler, Place};
///
/// # let set = SetLayout {
/// #     origin: [0.0; 3], step: 1.0 / 1024.0, extent: [1024; 3], normal_bits: 4, charts: 1, levels: Levels::default(), kernel_radius: 0.1,
/// #     points: 0, digest: GeometryDigest::default(),
/// # };
/// # let points: Vec<_> = (0..16_u8)
/// #     .map(|point| RestPoint { position: [(f32::from(point) + 0.5) / 16.0, 0.0, 0.0], normal: [0.0, 1.0, 0.0], chart: 0 })
/// #     .collect();
/// # let RoundedGeometry { geometry, order, .. } = Geometry::round(set, &points);
/// # let values: Vec<u8> = order.iter().map(|&point| if point < 8 { 51 } else { 255 }).collect();
/// # let layout = Layout::new(vec![*geometry.layout()], vec![Member { set: 0 }], &Limits::default())?;
/// # let state = State::from_parts(Arc::new(layout), vec![Arc::new(geometry)], &values);
/// let mut sampler = AoSampler::new();
/// sampler.prepare(&state); // after every frame; cheap unless new geometry arrived
/// let place = Place { position: [0.1, 0.0, 0.0], normal: [0.0, 1.0, 0.0], chart: 0, spacing: 0.0 };
/// let dark = sampler.ao(&state, 0, &place);
/// assert!(dark.is_some_and(|ao| (ao - 0.2).abs() < 1e-6));
/// assert_eq!(sampler.ao(&state, 0, &Place { chart: 7, ..place }), None, "the chart has no points");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct AoSampler {
    pub(crate) indices: SetIndices,
}

/// Input that [`AoSampler::ao_many`] refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SampleError {
    /// The slices differ in length.
    #[error("{places} places and room for {out} values were given; give as many of each")]
    Lengths {
        /// Number of places.
        places: usize,
        /// Number of values that `out` has room for.
        out: usize,
    },
    /// The stream does not have the instance.
    #[error(
        "instance {instance} was asked for, but the stream has {instances} instances; use the scene from which the stream was made"
    )]
    Instance {
        /// The requested instance.
        instance: u32,
        /// Number of instances of the stream's layout.
        instances: usize,
    },
}

impl AoSampler {
    /// Makes a sampler without indices.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Indexes the sets of points whose geometry arrived since the last call, and drops indices of removed geometry.
    ///
    /// Call it after each applied frame. Without new geometry it compares one pointer for each set. Making an index
    /// takes O(n log n) time and some 40 to 80 bytes a point. A stream of profile `paper` needs no index.
    pub fn prepare<'a>(&mut self, state: impl Into<StateRef<'a>>) {
        match state.into() {
            StateRef::Surface(state) => self.indices.prepare(state, |_| true),
            StateRef::Paper(_) => self.indices = SetIndices::default(),
        }
    }

    /// Returns the accessibility at a place of an instance, in `[0, 1]`; 1 is open.
    ///
    /// Profile `surface`: the value of a weighted affine fit over the points of the place's chart within the radius of the
    /// level that the place asks for, or of the next coarser one where points have not arrived or fewer than three are within
    /// it, or over the nearest six of the chart. Profile `paper`: the weighted mean
    /// of Eq. 4 over the points around the place. The function allocates nothing.
    ///
    /// It returns `None` when no point supports the place:
    ///
    /// * The chart has no point with a value; in profile `paper`, no point has a weight above 0. Eq. 4 calls such a place
    ///   open.
    /// * The points have yet to arrive, or their geometry arrived after the last [`prepare`](Self::prepare).
    /// * The stream lacks the instance.
    #[must_use]
    pub fn ao<'a>(&self, state: impl Into<StateRef<'a>>, instance: u32, place: &Place) -> Option<f32> {
        match state.into() {
            StateRef::Surface(state) => {
                let index = self.indices.of(state, instance)?;
                let sheet = Sheet { instance, chart: place.chart };
                index.fit_one(&arrived_ao(state), sheet, &place.at_rest()).ao
            }
            StateRef::Paper(state) => {
                let cells = InstanceCells::of(state, instance)?;
                let (position, normal) = place.vectors();
                cells.blend_one(state, &cells.query(position, normal)).ao
            }
        }
    }

    /// Writes the accessibility at many places of an instance to `out`, for each the result of [`ao`](Self::ao).
    ///
    /// Places near each other in the slices share work; vertices of a mesh mostly are near each other. The feature
    /// `rayon` uses all cores and does not change the values.
    ///
    /// # Errors
    ///
    /// [`SampleError`] when the slices differ in length, or the stream does not have the instance. `out` is then
    /// unchanged.
    pub fn ao_many<'a>(
        &self,
        state: impl Into<StateRef<'a>>,
        instance: u32,
        places: &[Place],
        out: &mut [Option<f32>],
    ) -> Result<(), SampleError> {
        if places.len() != out.len() {
            return Err(SampleError::Lengths { places: places.len(), out: out.len() });
        }
        match state.into() {
            StateRef::Surface(state) => self.many_at_rest(state, instance, places, out),
            StateRef::Paper(state) => many_in_cells(state, instance, places, out),
        }
    }

    /// Returns the size of the indices on the heap in bytes.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        self.indices.heap_bytes()
    }

    fn many_at_rest(
        &self,
        state: &surface::State,
        instance: u32,
        places: &[Place],
        out: &mut [Option<f32>],
    ) -> Result<(), SampleError> {
        let instances = state.layout().members().len();
        check_instance(instance, instances)?;
        let Some(index) = self.indices.of(state, instance) else {
            out.fill(None);
            return Ok(());
        };
        let ao = arrived_ao(state);
        parallel::chunks(out, PLACES_PER_CHUNK, |chunk, out| {
            let mut near = PointCache::new();
            for (place, out) in places[chunk * PLACES_PER_CHUNK..].iter().zip(out) {
                let sheet = Sheet { instance, chart: place.chart };
                *out = index.fit_near(&ao, &mut near, sheet, &place.at_rest()).ao;
            }
        });
        Ok(())
    }
}

fn many_in_cells(
    state: &paper::State,
    instance: u32,
    places: &[Place],
    out: &mut [Option<f32>],
) -> Result<(), SampleError> {
    let instances = state.layout().instances().len();
    let Some(cells) = InstanceCells::of(state, instance) else {
        return Err(SampleError::Instance { instance, instances });
    };
    parallel::chunks(out, PLACES_PER_CHUNK, |chunk, out| {
        let mut near = NeighbourhoodCache::new();
        for (place, out) in places[chunk * PLACES_PER_CHUNK..].iter().zip(out) {
            let (position, normal) = place.vectors();
            *out = cells.blend_near(state, &mut near, &cells.query(position, normal)).ao;
        }
    });
    Ok(())
}

fn check_instance(instance: u32, instances: usize) -> Result<(), SampleError> {
    if (instance as usize) < instances { Ok(()) } else { Err(SampleError::Instance { instance, instances }) }
}

impl Place {
    /// Returns the place for an index.
    fn at_rest(&self) -> RestPlace {
        let (position, normal) = self.vectors();
        RestPlace { position, normal, spacing: self.spacing }
    }

    /// Returns position and normal.
    fn vectors(&self) -> (Vec3, Vec3) {
        (self.position.into(), self.normal.into())
    }
}

#[cfg(test)]
mod tests;
